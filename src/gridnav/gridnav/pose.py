"""Poses on the ground, and where a robot is by odometry and what corrects it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

KEPT_ODOMETRY = 500
"""No more poses of the odometry are kept than this; a pose on the map that is older than them all
is used with the oldest."""


class Pose2D(NamedTuple):
    """A pose on the ground: metres and radians."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def compose(self, other: Pose2D) -> Pose2D:
        """Return a pose given in this one's frame, in the frame that this one is given in."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2D(
            self.x + cosine * other.x - sine * other.y,
            self.y + sine * other.x + cosine * other.y,
            math.remainder(self.yaw + other.yaw, math.tau),
        )

    def inverse(self) -> Pose2D:
        """Return the pose of this one's frame, seen from this one."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2D(-cosine * self.x - sine * self.y, sine * self.x - cosine * self.y, -self.yaw)


@dataclass(frozen=True)
class PoseEstimate:
    """Where the robot is in the map's frame, as far as is known.

    Attributes:
        stamp: Nanoseconds.
        pose: In the map's frame.
        covariance: Of x and y in m², (2, 2), if it is known.
    """

    stamp: int
    pose: Pose2D
    covariance: NDArray[np.float64] | None = None


class PoseTracker:
    """Brings odometry, which never jumps, and poses on the map, which come seldom, together.

    A pose on the map says where the odometry's frame is, once the odometry of its time has come;
    from then on the odometry moves the robot. Without odometry the latest pose on the map counts.
    """

    def __init__(self) -> None:
        self._odometry: deque[tuple[int, Pose2D]] = deque(maxlen=KEPT_ODOMETRY)
        self._fix: PoseEstimate | None = None
        self._is_aligned = False
        self._odom_in_map: Pose2D | None = None

    def add_odometry(self, stamp: int, pose: Pose2D) -> None:
        """Take in a pose in the odometry's frame; a clock that went back starts it anew."""
        if self._odometry and stamp < self._odometry[-1][0]:
            self._odometry.clear()
        self._odometry.append((stamp, pose))
        self._align()

    def add_fix(self, fix: PoseEstimate) -> None:
        """Take in a pose on the map."""
        self._fix = fix
        self._is_aligned = False
        self._align()

    def _align(self) -> None:
        """Place the odometry's frame by the latest pose on the map, as soon as that can be."""
        fix = self._fix
        if fix is None or self._is_aligned or not self._odometry:
            return
        stamp, newest = self._odometry[-1]
        if stamp >= fix.stamp:
            # The two travel on their own: matched with what came before, the robot would lag.
            _, newest = min(self._odometry, key=lambda entry: abs(entry[0] - fix.stamp))
            self._is_aligned = True
        elif self._odom_in_map is not None:
            return
        self._odom_in_map = fix.pose.compose(newest.inverse())

    @property
    def estimate(self) -> PoseEstimate | None:
        """Where the robot is now, once a pose on the map has come."""
        if self._fix is None or self._odom_in_map is None or not self._odometry:
            return self._fix
        stamp, pose = self._odometry[-1]
        return PoseEstimate(stamp, self._odom_in_map.compose(pose), self._fix.covariance)
