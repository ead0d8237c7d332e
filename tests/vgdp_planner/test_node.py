"""The planner node over real DDS, in the closed loop with simulator and mapper."""

from __future__ import annotations

import math
import signal
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from nav_msgs.srv import GetPlan
from std_msgs.msg import UInt8
from tests.ros_helpers import wait_for

from gridnav import GridGeometry
from gridnav.ros.conversions import (
    header,
    to_nanoseconds,
    to_occupancy_grid,
    to_odometry,
    to_pose,
    to_pose_stamped,
)
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, MARKER_QOS, RELIABLE_QOS
from maze_sim import MazeSimulation, make_mazes
from vgdp_planner import ValueGuidedPlanner
from vgdp_planner.ways import inflate

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.ros_helpers import NodeProcess, Probe, StartNode

READY = 'Planning with'
SIM, MAPPER, PLANNER = 'maze_sim.node', 'bev_mapper.node', 'vgdp_planner.node'


def in_process(seed: int) -> list[int]:
    """Return the actions of the same episode without ROS."""
    simulation = MazeSimulation(make_mazes(1, 15, seed))
    planner = ValueGuidedPlanner.from_pretrained()
    planner.reset(seed=0)
    actions = []
    while simulation.active[0]:
        row, col = simulation.cells[0].tolist()
        for action in planner.plan(simulation.partial_maps[0], (row, col)).committed:
            simulation.step(np.array([action]))
            actions.append(action)
    return actions


def outcome(episode: list[DiagnosticStatus]) -> str | None:
    """Return how the episode of the simulator ended, None while it runs."""
    ends = [m.message for m in episode if m.name == 'maze_sim' and m.message != 'running']
    return ends[-1] if ends else None


def start_loop(node_process: StartNode, **sim: Any) -> dict[str, NodeProcess]:  # noqa: ANN401
    """Start mapper, planner and simulator."""
    nodes = {name: node_process(name) for name in (MAPPER, PLANNER)}
    nodes[PLANNER].wait_output(READY)
    nodes[SIM] = node_process(SIM, sim)
    return nodes


def test_same_actions_as_in_process(node_process: StartNode, probe: Probe) -> None:
    """Over DDS the episode takes the very actions that it takes in one process."""
    actions = probe.record(UInt8, 'action', RELIABLE_QOS)
    episode = probe.record(DiagnosticStatus, 'episode', EPISODE_QOS)
    plans = probe.record(Path, 'plan', MAP_QOS)
    waypoints = probe.record(PoseStamped, 'waypoint', RELIABLE_QOS)
    start_loop(node_process, seed=2)
    wait_for(lambda: outcome(episode), 60)
    assert outcome(episode) == 'success'
    expected = in_process(2)
    wait_for(lambda: len(actions) == len(expected))
    assert [message.data for message in actions] == expected
    wait_for(lambda: len(waypoints) == len(expected) - 1)
    stamps = [to_nanoseconds(path.header.stamp) for path in plans]
    assert stamps == sorted(set(stamps))
    assert all(path.header.frame_id == 'map' and path.poses for path in plans)


@pytest.mark.parametrize('victim', [MAPPER, PLANNER])
def test_killed_in_mid_maze(node_process: StartNode, probe: Probe, victim: str) -> None:
    """Mapper or planner are killed in mid-episode and started again: still a success."""
    episode = probe.record(DiagnosticStatus, 'episode', EPISODE_QOS)
    odometry = probe.record(Odometry, 'odom', RELIABLE_QOS)
    nodes = start_loop(node_process, seed=2, rate=20.0)

    def steps() -> int:
        return len({to_nanoseconds(message.header.stamp) for message in odometry})

    wait_for(lambda: steps() > 8, 60)
    nodes[victim].kill()
    assert outcome(episode) is None
    node_process(victim)
    wait_for(lambda: outcome(episode), 60)
    assert outcome(episode) == 'success'


def test_a_slow_robot_is_waited_for(node_process: StartNode, probe: Probe) -> None:
    """Two actions that take longer than the timeout, but each less, do not count as lost."""
    odometry = probe.record(Odometry, 'odom', RELIABLE_QOS)
    planner = node_process(PLANNER, {'action_timeout': 1.5})
    node_process(MAPPER)
    planner.wait_output(READY)
    node_process(SIM, {'seed': 2, 'rate': 1.0})
    wait_for(lambda: len({to_nanoseconds(m.header.stamp) for m in odometry}) > 6, 40)
    assert 'planning again' not in planner.output


def test_bad_messages_are_survived(node_process: StartNode, probe: Probe) -> None:
    """After malformed maps, poses and goals a good observation still gets its plan."""
    node = node_process(PLANNER)
    node.wait_output(READY)
    maps = probe.publisher(OccupancyGrid, 'map', MAP_QOS)
    poses = probe.publisher(Odometry, 'odom', RELIABLE_QOS)
    goals = probe.publisher(PoseStamped, 'goal_pose', MAP_QOS)
    plans = probe.record(Path, 'plan', MAP_QOS)
    geometry = GridGeometry(7, 9, 0.5, -1.0, 2.0)
    occupancy = np.full((7, 9), -1, dtype=np.int8)
    occupancy[2:5, 2:7] = 0

    def grid(stamp: int = 10) -> OccupancyGrid:
        return to_occupancy_grid(occupancy, geometry, stamp=stamp, frame_id='map')

    def pose(stamp: int, x: float = 1.0, frame: str = 'odom') -> Odometry:
        return to_odometry(x, 3.7, stamp=stamp, frame_id=frame, child_frame_id='base_link')

    cut, flat, lost = grid(), grid(), grid()
    cut.data = cut.data[:-5]
    flat.info.resolution = 0.0
    lost.header.frame_id = ''
    nan_scale, turned = grid(), grid()
    nan_scale.info.resolution = math.nan
    turned.info.origin.orientation.z = 1.0
    for message in (cut, flat, lost, nan_scale, turned):
        maps.publish(message)
    poses.publish(pose(10, math.nan))
    poses.publish(pose(10, 1.0, ''))
    goals.publish(to_pose_stamped(math.inf, 0.0, stamp=10, frame_id='map'))
    goals.publish(to_pose_stamped(0.0, 0.0, stamp=10, frame_id='moon'))
    poses.publish(pose(11, 1e5))
    maps.publish(grid(11))
    wait_for(lambda: 'is not on the map' in node.output)
    assert not plans
    poses.publish(pose(12))
    maps.publish(grid(12))
    wait_for(lambda: plans)
    assert to_nanoseconds(plans[0].header.stamp) == 12
    first = plans[0].poses[0].pose.position
    assert (first.x, first.y) == (1.25, 3.75)
    node.assert_alive()


def test_second_publisher_and_late_joiner(
    node_process: StartNode, make_probe: Callable[[], Probe]
) -> None:
    """A second source of maps is survived and named; who comes late gets the latest plan."""
    node = node_process(PLANNER)
    node.wait_output(READY)
    first, second, late = make_probe(), make_probe(), make_probe()
    geometry = GridGeometry(5, 6, 1.0)
    occupancy = np.full((5, 6), -1, dtype=np.int8)
    occupancy[2, 1:4] = 0
    plans = first.record(Path, 'plan', MAP_QOS)
    maps = [probe.publisher(OccupancyGrid, 'map', MAP_QOS) for probe in (first, second)]
    poses = first.publisher(Odometry, 'odom', RELIABLE_QOS)
    for stamp in (5, 6):
        poses.publish(
            to_odometry(2.5, 2.5, stamp=stamp, frame_id='odom', child_frame_id='base_link')
        )
        for publisher in maps:
            publisher.publish(to_occupancy_grid(occupancy, geometry, stamp=stamp, frame_id='map'))
        wait_for(lambda: len(plans) >= stamp - 4)  # noqa: B023 - called at once
    wait_for(lambda: 'publishers, one is expected' in node.output)
    wait_for(lambda: to_nanoseconds(plans[-1].header.stamp) == 6)
    latched = late.record(Path, 'plan', MAP_QOS)
    wait_for(lambda: latched)
    assert latched[0] == plans[-1]
    node.assert_alive()


def test_gives_up_with_a_verdict(node_process: StartNode, probe: Probe) -> None:
    """In a closed room the planner says 'exhausted' on `episode` and sends nothing."""
    node_process(PLANNER).wait_output(READY)
    maps = probe.publisher(OccupancyGrid, 'map', MAP_QOS)
    poses = probe.publisher(Odometry, 'odom', RELIABLE_QOS)
    episode = probe.record(DiagnosticStatus, 'episode', EPISODE_QOS)
    plans = probe.record(Path, 'plan', MAP_QOS)
    actions = probe.record(UInt8, 'action', RELIABLE_QOS)
    occupancy = np.full((5, 5), 100, dtype=np.int8)
    occupancy[1:4, 1:4] = 0
    geometry = GridGeometry(5, 5, 1.0)
    maps.publish(to_occupancy_grid(occupancy, geometry, stamp=5, frame_id='map'))
    poses.publish(to_odometry(2.5, 2.5, stamp=5, frame_id='odom', child_frame_id='base_link'))
    wait_for(lambda: episode and plans)
    assert (episode[0].name, episode[0].message) == ('vgdp_planner', 'exhausted')
    assert not plans[0].poses
    assert not actions


REAL = {'pose_source': 'amcl_pose', 'robot_radius': 0.2, 'planning_resolution': 0.4}
"""Parameters for a robot that moves by itself."""


def on_map(stamp: int, x: float, y: float) -> PoseWithCovarianceStamped:
    """Build a pose as AMCL does, half a metre sure."""
    message = PoseWithCovarianceStamped(header=header(stamp, 'map'))
    message.pose.pose = to_pose(x, y)
    message.pose.covariance = np.diag([0.1, 0.1, 0, 0, 0, 0.1]).ravel()
    return message


def test_a_real_robot(node_process: StartNode, probe: Probe) -> None:
    """A SLAM's map and AMCL's pose of other stamps make a plan in metres, said again and again."""
    node = node_process(PLANNER, REAL)
    node.wait_output(READY)
    maps = probe.publisher(OccupancyGrid, 'map', MAP_QOS)
    poses = probe.publisher(PoseWithCovarianceStamped, 'amcl_pose', MAP_QOS)
    goals = probe.publisher(PoseStamped, 'goal_pose', MAP_QOS)
    plans = probe.record(Path, 'plan', MAP_QOS)
    waypoints = probe.record(PoseStamped, 'waypoint', RELIABLE_QOS)
    values = probe.record(OccupancyGrid, 'value_map', MARKER_QOS)
    actions = probe.record(UInt8, 'action', RELIABLE_QOS)
    wait_for(lambda: probe.node.count_publishers('value_map') > 0)
    # A room of 6 m by 4 m with a wall, seen but for its right end.
    occupancy = np.full((80, 100), 3, dtype=np.int8)
    occupancy[[0, -1]] = occupancy[:, 0] = 97
    occupancy[:50, 50] = 80
    geometry = GridGeometry(80, 100, 0.05, -7.3, 2.15)
    maps.publish(to_occupancy_grid(occupancy, geometry, stamp=5, frame_id='map'))
    poses.publish(on_map(900, -6.0, 3.0))
    wait_for(lambda: len(plans) > 2 and values)
    assert {to_nanoseconds(plan.header.stamp) for plan in plans} == {900}
    blocked = inflate(occupancy >= 50, 4)
    for pose in plans[0].poses:
        cell = geometry.cell_at(pose.pose.position.x, pose.pose.position.y)
        assert not blocked[cell]
    first = plans[0].poses[0].pose.position
    assert (first.x, first.y) == pytest.approx((-6.0, 3.0), abs=0.05)
    assert values[0].info.resolution == pytest.approx(0.4)
    # Whoever joins late may have missed the plan that a waypoint belongs to.
    wait_for(
        lambda: any(
            waypoint.pose.position in [pose.pose.position for pose in plan.poses]
            for waypoint in waypoints
            for plan in plans
        )
    )
    assert not actions

    # Behind the wall, and a path there on request.
    goals.publish(to_pose_stamped(-3.0, 3.0, stamp=901, frame_id='map'))
    goal = to_pose_stamped(-3.0, 3.0, 1.0, stamp=1, frame_id='map')
    path = probe.call(GetPlan, 'vgdp_planner/get_plan', GetPlan.Request(goal=goal)).plan
    last = path.poses[-1].pose
    assert (last.position.x, last.position.y) == pytest.approx((-3.0, 3.0), abs=0.05)
    assert last.orientation == goal.pose.orientation
    assert max(pose.pose.position.y for pose in path.poses) > 2.15 + 2.5
    for start, code in ((40.0, 'START_OUTSIDE_MAP'), (-7.28, '')):
        begin = to_pose_stamped(start, 3.0, stamp=1, frame_id='map')
        request = GetPlan.Request(start=begin, goal=goal)
        answer = probe.call(GetPlan, 'vgdp_planner/get_plan', request).plan
        assert bool(answer.poses) == (not code)
        assert code in node.output
    node.assert_alive()


def test_a_map_before_the_word_of_its_episode(node_process: StartNode, probe: Probe) -> None:
    """Is planned on once more: a world that waits for the robot does not say it again."""
    node_process(PLANNER, {**REAL, 'pose_source': 'odom'}).wait_output(READY)
    maps = probe.publisher(OccupancyGrid, 'map', MAP_QOS)
    poses = probe.publisher(Odometry, 'odom', RELIABLE_QOS)
    episode = probe.publisher(DiagnosticStatus, 'episode', EPISODE_QOS)
    waypoints = probe.record(PoseStamped, 'waypoint', RELIABLE_QOS)
    wait_for(lambda: probe.node.count_publishers('waypoint') > 0)
    occupancy = np.full((40, 40), -1, dtype=np.int8)
    occupancy[:30] = 0
    geometry = GridGeometry(40, 40, 0.1)
    maps.publish(to_occupancy_grid(occupancy, geometry, stamp=5, frame_id='map'))
    poses.publish(to_odometry(2.0, 2.0, stamp=6, frame_id='odom', child_frame_id='base_link'))
    wait_for(lambda: len(waypoints) == 1)
    episode.publish(EpisodeStatus('maze_sim', 'running', 4).to_message())
    wait_for(lambda: len(waypoints) == 2)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('busy', [False, True])
def test_signals_end_it_quietly(
    node_process: StartNode, probe: Probe, number: int, *, busy: bool
) -> None:
    """SIGINT and SIGTERM, idle and in mid-episode: exit code 0, nothing on stderr, in time."""
    if busy:
        actions = probe.record(UInt8, 'action', RELIABLE_QOS)
        node = start_loop(node_process, seed=4, size=31)[PLANNER]
        wait_for(lambda: len(actions) > 5, 60)
    else:
        node = node_process(PLANNER)
        node.wait_output(READY)
        time.sleep(0.3)
    assert node.end(number) < 2.0


@pytest.mark.parametrize(
    ('parameters', 'named'),
    [
        ({'weights': '/nowhere'}, 'nowhere'),
        ({'device': 'abacus'}, 'abacus'),
        ({'threads': 0}, 'threads'),
        ({'action_timeout': -1.0}, 'action_timeout'),
        ({'pose_source': 'gps'}, 'pose_source'),
        ({'robot_radius': -0.1}, 'robot_radius'),
    ],
)
def test_bad_parameters_are_named(
    node_process: StartNode, parameters: dict[str, object], named: str
) -> None:
    """A wrong parameter ends the start with one sentence that names it."""
    node = node_process(PLANNER, parameters)
    assert node.process.wait(30) == 1
    assert named in node.output
    assert 'Traceback' not in node.output
