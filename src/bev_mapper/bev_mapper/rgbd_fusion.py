"""Synchronised frames into a map, episode by episode."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from bev_mapper.frame_sync import FrameSync
from bev_mapper.local_map_fusion import MAX_LATENESS_NS
from bev_mapper.unprojection import thin

if TYPE_CHECKING:
    from collections import Counter

    import numpy as np
    from numpy.typing import NDArray

    from bev_mapper.frame_sync import SyncConfig
    from bev_mapper.rgbd_mapper import RgbdMapper
    from gridnav.rgbd import Camera, CameraMount, Pose3D, RgbdFrame

KEPT = 32
"""How many fused frames are kept, for when the word of their episode comes after them."""

_NEVER = -1


class RgbdFusion:
    """Takes in images, cameras and poses one by one and fuses each frame that they complete.

    A stamp that was used is ignored when it comes again.

    Attributes:
        mapper: What makes the map.
        sync: What makes the frames.
        refused: A sentence for each frame that was left out; whoever reads them empties it.
    """

    def __init__(self, mapper: RgbdMapper, sync: SyncConfig, mount: CameraMount | None) -> None:
        """Start with nothing seen; see `FrameSync`."""
        self.mapper = mapper
        self.sync = FrameSync(sync, mount)
        self.refused: list[str] = []
        self._start = _NEVER
        self._fused: dict[int, RgbdFrame] = {}

    @property
    def counts(self) -> Counter[str]:
        """How many messages were dropped, by reason."""
        return self.sync.counts

    def add_color(self, stamp: int, color: NDArray[np.uint8]) -> int:
        """Take in a colour image; see `add_depth`."""
        if self._wanted(stamp):
            self.sync.add_color(stamp, color)
        return self.fuse()

    def add_depth(self, stamp: int, depth: NDArray[Any], now: int) -> int:
        """Take in a depth image.

        Args:
            stamp: When it was taken, in nanoseconds.
            depth: (H, W), see `gridnav.rgbd.RgbdFrame`.
            now: When it came in, in nanoseconds of any clock.

        Returns:
            How many frames were fused.
        """
        if self._wanted(stamp):
            self.sync.add_depth(stamp, depth, now)
        return self.fuse()

    def add_camera(self, stamp: int, camera: Camera) -> int:
        """Take in what is said about the camera; see `add_depth`."""
        if self._wanted(stamp):
            self.sync.add_camera(stamp, camera)
        return self.fuse()

    def add_pose(self, stamp: int, pose: Pose3D) -> int:
        """Take in a pose of the robot in the frame of the map; see `add_depth`."""
        if self._wanted(stamp):
            self.sync.add_pose(stamp, pose)
        return self.fuse()

    def fuse(self) -> int:
        """Fuse all frames that are complete; see `add_depth`."""
        return sum(self._add(frame) for frame in self.sync.ready())

    def expire(self, now: int) -> None:
        """Give up depth images that have waited too long for the rest."""
        self.refused += self.sync.expire(now)

    def begin_episode(self, start: int) -> int:
        """Begin a new world, unless this one is known by now.

        Frames of the new world may have come before this was said; they are fused again.

        Args:
            start: Stamp of the world's first observation in nanoseconds; it names the world.

        Returns:
            How many frames were fused.
        """
        if start == self._start:
            return 0
        went_back = start < self._start
        again = [] if went_back else [self._fused[s] for s in sorted(self._fused) if s >= start]
        if went_back:
            self.sync.clear()
        self.sync.forget_before(start)
        self._start = start
        self._forget()
        return sum(self._add(frame) for frame in again)

    def clear(self) -> None:
        """Forget all frames, but not which episode is running."""
        self.sync.clear()
        self._forget()

    def _forget(self) -> None:
        self.mapper.clear()
        self._fused = {}

    def _wanted(self, stamp: int) -> bool:
        if stamp < self._start:
            self.counts['dropped: older than the episode'] += 1
            return False
        if stamp in self._fused:
            return False
        if self.mapper.stamp - stamp > MAX_LATENESS_NS:
            self.counts['time went back'] += 1
            self.clear()
        return True

    def _add(self, frame: RgbdFrame) -> bool:
        """Fuse a frame; tells whether it could be used."""
        frame = thin(frame, self.mapper.config.max_pixels)
        # Copied, as a thinned frame holds on to the whole one.
        frame = replace(frame, color=frame.color.copy(), depth=frame.depth.copy())
        try:
            self.mapper.add(frame)
        except ValueError as error:
            self.counts['refused: frames'] += 1
            self.refused.append(str(error))
            return False
        self._fused[frame.stamp] = frame
        if len(self._fused) > KEPT:
            del self._fused[min(self._fused)]
        return True
