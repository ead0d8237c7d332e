"""What a robot's sensors say in a scene, and how wrong they may be."""

from __future__ import annotations

import math
import zlib
from dataclasses import astuple, dataclass, field, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from avd_player.avd_format import index_of
from avd_player.homes.noise import DepthNoise, add_noise
from avd_player.sources import mounted_pose
from gridnav.rgbd import CLASSES, FrameError, Pose3D
from vgdp_experiments.search.views import SmallViews, small_views

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from avd_player.scene import Scene
    from bev_mapper.segmentation import Segmenter
    from gridnav.rgbd import RgbdFrame

SHARES = ('missing', 'labels', 'missed', 'false')

_DEPTH, _POSE, _LABELS, BOXES = range(4)
"""What is drawn for an image has a seed of its own for each of these."""


@dataclass(frozen=True)
class Noise:
    """What is wrong with what a robot senses.

    Attributes:
        depth: Standard deviation of Gaussian noise on depth, in millimetres. The depth images of
            the Active Vision Dataset count these, so 1 is the paper's N(0, I).
        missing: Share of the pixels without depth.
        position: Standard deviation of the reported position in x and in y, in millimetres.
        heading: Standard deviation of the reported heading, in degrees.
        labels: Share of the pixels that the segmentation gives any class at all.
        missed: Share of the target's boxes that the detector misses.
        false: Share of the images in which it has a box of something else.
    """

    depth: float = 0.0
    missing: float = 0.0
    position: float = 0.0
    heading: float = 0.0
    labels: float = 0.0
    missed: float = 0.0
    false: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        for name, value in zip((item.name for item in fields(self)), astuple(self), strict=True):
            if not 0 <= value < math.inf or (name in SHARES and value > 1):
                what = 'a share from 0 to 1' if name in SHARES else 'from 0'
                msg = f'The noise {name!r} is {what}, got {value}.'
                raise ValueError(msg)

    def __bool__(self) -> bool:
        """Tell whether anything is wrong."""
        return any(astuple(self))

    def describe(self) -> str:
        """Say it in a few words."""
        units = {'depth': ' mm', 'position': ' mm', 'heading': '°'}
        return ', '.join(
            f'{item.name} {value:g}{units.get(item.name, "")}'
            for item, value in zip(fields(self), astuple(self), strict=True)
            if value
        )


@dataclass
class Sensors:
    """A robot's camera and odometry in a scene.

    What is wrong is drawn for each image, or for the pose of each position, from the seed: a
    robot that comes back sees the same again.

    Attributes:
        scene: The scene.
        noise: What is wrong.
        seed: Of the noise.
    """

    scene: Scene
    noise: Noise = field(default_factory=Noise)
    seed: int = 0
    _poses: dict[str, Pose3D] = field(default_factory=dict, init=False, repr=False)
    _views: dict[str, SmallViews] = field(default_factory=dict, init=False, repr=False)

    def pose(self, name: str) -> Pose3D:
        """Return where the robot says that it was, looking where an image looks."""
        if name not in self._poses:
            pose = mounted_pose(self.scene.source, name)
            if self.noise.position or self.noise.heading:
                pose = self._misplaced(pose, self.scene.source.cluster_of(name))
            self._poses[name] = pose
        return self._poses[name]

    def frame(self, name: str) -> RgbdFrame | None:
        """Return what an image shows, None where it can't be read."""
        try:
            frame = self.scene.frame(name)
        except FrameError:
            return None
        frame = replace(frame, pose=self.pose(name), mount=self.scene.source.mount)
        noise = self.noise
        if not (noise.depth or noise.missing):
            return frame
        rng = self.rng(_DEPTH, index_of(name))
        measured = np.asarray(frame.depth, np.uint16)
        depth = add_noise(measured, DepthNoise(sigma=noise.depth), rng)
        depth[rng.random(depth.shape, np.float32) < noise.missing] = 0
        return replace(frame, depth=depth)

    def views(self, names: Iterable[str]) -> SmallViews:
        """Return what images show, made small; those that can't be read are left out.

        They are kept, as reading an image again takes longer than most decisions.
        """
        return SmallViews.joined([self._view(name) for name in names])

    def _view(self, name: str) -> SmallViews:
        if name not in self._views:
            frame = self.frame(name)
            self._views[name] = small_views([] if frame is None else [frame])
        return self._views[name]

    def segmenter(self, segmenter: Segmenter) -> Segmenter:
        """Return a segmenter as wrong as the noise has it."""
        return _WrongLabels(segmenter, self) if self.noise.labels else segmenter

    def rng(self, kind: int, number: int) -> np.random.Generator:
        """Return the source of what is drawn for an image or a position."""
        scene = zlib.crc32(self.scene.name.encode())
        return np.random.default_rng([self.seed, scene, kind, number])

    def _misplaced(self, pose: Pose3D, position: int) -> Pose3D:
        rng = self.rng(_POSE, position)
        off_x, off_y = rng.normal(0.0, self.noise.position / 1000, 2).tolist()
        turn = math.radians(rng.normal(0.0, self.noise.heading))
        matrix = pose.matrix()
        cos, sin = math.cos(turn), math.sin(turn)
        matrix[:2, :3] = np.array([[cos, -sin], [sin, cos]]) @ matrix[:2, :3]
        matrix[:2, 3] += off_x, off_y
        return Pose3D.from_matrix(matrix)


class _WrongLabels:
    """A segmenter that gives some pixels any class at all."""

    def __init__(self, segmenter: Segmenter, sensors: Sensors) -> None:
        self._segmenter = segmenter
        self._sensors = sensors
        self.name = segmenter.name

    def labels(self, frame: RgbdFrame, points: NDArray[np.float64]) -> NDArray[np.uint8]:
        """See `Segmenter`."""
        labels = self._segmenter.labels(frame, points).copy()
        rng = self._sensors.rng(_LABELS, index_of(frame.name))
        wrong = rng.random(labels.shape, np.float32) < self._sensors.noise.labels
        labels[wrong] = rng.integers(len(CLASSES), size=int(wrong.sum()), dtype=np.uint8)
        return labels
