"""How long mapping an RGB-D frame takes, beside the obvious pipeline of open3d, and its memory."""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import time
from dataclasses import asdict, dataclass
from itertools import cycle, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from bev_mapper.rgbd_mapper import STAGES, MapperConfig, RgbdMapper
from bev_mapper.room import Box, chair, render, table
from bev_mapper.segmentation import make_segmenter
from gridnav.rgbd import CLASSES, Camera, Pose3D
from vgdp_experiments.files import write_whole
from vgdp_experiments.options import whole_number

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from bev_mapper.evidence_grid import Crop
    from gridnav.rgbd import RgbdFrame

FOCAL = 0.83
"""Focal length in widths of the picture: a view of 62 degrees."""

HALL = Box((-7.0, -5.0, 0.0), (7.0, 5.0, 2.6), CLASSES.index('wall'))
WALL = CLASSES.index('wall')
THINGS = (
    *table(-4.0, 2.5), *chair(-4.0, 1.6), *chair(-4.0, 3.4), *table(3.5, -2.5), *chair(3.5, -3.4),
    *table(4.5, 2.5), *chair(4.5, 1.6),
    Box((-0.1, -5.0, 0.0), (0.1, -1.5, 2.6), WALL), Box((-0.1, 1.5, 0.0), (0.1, 5.0, 2.6), WALL),
    Box((-7.0, -4.5, 0.0), (-6.5, -1.0, 2.0), CLASSES.index('bookcase')),
    Box((-4.5, -5.0, 0.0), (-2.5, -4.1, 0.7), CLASSES.index('sofa')),
    Box((6.4, -2.0, 0.0), (7.0, 1.0, 0.9), CLASSES.index('clutter')),
)  # fmt: skip
"""A flat of 14 m by 10 m: two rooms with an opening between them."""

VIEWS = 40
"""Different frames; a robot that goes round sees them again and again."""

LAST = 0.2
"""The last part of the frames counts, when the cloud is as large as it gets."""

TARGET_RATIO = 5.0
TARGET_RATES = {'640x480': 10.0}
"""Frames a second that two cores should reach at least."""

BASELINE_STAGES = ('create_from_rgbd_image', 'voxel_down_sample', 'accumulate', 'project')


@dataclass(frozen=True)
class SizeResult:
    """What frames of one size took.

    Attributes:
        size: Width and height.
        frames: How many were mapped.
        median_ms: Median of the last ones.
        p95_ms: 95th percentile of these.
        frames_per_second: That come of the median.
        stages_ms: Median of each stage.
        processor_ms: Median of the processors' time, which other programs disturb little.
        baseline_ms: Median of open3d's pipeline on the same frames, None without open3d.
        baseline_stages_ms: Median of each of its stages.
        ratio: How many times as much processors' time that takes.
        bounded_ratio: The same where open3d downsamples the whole cloud after each frame, so that
            it does not grow for ever.
        target_ratio: What that should be at least.
        target_rate: Frames a second that are asked for, if there is a target for this size.
    """

    size: str
    frames: int
    median_ms: float
    p95_ms: float
    frames_per_second: float
    stages_ms: dict[str, float]
    processor_ms: float
    baseline_ms: float | None
    baseline_stages_ms: dict[str, float]
    ratio: float | None
    bounded_ratio: float | None
    target_ratio: float
    target_rate: float | None


@dataclass(frozen=True)
class MemoryResult:
    """How the memory of the process grew.

    Attributes:
        frames: After how many frames it was looked at, at first and at last.
        peak_mb: What the process had taken at most by then.
        voxels: Of the cloud by then.
    """

    frames: tuple[int, int]
    peak_mb: tuple[float, float]
    voxels: tuple[int, int]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp bench mapper``."""
    parser.add_argument(
        '--sizes',
        nargs='+',
        type=size,
        default=[(640, 480), (1920, 1080)],
        metavar='WxH',
        help='sizes of the frames in pixels (640x480 1920x1080)',
    )
    parser.add_argument(
        '--frames', type=whole_number(5), default=100, help='frames of each size (%(default)s)'
    )
    parser.add_argument(
        '--memory-frames',
        type=whole_number(0),
        default=1000,
        help='frames over which the memory is watched, 0 for none (%(default)s)',
    )
    parser.add_argument(
        '--segmenter', default='geometric', metavar='NAME', help='geometric or learned (geometric)'
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='file to write the numbers to')


def size(text: str) -> tuple[int, int]:
    """Read a width and a height, as in 640x480."""
    width, _, height = text.partition('x')
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        msg = f'{text!r} is no size such as 640x480'
        raise argparse.ArgumentTypeError(msg)
    return int(width), int(height)


def run(args: argparse.Namespace) -> int:
    """Time frames, print the tables and write the numbers; returns the exit status."""
    make_segmenter(args.segmenter)
    memory = watch_memory(args.segmenter, args.memory_frames) if args.memory_frames else None
    results = [time_size(shape, args.frames, args.segmenter) for shape in args.sizes]
    print_results(results, memory, args.segmenter)
    if args.json is not None:
        record = {
            'machine': machine(),
            'segmenter': args.segmenter,
            'sizes': [asdict(result) for result in results],
            'memory': memory and asdict(memory),
        }
        args.json.parent.mkdir(parents=True, exist_ok=True)
        write_whole(args.json, json.dumps(record, indent=2) + '\n')
    return 0


def views(shape: tuple[int, int]) -> Iterator[RgbdFrame]:
    """Yield endless frames of a robot that goes round a room."""
    width, height = shape
    camera = Camera(width, height, FOCAL * width, FOCAL * width, (width - 1) / 2, (height - 1) / 2)
    frames = [
        render(camera, tour(number), number, things=THINGS, room=HALL)
        for number in tqdm(range(VIEWS), desc=f'drawing {width}x{height}', leave=False)
    ]
    return cycle(frames)


def tour(number: int) -> Pose3D:
    """Return where the robot is in one of the views: it turns as it goes round both rooms."""
    angle = 2 * np.pi * number / VIEWS
    yaw = 6 * angle
    return Pose3D(
        x=float(4.5 * np.cos(angle)),
        y=float(np.sin(2 * angle)),
        qz=float(np.sin(yaw / 2)),
        qw=float(np.cos(yaw / 2)),
    )


def time_size(shape: tuple[int, int], frames: int, segmenter: str) -> SizeResult:
    """Map frames of a size, each by the mapper and by open3d in turn."""
    mapper = new_mapper(segmenter)
    open3d = import_open3d()
    baselines = open3d and [
        Baseline(open3d, mapper.config, bounded=bounded) for bounded in (False, True)
    ]
    times: list[list[float]] = []
    stages: list[list[float]] = []
    baseline_stages: list[list[float]] = []
    name = f'{shape[0]}x{shape[1]}'
    for frame in tqdm(islice(views(shape), frames), desc=name, total=frames, unit='frame'):
        began = time.process_time()
        mapper.add(frame)
        times.append([time.process_time() - began])
        stages.append([mapper.timings[stage] for stage in STAGES])
        for baseline in baselines or ():
            began = time.process_time()
            found = baseline.add(frame)
            times[-1].append(time.process_time() - began)
            if baseline is baselines[0]:
                baseline_stages.append(found)
    last = max(1, round(LAST * frames))
    ours = 1e3 * np.array(stages[-last:])
    theirs = 1e3 * np.array(baseline_stages[-last:])
    spent = 1e3 * np.median(times[-last:], axis=0)
    median = float(np.median(ours.sum(axis=1)))
    return SizeResult(
        size=name,
        frames=frames,
        median_ms=median,
        p95_ms=float(np.percentile(ours.sum(axis=1), 95)),
        frames_per_second=1e3 / median,
        stages_ms=dict(zip(STAGES, np.median(ours, axis=0).tolist(), strict=True)),
        processor_ms=float(spent[0]),
        baseline_ms=float(np.median(theirs.sum(axis=1))) if baselines else None,
        baseline_stages_ms=dict(
            zip(BASELINE_STAGES, np.median(theirs, axis=0).tolist(), strict=True)
        )
        if baselines
        else {},
        ratio=float(spent[1] / spent[0]) if baselines else None,
        bounded_ratio=float(spent[2] / spent[0]) if baselines else None,
        target_ratio=TARGET_RATIO,
        target_rate=TARGET_RATES.get(name),
    )


def new_mapper(segmenter: str) -> RgbdMapper:
    """Return a mapper as the node makes it by default."""
    return RgbdMapper(MapperConfig(), make_segmenter(segmenter))


def watch_memory(segmenter: str, frames: int) -> MemoryResult:
    """Map many frames of 640 x 480 pixels and look how the memory grows."""
    mapper = new_mapper(segmenter)
    early = max(1, frames // 10)
    peak_mb, voxels = [], []
    shown = tqdm(islice(views((640, 480)), frames), desc='memory', total=frames, unit='frame')
    for number, frame in enumerate(shown, start=1):
        mapper.add(frame)
        if number in {early, frames}:
            peak_mb.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
            voxels.append(len(mapper.cloud))
    return MemoryResult((early, frames), (peak_mb[0], peak_mb[-1]), (voxels[0], voxels[-1]))


def import_open3d() -> Any:  # noqa: ANN401 - a module without types
    """Return open3d, or None where it is not installed."""
    try:
        import open3d  # noqa: PLC0415 - optional, and takes seconds
    except ImportError:
        return None
    return open3d


class Baseline:
    """What one would write with open3d in an afternoon."""

    def __init__(self, open3d: Any, config: MapperConfig, *, bounded: bool) -> None:  # noqa: ANN401
        """Start with an empty cloud.

        Args:
            open3d: The module.
            config: Of the mapper, for what both have in common.
            bounded: Whether to downsample the whole cloud after each frame, not the frame alone.
        """
        self._open3d = open3d
        self._config = config
        self._bounded = bounded
        self._cloud = open3d.geometry.PointCloud()

    def add(self, frame: RgbdFrame) -> list[float]:
        """Map a frame; returns the seconds of each of `BASELINE_STAGES`."""
        geometry, voxel = self._open3d.geometry, self._config.voxel
        times = [time.perf_counter()]
        images = geometry.RGBDImage.create_from_color_and_depth(
            geometry.Image(frame.color),
            geometry.Image(frame.depth),
            depth_scale=1000.0,
            depth_trunc=self._config.max_range,
            convert_rgb_to_intensity=False,
        )
        points = geometry.PointCloud.create_from_rgbd_image(
            images,
            self._open3d.camera.PinholeCameraIntrinsic(*frame.camera),
            np.linalg.inv(frame.camera_to_map()),
        )
        times.append(time.perf_counter())
        if self._bounded:
            self._cloud = (self._cloud + points).voxel_down_sample(voxel)
            times += 2 * [time.perf_counter()]
        else:
            points = points.voxel_down_sample(voxel)
            times.append(time.perf_counter())
            self._cloud += points
            times.append(time.perf_counter())
        positions = np.asarray(self._cloud.points)
        project(positions, self._config.geometry.resolution, self._config.crop)
        times.append(time.perf_counter())
        return np.diff(times).tolist()


def project(points: NDArray[np.float64], resolution: float, crop: Crop) -> NDArray[np.bool_]:
    """Return which cells hold more obstacles than floor, by height alone, (H, W)."""
    points = points[points[:, 2] < crop.high]
    cells = np.floor(points[:, :2] / resolution).astype(np.int64)
    cells -= cells.min(axis=0)
    cols, rows = cells.max(axis=0) + 1
    flat = cells[:, 1] * cols + cells[:, 0]
    solid = points[:, 2] > crop.low
    obstacles = np.bincount(flat[solid], minlength=rows * cols)
    floor = np.bincount(flat[~solid], minlength=rows * cols)
    return (obstacles >= floor).reshape(rows, cols)


def machine() -> dict[str, object]:
    """Return what the numbers depend on."""
    return {
        'processor': platform.machine(),
        'cores': os.cpu_count(),
        'load': os.getloadavg()[0],
        'numpy': np.__version__,
    }


def print_results(
    results: Sequence[SizeResult], memory: MemoryResult | None, segmenter: str
) -> None:
    """Print the tables."""
    console = Console()
    table = Table(title=f'One RGB-D frame, {segmenter} segmenter, in milliseconds')
    headings = (
        'frame',
        'median',
        '95 %',
        'frames/s',
        'target',
        'CPU',
        'open3d',
        'ratio',
        'target',
    )
    for heading in (*headings, 'bounded'):
        table.add_column(heading, justify='right')
    stages = Table(title='Stages')
    for heading in ('frame', *STAGES):
        stages.add_column(heading, justify='right')
    theirs = Table(title='Stages of the open3d pipeline')
    for heading in ('frame', *BASELINE_STAGES):
        theirs.add_column(heading, justify='right')
    for result in results:
        table.add_row(
            result.size,
            f'{result.median_ms:.1f}',
            f'{result.p95_ms:.1f}',
            f'{result.frames_per_second:.1f}',
            '' if result.target_rate is None else f'≥ {result.target_rate:.0f}',
            f'{result.processor_ms:.1f}',
            '' if result.baseline_ms is None else f'{result.baseline_ms:.1f}',
            '' if result.ratio is None else f'{result.ratio:.1f}',
            f'≥ {result.target_ratio:.0f}',
            '' if result.bounded_ratio is None else f'{result.bounded_ratio:.1f}',
        )
        stages.add_row(result.size, *(f'{value:.1f}' for value in result.stages_ms.values()))
        if result.baseline_stages_ms:
            found = (f'{value:.1f}' for value in result.baseline_stages_ms.values())
            theirs.add_row(result.size, *found)
    console.print(table, stages, *([theirs] if theirs.row_count else []))
    if memory is not None:
        (early, late), (before, after) = memory.frames, memory.peak_mb
        console.print(
            f'Memory of the process: {before:.0f} MB after {early} frames, {after:.0f} MB after '
            f'{late}, with {memory.voxels[0]} and {memory.voxels[1]} voxels.',
            soft_wrap=True,
        )
    here = machine()
    console.print(
        f'The last {LAST:.0%} of the frames of each size, on {here["cores"]} cores of '
        f'{here["processor"]}; the load while this was measured was {here["load"]:.1f}. open3d '
        'maps the same frames in turn: create_from_rgbd_image, voxel_down_sample, accumulate, '
        'project the whole cloud. The ratios are those of the time of the processors (CPU), which '
        'other programs disturb least; "bounded" is that of open3d where it downsamples the whole '
        'cloud after each frame.',
        soft_wrap=True,
    )
