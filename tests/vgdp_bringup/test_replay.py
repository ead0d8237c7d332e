"""Making maps and plans of a bag again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from tests.vgdp_bringup.simulated import SimulatedRobot
from tests.vgdp_bringup.synthetic import SECOND, STORE

from vgdp_bringup.cli import main
from vgdp_bringup.recorder import BagRecorder
from vgdp_bringup.replay import replay_map, replay_plan
from vgdp_planner import ValueGuidedPlanner

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of two episodes with the same seed of the planner."""
    folder = tmp_path_factory.mktemp('replay') / 'bag'
    robot = SimulatedRobot(folder, ValueGuidedPlanner.from_pretrained(), '/robot/')
    robot.run(seed=4, start=100 * SECOND)
    robot.run(seed=4, start=500 * SECOND, max_steps=9)
    robot.close()
    return folder


def bag_of(folder: Path, **parameters: object) -> Path:
    """Return a short bag of a robot on a map with three cells to a step."""
    planner = ValueGuidedPlanner.from_pretrained()
    robot = SimulatedRobot(folder, planner, fineness=3, parameters=parameters)
    robot.run(seed=4, start=100 * SECOND, max_steps=25)
    robot.close()
    return folder


def changed(bag: Path, target: Path, topic: str, change: Callable[[int, Any], Any]) -> Path:
    """Copy a bag; ``change`` gets the number and the content of each message on one topic.

    It returns what is written instead, or None to leave the message out.
    """
    seen = 0
    with Reader(bag) as reader, BagRecorder(target) as recorder:
        for connection in reader.connections:
            recorder.add_topic(connection.topic, connection.msgtype, [])
        for connection, received, data in reader.messages():
            if connection.topic == topic:
                content = STORE.deserialize_cdr(data, connection.msgtype)
                content = change(seen, content)
                seen += 1
                if content is None:
                    continue
                data = bytes(STORE.serialize_cdr(content, connection.msgtype))  # noqa: PLW2901
            recorder.write(connection.topic, received, data)
    return target


@pytest.mark.parametrize('against', ['map', 'plan'])
def test_the_same_comes_out(bag: Path, against: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Bit for bit, in both episodes, found without being told where the robot's topics are."""
    assert main(['bag', 'replay', str(bag), '--against', against]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    equal, compared = (int(line.split()[index]) for index in (1, 3))
    assert equal == compared > 20
    assert 'not in the bag' not in line


def test_a_changed_cell_is_found(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the one map that was changed, and the exit status says so."""

    def change(number: int, grid: Any) -> Any:  # noqa: ANN401
        if number == 7:
            cells = grid.data.copy()
            cells[33] = 100 - max(cells[33], 0)
            grid = type(grid)(grid.header, grid.info, cells)
        return grid

    other = changed(bag, tmp_path / 'bag', '/robot/map', change)
    assert main(['bag', 'replay', str(other), '--against', 'map']) == 1
    found, summary = capsys.readouterr().out.splitlines()
    stamp = 100 * SECOND + 7 * SECOND // 5
    assert found.startswith(f'{stamp // SECOND}.{stamp % SECOND:09d}: 1 of ')
    assert 'cells of the map differ, first (row, col)' in found
    total = replay_map(bag, '/robot').compared
    assert summary.startswith(f'map: {total - 1} of {total} the same')


def test_a_lost_view_changes_maps(bag: Path, tmp_path: Path) -> None:
    """Without the first view, the maps from then on are others, and one map has no inputs."""
    other = changed(bag, tmp_path / 'bag', '/robot/local_map', lambda n, m: m if n else None)
    comparison = replay_map(other, '/robot')
    assert comparison.compared == replay_map(bag, '/robot').compared - 1
    assert comparison.differences


def test_a_map_that_was_not_recorded_is_no_difference(bag: Path, tmp_path: Path) -> None:
    """It is counted, as nobody knows what it was."""
    other = changed(bag, tmp_path / 'bag', '/robot/map', lambda n, m: m if n != 5 else None)
    comparison = replay_map(other, '/robot')
    assert (comparison.missing, comparison.differences) == (1, [])


def test_another_plan_is_found(bag: Path, tmp_path: Path) -> None:
    """A step that goes another way, and another action."""

    def turn(number: int, path: Any) -> Any:  # noqa: ANN401
        if number == 2:
            path.poses[1].pose.position.x += 1.0
        return path

    other = changed(bag, tmp_path / 'plan', '/robot/plan', turn)
    (difference,) = replay_plan(other, '/robot').differences
    assert difference.what == 'step 0 of the plan goes another way now'

    def swap(number: int, action: Any) -> Any:  # noqa: ANN401
        return type(action)(np.uint8((action.data + 1) % 8)) if number == 3 else action

    other = changed(bag, tmp_path / 'action', '/robot/action', swap)
    (difference,) = replay_plan(other, '/robot').differences
    assert difference.what == 'action 3 of the episode is not the one that is planned now'


def test_another_seed_plans_otherwise(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What was not recorded with the options given is found out."""
    assert main(['bag', 'replay', str(bag), '--against', 'plan', '--seed', '99']) == 1
    assert 'candidates have other values' in capsys.readouterr().out


def test_what_can_not_be_replayed_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one sentence, with exit status 2."""
    assert main(['bag', 'replay', str(tmp_path / 'none'), '--against', 'map']) == 2
    assert 'none is not a readable bag' in capsys.readouterr().err
    with BagRecorder(tmp_path / 'empty') as recorder:
        recorder.add_topic('/odom', 'nav_msgs/msg/Odometry', [])
    assert main(['bag', 'replay', str(tmp_path / 'empty'), '--against', 'map']) == 2
    assert 'holds neither an episode nor odom' in capsys.readouterr().err


def test_plans_on_a_coarser_grid_are_made_again_as_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the parameters that the planner's node said; without them, one sentence says why not."""
    bag = bag_of(tmp_path / 'bag', planning_resolution=1.0, seed=4)
    assert main(['bag', 'replay', str(bag), '--against', 'plan']) == 0
    (line,) = capsys.readouterr().out.splitlines()
    equal, compared = (int(line.split()[index]) for index in (1, 3))
    assert equal == compared > 5

    silent = changed(bag, tmp_path / 'silent', '/diagnostics', lambda *_: None)
    assert main(['bag', 'replay', str(silent), '--against', 'plan']) == 2
    assert 'coarser than the map' in capsys.readouterr().err


def test_the_seed_and_the_weights_are_those_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not those of the episode, or the shipped ones."""
    bag = bag_of(tmp_path / 'bag', planning_resolution=1.0, seed=99)
    assert main(['bag', 'replay', str(bag), '--against', 'plan']) == 1
    assert 'candidates have other values' in capsys.readouterr().out
    bag = bag_of(tmp_path / 'other', weights=str(tmp_path / 'none'))
    assert main(['bag', 'replay', str(bag), '--against', 'plan']) == 2
    assert 'none' in capsys.readouterr().err


def test_plans_of_a_robot_that_moves_by_itself_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They depend on when its poses came."""
    bag = bag_of(tmp_path / 'bag', pose_source='tf')
    assert main(['bag', 'replay', str(bag), '--against', 'plan']) == 2
    assert "moves by itself (pose_source 'tf')" in capsys.readouterr().err
