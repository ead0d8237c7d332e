"""The follower node over real DDS, and a robot with wheels that explores a maze with it."""

from __future__ import annotations

import bisect
import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from tests.ros_helpers import wait_for

from gridnav import GridGeometry
from gridnav.ros.conversions import (
    from_occupancy_grid,
    header,
    to_nanoseconds,
    to_occupancy_grid,
    to_odometry,
    to_path_of_points,
)
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, RELIABLE_QOS
from vgdp_planner.ways import inflate

if TYPE_CHECKING:
    from tests.ros_helpers import NodeProcess, Probe, StartNode

FOLLOWER = 'vgdp_planner.waypoint_follower_node'
PLANNER = 'vgdp_planner.node'
SIM = 'maze_sim.kinematic_node'

POINTS = [(0.05 * step, 0.0) for step in range(60)]


class Robot:
    """Stands at the origin and says so until it is told to be silent."""

    def __init__(self, probe: Probe, message_type: type = Twist) -> None:
        """Connect to a follower."""
        self.commands: list[Any] = probe.record(message_type, 'cmd_vel', RELIABLE_QOS)
        self.plans = probe.publisher(Path, 'plan', MAP_QOS)
        self.maps = probe.publisher(OccupancyGrid, 'map', MAP_QOS)
        poses = probe.publisher(Odometry, 'odom', RELIABLE_QOS)
        odom = to_odometry(0.0, 0.0, stamp=1, frame_id='odom', child_frame_id='base_link')
        self.timer = probe.node.create_timer(0.05, lambda: poses.publish(odom))
        wait_for(lambda: probe.node.count_publishers('cmd_vel') > 0)

    def go(self, points: list[tuple[float, float]] | None = None) -> None:
        """Send a plan."""
        path = to_path_of_points(points or POINTS, stamp=5, frame_id='map')
        self.plans.publish(path)

    def drives(self) -> bool:
        """Tell whether the latest command is to drive."""
        return bool(self.commands) and self.commands[-1].linear.x > 0


def follower(node_process: StartNode, **parameters: object) -> NodeProcess:
    """Start a follower."""
    node = node_process(FOLLOWER, {'plan_timeout': 60.0, 'pose_timeout': 60.0, **parameters})
    node.wait_output('Following plan')
    return node


def test_it_drives_and_stops_when_it_is_told_to_end(node_process: StartNode, probe: Probe) -> None:
    """The last command before the process ends is to stand."""
    node = follower(node_process)
    robot = Robot(probe)
    robot.go()
    wait_for(robot.drives)
    node.end()
    wait_for(lambda: not robot.drives())
    last = robot.commands[-1]
    assert (last.linear.x, last.angular.z) == (0.0, 0.0)


def test_it_stops_on_a_stale_plan(node_process: StartNode, probe: Probe) -> None:
    """Once, and then it is silent, so that somebody else may drive."""
    follower(node_process, plan_timeout=1.5)
    robot = Robot(probe)
    robot.go()
    wait_for(robot.drives)
    wait_for(lambda: not robot.drives())
    count = len(robot.commands)
    time.sleep(0.3)
    assert len(robot.commands) == count
    robot.go()
    wait_for(robot.drives)


def test_it_stops_without_a_pose(node_process: StartNode, probe: Probe) -> None:
    """A robot that does not know where it is stands."""
    follower(node_process, pose_timeout=1.5)
    robot = Robot(probe)
    robot.go()
    wait_for(robot.drives)
    robot.timer.cancel()
    wait_for(lambda: not robot.drives())


def test_it_stops_on_an_obstacle_in_the_newest_map(node_process: StartNode, probe: Probe) -> None:
    """And goes on when a newer one is clear; bad maps and plans are survived."""
    node = follower(node_process, robot_radius=0.2)
    robot = Robot(probe)
    geometry = GridGeometry(60, 120, 0.05, -1.0, -1.5)
    occupancy = np.zeros((60, 120), dtype=np.int8)
    occupancy[geometry.cell_at(0.5, 0.1)] = 100
    robot.go()
    wait_for(robot.drives)
    robot.maps.publish(to_occupancy_grid(occupancy, geometry, stamp=7, frame_id='map'))
    wait_for(lambda: not robot.drives())
    cut = to_occupancy_grid(occupancy, geometry, stamp=8, frame_id='map')
    cut.data = cut.data[:-1]
    robot.maps.publish(cut)
    robot.go([(math.nan, 0.0)])
    robot.plans.publish(Path(header=header(9, 'moon')))
    occupancy[:] = 0
    robot.maps.publish(to_occupancy_grid(occupancy, geometry, stamp=9, frame_id='map'))
    wait_for(robot.drives)
    robot.plans.publish(Path(header=header(9, 'map')))
    wait_for(lambda: not robot.drives())
    node.assert_alive()


def test_stamped_commands(node_process: StartNode, probe: Probe) -> None:
    """By a parameter, in the robot's frame."""
    follower(node_process, stamped=True, base_frame='base')
    robot = Robot(probe, TwistStamped)
    robot.go()
    wait_for(lambda: robot.commands and robot.commands[-1].twist.linear.x > 0)
    assert robot.commands[-1].header.frame_id == 'base'
    assert robot.commands[-1].header.stamp.sec > 0


@pytest.mark.parametrize(
    ('parameters', 'named'),
    [({'rate': 0.0}, 'rate'), ({'pose_source': 'gps'}, 'pose_source')],
)
def test_bad_parameters_are_named(
    node_process: StartNode, parameters: dict[str, object], named: str
) -> None:
    """A wrong parameter ends the start with one sentence that names it."""
    node = node_process(FOLLOWER, parameters)
    assert node.process.wait(60) == 1
    assert named in node.output
    assert 'Traceback' not in node.output


def explore(node_process: StartNode, probe: Probe, size: int, seed: int, timeout: float) -> None:
    """Let a robot with drifting odometry explore a maze until it stands at the goal.

    Time passes with each command, so that a busy machine changes nothing but how long it takes.
    """
    episode = probe.record(DiagnosticStatus, 'episode', EPISODE_QOS)
    plans = probe.record(Path, 'plan', MAP_QOS)
    maps = probe.record(OccupancyGrid, 'map', MAP_QOS)
    source = {'pose_source': 'amcl_pose'}
    planner = node_process(
        PLANNER,
        {'robot_radius': 0.25, 'planning_resolution': 1.0, 'action_timeout': 20.0, **source},
    )
    node_process(
        FOLLOWER,
        {
            'rate': 80.0,
            'max_speed': 0.8,
            'max_turn_rate': 2.0,
            'robot_radius': 0.2,
            'plan_timeout': 30.0,
            'pose_timeout': 30.0,
            **source,
        },
    ).wait_output('Following plan')
    planner.wait_output('Planning with')
    node_process(SIM, {'size': size, 'seed': seed, 'radius': 0.15, 'command_step': 0.05})
    wait_for(lambda: episode and episode[-1].message != 'running', timeout)
    assert episode[-1].message == 'success'
    assert len(plans) > 3
    # Every pose of every plan keeps off what was known then. A plan has the stamp of the newest of
    # map and pose, so it was made on the latest map of no later stamp, or on the one before where
    # the pose of that stamp was faster.
    stamps = [to_nanoseconds(message.header.stamp) for message in maps]
    for plan in plans:
        latest = bisect.bisect_right(stamps, to_nanoseconds(plan.header.stamp)) - 1
        assert any(keeps_off(plan, message) for message in maps[max(latest - 1, 0) : latest + 1])


def keeps_off(plan: Path, message: OccupancyGrid) -> bool:
    """Tell whether no pose of a plan is nearer than 0.25 m to an obstacle on a map."""
    occupancy, geometry = from_occupancy_grid(message)
    blocked = inflate(occupancy >= 50, 0.25 / geometry.resolution)
    cells = [geometry.cell_at(p.pose.position.x, p.pose.position.y) for p in plan.poses]
    return not any(blocked[cell] for cell in cells if geometry.contains(*cell))


@pytest.mark.timeout(240)
def test_a_robot_explores_a_small_maze(node_process: StartNode, probe: Probe) -> None:
    """And reaches the goal without touching a wall."""
    explore(node_process, probe, 9, 1, 150)


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize('seed', [0, 1])
def test_a_robot_explores_a_maze(node_process: StartNode, probe: Probe, seed: int) -> None:
    """Fifteen cells a side."""
    explore(node_process, probe, 15, seed, 300)
