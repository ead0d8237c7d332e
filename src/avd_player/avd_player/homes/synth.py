"""``vgdp avd synth``: synthetic homes, written as scenes of the Active Vision Dataset."""

from __future__ import annotations

import fcntl
import json
import multiprocessing
import os
import shutil
import sys
import threading
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from avd_player.avd_format import COLOR_FOLDER, DEPTH_FOLDER, LABEL_FOLDER
from avd_player.homes.noise import DepthNoise
from avd_player.homes.plan import POSITIONS
from avd_player.homes.scene import HEADINGS, Scan, SceneSettings
from avd_player.homes.write import (
    FIRST_HOME,
    LAST_HOME,
    scene_name,
    write_instance_map,
    write_scene,
    write_shot,
)

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from avd_player.homes.scene import Box

CHUNK = 6
"""A worker takes so many positions at a time."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    noise = DepthNoise()
    parser.add_argument('out', type=Path, help='folder for the scenes; complete ones are kept')
    parser.add_argument('--scenes', type=int, default=20, help='number of homes (default: 20)')
    parser.add_argument('--seed', type=int, default=1, help='all follows from it (default: 1)')
    parser.add_argument(
        '--first', type=int, default=1, help='number of the first home of the set (default: 1)'
    )
    parser.add_argument('--width', type=int, default=480, help='of the images (default: 480)')
    parser.add_argument('--height', type=int, default=270, help='of the images (default: 270)')
    parser.add_argument(
        '--positions',
        type=int,
        default=POSITIONS,
        help=f'most positions of a home, with 12 images each (default: {POSITIONS})',
    )
    parser.add_argument(
        '--jitter',
        type=float,
        default=1.0,
        help="times a good scan's errors in the robot's poses, 0 for none (default: 1)",
    )
    parser.add_argument(
        '--noise-sigma', type=float, default=noise.sigma, help='Gaussian noise of depth in mm'
    )
    parser.add_argument(
        '--noise-step', type=float, default=noise.step, help='depth is a multiple of it, in mm'
    )
    parser.add_argument(
        '--noise-edges', type=float, default=noise.edges, help='share of pixels lost at edges'
    )
    parser.add_argument(
        '--noise-dark', type=float, default=noise.dark, help='share of pixels lost on black'
    )
    parser.add_argument('--workers', type=int, default=2, help='processes (default: 2)')


def run(args: argparse.Namespace) -> int:
    """Write the scenes.

    Raises:
        ValueError: If an option is out of range, or a scene is there with other options.
        OSError: If something can't be written.
    """
    noise = DepthNoise(args.noise_sigma, args.noise_step, args.noise_edges, args.noise_dark)
    settings = SceneSettings(args.width, args.height, args.positions, args.jitter, noise)
    made = write_homes(
        args.out, args.scenes, args.seed, settings, first=args.first, workers=args.workers
    )
    sys.stdout.write(f'{made} of {args.scenes} scenes written, in {args.out}\n')
    return 0


def write_homes(
    out: Path,
    scenes: int,
    seed: int,
    settings: SceneSettings | None = None,
    *,
    first: int = 1,
    workers: int = 1,
    progress: bool = True,
) -> int:
    """Write homes as AVD scenes; those that are complete stay as they are.

    A scene's files depend on the seed, its number and the settings alone.

    Args:
        out: Folder for the scenes.
        scenes: How many.
        seed: Any integer from 0.
        settings: What they are like.
        first: Number of the first one, from 1.
        workers: Processes.
        progress: Whether to show how far it is.

    Returns:
        How many were written.

    Raises:
        ValueError: If an argument is out of range, or a scene is there with other settings.
        OSError: If something can't be written.
    """
    settings = settings or SceneSettings()
    for name, value, low in (
        ('scenes', scenes, 1),
        ('first', first, 1),
        ('workers', workers, 1),
        ('seed', seed, 0),
    ):
        if value < low:
            msg = f'{name} is a whole number from {low}, not {value}.'
            raise ValueError(msg)
    if FIRST_HOME + first + scenes - 1 > LAST_HOME:
        msg = f'Homes have numbers up to {LAST_HOME - FIRST_HOME}, not {first + scenes - 1}.'
        raise ValueError(msg)
    numbers = [
        number
        for number in range(first, first + scenes)
        if not _complete(out / scene_name(number), seed, number, settings)
    ]
    out.mkdir(parents=True, exist_ok=True)
    write_instance_map(out)
    pool = None
    if workers > 1 and numbers:
        # Threads of open3d don't survive a fork.
        context = multiprocessing.get_context('spawn')
        pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_end_with_parent)
    try:
        for number in numbers:
            _write_home(out, seed, number, settings, pool, progress=progress)
    except BrokenProcessPool:
        msg = 'A worker ended before its time, perhaps for lack of memory; use fewer --workers.'
        raise OSError(msg) from None
    finally:
        if pool is not None:
            pool.shutdown(cancel_futures=True)
    return len(numbers)


def _complete(folder: Path, seed: int, number: int, settings: SceneSettings) -> bool:
    """Tell whether a scene is there; scenes get their names when they are complete."""
    if not folder.exists():
        return False
    try:
        truth = json.loads((folder / 'ground_truth.json').read_text())
        made = truth['seed'], truth['number'], truth['settings']
    except (OSError, ValueError, KeyError, TypeError):
        msg = f'{folder} is there but was not written by this command; choose another folder.'
        raise ValueError(msg) from None
    if made != (seed, number, settings.as_dict()):
        msg = f'{folder} was written with other options; choose another folder.'
        raise ValueError(msg)
    return True


def _write_home(
    out: Path,
    seed: int,
    number: int,
    settings: SceneSettings,
    pool: ProcessPoolExecutor | None,
    *,
    progress: bool,
) -> None:
    name = scene_name(number)
    folder = out / f'.{name}.part'
    with _locked(folder):
        if _complete(out / name, seed, number, settings):
            return
        for left in folder.iterdir():
            shutil.rmtree(left) if left.is_dir() else left.unlink()
        for part in (COLOR_FOLDER, DEPTH_FOLDER, LABEL_FOLDER):
            (folder / part).mkdir(parents=True)
        scan = _scan(seed, number, settings)
        count = len(scan.home.positions)
        jobs = [
            (folder, seed, number, settings, start, min(start + CHUNK, count))
            for start in range(0, count, CHUNK)
        ]
        done: Iterator[list[list[Box]]] = pool.map(_shoot, jobs) if pool else map(_shoot, jobs)
        boxes: list[list[Box]] = []
        total = count * HEADINGS
        with tqdm(total=total, desc=name, unit='image', disable=not progress) as bar:
            for part_boxes in done:
                boxes += part_boxes
                bar.update(len(part_boxes))
        write_scene(folder, scan, boxes)
        folder.rename(out / name)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Make a folder and keep others from writing into it.

    Raises:
        OSError: If another process writes there.
    """
    folder.mkdir(exist_ok=True)
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            msg = f'Another process is writing into {folder}.'
            raise OSError(msg) from None
        yield
    finally:
        os.close(descriptor)


def _end_with_parent() -> None:
    """Let a worker end when its parent was killed, which could tell it nothing."""

    def wait() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


@lru_cache(maxsize=1)
def _scan(seed: int, number: int, settings: SceneSettings) -> Scan:
    """Return a scan; a process draws it once for all of its positions."""
    return Scan(seed, number, settings)


def _shoot(job: tuple[Path, int, int, SceneSettings, int, int]) -> list[list[Box]]:
    """Write the images of some positions and return their boxes."""
    folder, seed, number, settings, start, end = job
    scan = _scan(seed, number, settings)
    boxes = []
    for index in range(start * HEADINGS, end * HEADINGS):
        shot = scan.shoot(index)
        write_shot(folder, number, index, shot)
        boxes.append(shot.boxes)
    return boxes
