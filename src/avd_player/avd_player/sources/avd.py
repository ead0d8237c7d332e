"""Scenes of the Active Vision Dataset: images without distortion, placed in a map with z up."""

from __future__ import annotations

import math
import warnings
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from avd_player.avd_format import (
    COLOR_FOLDER,
    DEPTH_FOLDER,
    GRID_M,
    LABEL_FOLDER,
    STRUCTS,
    ImageStruct,
    SceneFiles,
    depth_name,
    index_of,
    looks_like_scene,
    read_scene_files,
)
from avd_player.distortion import Lens, Straightener
from avd_player.floor import Floor, align_to_grid, down_of, fit_floor, levelled, lowest_floor
from avd_player.sources.images import (
    image_size,
    read_color,
    read_depth,
    read_labels,
    sample_depth,
    scaled_camera,
)
from gridnav.rgbd import UNLABELLED, Camera, CameraMount, FrameError, Pose3D, RgbdFrame

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

IMAGE_PERIOD_NS = 100_000_000
"""The dataset has no times: image n has the stamp n times this."""

FLOOR_IMAGES = 12
"""The floor is fitted to the depth of this many images."""

BELOW_CAMERA_M = 0.3
"""The floor is further below each camera than this; what is higher is not looked at for it."""

MAX_GRAVITY_ERROR = 0.03
"""In radians: where floor and poses differ by more on what is level, the floor is right."""

DEFAULT_HEIGHT_M = 1.0
"""Of the camera, where no depth image can be read."""


class AvdSource:
    """A scene, behind ``gridnav.rgbd.FrameSource``; images are read when they are asked for.

    The frame of the map has z up and z = 0 on the floor, which is fitted to some of the depth
    images. It is turned about z by 45 degrees and moved by 0.15 m at most so that the positions
    lie on whole multiples of 0.30 m, as far as they lie on a grid.

    Attributes:
        files: What the folder holds, with everything that is wrong with it.
        lens: The camera that the images were taken with.
        camera: The pinhole camera of the frames.
    """

    def __init__(self, folder: Path, width: int = 0) -> None:
        """Read what is known of the images, but none of them.

        Args:
            folder: Of the scene.
            width: Of the frames in pixels, at most that of the images; 0 for that.

        Raises:
            FrameError: If this is no scene, or none of its images has a place.
        """
        if not looks_like_scene(folder):
            msg = f'{folder} is no scene: it has neither images nor poses nor annotations.'
            raise FrameError(msg)
        self.files: SceneFiles = read_scene_files(folder)
        scale = self.files.scale
        placed = self.files.structs
        if scale is None or not placed:
            why = next((p for p in self.files.problems if STRUCTS in p), 'No image has a pose.')
            msg = f'{folder} can not be used: {why}'
            raise FrameError(msg)
        self._unit = scale / 1000
        self._structs = {struct.name: struct for struct in placed}
        on_disk = set(self.files.colors)
        self._names = sorted(
            name
            for name in self._structs
            if name in on_disk and depth_name(name) in self.files.depths
        )
        for sentence in (*self.files.problems, *self.files.guesses):
            warnings.warn(f'{self.files.name}: {sentence}', stacklevel=2)

        registered = [s.rotation for s in placed if s.rotation is not None]
        self._down = down_of(np.stack(registered)) if registered else np.array([0.0, 1.0, 0.0])
        pitches = [math.asin(np.clip(r[2] @ self._down, -1.0, 1.0)) for r in registered]
        self._pitch = float(np.median(pitches)) if pitches else 0.0
        self.lens = self._fitting_lens()
        self.camera: Camera = scaled_camera(self.lens.camera(), width)
        self._straightener = Straightener(self.lens, self.camera)

    @property
    def name(self) -> str:
        """The scene's name."""
        return self.files.name

    @property
    def frame_names(self) -> Sequence[str]:
        """File names of the colour images that have a pose and depth."""
        return self._names

    @property
    def placed_names(self) -> Sequence[str]:
        """File names of all images that have a pose, whether they are on disk or not."""
        return sorted(self._structs)

    def stamp_of(self, name: str) -> int:
        """Return when an image was taken, in nanoseconds."""
        return index_of(name) * IMAGE_PERIOD_NS

    def cluster_of(self, name: str) -> int:
        """Return the number of the position that an image was taken at."""
        return self._structs[name].cluster

    @cached_property
    def map_from_world(self) -> NDArray[np.float64]:
        """What takes points of the scene's world, in metres, into the map, (4, 4)."""
        level = self._floor().to_level()
        positions = self._positions() @ level[:2, :3].T + level[:2, 3]
        yaw, offset = align_to_grid(positions, GRID_M)
        turn = np.eye(4)
        turn[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
        turn[:2, 3] = offset
        return turn @ level

    def camera_to_map(self, name: str) -> NDArray[np.float64]:
        """Return what takes points of an image's optical frame into the map, (4, 4)."""
        return self.map_from_world @ self._camera_to_world(self._structs[name])

    def place_of(self, name: str) -> tuple[Pose3D, CameraMount]:
        """Return where the robot was on the floor, and where its camera was on it."""
        matrix = self.camera_to_map(name)
        (x, y, height), turn = matrix[:3, 3].tolist(), matrix[:3, :3]
        right, forward = turn[:, 0], turn[:, 2]
        yaw = math.atan2(forward[1], forward[0])
        level = math.hypot(forward[0], forward[1])
        roll = math.atan2(-right[2], -turn[2, 1])
        pose = Pose3D(x, y, 0.0, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        return pose, CameraMount(z=height, roll=roll, pitch=math.atan2(-forward[2], level))

    @cached_property
    def mount(self) -> CameraMount:
        """Where the camera sits on the robot: the middle over all images, without roll."""
        mounts = [self.place_of(name)[1] for name in self._structs]
        height, pitch = np.median([(mount.z, mount.pitch) for mount in mounts], axis=0).tolist()
        return CameraMount(z=height, pitch=pitch)

    def read(self, name: str) -> RgbdFrame:
        """Read a frame.

        Raises:
            FrameError: If it can't be read, with one sentence that says why.
        """
        if name not in self._structs:
            msg = f'{self.name} has no image {name!r} with a pose.'
            raise FrameError(msg)
        folder, size = self.files.folder, (self.lens.width, self.lens.height)
        enough = self.camera.width, self.camera.height
        image = read_color(folder / COLOR_FOLDER / name, size, enough)
        depth = self._straightener.values(self.read_raw_depth(name))
        labels = None
        label_file = self.files.labels.get(name[:11])
        if label_file is not None:
            raw = read_labels(folder / LABEL_FOLDER / label_file, size)
            labels = self._straightener.values(raw, UNLABELLED)
        pose, mount = self.place_of(name)
        return RgbdFrame(
            name=name,
            stamp=self.stamp_of(name),
            color=self._straightener.color(image),
            depth=depth,
            camera=self.camera,
            pose=pose,
            mount=mount,
            labels=labels,
        )

    def read_raw_depth(self, name: str) -> NDArray[np.uint16]:
        """Read the depth of an image as the lens saw it: millimetres, (H, W) of the lens.

        Raises:
            FrameError: If it can't be read, or is not of the lens's size.
        """
        path = self.files.folder / DEPTH_FOLDER / depth_name(name)
        return read_depth(path, (self.lens.width, self.lens.height))

    def _fitting_lens(self) -> Lens:
        """Return the lens at the size of the images, which the first that can be read shows."""
        for name in self._names:
            try:
                size = image_size(self.files.folder / COLOR_FOLDER / name)
            except FrameError:
                continue
            lens = self.files.lens
            return lens if size == (lens.width, lens.height) else lens.resized(*size)
        return self.files.lens

    def _positions(self) -> NDArray[np.float64]:
        """Return where the images were taken in the world, one row for each cluster, (P, 3)."""
        clusters: dict[int, list[NDArray[np.float64]]] = {}
        for struct in self._structs.values():
            clusters.setdefault(struct.cluster, []).append(self._center(struct))
        return np.stack([np.median(points, axis=0) for points in clusters.values()])

    def _center(self, struct: ImageStruct) -> NDArray[np.float64]:
        """Return where an image was taken in the world, in metres, (3,)."""
        return struct.position * self._unit

    def _camera_to_world(self, struct: ImageStruct) -> NDArray[np.float64]:
        """Return what takes points of an image's optical frame into the world, metres, (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, 3] = self._center(struct)
        if struct.rotation is not None:
            matrix[:3, :3] = struct.rotation.T
            return matrix
        # Not registered: only a direction is known, turned from that of a neighbour. The camera
        # is taken to be level to the sides and as steep as those that are known.
        right = np.cross(self._down, struct.direction)
        right /= np.linalg.norm(right)
        level = np.cross(right, self._down)
        forward = math.cos(self._pitch) * level + math.sin(self._pitch) * self._down
        matrix[:3, :3] = np.column_stack((right, np.cross(forward, right), forward))
        return matrix

    def _floor(self) -> Floor:
        """Fit the floor to some depth images, spread over the scene."""
        names = self._names
        chosen = np.linspace(0, len(names) - 1, min(FLOOR_IMAGES, len(names))).astype(int)
        clouds, lows = [], []
        for name in (names[index] for index in chosen):
            try:
                depth = self.read_raw_depth(name) / np.float32(1000)
            except FrameError:
                continue
            matrix = self._camera_to_world(self._structs[name])
            pixels, z = sample_depth(depth)
            rays = np.column_stack((self.lens.unproject(pixels + 0.5), np.ones_like(z)))
            seen = (rays * z[:, None]) @ matrix[:3, :3].T
            clouds.append(seen + matrix[:3, 3])
            lows.append(clouds[-1][seen @ self._down > BELOW_CAMERA_M])
        points = np.vstack(clouds) if clouds else np.empty((0, 3))
        low = np.vstack(lows) if lows else points
        floor = fit_floor(low, self._down)
        if floor is not None and -(floor.up @ self._down) > math.cos(MAX_GRAVITY_ERROR):
            return levelled(floor, low, self._down)
        if floor is None:
            if len(points):
                floor = lowest_floor(points, self._down)
            else:
                heights = self._positions() @ -self._down
                floor = Floor(-self._down, DEFAULT_HEIGHT_M - float(np.median(heights)))
            warnings.warn(
                f'{self.name}: No floor was found in its depth images; the camera is taken to be '
                f'{float(np.median(self._positions() @ floor.up) + floor.offset):.2f} m above it.',
                stacklevel=2,
            )
        return floor
