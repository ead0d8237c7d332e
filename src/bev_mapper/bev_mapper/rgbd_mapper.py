"""From RGB-D frames to a labelled cloud and a map."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from bev_mapper.evidence_grid import Crop, Evidence, EvidenceGrid
from bev_mapper.floor import FloorTracker, Plane
from bev_mapper.grid_fusion import DEFAULT_GROWTH, DEFAULT_MAX_CELLS
from bev_mapper.majority_grid import MajorityGrid
from bev_mapper.segmentation import CloudSegmenter, GeometricSegmenter
from bev_mapper.unprojection import depth_in_metres, depth_noise, smooth, thin, unproject
from bev_mapper.voxel_cloud import VoxelCloud
from gridnav.grid import GridGeometry
from gridnav.rgbd import CLASSES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bev_mapper.segmentation import Segmenter
    from gridnav.rgbd import RgbdFrame

Mode = Literal['evidence', 'majority']

Stage = Literal['unprojection', 'floor', 'segmentation', 'grid', 'cloud']
STAGES: tuple[Stage, ...] = get_args(Stage)
"""What is done with a frame."""

FLOOR, CEILING = CLASSES.index('floor'), CLASSES.index('ceiling')

ON_FLOOR_M = 0.3
"""A robot whose pose is further from the floor than this does not stand on it."""


@dataclass(frozen=True)
class MapperConfig:
    """How frames become a map.

    Attributes:
        geometry: Where the map lies at first.
        mode: 'evidence' adds up what frames say about each cell; 'majority' counts the points of
            the cloud, as in the paper.
        growth: Cells by which a side of the map grows at least; 0 keeps it as it is.
        max_cells: The most cells it may have.
        crop: Heights between which something is an obstacle.
        footprint: Radius around the robot that is free, in metres.
        free_below: A cell whose floor was not seen is free where the camera looked through it
            lower than this, in metres.
        min_points: A frame must see so many points in a cell to say something about it.
        max_range: Depth beyond this is not mapped, in metres.
        max_pixels: The segmenter gets no more pixels of a frame than this.
        max_points: No more of them than this become points.
        max_rays: No more rays of a frame than this are followed.
        fit_floor: Whether the floor is looked for; else it is at z = 0.
        voxel: Side of the cloud's voxels in metres.
        max_voxels: The most voxels it may have.
        relabel_every: A model of whole clouds labels it after so many frames; 0 at the end alone.
    """

    geometry: GridGeometry = field(default_factory=lambda: GridGeometry(15, 15, 0.1))
    mode: Mode = 'evidence'
    growth: int = DEFAULT_GROWTH
    max_cells: int = DEFAULT_MAX_CELLS
    crop: Crop = field(default_factory=Crop)
    footprint: float = 0.2
    free_below: float = 0.3
    min_points: int = 3
    max_range: float = 5.0
    max_pixels: int = 130_000
    max_points: int = 40_000
    max_rays: int = 3000
    fit_floor: bool = True
    voxel: float = 0.04
    max_voxels: int = 1_000_000
    relabel_every: int = 0


class RgbdMapper:
    """Takes in frames one after the other.

    Attributes:
        cloud: Everything that was seen.
        grid: The map.
        frames: How many frames are in it.
        stamp: The newest stamp in it in nanoseconds, -1 if there is none.
        segmenter: Name of what tells floor from obstacles.
        position: x and y of the last frame's pose in metres, None before the first one.
        floor: Where the last frame's floor was.
        timings: Seconds that each stage of the last frame took.
    """

    def __init__(
        self,
        config: MapperConfig | None = None,
        segmenter: Segmenter | CloudSegmenter | None = None,
    ) -> None:
        """Start with nothing seen.

        Args:
            config: How to map.
            segmenter: What names the classes, the geometric one if None. With a model of whole
                clouds the mode is 'majority'.

        Raises:
            ValueError: If the first map is larger than it may be.
        """
        self.config = config = config or MapperConfig()
        found = segmenter or GeometricSegmenter()
        self._whole = found if isinstance(found, CloudSegmenter) else None
        self._pixels = GeometricSegmenter() if isinstance(found, CloudSegmenter) else found
        self.segmenter = found.name
        self.cloud = VoxelCloud(config.voxel, config.max_voxels)
        self.grid: EvidenceGrid | MajorityGrid
        if self._whole is not None or config.mode == 'majority':
            self.grid = MajorityGrid(
                config.geometry, config.crop, growth=config.growth, max_cells=config.max_cells
            )
        else:
            self.grid = EvidenceGrid(
                config.geometry,
                config.crop,
                growth=config.growth,
                max_cells=config.max_cells,
                footprint=config.footprint,
                free_below=config.free_below,
                min_points=config.min_points,
            )
        self._tracker = FloorTracker()
        self._forget()

    def _forget(self) -> None:
        self.frames = 0
        self.stamp = -1
        self.position: tuple[float, float] | None = None
        self.floor = Plane()
        self.timings = dict.fromkeys(STAGES, 0.0)

    def clear(self) -> None:
        """Forget all frames."""
        self.cloud.clear()
        self.grid.clear()
        self._tracker.clear()
        self._forget()

    def add(self, frame: RgbdFrame) -> None:
        """Take in a frame.

        Raises:
            ValueError: If it lacks what the segmenter needs or the map would grow beyond its
                limit, with one sentence that says so; the map is as it was.
        """
        clock = _Clock()
        seen, color, kinds = self._look(frame, clock)
        if isinstance(self.grid, EvidenceGrid):
            self.grid.update(seen)
        clock.lap('grid')

        self.cloud.merge(seen.points, color, kinds)
        clock.lap('cloud')
        self.frames += 1
        self.stamp = max(self.stamp, frame.stamp)
        self.position = frame.pose[:2]
        if isinstance(self.grid, MajorityGrid):
            every = self.config.relabel_every
            if self._whole is not None and every and self.frames % every == 0:
                self._relabel(self._whole)
                clock.lap('segmentation')
            self.grid.project(self.cloud.points())
            clock.lap('grid')
        self.timings = clock.laps

    def evidence(self, frame: RgbdFrame) -> Evidence:
        """Return what a frame says about cells, without adding it to the map.

        It depends on the frame alone where the floor is not looked for.

        Raises:
            ValueError: If the frame lacks what the segmenter needs.
        """
        return self._look(frame, _Clock())[0]

    def _look(
        self, frame: RgbdFrame, clock: _Clock
    ) -> tuple[Evidence, NDArray[np.uint8], NDArray[np.uint8]]:
        """Return what a frame says, and colours (N, 3) and classes (N,) of its points."""
        config = self.config
        _check(frame)
        frame = thin(frame, config.max_pixels)
        depth = depth_in_metres(frame.depth)
        depth = smooth(depth, depth_noise(depth))
        frame = replace(frame, depth=depth)
        # To a nanometre: what a pose loses on its way through a message changes no cell.
        camera_to_map = np.round(frame.camera_to_map(), 9)
        points = unproject(depth, frame.camera, camera_to_map)
        near = (depth > 0) & (depth <= config.max_range)
        camera = camera_to_map[:3, 3].copy()
        clock.lap('unprojection')

        if config.fit_floor:
            self.floor = self._tracker.fit(points, near, camera_to_map)
            points[2] -= self.floor.height_at(points[0], points[1])
            camera[2] -= self.floor.height_at(camera[0], camera[1])
        clock.lap('floor')

        labels = self._pixels.labels(frame, points)
        clock.lap('segmentation')

        some = _some(near.shape, config.max_points)
        kept = np.flatnonzero(near[some])
        flat = np.take(points[:, *some].reshape(3, -1), kept, axis=1)
        kinds = labels[some].reshape(-1)[kept]
        seen = Evidence(
            points=flat,
            is_floor=kinds == FLOOR,
            is_solid=(kinds != FLOOR) & (kinds != CEILING),
            camera=camera,
            rays=self._rays(points, depth, camera),
            robot=self._on_floor(frame),
        )
        return seen, frame.color[some].reshape(-1, 3)[kept], kinds

    def finish(self) -> None:
        """Do what is done once all frames are there: a model of whole clouds labels the cloud."""
        if self._whole is not None and isinstance(self.grid, MajorityGrid):
            self._relabel(self._whole)
            self.grid.project(self.cloud.points())

    def _relabel(self, model: CloudSegmenter) -> None:
        points = self.cloud.points()
        if len(points.labels):
            self.cloud.relabel(model.cloud_labels(points.positions, points.colors))

    def _rays(
        self,
        points: NDArray[np.float64],
        depth: NDArray[np.float32],
        camera: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return up to where the camera sees, for some of the pixels, (3, N)."""
        some = _some(depth.shape, self.config.max_rays)
        depths = depth[some].reshape(-1)
        seen = np.flatnonzero(depths)
        ends = np.take(points[:, *some].reshape(3, -1), seen, axis=1)
        # What is too far away to be mapped still shows that nothing is before it.
        part = np.minimum(self.config.max_range / depths[seen], 1.0)
        rays: NDArray[np.float64] = camera[:, None] + (ends - camera[:, None]) * part
        return rays

    def _on_floor(self, frame: RgbdFrame) -> tuple[float, float] | None:
        """Return where the robot stands, None where the pose is that of a camera in the air."""
        x, y, z = frame.pose[:3]
        height = abs(z - self.floor.height_at(x, y))
        return (x, y) if self.config.footprint > 0 and height <= ON_FLOOR_M else None


class _Clock:
    """Measures what stages take."""

    def __init__(self) -> None:
        self.laps: dict[Stage, float] = dict.fromkeys(STAGES, 0.0)
        self._last = time.perf_counter()

    def lap(self, stage: Stage) -> None:
        """Add the time since the last call to a stage."""
        now = time.perf_counter()
        self.laps[stage] += now - self._last
        self._last = now


def _some(shape: tuple[int, ...], most: int) -> tuple[slice, slice]:
    """Return some rows and columns of a picture, with no more than so many pixels.

    More columns than rows: what is thin, such as a table's leg, is upright.
    """
    height, width = shape
    factor = max(1, -(-height * width // most))
    across = math.isqrt(factor)
    down = -(-factor // across)
    while len(range(down // 2, height, down)) * len(range(across // 2, width, across)) > most:
        down += 1
    return slice(down // 2, None, down), slice(across // 2, None, across)


def _check(frame: RgbdFrame) -> None:
    """Refuse a frame whose parts do not fit together."""
    sizes = {
        'colour': frame.color.shape[:2],
        'depth': frame.depth.shape,
        'camera': (frame.camera.height, frame.camera.width),
    }
    if len(set(sizes.values())) > 1:
        found = ', '.join(f'{what} {rows} x {cols}' for what, (rows, cols) in sizes.items())
        msg = f'{frame.name} has parts of unequal size (rows x columns): {found}.'
        raise ValueError(msg)
