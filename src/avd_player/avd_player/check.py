"""The command ``vgdp avd check``: what of a scene is present, missing or broken."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from avd_player.avd_format import (
    SCENE_NAME,
    STRUCTS,
    VIEWS,
    SceneFiles,
    read_scene_files,
    some_of,
)
from avd_player.scene import Scene
from avd_player.sources import AvdSource, scenes_in
from gridnav.rgbd import FrameError

if TYPE_CHECKING:
    import argparse

BROKEN = 1
"""Exit status when something is broken."""

PROGRESS_DELAY_S = 2.0

SHOWN = 20
"""No more broken images than this are named one by one."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to a parser."""
    parser.add_argument('folder', type=Path, help='a scene, or a folder of scenes')
    parser.add_argument(
        '--quick', action='store_true', help='leave the images unopened, check all else'
    )


def run(args: argparse.Namespace) -> int:
    """Check the scenes and print what was found.

    Raises:
        ValueError: If there is no such folder, or no scene in it.
    """
    if not args.folder.is_dir():
        msg = f'There is no folder {str(args.folder)!r}.'
        raise ValueError(msg)
    scenes = scenes_in(args.folder)
    if not scenes:
        msg = f'{args.folder} is no scene and holds none.'
        raise ValueError(msg)
    broken = 0
    for folder in scenes:
        present, problems = check_scene(folder, quick=args.quick)
        broken += bool(problems)
        sys.stdout.write(f'{folder.resolve().name}: {"broken" if problems else "fine"}\n')
        lines = [f'  {sentence}' for sentence in present]
        lines += [f'  BROKEN: {sentence}' for sentence in problems]
        sys.stdout.write('\n'.join(lines) + '\n')
    if len(scenes) > 1:
        sys.stdout.write(f'{len(scenes) - broken} of {len(scenes)} scenes are fine.\n')
    return BROKEN if broken else 0


def check_scene(folder: Path, *, quick: bool) -> tuple[list[str], list[str]]:
    """Check a scene.

    Args:
        folder: Of the scene.
        quick: Whether the images are left unopened.

    Returns:
        Sentences on what is there, and sentences on what is broken.
    """
    with warnings.catch_warnings(record=True):
        # They are the sentences that are printed anyway.
        warnings.simplefilter('always')
        try:
            source = AvdSource(folder)
        except FrameError:
            files = read_scene_files(folder)
            return _what_is_there(files), files.problems or ['None of its images has a pose.']
        files = source.files
        present, problems = _what_is_there(files), list(files.problems)
        broken = [] if quick else _broken_images(source)
        problems += broken[:SHOWN]
        if len(broken) > SHOWN:
            problems.append(f'{len(broken) - SHOWN} more images can not be used.')
        if not quick and len(broken) < len(source.frame_names):
            present.append(_geometry(source))
    return present, problems


def _what_is_there(files: SceneFiles) -> list[str]:
    """Return sentences on what a scene has."""
    clusters: dict[int, int] = {}
    for struct in files.structs:
        clusters[struct.cluster] = clusters.get(struct.cluster, 0) + 1
    boxes = [box for a in files.annotations.values() for box in a.boxes[:, 4].tolist()]
    sentences = [
        f'{len(files.colors)} images, {len(files.structs)} poses, {len(clusters)} positions.',
        f'{len(boxes)} boxes of {len(set(boxes))} instances.',
    ]
    if not SCENE_NAME.fullmatch(files.name):
        sentences.append('Its folder is not named as scenes are, such as Home_001_1.')
    if files.scale is not None:
        sentences.append(f'A unit of {STRUCTS} is {files.scale:g} mm.')
    if files.labels:
        sentences.append(f'{len(files.labels)} images have labels.')
    odd = sorted(cluster for cluster, count in clusters.items() if count != VIEWS)
    if odd:
        sentences.append(
            f'Positions with more or less than {VIEWS} images with a pose: '
            f'{some_of(str(cluster) for cluster in odd)}.'
        )
    return sentences + files.guesses + files.notes


def _broken_images(source: AvdSource) -> list[str]:
    """Open all images and return a sentence for each frame that can't be read."""
    broken = []
    names = source.frame_names
    for name in tqdm(names, f'{source.name}: images', leave=False, delay=PROGRESS_DELAY_S):
        try:
            source.read(name)
        except FrameError as error:
            broken.append(str(error))
    return broken


def _geometry(source: AvdSource) -> str:
    """Return a sentence on where the camera is and where one can go."""
    scene = Scene(source)
    largest = int(np.bincount(scene.components).max())
    pitch = np.degrees(source.mount.pitch)
    return (
        f'The camera is {source.mount.z:.2f} m above the floor and looks {pitch:.1f} degrees '
        f'down; {largest} of {len(scene.views)} positions lead to each other in steps of '
        f'{scene.max_link:g} m at most.'
    )
