"""Sequences of posed colour and depth images from a camera that is carried through a room."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from avd_player.floor import down_of, fit_floor, lowest_floor
from avd_player.sources.images import (
    image_size,
    nearest_pixels,
    read_color,
    read_depth,
    sample_depth,
    scaled_camera,
)
from gridnav.rgbd import Camera, CameraMount, FrameError, Pose3D, RgbdFrame

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

SAMPLED_FRAMES = 24
"""The floor is fitted to this many depth images."""

MILLIMETRES = 1000.0
"""Units per metre of depth that frames keep as it is."""

CARRIED_TOLERANCE = 0.6
"""A camera that is carried says less of what is level than one on a robot: radians."""

INTRINSICS = 'camera-intrinsics.txt'
"""Three lines of three numbers, the matrix K."""


@dataclass(frozen=True)
class SequenceEntry:
    """One frame of a sequence.

    Attributes:
        stamp: Nanoseconds.
        color: Its colour image.
        depth: Its depth image, of 16 bits.
        pose: Reads what takes points of the optical frame into the world, (4, 4); raises
            ``FrameError``.
    """

    stamp: int
    color: Path
    depth: Path
    pose: Callable[[], NDArray[np.float64]]


@dataclass(frozen=True)
class SequenceFormat:
    """How a sequence is written.

    Attributes:
        camera: That took both images.
        units_per_metre: Of the depth images.
        invalid: Value of pixels without depth, besides 0; -1 for none.
    """

    camera: Camera
    units_per_metre: float = MILLIMETRES
    invalid: int = -1


class PosedSequence:
    """A sequence, behind ``gridnav.rgbd.FrameSource``; images are read when they are asked for.

    The robot is the camera: its pose has all six degrees of freedom in a frame with z up.
    """

    def __init__(
        self,
        name: str,
        entries: dict[str, SequenceEntry],
        written: SequenceFormat,
        up_from_world: NDArray[np.float64] | None = None,
        width: int = 0,
    ) -> None:
        """Prepare to read.

        Args:
            name: What people call it.
            entries: Its frames by their names, in order.
            written: How it is written.
            up_from_world: What takes points of its world into a frame with z up and z = 0 on the
                floor, (4, 4); if None, the floor is fitted to the depth images.
            width: Of the frames in pixels; 0 for that of the images.

        Raises:
            FrameError: If it has no frames.
        """
        if not entries:
            msg = f'The sequence {name} has no frames with colour, depth and pose.'
            raise FrameError(msg)
        self.name = name
        self.mount = CameraMount()
        self._entries = entries
        self._written = replace(written, camera=_fitting_camera(written.camera, entries))
        self.camera = scaled_camera(self._written.camera, width)
        self._given_up = up_from_world

    @property
    def frame_names(self) -> Sequence[str]:
        """The frames, in order."""
        return list(self._entries)

    def stamp_of(self, name: str) -> int:
        """Return when a frame was taken, in nanoseconds."""
        return self._entries[name].stamp

    def camera_to_map(self, name: str) -> NDArray[np.float64]:
        """Return what takes points of a frame's optical frame into the map, (4, 4).

        Raises:
            FrameError: If there is no such frame, or its pose can't be read.
        """
        return self.up_from_world @ self._entry(name).pose()

    def read(self, name: str) -> RgbdFrame:
        """Read a frame.

        Raises:
            FrameError: If it can't be read, with one sentence that says why.
        """
        entry = self._entry(name)
        matrix = self.camera_to_map(name)
        full, camera = self._written.camera, self.camera
        size = full.width, full.height
        image = read_color(entry.color, size, (camera.width, camera.height))
        if image.size != (camera.width, camera.height):
            image = image.resize((camera.width, camera.height), Image.Resampling.BILINEAR)
        raw = self._without_invalid(read_depth(entry.depth, size))
        if camera != full:
            raw = nearest_pixels(raw, camera)
        units = self._written.units_per_metre
        return RgbdFrame(
            name=name,
            stamp=entry.stamp,
            color=np.asarray(image),
            depth=raw if units == MILLIMETRES else (raw / units).astype(np.float32),
            camera=camera,
            pose=Pose3D.from_matrix(matrix @ np.linalg.inv(self.mount.matrix())),
            mount=self.mount,
        )

    @cached_property
    def up_from_world(self) -> NDArray[np.float64]:
        """What takes points of the sequence's world into a frame with z up, (4, 4)."""
        if self._given_up is not None:
            return self._given_up
        names = list(self._entries)
        chosen = np.linspace(0, len(names) - 1, min(SAMPLED_FRAMES, len(names))).astype(int)
        poses, clouds = [], []
        full = self._written.camera
        for entry in (self._entries[names[index]] for index in chosen):
            try:
                pose, raw = entry.pose(), read_depth(entry.depth, (full.width, full.height))
            except FrameError:
                continue
            depth = self._without_invalid(raw) / np.float32(self._written.units_per_metre)
            pixels, z = sample_depth(depth)
            rays = np.ones((len(z), 3))
            rays[:, :2] = (pixels - (full.cx, full.cy)) / (full.fx, full.fy)
            poses.append(pose)
            clouds.append((rays * z[:, None]) @ pose[:3, :3].T + pose[:3, 3])
        if not poses:
            msg = f'The sequence {self.name} has no frame with depth and pose that can be read.'
            raise FrameError(msg)
        points = np.vstack(clouds)
        down = down_of(np.stack([pose[:3, :3].T for pose in poses]))
        floor = fit_floor(points, down, CARRIED_TOLERANCE)
        if floor is None:
            if not len(points):
                points = np.stack([pose[:3, 3] for pose in poses])
            floor = lowest_floor(points, down)
        return floor.to_level()

    def _entry(self, name: str) -> SequenceEntry:
        if name not in self._entries:
            msg = f'{self.name} has no frame {name!r}.'
            raise FrameError(msg)
        return self._entries[name]

    def _without_invalid(self, raw: NDArray[np.uint16]) -> NDArray[np.uint16]:
        if self._written.invalid >= 0:
            raw[raw == self._written.invalid] = 0
        return raw


def read_numbers(path: Path, shape: tuple[int, int]) -> NDArray[np.float64]:
    """Read a table of finite numbers from a text file.

    Raises:
        FrameError: If the file doesn't hold one of this shape.
    """
    try:
        rows = path.read_text(encoding='utf-8', errors='replace').split('\n')
        table = np.array([[float(text) for text in row.split()] for row in rows if row.strip()])
    except FileNotFoundError as error:
        msg = f'{path.name} is missing.'
        raise FrameError(msg) from error
    except (OSError, ValueError) as error:
        msg = f'{path.name} is no table of numbers ({error}).'
        raise FrameError(msg) from error
    if table.shape != shape or not np.isfinite(table).all():
        msg = f'{path.name} does not hold {shape[0]} x {shape[1]} finite numbers.'
        raise FrameError(msg)
    return table


def read_rigid(path: Path) -> NDArray[np.float64]:
    """Read a rigid transform, (4, 4).

    Raises:
        FrameError: If the file doesn't hold one.
    """
    matrix = read_numbers(path, (4, 4))
    try:
        Pose3D.from_matrix(matrix)
    except ValueError as error:
        msg = f'{path.name} holds no pose: {error}'
        raise FrameError(msg) from error
    return matrix


def read_intrinsics(folder: Path, default: Camera) -> Camera:
    """Read the intrinsics of a sequence, or take the default ones where it has none.

    Raises:
        FrameError: If its file is broken.
    """
    path = folder / INTRINSICS
    if not path.is_file():
        return default
    k = read_numbers(path, (3, 3))
    if k[0, 0] <= 0 or k[1, 1] <= 0:
        msg = f'{path.name} has focal lengths {k[0, 0]:g} and {k[1, 1]:g}, expected more than 0.'
        raise FrameError(msg)
    return default._replace(
        fx=float(k[0, 0]), fy=float(k[1, 1]), cx=float(k[0, 2]), cy=float(k[1, 2])
    )


def _fitting_camera(camera: Camera, entries: dict[str, SequenceEntry]) -> Camera:
    """Return a camera with the size of the first image that can be read, its lengths as given."""
    for entry in entries.values():
        try:
            width, height = image_size(entry.color)
        except FrameError:
            continue
        return camera._replace(width=width, height=height)
    return camera
