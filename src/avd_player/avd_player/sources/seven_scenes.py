"""Sequences as Microsoft's 7-Scenes and the examples of tsdf-fusion have them.

``frame-NNNNNN.color.jpg`` or ``.color.png``, ``.depth.png`` (millimetres, 65535 where nothing was
measured) and ``.pose.txt`` (camera to world, 4 x 4, metres), side by side.
``camera-intrinsics.txt`` (K) may lie beside them, and ``T_zup_from_world.txt``: what takes the
world into a frame with z up and z = 0 on the floor.
"""

from __future__ import annotations

import re
from functools import partial
from typing import TYPE_CHECKING

from avd_player.sources.sequence import (
    PosedSequence,
    SequenceEntry,
    SequenceFormat,
    read_intrinsics,
    read_rigid,
)
from gridnav.rgbd import Camera

if TYPE_CHECKING:
    from pathlib import Path

EXPECTED = 'frame-NNNNNN.color.jpg (or .png), .depth.png and .pose.txt (7-Scenes)'

UP_FILE = 'T_zup_from_world.txt'

DEFAULT_CAMERA = Camera(640, 480, 585.0, 585.0, 320.0, 240.0)
"""That of the data set; its own files don't say."""

FRAME_PERIOD_NS = 33_333_333
"""There are no times, but thirty frames a second."""

INVALID_DEPTH = 65535

_COLOR = re.compile(r'(frame-(\d{6}))\.color\.(?:jpg|png)')


def is_seven_scenes(folder: Path) -> bool:
    """Tell whether a folder holds such a sequence."""
    return any(folder.glob('frame-??????.color.*'))


def open_seven_scenes(folder: Path, width: int = 0) -> PosedSequence:
    """Open a sequence.

    Args:
        folder: Where its files lie.
        width: Of the frames in pixels; 0 for that of the images.

    Raises:
        FrameError: If it can't be used.
    """
    files = {path.name for path in folder.iterdir()}
    entries = {
        match[1]: SequenceEntry(
            int(match[2]) * FRAME_PERIOD_NS,
            folder / match[0],
            folder / f'{match[1]}.depth.png',
            partial(read_rigid, folder / f'{match[1]}.pose.txt'),
        )
        for match in filter(None, map(_COLOR.fullmatch, sorted(files)))
        if {f'{match[1]}.depth.png', f'{match[1]}.pose.txt'} <= files
    }
    return PosedSequence(
        folder.resolve().name,
        entries,
        SequenceFormat(read_intrinsics(folder, DEFAULT_CAMERA), invalid=INVALID_DEPTH),
        read_rigid(folder / UP_FILE) if UP_FILE in files else None,
        width,
    )
