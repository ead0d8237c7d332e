"""The node maze_sim over DDS."""

from __future__ import annotations

import math
import signal
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import UInt8
from std_srvs.srv import Trigger
from tests.maze_sim.test_map_file import write_map
from tests.ros_helpers import wait_for

from gridnav.actions import DONE, STEPS
from gridnav.grid import GridGeometry
from gridnav.ros.conversions import from_occupancy_grid, to_nanoseconds, to_yaw
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, RELIABLE_QOS
from maze_sim import MazeSimulation, draw_world, make_mazes, shortest_actions

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.ros_helpers import NodeProcess, Probe, StartNode

    from maze_sim import Maze

SIM = 'maze_sim.node'


class Driver:
    """Sends actions to a maze and records what comes back."""

    def __init__(self, probe: Probe) -> None:
        """Connect to the maze."""
        self._probe = probe
        self.odom = probe.record(Odometry, 'odom', RELIABLE_QOS)
        self.local_maps = probe.record(OccupancyGrid, 'local_map', RELIABLE_QOS)
        self.goals = probe.record(PoseStamped, 'goal_pose', MAP_QOS)
        self.episodes = probe.record(DiagnosticStatus, 'episode', EPISODE_QOS)
        self.action = probe.publisher(UInt8, 'action', RELIABLE_QOS)
        self.episode = probe.publisher(DiagnosticStatus, 'episode', EPISODE_QOS)
        wait_for(lambda: self.odom and self.local_maps and self.episodes)

    def stamps(self) -> list[int]:
        """Return the stamps of the observations, each once."""
        return list(dict.fromkeys(stamp_of(message) for message in list(self.local_maps)))

    def step(self, action: int) -> OccupancyGrid:
        """Take an action and return what is then seen."""
        before = stamp_of(self.local_maps[-1])
        self.action.publish(UInt8(data=action))
        wait_for(lambda: stamp_of(self.local_maps[-1]) > before)
        return self.local_maps[-1]

    def status(self) -> EpisodeStatus:
        """Return the latest word of the maze."""
        return EpisodeStatus.from_message(self.episodes[-1])

    def reset(self) -> str:
        """Ask for the next episode, wait for it and return the answer."""
        start = self.status().start
        response = self._probe.call(Trigger, 'maze_sim/reset', Trigger.Request())
        assert response.success
        wait_for(lambda: self.status().start > start)
        wait_for(lambda: stamp_of(self.local_maps[-1]) == self.status().start)
        wait_for(lambda: stamp_of(self.odom[-1]) == self.status().start)
        return str(response.message)


def stamp_of(message: Any) -> int:  # noqa: ANN401 - any stamped message
    """Return the stamp in nanoseconds."""
    return to_nanoseconds(message.header.stamp)


def position_of(message: Odometry) -> tuple[float, float]:
    """Return x and y."""
    return message.pose.pose.position.x, message.pose.pose.position.y


def way_through(maze: Maze) -> list[int]:
    """Return the expert's actions with Done at the end."""
    return [*shortest_actions(maze.blocked, maze.start, maze.goal), DONE]


@pytest.fixture
def start_sim(node_process: StartNode) -> Callable[..., NodeProcess]:
    """Return a function that starts the node."""

    def start(**parameters: object) -> NodeProcess:
        return node_process(SIM, parameters)

    return start


def test_an_episode_from_the_first_look_to_success(
    start_sim: Callable[..., NodeProcess], probe: Probe
) -> None:
    """Everything that is published, against the simulation in process."""
    sim = start_sim(seed=3, size=15, view_range=3, resolution=0.5)
    driver = Driver(probe)
    [maze] = make_mazes(1, 15, 3)
    simulation = MazeSimulation([maze], view_range=3)
    geometry = GridGeometry(15, 15, 0.5)

    start = driver.status()
    assert (start.source, start.message) == ('maze_sim', 'running')
    assert start.values['seed'] == '3'
    assert start.values['view_range'] == '3'
    assert start.values['rows'] == start.values['cols'] == start.values['size'] == '15'
    assert start.values['expert_steps'] == str(maze.expert_steps)
    assert driver.stamps() == [start.start]
    assert {message.child_frame_id for message in driver.odom} == {'base_link'}

    goal_stamp = None
    for action in [None, *way_through(maze)]:
        if action is not None:
            driver.step(action)
            simulation.step(np.array([action]))
        cells, window = from_occupancy_grid(driver.local_maps[-1])
        assert np.array_equal(cells, simulation.windows()[0])
        row, col = simulation.cells[0].tolist()
        assert window == GridGeometry(7, 7, 0.5, (col - 3) * 0.5, (row - 3) * 0.5)
        stamp = stamp_of(driver.local_maps[-1])
        wait_for(lambda stamp=stamp: stamp_of(driver.odom[-1]) == stamp)  # type: ignore[misc]
        assert position_of(driver.odom[-1]) == geometry.center_of(row, col)
        if action not in (None, DONE):
            yaw = math.atan2(*STEPS[action].tolist())
            assert to_yaw(driver.odom[-1].pose.pose.orientation) == pytest.approx(yaw)
        if simulation.goal_seen[0] and goal_stamp is None:
            goal_stamp = stamp

    wait_for(lambda: driver.goals and driver.status().message == 'success')
    [goal] = driver.goals
    assert stamp_of(goal) == goal_stamp
    assert (goal.pose.position.x, goal.pose.position.y) == geometry.center_of(*maze.goal)
    end = driver.status()
    assert end.start == start.start
    assert end.values['steps'] == str(maze.expert_steps + 1)
    assert float(end.values['spl']) == 1.0
    assert float(end.values['path_cost']) == pytest.approx(maze.expert_cost)
    stamps = driver.stamps()
    assert stamps == sorted(stamps)
    assert len(stamps) == maze.expert_steps + 2
    sim.assert_alive()


def test_the_latest_observation_is_repeated_with_its_stamp(
    start_sim: Callable[..., NodeProcess], make_probe: Callable[[], Probe]
) -> None:
    """So a late joiner gets it, and the goal too; nothing new is made up."""
    start_sim(seed=3, observation_period=0.1)
    driver = Driver(make_probe())
    [maze] = make_mazes(1, 15, 3)
    for action in way_through(maze):
        driver.step(action)
    count = len(driver.local_maps)
    wait_for(lambda: len(driver.local_maps) >= count + 5)
    assert {stamp_of(message) for message in driver.local_maps[-5:]} == {driver.stamps()[-1]}
    late = make_probe()
    odom = late.record(Odometry, 'odom', RELIABLE_QOS)
    goals = late.record(PoseStamped, 'goal_pose', MAP_QOS)
    episodes = late.record(DiagnosticStatus, 'episode', EPISODE_QOS)
    wait_for(lambda: odom and goals and len(episodes) == 2)
    assert stamp_of(odom[0]) == driver.stamps()[-1]
    assert [status.message for status in episodes] == ['running', 'success']


def test_the_same_seed_shows_the_same_world(
    start_sim: Callable[..., NodeProcess], make_probe: Callable[[], Probe]
) -> None:
    """In two processes one after the other, whatever the robot does."""
    actions = np.random.default_rng(0).integers(0, 8, size=300).tolist()

    def run() -> list[tuple[bytes, tuple[float, float]]]:
        sim = start_sim(seed=11, size=20)
        probe = make_probe()
        driver = Driver(probe)
        [maze] = make_mazes(1, 20, 11)
        simulation = MazeSimulation([maze])
        seen = []
        for action in actions:
            if not _is_valid(maze, simulation.cells[0].tolist(), action):
                continue
            simulation.step(np.array([action]))
            message = driver.step(action)
            seen.append((message.data.tobytes(), position_of(driver.odom[-1])))
            if len(seen) == 25:
                break
        sim.end()
        return seen

    first, second = run(), run()
    assert len(first) == 25
    assert first == second


def _is_valid(maze: Maze, cell: list[int], action: int) -> bool:
    dr, dc = STEPS[action].tolist()
    row, col = cell
    beside = not maze.blocked[row + dr, col] or not maze.blocked[row, col + dc]
    return not maze.blocked[row + dr, col + dc] and (not (dr and dc) or beside)


def test_bad_actions_are_refused_and_late_ones_ignored(
    start_sim: Callable[..., NodeProcess], probe: Probe, namespace: str
) -> None:
    """The node lives on, and the next episode has the next seed."""
    sim = start_sim(seed=3)
    driver = Driver(probe)
    for number in (9, 200, 255):
        driver.action.publish(UInt8(data=number))
    driver.step(DONE)
    wait_for(lambda: driver.status().message == 'false_done')
    refusal = f'Refused a message on {namespace}/action: An action is a number from 0 to 8, got 9.'
    assert refusal in sim.output
    assert driver.status().values['steps'] == '1'
    assert driver.episodes[-1].level == DiagnosticStatus.WARN

    driver.action.publish(UInt8(data=0))
    assert driver.reset() == 'A new episode with seed 4 has begun.'
    [maze] = make_mazes(1, 15, 4)
    assert position_of(driver.odom[-1]) == GridGeometry(15, 15, 1.0).center_of(*maze.start)
    assert driver.status().message == 'running'
    for action in way_through(maze):
        driver.step(action)
    wait_for(lambda: driver.status().message == 'success')
    sim.assert_alive()


def test_a_collision_leaves_the_robot_where_it_is(
    start_sim: Callable[..., NodeProcess], probe: Probe
) -> None:
    """And ends the episode."""
    start_sim(seed=3)
    driver = Driver(probe)
    [maze] = make_mazes(1, 15, 3)
    wall = next(a for a in range(8) if not _is_valid(maze, list(maze.start), a))
    before = position_of(driver.odom[-1])
    driver.step(wall)
    wait_for(lambda: driver.status().message == 'collision')
    assert position_of(driver.odom[-1]) == before


def test_a_planner_that_gives_up_ends_its_own_episode_alone(
    start_sim: Callable[..., NodeProcess], probe: Probe
) -> None:
    """Malformed words and those about another episode change nothing."""
    sim = start_sim(seed=3)
    driver = Driver(probe)
    start = driver.status().start
    driver.episode.publish(DiagnosticStatus(name='vgdp_planner', message='exhausted'))
    for text, of in (('exhausted', start - 1), ('happy', start)):
        driver.episode.publish(EpisodeStatus('vgdp_planner', text, of).to_message())
    [maze] = make_mazes(1, 15, 3)
    driver.step(way_through(maze)[0])
    assert [status.name for status in driver.episodes].count('maze_sim') == 1
    driver.episode.publish(EpisodeStatus('vgdp_planner', 'exhausted', start).to_message())
    wait_for(lambda: driver.episodes[-1].message == 'gave_up')
    assert driver.status().start == start
    assert 'vgdp_planner gave up: exhausted.' in sim.output
    sim.assert_alive()


def test_parameters_of_the_maze_take_effect_with_the_next_episode(
    start_sim: Callable[..., NodeProcess], probe: Probe
) -> None:
    """A seed that is set counts from there; bad values are refused with the reason."""
    start_sim(seed=3)
    driver = Driver(probe)

    def set_parameters(**values: object) -> str:
        request = SetParameters.Request(
            parameters=[Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
        )
        results = probe.call(SetParameters, 'maze_sim/set_parameters', request).results
        return ' '.join(result.reason for result in results)

    assert set_parameters(size=21, seed=40, view_range=1, max_steps=2).strip() == ''
    assert driver.status().values['size'] == '15'
    assert driver.reset() == 'A new episode with seed 40 has begun.'
    values = driver.status().values
    assert [values[key] for key in ('size', 'seed', 'view_range')] == ['21', '40', '1']
    [maze] = make_mazes(1, 21, 40)
    for action in way_through(maze)[:2]:
        driver.step(action)
    wait_for(lambda: driver.status().message == 'timeout')
    assert driver.reset() == 'A new episode with seed 41 has begun.'
    assert 'out of range' in set_parameters(size=8)
    assert 'out of range' in set_parameters(rate=-1.0)
    assert 'read-only' in set_parameters(resolution=2.0)


def test_a_rate_paces_the_actions(start_sim: Callable[..., NodeProcess], probe: Probe) -> None:
    """Ten a second: the first at once, the others wait for their turn, in order."""
    start_sim(seed=3, rate=10)
    driver = Driver(probe)
    [maze] = make_mazes(1, 15, 3)
    way = way_through(maze)[:6]
    began = time.monotonic()
    for action in way:
        driver.action.publish(UInt8(data=action))
    wait_for(lambda: len(driver.stamps()) == 7)
    assert 0.45 < time.monotonic() - began < 2.0
    gaps = np.diff(driver.stamps()[1:]) / 1e9
    assert (gaps > 0.09).all()
    simulation = MazeSimulation([maze])
    for action in way:
        simulation.step(np.array([action]))
    expected = GridGeometry(15, 15, 1.0).center_of(*simulation.cells[0].tolist())
    wait_for(lambda: position_of(driver.odom[-1]) == expected)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_quietly_idle_and_busy(
    start_sim: Callable[..., NodeProcess], probe: Probe, number: int
) -> None:
    """Code 0, no traceback, within two seconds."""
    idle, busy = start_sim(seed=1), start_sim(seed=2, observation_period=0.01, rate=1000.0)
    idle.wait_output('Episode with seed 1')
    busy.wait_output('Episode with seed 2')
    driver = Driver(probe)
    for _ in range(50):
        driver.action.publish(UInt8(data=0))
    assert idle.end(number) < 2.0
    assert busy.end(number) < 2.0


def test_slips_and_a_noisy_pose_in_rooms(
    start_sim: Callable[..., NodeProcess], probe: Probe
) -> None:
    """The pose is noisy and says so, the view lies where the robot is, all as in process."""
    start_sim(seed=5, kind='rooms', rows=14, cols=20, slip=0.3, pose_noise=1.5, resolution=0.5)
    driver = Driver(probe)
    [maze] = make_mazes(1, (14, 20), 5, kind='rooms')
    simulation = MazeSimulation([maze], slip=0.3, pose_noise=1.5, seeds=[[5, 1]])
    geometry = GridGeometry(14, 20, 0.5)
    assert [driver.status().values[key] for key in ('rows', 'cols')] == ['14', '20']
    apart = []
    for action in (None, *range(8), *range(8)):
        cell = simulation.cells[0].tolist()
        if action is not None:
            if not _is_valid(maze, cell, action):
                continue
            simulation.step(np.array([action]))
            driver.step(action)
        cells, window = from_occupancy_grid(driver.local_maps[-1])
        assert np.array_equal(cells, simulation.windows()[0])
        row, col = simulation.cells[0].tolist()
        assert (window.origin_x, window.origin_y) == ((col - 2) * 0.5, (row - 2) * 0.5)
        stamp = stamp_of(driver.local_maps[-1])
        wait_for(lambda stamp=stamp: stamp_of(driver.odom[-1]) == stamp)  # type: ignore[misc]
        reported = simulation.reported_cells[0].tolist()
        assert position_of(driver.odom[-1]) == geometry.center_of(*reported)
        covariance = driver.odom[-1].pose.covariance
        assert covariance[0] == covariance[7] == pytest.approx(0.75**2)
        assert np.count_nonzero(covariance) == 2
        apart.append(reported != [row, col])
    assert len(apart) > 5
    assert any(apart)


def test_a_map_of_a_map_server_is_a_world(
    start_sim: Callable[..., NodeProcess], probe: Probe, tmp_path: Path
) -> None:
    """It lies where the file says; a file that is no map is named, and the episode goes on."""
    blocked = draw_world('rooms', (16, 24), np.random.default_rng(0))
    path = write_map(tmp_path, blocked)
    sim = start_sim(seed=2, map_file=str(path), min_expert_steps=5, reachable=False)
    driver = Driver(probe)
    [maze] = make_mazes(1, 15, 2, 5, map_file=str(path), reachable=False)
    geometry = GridGeometry(16, 24, 0.05, -1.5, 2.0)
    assert position_of(driver.odom[-1]) == geometry.center_of(*maze.start)
    _, window = from_occupancy_grid(driver.local_maps[-1])
    assert window.resolution == 0.05
    row, col = maze.start
    assert window.origin_x == pytest.approx(-1.5 + (col - 2) * 0.05)
    assert window.origin_y == pytest.approx(2.0 + (row - 2) * 0.05)
    values = driver.status().values
    assert (values['expert_steps'], values['expert_cost']) == ('0', 'inf')
    assert (values['resolution'], values['rows'], values['cols']) == ('0.05', '16', '24')

    path.write_text('nothing', encoding='utf-8')
    response = probe.call(Trigger, 'maze_sim/reset', Trigger.Request())
    assert not response.success
    assert response.message == f'The map {path} has no settings.'
    action = next(a for a in range(8) if _is_valid(maze, list(maze.start), a))
    driver.step(action)
    assert driver.status().message == 'running'
    sim.assert_alive()
    other = start_sim(map_file=str(path))
    assert other.process.wait(15) == 1
    assert other.output.endswith(f'Can not start: The map {path} has no settings.\n')


def test_a_side_that_can_not_be_is_named(start_sim: Callable[..., NodeProcess]) -> None:
    """Rows and columns are left to the size or long enough."""
    sim = start_sim(cols=5)
    assert sim.process.wait(15) == 1
    assert sim.output == "Can not start: Parameter 'cols' must be 0 or 9 to 201 cells, got 5.\n"


def test_a_size_that_can_not_be_is_named(start_sim: Callable[..., NodeProcess]) -> None:
    """One sentence and exit code 1."""
    sim = start_sim(size=4)
    assert sim.process.wait(15) == 1
    assert sim.output == "Can not start: Parameter 'size' must be 9 to 201 cells, got 4.\n"
