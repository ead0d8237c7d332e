"""Follow a path with two driven wheels: regulated pure pursuit with a look at the map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gridnav.partial_map import OCCUPIED_FROM
from vgdp_planner.ways import inflate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gridnav import GridGeometry
    from gridnav.pose import Pose2D

LEAST_SPEED_SHARE = 0.15
"""Of the highest speed; slower the robot never drives, or it would not arrive."""


CURVE_SHARE = 0.6
"""Of the highest speed; taken off where the robot turns as much as it may while it drives."""

ON_IT_M = 1e-6
"""Nearer than this a point has no direction."""


@dataclass
class FollowerSettings:
    """How to follow.

    Attributes:
        max_speed: In m/s.
        max_turn_rate: In rad/s.
        max_acceleration: In m/s²; braking is not limited.
        lookahead: How far ahead on the path the robot heads for, in metres.
        turn_first: Where the path lies further to the side than this the robot turns on the
            spot, in radians.
        goal_tolerance: A path ends this near to its last pose, in metres.
        stop_distance: As far ahead the path has to be clear, in metres.
        robot_radius: No obstacle may come nearer to the path than this, in metres.
    """

    max_speed: float = 0.4
    max_turn_rate: float = 1.0
    max_acceleration: float = 1.0
    lookahead: float = 0.4
    turn_first: float = 0.6
    goal_tolerance: float = 0.1
    stop_distance: float = 0.6
    robot_radius: float = 0.0


@dataclass(frozen=True)
class Command:
    """What to do now.

    Attributes:
        speed: Ahead, in m/s.
        turn_rate: To the left, in rad/s.
        reason: 'driving', 'turning', or why the robot stops: 'no plan', 'arrived', 'obstacle'.
    """

    speed: float
    turn_rate: float
    reason: str


class PathFollower:
    """Turns a path and a pose into commands.

    Args:
        settings: May be changed at any time.
    """

    def __init__(self, settings: FollowerSettings) -> None:
        self.settings = settings
        self._path: NDArray[np.float64] = np.empty((0, 2))
        self._along: NDArray[np.float64] = np.empty(0)
        self._passed = 0
        self._map: tuple[NDArray[np.bool_], GridGeometry] | None = None
        self._speed = 0.0

    def set_path(self, path: NDArray[np.float64]) -> None:
        """Follow a path from now on: (x, y) in metres in the map's frame, (N, 2).

        The same path again changes nothing; a new one is followed from its begin.
        """
        if not np.array_equal(path, self._path):
            self._path, self._passed = path, 0
            self._along = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))

    def set_map(self, occupancy: NDArray[np.int8], geometry: GridGeometry) -> None:
        """Take in the newest map: −1 unseen, 0 to 100 occupied, (rows, cols)."""
        radius = self.settings.robot_radius / geometry.resolution
        self._map = (inflate(occupancy >= OCCUPIED_FROM, radius), geometry)

    def stop(self) -> None:
        """Forget the path."""
        self._path, self._passed = np.empty((0, 2)), 0
        self._speed = 0.0

    def command(self, pose: Pose2D, period: float) -> Command:
        """Return what to do.

        Args:
            pose: Of the robot in the map's frame.
            period: Seconds until the next command.
        """
        command = self._decide(pose, period)
        self._speed = command.speed
        return command

    def _decide(self, pose: Pose2D, period: float) -> Command:
        s = self.settings
        if not len(self._path):
            return Command(0.0, 0.0, 'no plan')
        place = np.array([pose.x, pose.y])
        self._pass_by(place)
        ahead = self._path[self._passed :]
        along = self._along[self._passed :] - self._along[self._passed]
        to_end = float(np.hypot(*(self._path[-1] - place)))
        if to_end <= s.goal_tolerance and along[-1] <= 2 * s.goal_tolerance:
            return Command(0.0, 0.0, 'arrived')
        if self._is_blocked(ahead[along <= s.stop_distance]):
            return Command(0.0, 0.0, 'obstacle')
        target = self._target(pose, ahead[along <= s.lookahead])
        if target is None:
            return Command(0.0, 0.0, 'obstacle')
        distance, bearing = target
        if abs(bearing) > s.turn_first:
            # No faster than that the turn ends where the path lies.
            rate = min(s.max_turn_rate, abs(bearing) / period)
            return Command(0.0, math.copysign(rate, bearing), 'turning')
        curvature = 2 * math.sin(bearing) / distance
        # Slower the more it has to turn, so that it is on the path again before it is fast.
        speed = s.max_speed * (1 - CURVE_SHARE * abs(bearing) / s.turn_first)
        speed = min(speed, s.max_turn_rate / max(abs(curvature), 1e-6))
        speed = min(speed, self._speed + s.max_acceleration * period)
        # Brakes so as to stand at the end of the path.
        speed = min(speed, math.sqrt(2 * s.max_acceleration * to_end))
        speed = max(speed, LEAST_SPEED_SHARE * s.max_speed)
        rate = min(max(speed * curvature, -s.max_turn_rate), s.max_turn_rate)
        return Command(speed, rate, 'driving')

    def _pass_by(self, place: NDArray[np.float64]) -> None:
        """Note how far along the path the robot is.

        It is looked for a little ahead of where it was, so that where a path comes back to a place
        the part in between is not skipped; and everywhere ahead only if it is not there.
        """
        along = self._along[self._passed :] - self._along[self._passed]
        away = np.hypot(*(self._path[self._passed :] - place).T)
        near = away[along <= self.settings.lookahead]
        found = near if near.min() <= self.settings.lookahead else away
        self._passed += int(found.argmin())

    def _target(self, pose: Pose2D, ahead: NDArray[np.float64]) -> tuple[float, float] | None:
        """Return how far and in which direction the furthest point is that can be headed for.

        That is one to which the robot's way is clear: along an arc, or straight where it turns on
        the spot first.

        Args:
            pose: Of the robot.
            ahead: Points of the path, (N, 2).
        """
        for x, y in ahead[::-1].tolist():
            distance = math.hypot(x - pose.x, y - pose.y)
            if distance < ON_IT_M:
                continue
            bearing = math.remainder(math.atan2(y - pose.y, x - pose.x) - pose.yaw, math.tau)
            if not self._is_blocked(self._way_to(pose, distance, bearing)):
                return distance, bearing
        return None

    def _way_to(self, pose: Pose2D, distance: float, bearing: float) -> NDArray[np.float64]:
        """Return points of the way to a point, (N, 2)."""
        step = self._map[1].resolution / 2 if self._map is not None else distance
        shares = np.linspace(0.0, 1.0, 2 + math.ceil(distance / step))
        if abs(bearing) > self.settings.turn_first:
            heading = np.full(len(shares), pose.yaw + bearing)
            reach = shares * distance
        else:
            # An arc that begins ahead: after a share of its angle the chord has turned by half
            # of that.
            heading = pose.yaw + shares * bearing
            half = max(abs(bearing), 1e-9)
            reach = distance * np.sin(shares * half) / math.sin(half)
        place = np.array([pose.x, pose.y])
        way: NDArray[np.float64] = place + reach[:, None] * np.stack(
            [np.cos(heading), np.sin(heading)], axis=-1
        )
        return way

    def _is_blocked(self, points: NDArray[np.float64]) -> bool:
        """Tell whether an obstacle is too near to a line of points.

        A robot that stands too near to one already may leave: the first points of the line count
        only from where it is clear.
        """
        if self._map is None:
            return False
        blocked, geometry = self._map
        corner = (geometry.origin_x, geometry.origin_y)
        cols, rows = np.floor((points - corner) / geometry.resolution).astype(np.int64).T
        inside = (rows >= 0) & (rows < geometry.rows) & (cols >= 0) & (cols < geometry.cols)
        hit = np.zeros(len(points), dtype=np.bool_)
        hit[inside] = blocked[rows[inside], cols[inside]]
        leaves = np.logical_and.accumulate(hit)
        return bool((hit & ~leaves).any() or hit.all())
