"""The node ``maze_sim``: one robot in a maze, driven by ``action``."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from std_msgs.msg import UInt8

from gridnav.actions import DONE
from gridnav.grid import GridGeometry
from gridnav.metrics import Outcome
from gridnav.ros.conversions import (
    NANOSECONDS,
    to_occupancy_grid,
    to_odometry,
    to_pose_stamped,
)
from gridnav.ros.episode import PLANNER_GAVE_UP, EpisodeStatus
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, RELIABLE_QOS
from gridnav.ros.run import run_node
from gridnav.ros.tf import FrameBroadcaster
from gridnav.ros.validation import MAX_RESOLUTION_M, MIN_RESOLUTION_M, InvalidMessage
from maze_sim.simulation import MazeSimulation
from maze_sim.worlds import WORLD_KINDS, Worlds

SOURCE = 'maze_sim'
"""Who speaks on ``episode``."""

X_X, Y_Y = 0, 7
"""Where the variances of x and y are in the 6 x 6 covariance of a pose."""

MIN_SIDE = 9
"""Smaller worlds have no start and goal that are 15 steps apart."""

MAX_QUEUED = 1000
"""More actions than this never wait for their turn."""


@dataclass
class MazeSimParameters:
    """Parameters of the node; those of the maze take effect with the next episode."""

    size: int = parameter(15, 'Side of the world', unit='cells', low=MIN_SIDE, high=201)
    rows: int = parameter(
        0, 'Rows of the world where it is not square; 0 for size', unit='cells', low=0, high=201
    )
    cols: int = parameter(
        0, 'Columns of the world where it is not square; 0 for size', unit='cells', low=0, high=201
    )
    kind: str = parameter('maze', 'Kind of the world', choices=WORLD_KINDS)
    map_file: str = parameter(
        '',
        'Map of a map server (YAML) to use as the world; where it lies and the side of its cells '
        'are those of the map; none if empty',
    )
    min_expert_steps: int = parameter(
        15, 'Steps from start to goal for one who knows the world, at least', low=1, high=100_000
    )
    reachable: bool = parameter(
        True,  # noqa: FBT003
        'Whether a way leads to the goal; if not, there is a wall between start and goal',
    )
    view_range: int = parameter(
        2, 'How far a view reaches to each side', unit='cells', low=1, high=20
    )
    seed: int = parameter(
        0,
        'Seed of the maze, start and goal; each reset adds 1 until it is set again',
        low=0,
        high=2**31 - 1,
    )
    max_steps: int = parameter(500, 'Actions after which the episode ends', low=1, high=1_000_000)
    slip: float = parameter(
        0.0,
        'Probability that a step ends beside the cell it should reach, or where it began',
        low=0.0,
        high=1.0,
    )
    pose_noise: float = parameter(
        0.0,
        'Standard deviation of the pose in odom; local_map is still placed where the robot is',
        unit='cells',
        low=0.0,
        high=100.0,
    )
    rate: float = parameter(
        0.0,
        'Actions executed in a second; 0 executes each at once',
        unit='Hz',
        low=0.0,
        high=1000.0,
    )
    resolution: float = parameter(
        1.0,
        'Side of a cell',
        unit='m',
        low=MIN_RESOLUTION_M,
        high=MAX_RESOLUTION_M,
        read_only=True,
    )
    observation_period: float = parameter(
        0.5,
        'The latest observation is published again after this time without a new one',
        unit='s',
        low=0.01,
        high=60.0,
        read_only=True,
    )
    map_frame: str = parameter('map', 'Frame of local_map and goal_pose', read_only=True)
    odom_frame: str = parameter('odom', 'Frame of odom, the same place as map', read_only=True)
    base_frame: str = parameter('base_link', 'Frame of the robot', read_only=True)

    def __post_init__(self) -> None:
        """Refuse a side that is neither left to ``size`` nor long enough."""
        for name, side in (('rows', self.rows), ('cols', self.cols)):
            if 0 < side < MIN_SIDE:
                msg = f'Parameter {name!r} must be 0 or {MIN_SIDE} to 201 cells, got {side}.'
                raise ValueError(msg)

    def worlds(self) -> Worlds:
        """Return what the worlds are drawn from."""
        return Worlds(
            (self.rows or self.size, self.cols or self.size),
            self.kind,
            map_file=self.map_file,
            min_expert_steps=self.min_expert_steps,
            reachable=self.reachable,
        )


class MazeSimNode(BaseNode[MazeSimParameters]):
    """Executes actions in a maze and publishes what the robot sees."""

    def __init__(self) -> None:
        """Start the node with its first episode.

        Raises:
            ParameterError: If a parameter can't be used.
        """
        super().__init__('maze_sim', MazeSimParameters)
        self._actions: deque[int] = deque()
        self._stamp = -1
        self._base_seed = self.parameters.seed
        self._episodes = 0

        self._episode = self.advertise(DiagnosticStatus, 'episode', EPISODE_QOS)
        self._goal_pose = self.advertise(PoseStamped, 'goal_pose', MAP_QOS)
        self._odom = self.advertise(Odometry, 'odom', RELIABLE_QOS)
        self._local_map = self.advertise(OccupancyGrid, 'local_map', RELIABLE_QOS)
        self._frames = FrameBroadcaster(self)

        self._pace = self.create_timer(1.0, self._on_pace)
        self._pace.cancel()
        self._repeat = self.create_timer(
            self.parameters.observation_period, self._publish_observation
        )
        self._begin_episode()
        self.subscribe(
            DiagnosticStatus, 'episode', self._on_episode, EPISODE_QOS, single_source=False
        )
        self.subscribe(UInt8, 'action', self._on_action, RELIABLE_QOS)
        self.provide_reset(self._reset)

    def _begin_episode(self) -> None:
        """Draw a maze, put the robot on its start and say so."""
        p = self.parameters
        if p.seed != self._base_seed:
            self._base_seed, self._episodes = p.seed, 0
        seed = self._base_seed + self._episodes
        worlds = p.worlds()
        maze = worlds.sample(np.random.default_rng([seed, 0]))
        simulation = MazeSimulation(
            [maze],
            p.view_range,
            p.max_steps,
            slip=p.slip,
            pose_noise=p.pose_noise,
            seeds=[[seed, 1]],
        )
        self._episodes += 1
        self._seed = seed
        self._simulation = simulation
        self._geometry = worlds.geometry
        if not p.map_file:
            self._geometry = replace(worlds.geometry, resolution=p.resolution)
        self._actions.clear()
        self._pace.cancel()
        self._yaw = 0.0
        self._goal_published = False
        self._advance_stamp()
        self._start = self._stamp
        self._publish_episode()
        self._publish_step()
        rows, cols = self._geometry.shape
        for_expert = f'{maze.expert_steps} steps for one who knows the maze'
        if not maze.reachable:
            for_expert = 'no way to the goal'
        self.get_logger().info(
            f'Episode with seed {self._seed}: {rows} x {cols} cells, view range '
            f'{p.view_range}, {for_expert}.'
        )

    def _reset(self) -> str:
        self._begin_episode()
        return f'A new episode with seed {self._seed} has begun.'

    def _on_action(self, message: UInt8) -> None:
        if message.data > DONE:
            msg = f'An action is a number from 0 to {DONE}, got {message.data}.'
            raise InvalidMessage(msg)
        if not self._simulation.active[0]:
            self.diagnostics.count('ignored: action after the end of the episode')
            return
        if len(self._actions) >= MAX_QUEUED:
            msg = f'More than {MAX_QUEUED} actions are waiting to be executed.'
            raise InvalidMessage(msg)
        self._actions.append(message.data)
        if self._pace.is_canceled():
            self._on_pace()

    def _on_pace(self) -> None:
        """Execute the next action, or all of them when there is no pace to keep."""
        self._pace.cancel()
        while self._actions:
            self._execute(self._actions.popleft())
            if self.parameters.rate > 0:
                self._pace.timer_period_ns = round(NANOSECONDS / self.parameters.rate)
                self._pace.reset()
                return

    def _execute(self, action: int) -> None:
        """Take one step and publish what came of it."""
        began = time.perf_counter()
        before = self._simulation.cells[0].copy()
        self._simulation.step(np.array([action]))
        row_step, col_step = (self._simulation.cells[0] - before).tolist()
        if row_step or col_step:
            self._yaw = math.atan2(row_step, col_step)
        self._advance_stamp()
        if not self._simulation.active[0]:
            self._end_episode()
        self._publish_step()
        self.diagnostics.latency(time.perf_counter() - began, 'step')

    def _on_episode(self, message: DiagnosticStatus) -> None:
        """End the episode when the planner of this very episode gave up."""
        if message.name == SOURCE:
            return
        status = EpisodeStatus.from_message(message)
        gave_up = status.message in PLANNER_GAVE_UP and status.start == self._start
        if gave_up and self._simulation.active[0]:
            self._simulation.give_up(np.array([0]))
            self.get_logger().info(f'{status.source} gave up: {status.message}.')
            self._end_episode()

    def _end_episode(self) -> None:
        self._actions.clear()
        self._pace.cancel()
        self._publish_episode()
        result = self._simulation.results()[0]
        self.get_logger().info(
            f'Episode with seed {self._seed} ended in {result.outcome} after {result.steps} '
            f'actions, SPL {result.spl:.2f}.'
        )

    def _advance_stamp(self) -> None:
        """Give the next step its stamp: now, but later than all before."""
        self._stamp = max(self.get_clock().now().nanoseconds, self._stamp + 1)

    def _publish_episode(self) -> None:
        result = self._simulation.results()[0]
        values = {
            'steps': result.steps,
            'path_cost': f'{result.path_cost:.6f}',
            'expert_steps': result.expert_steps,
            'expert_cost': f'{result.expert_cost:.6f}',
            'spl': f'{result.spl:.6f}',
            'spl_steps': f'{result.spl_steps:.6f}',
            'seed': self._seed,
            'size': max(self._geometry.shape),
            'rows': self._geometry.rows,
            'cols': self._geometry.cols,
            'view_range': self._simulation.view_range,
            'max_steps': self._simulation.max_steps,
            'resolution': self._geometry.resolution,
        }
        status = EpisodeStatus(
            SOURCE, result.outcome, self._start, {key: str(v) for key, v in values.items()}
        )
        self._episode.publish(status.to_message())
        fine = result.outcome in (Outcome.RUNNING, Outcome.SUCCESS)
        level = DiagnosticStatus.OK if fine else DiagnosticStatus.WARN
        self.diagnostics.report(level, f'seed {self._seed}: {result.outcome}')

    def _publish_step(self) -> None:
        """Publish a new step: the goal if it has just come into sight, then the observation.

        The observation comes last, as it makes the planner act.
        """
        if self._simulation.goal_seen[0] and not self._goal_published:
            self._goal_published = True
            row, col = self._simulation.mazes[0].goal
            goal = to_pose_stamped(
                *self._geometry.center_of(row, col),
                stamp=self._stamp,
                frame_id=self.parameters.map_frame,
            )
            self._goal_pose.publish(goal)
        self._publish_observation()
        self._repeat.reset()
        self.diagnostics.value('steps', self._simulation.steps[0])

    def _publish_observation(self) -> None:
        """Publish where the robot stands and what it sees, as of the latest step."""
        p, stamp = self.parameters, self._stamp
        x, y = self._geometry.center_of(*self._simulation.reported_cells[0].tolist())
        self._frames.send(stamp, p.map_frame, p.odom_frame, 0.0, 0.0, 0.0)
        self._frames.send(stamp, p.odom_frame, p.base_frame, x, y, self._yaw)
        odometry = to_odometry(
            x, y, self._yaw, stamp=stamp, frame_id=p.odom_frame, child_frame_id=p.base_frame
        )
        variance = (self._simulation.pose_noise * self._geometry.resolution) ** 2
        odometry.pose.covariance[X_X] = odometry.pose.covariance[Y_Y] = variance
        self._odom.publish(odometry)
        reach = self._simulation.view_range
        row, col = self._simulation.cells[0].tolist()
        resolution = self._geometry.resolution
        geometry = GridGeometry(
            rows=2 * reach + 1,
            cols=2 * reach + 1,
            resolution=resolution,
            origin_x=self._geometry.origin_x + (col - reach) * resolution,
            origin_y=self._geometry.origin_y + (row - reach) * resolution,
        )
        window = self._simulation.windows()[0]
        self._local_map.publish(
            to_occupancy_grid(window, geometry, stamp=stamp, frame_id=p.map_frame)
        )


def main() -> int:
    """Run the node; the executable ``maze_sim_node``."""
    return run_node(MazeSimNode)


if __name__ == '__main__':
    sys.exit(main())
