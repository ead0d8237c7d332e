"""Readers of posed colour and depth images, one file for each format."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from avd_player.avd_format import looks_like_scene
from avd_player.sources.avd import AvdSource
from avd_player.sources.sequence import PosedSequence
from avd_player.sources.seven_scenes import EXPECTED as SEVEN_SCENES_FILES
from avd_player.sources.seven_scenes import is_seven_scenes, open_seven_scenes
from avd_player.sources.tum import EXPECTED as TUM_FILES
from avd_player.sources.tum import is_tum, open_tum
from gridnav.rgbd import FrameError, Pose3D

__all__ = ['FORMATS', 'AvdSource', 'PosedSequence', 'mounted_pose', 'open_source', 'scenes_in']

FORMATS = (
    (looks_like_scene, AvdSource),
    (is_seven_scenes, open_seven_scenes),
    (is_tum, open_tum),
)
"""How each format is told from the others, and what opens it."""

_EXPECTED = (
    'jpg_rgb, high_res_depth, annotations.json and image_structs.mat (Active Vision Dataset), '
    f'{SEVEN_SCENES_FILES}, or {TUM_FILES}'
)


def mounted_pose(source: AvdSource | PosedSequence, name: str) -> Pose3D:
    """Return where the robot is, in space, for the one mount that a source has for all frames.

    The pose and the mount of a frame by itself may share out tilt and height in another way.
    """
    mount = np.linalg.inv(source.mount.matrix())
    return Pose3D.from_matrix(source.camera_to_map(name) @ mount)


def open_source(path: str | Path, width: int = 0) -> AvdSource | PosedSequence:
    """Open a scene or a sequence, whatever its format.

    Args:
        path: Its folder.
        width: Of the frames in pixels; 0 for that of the images.

    Raises:
        FrameError: If it is none, with one sentence that says what was expected.
    """
    folder = Path(path)
    if not folder.is_dir():
        msg = f'{str(path)!r} is no folder with RGB-D images.'
        raise FrameError(msg)
    for is_format, open_it in FORMATS:
        if is_format(folder):
            return open_it(folder, width)
    scenes = scenes_in(folder)
    if scenes:
        msg = f'{folder} holds {len(scenes)} scenes: name one of them, such as {scenes[0]}.'
        raise FrameError(msg)
    msg = f'{folder} holds no RGB-D images that can be read, expected {_EXPECTED}.'
    raise FrameError(msg)


def scenes_in(folder: Path) -> list[Path]:
    """Return the scenes of the Active Vision Dataset in a folder: itself, or those below it."""
    if looks_like_scene(folder):
        return [folder]
    return sorted(path for path in folder.iterdir() if path.is_dir() and looks_like_scene(path))
