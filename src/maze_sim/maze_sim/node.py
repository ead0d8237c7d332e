"""The node ``maze_sim``: one robot in a maze, driven by ``action``."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry

from gridnav.grid import GridGeometry
from gridnav.ros.conversions import to_occupancy_grid, to_odometry, to_pose_stamped
from gridnav.ros.lockstep import Lockstep, LockstepWorld
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.qos import MAP_QOS, RELIABLE_QOS
from gridnav.ros.run import run_node
from gridnav.ros.tf import FrameBroadcaster
from gridnav.ros.validation import MAX_RESOLUTION_M, MIN_RESOLUTION_M
from maze_sim.simulation import MazeSimulation
from maze_sim.worlds import WORLD_KINDS, Worlds

if TYPE_CHECKING:
    from gridnav.metrics import EpisodeResult

SOURCE = 'maze_sim'
"""Who speaks on ``episode``."""

X_X, Y_Y = 0, 7
"""Where the variances of x and y are in the 6 x 6 covariance of a pose."""

MIN_SIDE = 9
"""Smaller worlds have no start and goal that are 15 steps apart."""


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
        self._stamp = -1
        self._goal_pose = self.advertise(PoseStamped, 'goal_pose', MAP_QOS)
        self._odom = self.advertise(Odometry, 'odom', RELIABLE_QOS)
        self._local_map = self.advertise(OccupancyGrid, 'local_map', RELIABLE_QOS)
        self._frames = FrameBroadcaster(self)
        self._repeat = self.create_timer(
            self.parameters.observation_period, self._publish_observation
        )
        world = LockstepWorld(
            begin=self._begin,
            show_start=self._show_start,
            act=self._act,
            show_step=self._publish_step,
            give_up=self._give_up,
            result=self._result,
            facts=self._facts,
        )
        self._lockstep = Lockstep(self, SOURCE, world)
        self._lockstep.open()

    def _begin(self, seed: int) -> int:
        """Draw a maze and put the robot on its start."""
        p = self.parameters
        worlds = p.worlds()
        maze = worlds.sample(np.random.default_rng([seed, 0]))
        self._simulation = MazeSimulation(
            [maze],
            p.view_range,
            p.max_steps,
            slip=p.slip,
            pose_noise=p.pose_noise,
            seeds=[[seed, 1]],
        )
        self._geometry = worlds.geometry
        if not p.map_file:
            self._geometry = replace(worlds.geometry, resolution=p.resolution)
        self._yaw = 0.0
        self._goal_published = False
        self._advance_stamp()
        return self._stamp

    def _show_start(self) -> None:
        """Publish the first observation and say what world it is of."""
        self._publish_step()
        rows, cols = self._geometry.shape
        maze = self._simulation.mazes[0]
        for_expert = f'{maze.expert_steps} steps for one who knows the maze'
        if not maze.reachable:
            for_expert = 'no way to the goal'
        self.get_logger().info(
            f'Episode with seed {self._lockstep.seed}: {rows} x {cols} cells, view range '
            f'{self._simulation.view_range}, {for_expert}.'
        )

    def _act(self, action: int) -> None:
        """Take one step."""
        before = self._simulation.cells[0].copy()
        self._simulation.step(np.array([action]))
        row_step, col_step = (self._simulation.cells[0] - before).tolist()
        if row_step or col_step:
            self._yaw = math.atan2(row_step, col_step)
        self._advance_stamp()

    def _advance_stamp(self) -> None:
        """Give the next step its stamp: now, but later than all before."""
        self._stamp = max(self.get_clock().now().nanoseconds, self._stamp + 1)

    def _give_up(self) -> None:
        self._simulation.give_up(np.array([0]))

    def _result(self) -> EpisodeResult:
        return self._simulation.result(0)

    def _facts(self) -> dict[str, object]:
        """Return what is said of the episode besides how it goes."""
        return {
            'size': max(self._geometry.shape),
            'rows': self._geometry.rows,
            'cols': self._geometry.cols,
            'view_range': self._simulation.view_range,
            'max_steps': self._simulation.max_steps,
            'resolution': self._geometry.resolution,
        }

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
