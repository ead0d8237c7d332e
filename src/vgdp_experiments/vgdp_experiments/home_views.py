"""Views of synthetic homes, to train and to evaluate segmentation on: `vgdp data homes-views`.

Cameras are drawn much more widely than any one robot has them: how high they sit, where they look
and how wide their lenses are.
"""

from __future__ import annotations

import json
import multiprocessing
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from tqdm import tqdm

from gridnav.rgbd import UNLABELLED, Camera, CameraMount
from vgdp_experiments.files import write_whole
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.preset_settings import require_positive

if TYPE_CHECKING:
    import argparse

    from numpy.typing import NDArray

    from avd_player.homes.home import Home
    from avd_player.homes.render import Picture

TRAINING_SEED = 770_001
"""Of the homes that the shipped weights were trained on, far from those that people choose."""

HEIGHT_M = (0.4, 1.7)
PITCH_DEG = (-10.0, 5.0, 45.0)
"""Lowest, most frequent and highest; positive looks down."""

ROLL_DEG = 3.0
"""Standard deviation."""

FIELD_DEG = (50.0, 100.0)
"""Horizontal field of view."""

JITTER_M = 0.1
"""A camera is so far from one of the home's positions at most, along x and y."""

NEAREST_M = 0.5
"""A view of which half is nearer than this shows too little to be kept."""

MOST_UNSEEN = 0.02
"""A view with a larger share of nothing was taken from inside something."""

SETTINGS_FILE = 'settings.json'


@dataclass(frozen=True)
class HomeViews:
    """Settings of views of homes.

    Attributes:
        out: Folder for them; homes that are complete are kept.
        seed: All follows from it.
        homes: How many homes.
        views: Views of each home.
        width: Of the images in pixels.
        height: Of the images in pixels.
        workers: Processes.
    """

    out: str = 'runs/homes-views'
    seed: int = TRAINING_SEED
    homes: int = 120
    views: int = 100
    width: int = 160
    height: int = 120
    workers: int = 2

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self, ('homes', 'views', 'width', 'height', 'workers'))
        if self.seed < 0:
            msg = f'--seed must be at least 0, got {self.seed}.'
            raise ValueError(msg)


class View(NamedTuple):
    """What a camera saw of a home.

    Attributes:
        home: Number of the home.
        color: RGB, uint8 (H, W, 3).
        depth: Millimetres, uint16 (H, W).
        labels: True classes, uint8 (H, W).
        camera: Of the images.
        mount: Where the camera was: its height, its roll and its pitch.
    """

    home: int
    color: NDArray[np.uint8]
    depth: NDArray[np.uint16]
    labels: NDArray[np.uint8]
    camera: Camera
    mount: CameraMount


class Views:
    """Views of all homes of a folder.

    Attributes:
        settings: How they were made.
        homes: Number of the home of each view, (N,).
        color: uint8 (N, H, W, 3).
        depth: Millimetres, uint16 (N, H, W).
        labels: uint8 (N, H, W).
    """

    def __init__(self, folder: Path) -> None:
        """Read them.

        Raises:
            ValueError: If the folder does not hold complete views, with one sentence.
        """
        try:
            self.settings = HomeViews(**json.loads((folder / SETTINGS_FILE).read_text()))
        except (OSError, ValueError, TypeError) as error:
            msg = f'{folder} holds no views of homes; `vgdp data homes-views` makes them.'
            raise ValueError(msg) from error
        parts: list[dict[str, NDArray[np.float64]]] = []
        for number in range(1, self.settings.homes + 1):
            path = _file(folder, number)
            if not zipfile.is_zipfile(path):
                msg = f'{path} is missing or damaged: run `vgdp data homes-views` again.'
                raise ValueError(msg)
            with np.load(path) as part:
                parts.append({name: part[name] for name in part.files})
        self.homes = np.repeat(np.arange(1, len(parts) + 1), self.settings.views)
        self.color: NDArray[np.uint8] = np.concatenate([part['color'] for part in parts])
        self.depth: NDArray[np.uint16] = np.concatenate([part['depth'] for part in parts])
        self.labels: NDArray[np.uint8] = np.concatenate([part['labels'] for part in parts])
        self._cameras = np.concatenate([part['cameras'] for part in parts])

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.homes)

    def __getitem__(self, index: int) -> View:
        """Return one of them."""
        focal, height, roll, pitch = self._cameras[index].tolist()
        return View(
            int(self.homes[index]),
            self.color[index],
            self.depth[index],
            self.labels[index],
            _camera(self.settings, focal),
            CameraMount(z=height, roll=roll, pitch=pitch),
        )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, HomeViews)


def run(arguments: argparse.Namespace) -> int:
    """Draw the views; returns the exit code."""
    settings = read_settings(HomeViews, arguments)
    write_views(settings)
    print(f'{settings.homes * settings.views} views are in {settings.out}.')  # noqa: T201
    return 0


def write_views(settings: HomeViews) -> None:
    """Draw views of homes into a folder; what is complete there is kept.

    Raises:
        ValueError: If the folder holds views of other settings, or open3d is missing.
    """
    folder = Path(settings.out)
    folder.mkdir(parents=True, exist_ok=True)
    # Where they are and how many processes draw them is not what they are.
    kept = asdict(settings) | {'out': '', 'workers': 1}
    path = folder / SETTINGS_FILE
    if path.exists() and json.loads(path.read_text()) != kept:
        msg = f'{folder} holds views of other settings; give another --out or remove it.'
        raise ValueError(msg)
    write_whole(path, json.dumps(kept, indent=2) + '\n')
    numbers = [n for n in range(1, settings.homes + 1) if not _file(folder, n).exists()]
    jobs = [(settings, number) for number in numbers]
    with tqdm(total=len(jobs), desc='homes', unit='home') as bar:
        if settings.workers == 1:
            for job in jobs:
                _write_home(job)
                bar.update()
            return
        # Threads of open3d don't survive a fork.
        with multiprocessing.get_context('spawn').Pool(settings.workers) as pool:
            for _ in pool.imap_unordered(_write_home, jobs):
                bar.update()


def _file(folder: Path, number: int) -> Path:
    return folder / f'home-{number:05d}.npz'


def _camera(settings: HomeViews, focal: float) -> Camera:
    width, height = settings.width, settings.height
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


def _write_home(job: tuple[HomeViews, int]) -> None:
    # Loaded late, in the processes that draw.
    from avd_player.homes.plan import draw_home  # noqa: PLC0415

    settings, number = job
    home = draw_home([settings.seed, number])
    parts = _views(home, settings, np.random.default_rng([settings.seed, number, 3]))
    path = _file(Path(settings.out), number)
    part = path.with_suffix('.part')
    with part.open('wb') as file:
        np.savez(file, **parts)
    part.replace(path)


def _views(home: Home, settings: HomeViews, rng: np.random.Generator) -> dict[str, Any]:
    """Return the arrays of a home's views by their names in `Views`, and `cameras` (N, 4)."""
    from avd_player.homes.render import HomeRenderer  # noqa: PLC0415

    renderer: HomeRenderer | None = None
    pictures: list[Picture] = []
    cameras = []
    while len(pictures) < settings.views:
        half = np.radians(rng.uniform(*FIELD_DEG)) / 2
        camera = _camera(settings, settings.width / 2 / float(np.tan(half)))
        roll = np.radians(ROLL_DEG * rng.standard_normal())
        pitch = np.radians(rng.triangular(*PITCH_DEG))
        height = rng.uniform(*HEIGHT_M)
        x, y = home.positions[rng.integers(len(home.positions))] + rng.uniform(
            -JITTER_M, JITTER_M, 2
        )
        if renderer is None:
            renderer = HomeRenderer(home, camera)
        else:
            renderer.set_camera(camera)
        yaw = rng.uniform(-np.pi, np.pi)
        picture = renderer.render(CameraMount(x, y, height, roll, pitch, yaw).matrix())
        unseen = float((picture.labels == UNLABELLED).mean())
        if unseen > MOST_UNSEEN or np.median(picture.depth) < NEAREST_M:
            continue
        pictures.append(picture)
        cameras.append([camera.fx, height, roll, pitch])
    depth = np.stack([picture.depth for picture in pictures])
    return {
        'color': np.stack([picture.rgb for picture in pictures]),
        'depth': np.rint(np.minimum(1000 * depth, 65000.0)).astype(np.uint16),
        'labels': np.stack([picture.labels for picture in pictures]),
        'cameras': np.array(cameras),
    }
