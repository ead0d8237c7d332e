"""The node ``kinematic_sim``: a robot with wheels in a maze, driven by ``cmd_vel``."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry

from gridnav.metrics import Outcome
from gridnav.ros.conversions import (
    header,
    to_occupancy_grid,
    to_odometry,
    to_pose,
    to_pose_stamped,
)
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, RELIABLE_QOS
from gridnav.ros.run import run_node
from gridnav.ros.tf import FrameBroadcaster
from gridnav.ros.validation import InvalidMessage
from maze_sim.kinematic import KinematicSimulation, RobotConfig
from maze_sim.worlds import make_mazes

SOURCE = 'maze_sim'
"""Who speaks on ``episode``."""

TICK_S = 0.05
"""So often the robot moves in real time and says where it is."""

COMMAND_LIFE_S = 0.5
"""A robot that hears no command for this long stops, and says again where it is."""


@dataclass
class KinematicParameters:
    """Parameters of the node; those of robot and maze take effect with the next episode."""

    size: int = parameter(15, 'Side of the maze', unit='cells', low=9, high=201)
    seed: int = parameter(
        0, 'Seed of the maze, start, goal and noise; each reset adds 1', low=0, high=2**31 - 1
    )
    cell_size: float = parameter(1.0, 'Side of a cell of the maze', unit='m', low=0.1, high=100.0)
    map_resolution: float = parameter(
        0.05, 'Side of a cell of the map', unit='m', low=0.005, high=10.0
    )
    radius: float = parameter(0.2, 'Radius of the robot', unit='m', low=0.01, high=50.0)
    max_speed: float = parameter(1.0, 'Most that it drives', unit='m/s', low=0.01, high=20.0)
    max_turn_rate: float = parameter(2.0, 'Most that it turns', unit='rad/s', low=0.01, high=20.0)
    view_range: float = parameter(
        3.0, 'How far its range finder reaches', unit='m', low=0.1, high=200.0
    )
    odometry_noise: float = parameter(
        0.02, 'Standard deviation of its odometry after a metre', unit='m', low=0.0, high=1.0
    )
    pose_noise: float = parameter(
        0.01, 'Standard deviation of amcl_pose in x and in y', unit='m', low=0.0, high=10.0
    )
    max_time: float = parameter(
        600.0, 'Simulated time after which the episode ends', unit='s', low=1.0, high=1e6
    )
    map_period: float = parameter(
        0.25, 'Simulated time between two maps', unit='s', low=0.01, high=60.0
    )
    command_step: float = parameter(
        0.0,
        'Simulated time that passes with each cmd_vel; 0 for real time',
        unit='s',
        low=0.0,
        high=1.0,
        read_only=True,
    )
    stamped: bool = parameter(
        default=False, description='Whether cmd_vel is a TwistStamped', read_only=True
    )
    map_frame: str = parameter('map', 'Frame of map, amcl_pose and goal_pose', read_only=True)
    odom_frame: str = parameter('odom', 'Frame of odom, which drifts', read_only=True)
    base_frame: str = parameter('base_link', 'Frame of the robot', read_only=True)


class KinematicNode(BaseNode[KinematicParameters]):
    """Drives as it is told and publishes what the robot's sensors and its SLAM would."""

    def __init__(self) -> None:
        """Start the node with its first episode.

        Raises:
            ParameterError: If a parameter can't be used.
        """
        super().__init__('kinematic_sim', KinematicParameters)
        p = self.parameters
        self._stamp = -1
        self._episodes = 0
        self._episode = self.advertise(DiagnosticStatus, 'episode', EPISODE_QOS)
        self._goal_pose = self.advertise(PoseStamped, 'goal_pose', MAP_QOS)
        self._odom = self.advertise(Odometry, 'odom', RELIABLE_QOS)
        self._fix = self.advertise(PoseWithCovarianceStamped, 'amcl_pose', MAP_QOS)
        self._map = self.advertise(OccupancyGrid, 'map', MAP_QOS)
        self._frames = FrameBroadcaster(self)
        self._begin_episode()
        self.subscribe(
            TwistStamped if p.stamped else Twist, 'cmd_vel', self._on_command, RELIABLE_QOS
        )
        self.provide_reset(self._reset)
        self.create_timer(TICK_S, self._on_tick)

    def _begin_episode(self) -> None:
        p = self.parameters
        self._seed = p.seed + self._episodes
        self._episodes += 1
        robot = RobotConfig(
            p.radius, p.max_speed, p.max_turn_rate, p.view_range, p.odometry_noise, p.pose_noise
        )
        self._simulation = KinematicSimulation(
            make_mazes(1, p.size, self._seed)[0],
            p.cell_size,
            p.map_resolution,
            robot,
            max_time=p.max_time,
            seed=self._seed,
        )
        self._command = (0.0, 0.0)
        self._command_ends = -math.inf
        self._goal_published = False
        self._next_map = 0.0
        self._start = self._next_stamp()
        self._publish_episode()
        self._publish_state()
        self.get_logger().info(f'Episode with seed {self._seed}: drive by cmd_vel.')

    def _reset(self) -> str:
        self._begin_episode()
        return f'A new episode with seed {self._seed} has begun.'

    def _on_command(self, message: Any) -> None:  # noqa: ANN401 - Twist or TwistStamped
        twist = message.twist if self.parameters.stamped else message
        command = (twist.linear.x, twist.angular.z)
        if not all(math.isfinite(value) for value in command):
            msg = f'It is not finite {command}.'
            raise InvalidMessage(msg)
        self._command = command
        self._command_ends = self._seconds() + COMMAND_LIFE_S
        if self.parameters.command_step > 0:
            self._drive(self.parameters.command_step)

    def _on_tick(self) -> None:
        idle = self._seconds() > self._command_ends
        if self.parameters.command_step > 0:
            if idle:
                self._publish_state()
            return
        if idle:
            self._command = (0.0, 0.0)
        self._drive(TICK_S)

    def _seconds(self) -> float:
        return float(self.get_clock().now().nanoseconds) / 1e9

    def _drive(self, duration: float) -> None:
        """Drive for a while by the latest command and say what came of it."""
        was_running = self._simulation.outcome is Outcome.RUNNING
        self._simulation.drive(*self._command, duration)
        self._publish_state()
        if was_running and self._simulation.outcome is not Outcome.RUNNING:
            self._publish_episode()
            self.get_logger().info(
                f'Episode with seed {self._seed} ended in {self._simulation.outcome} after '
                f'{self._simulation.time:.1f} s and {self._simulation.distance:.1f} m.'
            )

    def _next_stamp(self) -> int:
        self._stamp = max(self.get_clock().now().nanoseconds, self._stamp + 1)
        return self._stamp

    def _publish_episode(self) -> None:
        p, simulation = self.parameters, self._simulation
        values = {
            'seed': self._seed,
            'size': p.size,
            'cell_size': p.cell_size,
            'time': f'{simulation.time:.3f}',
            'distance': f'{simulation.distance:.3f}',
        }
        texts = {key: str(value) for key, value in values.items()}
        status = EpisodeStatus(SOURCE, simulation.outcome, self._start, texts)
        self._episode.publish(status.to_message())
        fine = simulation.outcome in (Outcome.RUNNING, Outcome.SUCCESS)
        level = DiagnosticStatus.OK if fine else DiagnosticStatus.WARN
        self.diagnostics.report(level, f'seed {self._seed}: {simulation.outcome}')

    def _publish_state(self) -> None:
        """Publish odometry, and when it is time map, pose on it and goal."""
        p, simulation = self.parameters, self._simulation
        stamp = self._next_stamp()
        self._odom.publish(
            to_odometry(
                *simulation.odometry,
                stamp=stamp,
                frame_id=p.odom_frame,
                child_frame_id=p.base_frame,
            )
        )
        drift = simulation.pose.compose(simulation.odometry.inverse())
        self._frames.send(stamp, p.map_frame, p.odom_frame, *drift)
        self._frames.send(stamp, p.odom_frame, p.base_frame, *simulation.odometry)
        if simulation.time < self._next_map:
            return
        self._next_map = simulation.time + p.map_period
        simulation.look()
        occupancy, geometry = simulation.map()
        self._map.publish(
            to_occupancy_grid(occupancy, geometry, stamp=stamp, frame_id=p.map_frame)
        )
        estimate = simulation.fix(stamp)
        fix = PoseWithCovarianceStamped(header=header(stamp, p.map_frame))
        fix.pose.pose = to_pose(*estimate.pose)
        covariance = np.zeros((6, 6))
        covariance[:2, :2] = estimate.covariance
        fix.pose.covariance = covariance.ravel()
        self._fix.publish(fix)
        if simulation.goal_seen and not self._goal_published:
            self._goal_published = True
            self._goal_pose.publish(
                to_pose_stamped(*simulation.goal, stamp=stamp, frame_id=p.map_frame)
            )


def main() -> int:
    """Run the node; the executable ``kinematic_node``."""
    return run_node(KinematicNode)


if __name__ == '__main__':
    sys.exit(main())
