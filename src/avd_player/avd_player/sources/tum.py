"""Sequences of the TUM RGB-D benchmark.

``rgb.txt`` and ``depth.txt`` list times and files, ``groundtruth.txt`` times and poses of the
camera (x, y, z, and the quaternion x, y, z, w); depth counts 5000 to the metre. What belongs
together is nearest in time. ``camera-intrinsics.txt`` (K) may lie beside them.
"""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from avd_player.sources.sequence import (
    PosedSequence,
    SequenceEntry,
    SequenceFormat,
    read_intrinsics,
)
from gridnav.rgbd import Camera, FrameError, Pose3D

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

EXPECTED = 'rgb.txt, depth.txt and groundtruth.txt (TUM)'

COLOR_LIST, DEPTH_LIST, POSE_LIST = 'rgb.txt', 'depth.txt', 'groundtruth.txt'

DEFAULT_CAMERA = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
"""What the benchmark advises for its images as they are."""

UNITS_PER_METRE = 5000.0

MAX_APART_NS = 20_000_000
"""What is further apart in time does not belong together."""

POSE_VALUES = 7


def is_tum(folder: Path) -> bool:
    """Tell whether a folder holds such a sequence."""
    return (folder / COLOR_LIST).is_file()


def open_tum(folder: Path, width: int = 0) -> PosedSequence:
    """Open a sequence.

    Args:
        folder: Where its lists lie.
        width: Of the frames in pixels; 0 for that of the images.

    Raises:
        FrameError: If it can't be used.
    """
    colors = _read_list(folder / COLOR_LIST, 1)
    depths = _read_list(folder / DEPTH_LIST, 1)
    poses = _read_list(folder / POSE_LIST, POSE_VALUES)
    depth_stamps, pose_stamps = (np.array(sorted(items)) for items in (depths, poses))
    entries = {}
    for stamp, (file,) in sorted(colors.items()):
        depth, pose = _nearest(depth_stamps, stamp), _nearest(pose_stamps, stamp)
        if depth is not None and pose is not None:
            entries[file] = SequenceEntry(
                stamp,
                folder / file,
                folder / depths[depth][0],
                partial(_pose, file, poses[pose]),
            )
    written = SequenceFormat(read_intrinsics(folder, DEFAULT_CAMERA), UNITS_PER_METRE)
    return PosedSequence(folder.resolve().name, entries, written, width=width)


def _read_list(path: Path, values: int) -> dict[int, list[str]]:
    """Read lines of a time and values; lines that are cut are left out.

    Raises:
        FrameError: If there are no such lines.
    """
    try:
        lines = path.read_text(encoding='utf-8', errors='replace').splitlines()
    except OSError as error:
        msg = f'{path.name} is missing.'
        raise FrameError(msg) from error
    items: dict[int, list[str]] = {}
    for line in lines:
        time, *texts = line.split() or ['#']
        if time.startswith('#') or len(texts) < values:
            continue
        try:
            # A float holds these times to a tenth of a microsecond only.
            items[int(Decimal(time).scaleb(9))] = texts[:values]
        except (InvalidOperation, ValueError, OverflowError):
            continue
    if not items:
        msg = f'{path.name} lists nothing: expected lines of a time and {values} values.'
        raise FrameError(msg)
    return items


def _nearest(stamps: NDArray[np.int64], stamp: int) -> int | None:
    """Return the nearest of the sorted stamps, if it is near."""
    place = int(np.searchsorted(stamps, stamp))
    near = stamps[max(place - 1, 0) : place + 1]
    best = int(near[np.abs(near - stamp).argmin()])
    return best if abs(best - stamp) <= MAX_APART_NS else None


def _pose(file: str, texts: list[str]) -> NDArray[np.float64]:
    """Return the pose that a line says, (4, 4).

    Raises:
        FrameError: If it says none.
    """
    try:
        x, y, z, *quaternion = (float(text) for text in texts)
    except ValueError:
        quaternion = [0.0]
    length = float(np.linalg.norm(quaternion))
    if not (np.isfinite(length) and length > 0 and np.isfinite([x, y, z]).all()):
        msg = f'The pose of {file} in {POSE_LIST} is none: {" ".join(texts)}.'
        raise FrameError(msg)
    return Pose3D(x, y, z, *(np.array(quaternion) / length).tolist()).matrix()
