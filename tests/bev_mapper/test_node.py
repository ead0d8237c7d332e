"""The node bev_mapper over DDS."""

from __future__ import annotations

import array
import math
import signal
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry
from std_msgs.msg import UInt8
from std_srvs.srv import Trigger
from tests.ros_helpers import wait_for

from gridnav.grid import GridGeometry
from gridnav.partial_map import to_occupancy
from gridnav.ros.conversions import (
    from_occupancy_grid,
    to_nanoseconds,
    to_occupancy_grid,
    to_odometry,
)
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, RELIABLE_QOS
from maze_sim import MazeSimulation, make_mazes, shortest_actions

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray
    from tests.ros_helpers import Probe, StartNode

MAPPER, SIM = 'bev_mapper.node', 'maze_sim.node'
STAMP = 1_000_000_000_000


class Robot:
    """Sends observations to a mapper and records its maps."""

    def __init__(self, probe: Probe) -> None:
        """Connect to the mapper."""
        self.maps = probe.record(OccupancyGrid, 'map', MAP_QOS)
        self.local_map = probe.publisher(OccupancyGrid, 'local_map', RELIABLE_QOS)
        self.odom = probe.publisher(Odometry, 'odom', RELIABLE_QOS)
        self.episode = probe.publisher(DiagnosticStatus, 'episode', EPISODE_QOS)

    def observe(self, stamp: int, row: int, col: int) -> None:
        """Stand on a cell and see a wall two cells to the north and nothing else."""
        self.odom.publish(odometry(stamp, row, col))
        self.local_map.publish(window(stamp, row, col))

    def wait_map(self, stamp: int) -> NDArray[np.int8]:
        """Wait for the map of a stamp and return its cells."""
        wait_for(lambda: any(stamp_of(message) == stamp for message in list(self.maps)))
        found = [message for message in self.maps if stamp_of(message) == stamp]
        cells, _ = from_occupancy_grid(found[-1])
        return cells


def window(stamp: int, row: int, col: int, frame_id: str = 'map') -> OccupancyGrid:
    """Build a window of 5 x 5 cells around a cell of the map."""
    cells = np.full((5, 5), -1, dtype=np.int8)
    cells[4, 2] = 100
    origin = (-2.5, -2.5) if frame_id == 'base_link' else (col - 2.0, row - 2.0)
    return to_occupancy_grid(
        cells, GridGeometry(5, 5, 1.0, *origin), stamp=stamp, frame_id=frame_id
    )


def odometry(stamp: int, row: int, col: int) -> Odometry:
    """Build the odometry of a robot on a cell."""
    return to_odometry(
        col + 0.5, row + 0.5, stamp=stamp, frame_id='odom', child_frame_id='base_link'
    )


def stamp_of(message: Any) -> int:  # noqa: ANN401 - any stamped message
    """Return the stamp in nanoseconds."""
    return to_nanoseconds(message.header.stamp)


def spoil(message: Any, path: str, value: object) -> Any:  # noqa: ANN401 - any message
    """Set a field of a message by its dotted path and return the message."""
    target = message
    *parents, name = path.split('.')
    for parent in parents:
        target = getattr(target, parent)
    setattr(target, name, value)
    return message


BAD_LOCAL_MAPS = [
    ('data', array.array('b', [0] * 24)),
    ('data', array.array('b')),
    ('data', array.array('b', [0] * 24 + [-7])),
    ('info.resolution', 0.0),
    ('info.resolution', math.nan),
    ('info.resolution', 0.5),
    ('info.width', 0),
    ('info.width', 2**32 - 1),
    ('info.origin.position.x', math.nan),
    ('info.origin.position.x', 1e30),
    ('info.origin.position.x', 9e5),
    ('info.origin.orientation.w', 0.0),
    ('header.frame_id', ''),
    ('header.frame_id', 'camera'),
    ('header.stamp.nanosec', 2**32 - 1),
]

BAD_ODOMETRY = [
    ('pose.pose.position.x', math.nan),
    ('pose.pose.position.y', math.inf),
    ('pose.pose.position.y', 9e5),
    ('pose.pose.orientation.w', 0.0),
    ('header.frame_id', ''),
    ('header.frame_id', 'base_link'),
    ('header.stamp.sec', -5),
]


def test_malformed_messages_are_refused_and_the_next_good_one_is_mapped(
    node_process: StartNode, probe: Probe, namespace: str
) -> None:
    """None of them ends the node or spoils the map."""
    mapper = node_process(MAPPER)
    robot = Robot(probe)
    diagnostics = probe.record(DiagnosticArray, '/diagnostics', RELIABLE_QOS)

    def refused(topic: str) -> int:
        counts = [
            int(item.value)
            for message in list(diagnostics)
            for status in message.status
            if status.name == f'{namespace}/bev_mapper'
            for item in status.values
            if item.key == f'refused: {topic}'
        ]
        return max(counts, default=0)

    # Each has a good partner of the same stamp, so a bad one that passed would make a map.
    stamp = STAMP
    for path, value in BAD_LOCAL_MAPS:
        robot.odom.publish(odometry(stamp, 5, 5))
        robot.local_map.publish(spoil(window(stamp, 5, 5), path, value))
        robot.observe(stamp + 1, 6, 6)
        robot.wait_map(stamp + 1)
        stamp += 2
    for path, value in BAD_ODOMETRY:
        robot.local_map.publish(window(stamp, 5, 5))
        robot.odom.publish(spoil(odometry(stamp, 5, 5), path, value))
        robot.observe(stamp + 1, 6, 6)
        robot.wait_map(stamp + 1)
        stamp += 2
    robot.episode.publish(DiagnosticStatus(name='maze_sim', message='running'))

    bad = len(BAD_LOCAL_MAPS) + len(BAD_ODOMETRY)
    wait_for(lambda: refused('local_map') + refused('odom') == bad and refused('episode'))
    cells, _ = from_occupancy_grid(robot.maps[-1])
    assert np.argwhere(cells != -1).tolist() == [[6, 6], [8, 6]]
    assert [stamp_of(message) - STAMP for message in robot.maps] == [*range(1, 2 * bad, 2)]
    mapper.assert_alive()
    assert f'Refused a message on {namespace}/local_map: It' in mapper.output


def test_maps_carry_the_stamp_and_frame_of_the_observation(
    node_process: StartNode, probe: Probe
) -> None:
    """Window in the map's frame or on the robot, odom before or after it, each once."""
    node_process(MAPPER, {'width': 20, 'height': 10, 'origin_x': -5.0, 'origin_y': -1.0})
    robot = Robot(probe)
    robot.observe(STAMP, 2, 3)
    robot.wait_map(STAMP)
    robot.local_map.publish(window(STAMP + 1, 2, 4, 'base_link'))
    robot.odom.publish(odometry(STAMP + 1, 2, 4))
    cells = robot.wait_map(STAMP + 1)
    assert np.argwhere(cells != -1).tolist() == [[3, 8], [3, 9], [5, 8], [5, 9]]
    robot.observe(STAMP + 1, 2, 4)
    robot.observe(STAMP + 2, 2, 5)
    robot.wait_map(STAMP + 2)
    assert [stamp_of(message) - STAMP for message in robot.maps] == [0, 1, 2]
    assert robot.maps[0].header.frame_id == 'map'
    info = robot.maps[0].info
    assert (info.width, info.height, info.resolution) == (20, 10, 1.0)
    assert (info.origin.position.x, info.origin.position.y) == (-5.0, -1.0)


def test_a_late_joiner_gets_the_map(
    node_process: StartNode, make_probe: Callable[[], Probe]
) -> None:
    """It is latched."""
    node_process(MAPPER)
    robot = Robot(make_probe())
    robot.observe(STAMP, 2, 3)
    robot.wait_map(STAMP)
    maps = make_probe().record(OccupancyGrid, 'map', MAP_QOS)
    wait_for(lambda: maps)
    assert maps == robot.maps


def test_a_new_episode_and_a_reset_clear_the_map(node_process: StartNode, probe: Probe) -> None:
    """What was seen of the new world before the word of it is kept."""
    node_process(MAPPER)
    robot = Robot(probe)
    robot.observe(STAMP, 2, 3)
    robot.wait_map(STAMP)
    robot.observe(STAMP + 10, 5, 3)
    assert (robot.wait_map(STAMP + 10) != -1).sum() == 4
    robot.episode.publish(EpisodeStatus('maze_sim', 'running', STAMP + 10).to_message())
    wait_for(lambda: len(robot.maps) == 3)
    assert np.argwhere(robot.wait_map(STAMP + 10) != -1).tolist() == [[5, 3], [7, 3]]
    robot.episode.publish(EpisodeStatus('maze_sim', 'success', STAMP + 10).to_message())

    response = probe.call(Trigger, 'bev_mapper/reset', Trigger.Request())
    assert (response.success, response.message) == (True, 'The map is empty.')
    robot.observe(STAMP + 11, 9, 3)
    assert np.argwhere(robot.wait_map(STAMP + 11) != -1).tolist() == [[9, 3], [11, 3]]


def test_the_map_is_that_of_the_simulation_even_after_kill_9(
    node_process: StartNode, probe: Probe
) -> None:
    """Each map equals the partial map in process; a mapper killed in mid-maze comes back."""
    seed, size = 5, 15
    sim = node_process(SIM, {'seed': seed, 'size': size})
    mapper = node_process(MAPPER, {'width': size, 'height': size})
    maps = probe.record(OccupancyGrid, 'map', MAP_QOS)
    odometry = probe.record(Odometry, 'odom', RELIABLE_QOS)
    actions = probe.publisher(UInt8, 'action', RELIABLE_QOS)
    [maze] = make_mazes(1, size, seed)
    simulation = MazeSimulation([maze])
    way = shortest_actions(maze.blocked, maze.start, maze.goal)

    def has_map() -> bool:
        return bool(maps and odometry) and stamp_of(maps[-1]) == stamp_of(odometry[-1])

    def step(action: int) -> None:
        seen = len(maps)
        actions.publish(UInt8(data=action))
        simulation.step(np.array([action]))
        wait_for(lambda: len(maps) > seen and has_map())

    wait_for(has_map)
    for action in way[:6]:
        step(action)
        cells, geometry = from_occupancy_grid(maps[-1])
        assert np.array_equal(cells, to_occupancy(simulation.partial_maps[0]))
        assert geometry == GridGeometry(size, size, 1.0)

    mapper.kill()
    before = len(maps)
    mapper = node_process(MAPPER, {'width': size, 'height': size})
    wait_for(lambda: len(maps) > before and has_map())
    again, _ = from_occupancy_grid(maps[-1])
    known = to_occupancy(simulation.partial_maps[0])
    assert (again != -1).sum() >= 4
    assert np.array_equal(again[again != -1], known[again != -1])
    for action in way[6:]:
        step(action)
    sim.assert_alive()
    mapper.assert_alive()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_quietly_idle_and_busy(
    node_process: StartNode, probe: Probe, number: int
) -> None:
    """Code 0, no traceback, within two seconds."""
    idle, busy = node_process(MAPPER), node_process(MAPPER, {'width': 1000, 'height': 1000})
    idle.wait_output('Mapping from')
    busy.wait_output('Mapping from')
    robot = Robot(probe)
    assert idle.end(number) < 2.0
    for i in range(100):
        robot.observe(STAMP + i, 2, 3)
    assert busy.end(number) < 2.0


@pytest.mark.parametrize(
    ('parameters', 'sentence'),
    [
        ({'width': 0}, "Parameter 'width' must be 1 to 4096 cells, got 0."),
        ({'width': 4096, 'height': 4096}, 'more than the limit of 4000000'),
    ],
)
def test_parameters_that_can_not_be_used_are_named(
    node_process: StartNode, parameters: dict[str, object], sentence: str
) -> None:
    """One sentence and exit code 1."""
    mapper = node_process(MAPPER, parameters)
    assert mapper.process.wait(15) == 1
    assert sentence in mapper.output
    assert 'Traceback' not in mapper.output
