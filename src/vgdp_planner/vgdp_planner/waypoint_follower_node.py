"""The node ``waypoint_follower``: drives a robot with two driven wheels along ``plan``."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.duration import Duration

from gridnav.ros.conversions import from_occupancy_grid, header
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.poses import SOURCES, PoseSource
from gridnav.ros.qos import MAP_QOS, RELIABLE_QOS
from gridnav.ros.run import run_node
from gridnav.ros.validation import validate_occupancy_grid, validate_path
from vgdp_planner.follower import Command, FollowerSettings, PathFollower

if TYPE_CHECKING:
    from gridnav.pose import PoseEstimate

LAST_WORD_S = 0.5
"""How long the last stop may take to arrive before the process ends all the same."""

STOP = Command(0.0, 0.0, 'no plan')


@dataclass
class FollowerParameters:
    """Parameters of the node."""

    rate: float = parameter(
        20.0,
        'Commands in a second, one for each pose at most',
        unit='Hz',
        low=1.0,
        high=200.0,
        read_only=True,
    )
    stamped: bool = parameter(
        default=False, description='Whether cmd_vel is a TwistStamped', read_only=True
    )
    max_speed: float = parameter(0.4, 'Most that it drives', unit='m/s', low=0.01, high=10.0)
    max_turn_rate: float = parameter(1.0, 'Most that it turns', unit='rad/s', low=0.01, high=10.0)
    max_acceleration: float = parameter(
        1.0, 'Most that it gains speed; braking is not limited', unit='m/s²', low=0.01, high=50.0
    )
    lookahead: float = parameter(
        0.4, 'How far ahead on the plan the robot heads for', unit='m', low=0.01, high=10.0
    )
    turn_first: float = parameter(
        0.6,
        'Where the plan lies further to the side than this, the robot turns on the spot',
        unit='rad',
        low=0.05,
        high=1.5,
    )
    goal_tolerance: float = parameter(
        0.1, 'A plan ends this near to its last pose', unit='m', low=0.01, high=5.0
    )
    stop_distance: float = parameter(
        0.6, 'As far ahead on the plan the newest map must be clear', unit='m', low=0.0, high=20.0
    )
    robot_radius: float = parameter(
        0.0,
        "No obstacle may come nearer to the plan than this; a little less than the planner's",
        unit='m',
        low=0.0,
        high=10.0,
        read_only=True,
    )
    plan_timeout: float = parameter(
        2.0, 'A plan that was not said again for this long is stale', unit='s', low=0.1, high=600.0
    )
    pose_timeout: float = parameter(
        1.0, 'Without a pose for this long the robot stops', unit='s', low=0.05, high=600.0
    )
    pose_source: str = parameter(
        'odom', "Where the robot's pose comes from", choices=SOURCES, read_only=True
    )
    map_frame: str = parameter('map', 'Frame of plan and map', read_only=True)
    odom_frame: str = parameter(
        'odom',
        "Frame of odom; but with the pose source 'amcl_pose' taken to be where the map frame is",
        read_only=True,
    )
    base_frame: str = parameter(
        'base_link', 'Frame of the robot, also that of a TwistStamped', read_only=True
    )


class WaypointFollowerNode(BaseNode[FollowerParameters]):
    """Sends commands while there is a fresh plan, and stops when there is a reason to."""

    def __init__(self) -> None:
        """Start the node.

        Raises:
            ParameterError: If a parameter can't be used.
            ValueError: If the pose source is 'tf' where tf2_ros is not installed.
        """
        super().__init__('waypoint_follower', FollowerParameters)
        p = self.parameters
        self._follower = PathFollower(self._settings())
        self._estimate: PoseEstimate | None = None
        self._heard_pose = self._heard_plan = time.monotonic()
        self._answered: PoseEstimate | None = None
        self._reason = ''
        self._silent = True
        self._cmd_vel = self.advertise(
            TwistStamped if p.stamped else Twist, 'cmd_vel', RELIABLE_QOS
        )
        self.subscribe(
            Path,
            'plan',
            self._on_plan,
            MAP_QOS,
            validate=partial(validate_path, frames=(p.map_frame,)),
        )
        self.subscribe(
            OccupancyGrid,
            'map',
            self._on_map,
            MAP_QOS,
            validate=partial(validate_occupancy_grid, frames=(p.map_frame,)),
        )
        self._poses = PoseSource(
            self,
            p.pose_source,
            self._on_pose,
            map_frame=p.map_frame,
            odom_frame=p.odom_frame,
            base_frame=p.base_frame,
        )
        self.create_timer(1 / p.rate, self._on_tick)
        self.diagnostics.report(DiagnosticStatus.OK, 'waiting for a plan')
        self.get_logger().info(f'Following plan at {p.max_speed} m/s and less.')

    def _settings(self) -> FollowerSettings:
        p = self.parameters
        return FollowerSettings(
            max_speed=p.max_speed,
            max_turn_rate=p.max_turn_rate,
            max_acceleration=p.max_acceleration,
            lookahead=p.lookahead,
            turn_first=p.turn_first,
            goal_tolerance=p.goal_tolerance,
            stop_distance=p.stop_distance,
            robot_radius=p.robot_radius,
        )

    def _on_plan(self, message: Path) -> None:
        self._heard_plan = time.monotonic()
        positions = [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]
        self._follower.set_path(np.array(positions).reshape(-1, 2))

    def _on_map(self, message: OccupancyGrid) -> None:
        self._follower.set_map(*from_occupancy_grid(message))

    def _on_pose(self, estimate: PoseEstimate) -> None:
        self._estimate = estimate
        self._heard_pose = time.monotonic()

    def _on_tick(self) -> None:
        """Send the next command; one stop, and then nothing, where there is no fresh plan."""
        command = self._command()
        if command.reason != self._reason:
            self._reason = command.reason
            level = DiagnosticStatus.WARN if 'stale' in command.reason else DiagnosticStatus.OK
            self.diagnostics.report(level, command.reason)
        self.diagnostics.count(f'commands: {command.reason}')
        if command.reason == 'no plan' or 'stale' in command.reason:
            if not self._silent:
                self._silent = True
                self._send(command)
            return
        self._silent = False
        if self._answered is self._estimate and command.reason in ('driving', 'turning'):
            # Steering again by the same pose would count the way since then twice.
            return
        self._answered = self._estimate
        self._send(command)

    def _command(self) -> Command:
        p, now = self.parameters, time.monotonic()
        if now - self._heard_plan > p.plan_timeout:
            self._follower.stop()
            return Command(0.0, 0.0, 'stale plan')
        if self._estimate is None or now - self._heard_pose > p.pose_timeout:
            return Command(0.0, 0.0, 'stale pose')
        self._follower.settings = self._settings()
        return self._follower.command(self._estimate.pose, 1 / p.rate)

    def _send(self, command: Command) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z = float(command.speed), float(command.turn_rate)
        if self.parameters.stamped:
            stamp = self.get_clock().now().nanoseconds
            frame = self.parameters.base_frame
            self._cmd_vel.publish(TwistStamped(header=header(stamp, frame), twist=twist))
        else:
            self._cmd_vel.publish(twist)

    def destroy_node(self) -> None:
        """Stop the robot, wait until it has heard so, and end the node."""
        self._send(STOP)
        self._cmd_vel.wait_for_all_acked(Duration(seconds=LAST_WORD_S))
        super().destroy_node()


def main() -> int:
    """Run the node; the executable ``waypoint_follower_node``."""
    return run_node(WaypointFollowerNode)


if __name__ == '__main__':
    sys.exit(main())
