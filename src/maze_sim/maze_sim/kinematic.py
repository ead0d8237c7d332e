"""A robot on two driven wheels in a maze: it moves smoothly, and its odometry drifts.

It comes with what runs on a real one: a map with small cells that grows with what its range
finder hits, and now and then a pose on that map with a covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gridnav.grid import GridGeometry
from gridnav.metrics import Outcome
from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE
from gridnav.pose import Pose2D, PoseEstimate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from maze_sim.mazes import Maze

SUBSTEP_S = 0.02
"""A collision is looked for this often, in simulated time."""

RAYS = 360

AT_GOAL_SHARE = 0.3
"""A robot that stands still within this share of a cell from the middle of the goal is there."""


@dataclass(frozen=True)
class RobotConfig:
    """The robot and its sensors.

    Attributes:
        radius: Of its round body, in metres.
        max_speed: In m/s; faster commands are cut.
        max_turn_rate: In rad/s.
        view_range: Of the range finder, in metres.
        odometry_noise: Standard deviation of the odometry after a metre, in metres, and after a
            metre or a radian in radians.
        pose_noise: Standard deviation of the pose on the map in x and in y, in metres.
    """

    radius: float = 0.2
    max_speed: float = 1.0
    max_turn_rate: float = 2.0
    view_range: float = 3.0
    odometry_noise: float = 0.02
    pose_noise: float = 0.01


class KinematicSimulation:
    """One robot in one maze.

    An episode ends in success (the robot stands still at the goal), collision (it touches a wall)
    or timeout.

    Args:
        maze: Where it drives; the corner of its cell (0, 0) is the origin of the map's frame.
        cell_size: Side of a cell of the maze, in metres.
        map_resolution: Side of a cell of the map, in metres, rounded to a part of `cell_size`.
        config: The robot.
        max_time: Simulated seconds after which the episode ends.
        seed: Of the noise.

    Attributes:
        pose: Where the robot is.
        odometry: Where it is by its wheels; begins at zero.
        time: Simulated seconds since the start.
        distance: Metres driven.
        outcome: How the episode ended.
        goal_seen: Whether the range finder has seen the middle of the goal.
    """

    def __init__(
        self,
        maze: Maze,
        cell_size: float = 1.0,
        map_resolution: float = 0.05,
        config: RobotConfig | None = None,
        *,
        max_time: float = 600.0,
        seed: int = 0,
    ) -> None:
        self.maze = maze
        self.config = config or RobotConfig()
        self._rng = np.random.default_rng(seed)
        self._max_time = max_time
        rows, cols = maze.blocked.shape
        self._cells = GridGeometry(rows, cols, cell_size)
        factor = max(1, round(cell_size / map_resolution))
        self._fine = GridGeometry(rows * factor, cols * factor, cell_size / factor)
        self._truth = maze.blocked.repeat(factor, axis=0).repeat(factor, axis=1)
        self._known = np.full(self._truth.shape, UNKNOWN_VALUE, dtype=np.int8)
        reach = np.arange(0.0, self.config.view_range, self._fine.resolution / 2)
        angles = np.linspace(0.0, math.tau, RAYS, endpoint=False)
        # x and y along each beam, (S, 2, RAYS).
        self._beams = reach[:, None, None] * np.stack([np.cos(angles), np.sin(angles)])

        self.pose = Pose2D(*self._cells.center_of(*maze.start))
        self.odometry = Pose2D()
        self.time = 0.0
        self.distance = 0.0
        self.outcome = Outcome.RUNNING
        self.goal_seen = False
        self.look()

    @property
    def goal(self) -> tuple[float, float]:
        """Middle of the goal's cell, (x, y) in metres."""
        return self._cells.center_of(*self.maze.goal)

    def drive(self, speed: float, turn_rate: float, duration: float) -> None:
        """Drive for a while, unless the episode has ended.

        Args:
            speed: Ahead, in m/s.
            turn_rate: To the left, in rad/s.
            duration: In seconds.

        Raises:
            ValueError: If a number is not finite.
        """
        if not all(math.isfinite(value) for value in (speed, turn_rate, duration)):
            msg = f'A command must be finite, got {speed} m/s, {turn_rate} rad/s.'
            raise ValueError(msg)
        limits = self.config
        speed = min(max(speed, -limits.max_speed), limits.max_speed)
        turn_rate = min(max(turn_rate, -limits.max_turn_rate), limits.max_turn_rate)
        steps = max(1, math.ceil(duration / SUBSTEP_S))
        for _ in range(steps):
            if self.outcome is not Outcome.RUNNING:
                return
            self._step(speed * duration / steps, turn_rate * duration / steps)
            self.time += duration / steps
            if self.touches_wall():
                self.outcome = Outcome.COLLISION
            elif self.time >= self._max_time:
                self.outcome = Outcome.TIMEOUT
        if speed == 0 and turn_rate == 0 and self._is_at_goal():
            self.outcome = Outcome.SUCCESS

    def _step(self, ahead: float, turn: float) -> None:
        """Move along an arc, and the odometry along one that is a little wrong."""
        self.pose = self.pose.compose(_arc(ahead, turn))
        self.distance += abs(ahead)
        spread = self.config.odometry_noise * np.sqrt([abs(ahead), abs(ahead) + abs(turn)])
        wrong_ahead, wrong_turn = self._rng.normal(0.0, spread).tolist()
        self.odometry = self.odometry.compose(_arc(ahead + wrong_ahead, turn + wrong_turn))

    def touches_wall(self) -> bool:
        """Tell whether the robot's body reaches into a wall."""
        side, radius = self._cells.resolution, self.config.radius
        place = np.array([self.pose.y, self.pose.x]) / side
        low = np.floor(place - radius / side).astype(int)
        high = np.floor(place + radius / side).astype(int)
        walls = low + np.argwhere(self.maze.blocked[low[0] : high[0] + 1, low[1] : high[1] + 1])
        gaps = np.maximum(np.maximum(walls - place, place - walls - 1), 0.0) * side
        return bool((np.hypot(*gaps.T) < radius).any())

    def _is_at_goal(self) -> bool:
        x, y = self.goal
        away = math.hypot(self.pose.x - x, self.pose.y - y)
        return away <= AT_GOAL_SHARE * self._cells.resolution

    def look(self) -> None:
        """Turn the range finder once around and draw what it sees into the map."""
        points = self._beams + np.array([[self.pose.x], [self.pose.y]])
        cells = np.floor(points / self._fine.resolution).astype(np.int64)
        # A beam ends at the outer wall at the latest, so what lies beyond is not looked at.
        cols = cells[:, 0].clip(0, self._fine.cols - 1)
        rows = cells[:, 1].clip(0, self._fine.rows - 1)
        hit = np.logical_or.accumulate(self._truth[rows, cols], axis=0)
        first = hit & ~np.pad(hit, ((1, 0), (0, 0)))[:-1]
        self._known[rows[first], cols[first]] = OCCUPIED_VALUE
        self._known[rows[~hit], cols[~hit]] = FREE_VALUE
        row, col = self._fine.cell_at(*self.goal)
        self.goal_seen |= bool(self._known[row, col] == FREE_VALUE)

    def map(self) -> tuple[NDArray[np.int8], GridGeometry]:
        """Return the map so far, as large as what is known, and where it lies."""
        rows, cols = (np.flatnonzero((self._known >= 0).any(axis=axis)) for axis in (1, 0))
        top, left = int(rows[0]), int(cols[0])
        known = self._known[top : rows[-1] + 1, left : cols[-1] + 1].copy()
        side = self._fine.resolution
        height, width = known.shape
        return known, GridGeometry(height, width, side, left * side, top * side)

    def fix(self, stamp: int) -> PoseEstimate:
        """Return a pose on the map as a localisation gives it."""
        noise = self.config.pose_noise
        dx, dy = self._rng.normal(0.0, noise, 2).tolist()
        pose = Pose2D(self.pose.x + dx, self.pose.y + dy, self.pose.yaw)
        return PoseEstimate(stamp, pose, np.eye(2) * noise**2)


def _arc(ahead: float, turn: float) -> Pose2D:
    """Return where a robot at the origin is after driving on a circle."""
    # sin(t/2)/(t/2) is the chord's share of the arc.
    chord = ahead * float(np.sinc(turn / math.tau))
    return Pose2D(chord * math.cos(turn / 2), chord * math.sin(turn / 2), turn)
