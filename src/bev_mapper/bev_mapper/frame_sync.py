"""Bring the images, the camera and the pose of one moment together."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np

from gridnav.rgbd import Pose3D, RgbdFrame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gridnav.rgbd import Camera, CameraMount

T = TypeVar('T')

KEPT_POSES = 1000
NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class SyncConfig:
    """How parts are matched.

    Attributes:
        image_slop: Nanoseconds that colour and camera may be away from the depth image; 0 takes
            equal stamps alone.
        pose_slop: Where no pose has the stamp of the depth image, it is taken between two that are
            no further away than this, in nanoseconds.
        wait: A depth image waits so long for the rest, in nanoseconds; then it is refused.
        kept: How many images wait at most.
    """

    image_slop: int = 0
    pose_slop: int = 100_000_000
    wait: int = 5_000_000_000
    kept: int = 32


class _Stream(Generic[T]):
    """Things that came, by stamp."""

    def __init__(self, kept: int) -> None:
        self.stamps: list[int] = []
        self.items: dict[int, T] = {}
        self._kept = kept

    def add(self, stamp: int, item: T) -> T | None:
        """Take one in; return the one that had to make room, if one had to."""
        if stamp not in self.items:
            insort(self.stamps, stamp)
        self.items[stamp] = item
        return self.items.pop(self.stamps.pop(0)) if len(self.stamps) > self._kept else None

    def forget_before(self, stamp: int) -> None:
        """Forget what is older than a stamp."""
        number = bisect_left(self.stamps, stamp)
        for old in self.stamps[:number]:
            del self.items[old]
        del self.stamps[:number]

    def forget(self, stamp: int) -> None:
        """Forget the one of a stamp."""
        self.stamps.remove(stamp)
        del self.items[stamp]

    def take(self, stamp: int) -> T:
        """Return the one of a stamp, and forget it and all before it."""
        item = self.items[stamp]
        self.forget_before(stamp + 1)
        return item

    def nearest(self, stamp: int, slop: int) -> int | None:
        """Return the stamp nearest to one; None where none is near, or a nearer one may come."""
        if stamp in self.items or not slop:
            return stamp if stamp in self.items else None
        after = bisect_left(self.stamps, stamp)
        if after == len(self.stamps):
            return None
        found = min(self.stamps[max(after - 1, 0) : after + 1], key=lambda near: abs(near - stamp))
        return found if abs(found - stamp) <= slop else None


class _Match(NamedTuple):
    """What belongs to a depth image: stamps of colour image and camera, pose and mount."""

    color: int
    camera: int
    pose: Pose3D
    mount: CameraMount


class FrameSync:
    """Makes frames of depth images and what belongs to them, in the order of their stamps.

    Each kind of message is taken to come in the order of its stamps. So once a frame is complete,
    those before it will never be, and are dropped.

    Attributes:
        mount: Where the camera is on the robot; None as long as nobody knows.
        counts: How many messages were dropped, by reason.
    """

    def __init__(self, config: SyncConfig, mount: CameraMount | None) -> None:
        """Start with nothing."""
        self.config = config
        self.mount = mount
        self.counts: Counter[str] = Counter()
        self.clear()

    def clear(self) -> None:
        """Forget all that waits."""
        kept = self.config.kept
        self._colors: _Stream[NDArray[np.uint8]] = _Stream(kept)
        self._depths: _Stream[tuple[NDArray[Any], int]] = _Stream(kept)
        self._cameras: _Stream[Camera] = _Stream(kept)
        self._poses: _Stream[Pose3D] = _Stream(KEPT_POSES)

    def add_color(self, stamp: int, color: NDArray[np.uint8]) -> None:
        """Take in a colour image (H, W, 3)."""
        if self._colors.add(stamp, color) is not None:
            self.counts['dropped: colour image without depth'] += 1

    def add_camera(self, stamp: int, camera: Camera) -> None:
        """Take in what is said about the camera."""
        if self._cameras.add(stamp, camera) is not None:
            self.counts['dropped: camera_info without depth'] += 1

    def add_pose(self, stamp: int, pose: Pose3D) -> None:
        """Take in a pose of the robot in the frame of the map."""
        self._poses.add(stamp, pose)

    def add_depth(self, stamp: int, depth: NDArray[Any], now: int) -> None:
        """Take in a depth image (H, W) that came at a time in nanoseconds."""
        if len(self._depths.stamps) == self.config.kept:
            oldest = self._depths.stamps[0]
            self.counts[f'dropped: depth without {self._match(oldest)}'] += 1
        self._depths.add(stamp, (depth, now))

    def forget_before(self, stamp: int) -> None:
        """Forget all that is older than a stamp."""
        for stream in (self._colors, self._depths, self._cameras, self._poses):
            stream.forget_before(stamp)

    def ready(self) -> list[RgbdFrame]:
        """Return the frames that are complete, in the order of their stamps, each once."""
        return [
            self._take(stamp, match)
            for stamp in list(self._depths.stamps)
            if isinstance(match := self._match(stamp), _Match)
        ]

    def expire(self, now: int) -> list[str]:
        """Give up depth images that have waited too long; says of each in a sentence why."""
        sentences = []
        for stamp in list(self._depths.stamps):
            _, came = self._depths.items[stamp]
            if now - came > self.config.wait:
                missing = self._match(stamp)
                sentences.append(
                    f'The depth image of {stamp / NANOSECONDS:.3f} s waited '
                    f'{self.config.wait / NANOSECONDS:g} s for its {missing} and is left out.'
                )
                self.counts[f'dropped: depth without {missing}'] += 1
                self._depths.forget(stamp)
        return sentences

    def _match(self, stamp: int) -> _Match | str:
        """Return what belongs to a depth image, or the name of the first thing that is missing."""
        slop = self.config.image_slop
        color = self._colors.nearest(stamp, slop)
        if color is None:
            return 'colour image'
        camera = self._cameras.nearest(stamp, slop)
        if camera is None:
            return 'camera_info'
        pose = self._pose(stamp)
        if pose is None:
            return 'pose'
        return (
            'camera transform' if self.mount is None else _Match(color, camera, pose, self.mount)
        )

    def _take(self, stamp: int, match: _Match) -> RgbdFrame:
        """Remove a complete frame and what came before it, and return it."""
        for older in self._depths.stamps[: self._depths.stamps.index(stamp)]:
            self.counts[f'dropped: depth without {self._match(older)}'] += 1
        for stream, used, name in (
            (self._colors, match.color, 'colour image'),
            (self._cameras, match.camera, 'camera_info'),
        ):
            lost = stream.stamps.index(used)
            if lost:
                self.counts[f'dropped: {name} without depth'] += lost
        return RgbdFrame(
            name=f'frame {stamp / NANOSECONDS:.3f} s',
            stamp=stamp,
            color=self._colors.take(match.color),
            depth=self._depths.take(stamp)[0],
            camera=self._cameras.take(match.camera),
            pose=match.pose,
            mount=match.mount,
        )

    def _pose(self, stamp: int) -> Pose3D | None:
        """Return where the robot was; None if that is not known (yet)."""
        stamps, poses = self._poses.stamps, self._poses.items
        if stamp in poses:
            return poses[stamp]
        after = bisect_left(stamps, stamp)
        if after in {0, len(stamps)}:
            return None
        before, later = stamps[after - 1], stamps[after]
        if max(stamp - before, later - stamp) > self.config.pose_slop:
            return None
        return _between(poses[before], poses[later], (stamp - before) / (later - before))


def _between(first: Pose3D, second: Pose3D, part: float) -> Pose3D:
    """Return the pose that is reached after a part of the way from one to another."""
    a, b = np.array(first), np.array(second)
    if a[3:] @ b[3:] < 0:
        b[3:] = -b[3:]
    mean = (1 - part) * a + part * b
    mean[3:] /= np.linalg.norm(mean[3:])
    return Pose3D(*mean.tolist())
