"""Bring windows and poses of equal stamp together and fuse them, episode by episode."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from bev_mapper.grid_fusion import GridFusion
    from gridnav.grid import GridGeometry
    from gridnav.pose import Pose2D

T = TypeVar('T')

KEPT = 64
"""How many windows, poses and fused pairs are kept."""

MAX_LATENESS_NS = 5_000_000_000
"""What comes later than this after the newest observation means that time itself went back."""

_NEVER = -1


@dataclass(frozen=True)
class Window:
    """A local view.

    Attributes:
        occupancy: -1 unseen, 0 free to 100 obstacle, int8 (h, w).
        geometry: Where it lies in its frame.
        on_robot: Whether its frame is that of the robot; else it is that of the map.
    """

    occupancy: NDArray[np.int8]
    geometry: GridGeometry
    on_robot: bool = False


class LocalMapFusion:
    """Fuses each window with the robot's pose of the same stamp, whichever comes first.

    A stamp that was used is ignored when it comes again. A late pair is fused still, without
    undoing what was seen since. The cell that the robot stands on is free.

    Attributes:
        grid: The map so far.
        stamp: The newest stamp in it in nanoseconds, -1 if there is none.
        counts: How many messages were dropped, by reason.
    """

    def __init__(self, grid: GridFusion) -> None:
        """Start with an empty grid."""
        self.grid = grid
        self.stamp = _NEVER
        self.counts: Counter[str] = Counter()
        self._start = _NEVER
        self._windows: dict[int, Window] = {}
        self._poses: dict[int, Pose2D] = {}
        self._fused: dict[int, tuple[Window, Pose2D]] = {}

    def add_window(self, stamp: int, window: Window) -> bool:
        """Take in a window.

        Args:
            stamp: When it was seen, in nanoseconds.
            window: The window.

        Returns:
            Whether it made a new map.

        Raises:
            ValueError: If the grid can't take it.
        """
        self.grid.check_window(window.geometry)
        if not self._wanted(stamp):
            return False
        self._keep(self._windows, stamp, window, 'dropped: local_map without odom')
        return self._fuse(stamp)

    def add_pose(self, stamp: int, pose: Pose2D) -> bool:
        """Take in a pose of the robot in the map frame; see ``add_window``."""
        if not self._wanted(stamp):
            return False
        self._keep(self._poses, stamp, pose, 'dropped: odom without local_map')
        return self._fuse(stamp)

    def begin_episode(self, start: int) -> bool:
        """Begin a new world, unless this one is known by now.

        Observations of the new world may have come before this was said; they are fused again.

        Args:
            start: Stamp of the world's first observation in nanoseconds; it names the world.

        Returns:
            Whether it made a new map.
        """
        if start == self._start:
            return False
        went_back = start < self._start
        fused = {} if went_back else {s: pair for s, pair in self._fused.items() if s >= start}
        windows = {} if went_back else {s: w for s, w in self._windows.items() if s >= start}
        poses = {} if went_back else {s: p for s, p in self._poses.items() if s >= start}
        self.clear()
        self._start = start
        self._windows = windows | {stamp: window for stamp, (window, _) in fused.items()}
        self._poses = poses | {stamp: pose for stamp, (_, pose) in fused.items()}
        for stamp in sorted(fused):
            self._fuse(stamp)
        return bool(fused)

    def clear(self) -> None:
        """Forget all observations, but not which episode is running."""
        self.grid.clear()
        self.stamp = _NEVER
        self._windows = {}
        self._poses = {}
        self._fused = {}

    def _wanted(self, stamp: int) -> bool:
        if stamp < self._start:
            self.counts['dropped: older than the episode'] += 1
            return False
        if stamp in self._fused:
            return False
        if self.stamp - stamp > MAX_LATENESS_NS:
            self.counts['time went back'] += 1
            self.clear()
        return True

    def _keep(self, buffer: dict[int, T], stamp: int, item: T, when_dropped: str) -> None:
        buffer[stamp] = item
        if len(buffer) > KEPT:
            del buffer[min(buffer)]
            self.counts[when_dropped] += 1

    def _fuse(self, stamp: int) -> bool:
        """Fuse the window and the pose of a stamp if both are there."""
        if stamp not in self._windows or stamp not in self._poses:
            return False
        window, pose = self._windows.pop(stamp), self._poses.pop(stamp)
        self.grid.fuse(
            window.occupancy, window.geometry, stamp, robot=pose, on_robot=window.on_robot
        )
        self._fused[stamp] = window, pose
        if len(self._fused) > KEPT:
            del self._fused[min(self._fused)]
        self.stamp = max(self.stamp, stamp)
        return True
