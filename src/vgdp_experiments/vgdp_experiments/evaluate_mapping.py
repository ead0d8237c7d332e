"""Evaluates maps that are made from RGB-D frames against the true plans of synthetic homes."""

from __future__ import annotations

import json
import multiprocessing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from tqdm import tqdm

from avd_player.homes.home import FREE, OCCUPIED, OUTSIDE
from avd_player.homes.noise import DepthNoise, add_noise
from avd_player.homes.plan import draw_home
from avd_player.homes.render import HomeRenderer
from bev_mapper.rgbd_mapper import MapperConfig, RgbdMapper
from bev_mapper.segmentation import make_segmenter
from bev_mapper.unprojection import depth_in_metres, unproject
from gridnav import GridGeometry
from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE
from gridnav.rgbd import Camera, CameraMount, Pose3D, RgbdFrame
from vgdp_experiments import plots
from vgdp_experiments.files import write_whole
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.preset_settings import require_positive
from vgdp_experiments.report import current_versions

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Sequence

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from avd_player.homes.home import Home, TruePlan

SEGMENTERS = ('ground_truth', 'learned', 'geometric')
SIGMAS_MM = (0.0, 10.0, 30.0, 100.0)
KINDS = ('occupied', 'free')

RESOLUTION_M = 0.1

FOCAL = 0.8
"""Focal length in widths of the picture: a field of view of 64 degrees."""

SEEN_POINTS = 3
"""A cell counts where the frames have so many points in it, without noise."""

DRAWS, INTERVAL = 1000, (2.5, 97.5)
"""Homes are drawn anew so often for a confidence of 95 %."""


@dataclass(frozen=True)
class MappingEvaluation:
    """Settings of the evaluation.

    Attributes:
        out: JSON file for the results; the curves go to a PNG file of the same name.
        seed: Seed of the homes, as of `vgdp avd synth`.
        homes: Homes 1 to this one.
        stops: Positions from which frames are taken, far from each other.
        headings: Frames of each stop, evenly around it.
        width: Of the frames in pixels.
        height: Of the frames in pixels.
        workers: Processes.
    """

    out: str = 'runs/mapping.json'
    seed: int = 1
    homes: int = 20
    stops: int = 24
    headings: int = 8
    width: int = 480
    height: int = 270
    workers: int = 2

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self, ('homes', 'stops', 'headings', 'width', 'height', 'workers'))


class Truth(NamedTuple):
    """What a map of a home should say, in cells of `RESOLUTION_M`.

    Attributes:
        geometry: Where the cells lie.
        cells: `FREE`, `OCCUPIED` or `OUTSIDE`, uint8 (H, W).
    """

    geometry: GridGeometry
    cells: NDArray[np.uint8]


def truth_of(plan: TruePlan) -> Truth:
    """Return the true plan in larger cells: occupied where any of a cell is."""
    times = round(RESOLUTION_M / plan.resolution)
    rows, cols = (-(-size // times) for size in plan.cells.shape)
    missing = rows * times - plan.cells.shape[0], cols * times - plan.cells.shape[1]
    fine = np.pad(plan.cells, ((0, missing[0]), (0, missing[1])), constant_values=OUTSIDE)
    blocks = fine.reshape(rows, times, cols, times)
    cells = np.where((blocks == OUTSIDE).any(axis=(1, 3)), OUTSIDE, FREE)
    cells[(blocks == OCCUPIED).any(axis=(1, 3))] = OCCUPIED
    geometry = GridGeometry(rows, cols, RESOLUTION_M, plan.x, plan.y)
    return Truth(geometry, cells.astype(np.uint8))


def stops(home: Home, count: int) -> NDArray[np.float64]:
    """Return positions that are far from each other, (N, 2)."""
    chosen = [0]
    far = np.full(len(home.positions), np.inf)
    while len(chosen) < min(count, len(home.positions)):
        apart = np.hypot(*(home.positions - home.positions[chosen[-1]]).T)
        far = np.minimum(far, apart)
        chosen.append(int(far.argmax()))
    return home.positions[chosen]


def frames(home: Home, settings: MappingEvaluation) -> Iterator[RgbdFrame]:
    """Yield what a robot sees that stands at the stops and looks around."""
    width, height = settings.width, settings.height
    focal = FOCAL * width
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    renderer = HomeRenderer(home, camera)
    mount = CameraMount(z=home.camera_height, pitch=home.camera_pitch)
    for stop, (x, y) in enumerate(stops(home, settings.stops).tolist()):
        for turn in range(settings.headings):
            half = np.pi * turn / settings.headings
            pose = Pose3D(x, y, 0.0, 0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
            picture = renderer.render(pose.matrix() @ mount.matrix())
            yield RgbdFrame(
                name=f'frame {turn} of stop {stop}',
                stamp=stop * settings.headings + turn,
                color=picture.rgb,
                depth=np.rint(np.minimum(1000 * picture.depth, 65000.0)).astype(np.uint16),
                camera=camera,
                pose=pose,
                mount=mount,
                labels=picture.labels,
            )


class Seen:
    """Counts which cells the frames show, whatever is made of them."""

    def __init__(self, geometry: GridGeometry, config: MapperConfig) -> None:
        self._geometry, self._config = geometry, config
        self._points = np.zeros(geometry.shape, dtype=np.int64)

    def add(self, frame: RgbdFrame) -> None:
        """Count a frame without noise."""
        depth = depth_in_metres(frame.depth)
        x, y, z = unproject(depth, frame.camera, frame.camera_to_map())
        used = (depth > 0) & (depth <= self._config.max_range) & (z < self._config.crop.high)
        geometry = self._geometry
        col = np.floor((x[used] - geometry.origin_x) / geometry.resolution).astype(np.int64)
        row = np.floor((y[used] - geometry.origin_y) / geometry.resolution).astype(np.int64)
        on_map = (row >= 0) & (row < geometry.rows) & (col >= 0) & (col < geometry.cols)
        np.add.at(self._points, (row[on_map], col[on_map]), 1)

    def cells(self) -> NDArray[np.bool_]:
        """Return which cells were seen, (H, W)."""
        return self._points >= SEEN_POINTS


def counts(
    occupancy: NDArray[np.int8], truth: NDArray[np.uint8], seen: NDArray[np.bool_]
) -> list[list[int]]:
    """Return intersection and union of the cells that are and of those that should be.

    A cell that was seen and is unknown to the map is neither free nor occupied in it.

    Args:
        occupancy: The map, int8 (H, W).
        truth: The true plan, (H, W).
        seen: The cells that count, (H, W).

    Returns:
        Both for occupied and for free cells.
    """
    used = seen & (truth != OUTSIDE)
    found = []
    for value, kind in ((OCCUPIED_VALUE, OCCUPIED), (FREE_VALUE, FREE)):
        said, true = (occupancy == value) & used, (truth == kind) & used
        found.append([int((said & true).sum()), int((said | true).sum())])
    return found


def map_home(job: tuple[MappingEvaluation, int]) -> dict[str, dict[str, list[list[int]]]]:
    """Map a home with each segmenter and noise; returns the counts of each."""
    settings, number = job
    home = draw_home([settings.seed, number])
    truth = truth_of(home.plan)
    config = replace(MapperConfig(), geometry=truth.geometry, growth=0)
    mappers = {
        (name, sigma): RgbdMapper(config, make_segmenter(name))
        for name in SEGMENTERS
        for sigma in SIGMAS_MM
    }
    seen = Seen(truth.geometry, config)
    for frame in frames(home, settings):
        seen.add(frame)
        for sigma in SIGMAS_MM:
            rng = np.random.default_rng([settings.seed, number, 4, frame.stamp])
            depth = depth_in_metres(frame.depth)
            noisy = replace(frame, depth=add_noise(depth, DepthNoise(sigma=sigma), rng))
            for name in SEGMENTERS:
                mappers[name, sigma].add(noisy)
    found: dict[str, dict[str, list[list[int]]]] = {name: {} for name in SEGMENTERS}
    for (name, sigma), mapper in mappers.items():
        found[name][f'{sigma:g}'] = counts(mapper.grid.occupancy, truth.cells, seen.cells())
    return found


def summary(homes: Sequence[Sequence[Sequence[int]]]) -> dict[str, list[float]]:
    """Return the mean over homes of the intersection over union, and its interval."""
    table = np.array(homes, dtype=np.float64)
    scores = table[..., 0] / np.maximum(table[..., 1], 1)
    drawn = np.random.default_rng(0).integers(len(scores), size=(DRAWS, len(scores)))
    bounds = np.percentile(scores[drawn].mean(axis=1), INTERVAL, axis=0)
    numbers = np.stack([scores.mean(axis=0), *bounds]).round(5)
    return {kind: numbers[:, index].tolist() for index, kind in enumerate(KINDS)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, MappingEvaluation)


def run(arguments: argparse.Namespace) -> int:
    """Map the homes, write the scores and draw them; returns the exit code."""
    settings = read_settings(MappingEvaluation, arguments)
    jobs = [(settings, number) for number in range(1, settings.homes + 1)]
    # Threads of open3d don't survive a fork.
    with multiprocessing.get_context('spawn').Pool(settings.workers) as pool:
        each = list(tqdm(pool.imap(map_home, jobs), total=len(jobs), desc='homes', unit='home'))
    scores = {
        name: {
            f'{sigma:g}': summary([home[name][f'{sigma:g}'] for home in each])
            for sigma in SIGMAS_MM
        }
        for name in SEGMENTERS
    }
    report = {
        'settings': asdict(settings),
        'interval_percentiles': INTERVAL,
        'iou': scores,
        'cells': each,
        'versions': current_versions(),
    }
    out = Path(settings.out)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(out, json.dumps(report, indent=1) + '\n')
    write_page(out)
    print(table(scores))  # noqa: T201
    return 0


PAGE = """# Maps of homes that were not seen before

`vgdp eval mapping{options}`

Synthetic homes, {stops} stops in each with {headings} images around it, cells of {cell:g} m.
Intersection over union, in percent, of what the map says and what the true plan says, over the
cells that the images show; the mean of {homes} homes with a 95 % interval from drawing homes anew.
The learned network has not seen these homes. The noise is Gaussian, on the depth.

{table}

![Curves of the same]({picture})
"""


def page(report: dict[str, Any], picture: str) -> str:
    """Return the page of results as Markdown."""
    settings = MappingEvaluation(**report['settings'])
    defaults = MappingEvaluation(out=settings.out, workers=settings.workers)
    options = [
        f' --{name} {value}'
        for name, value in asdict(settings).items()
        if value != getattr(defaults, name)
    ]
    return PAGE.format(
        **report['settings'],
        options=''.join(options),
        cell=RESOLUTION_M,
        table=table(report['iou']),
        picture=picture,
    )


def write_page(path: Path) -> None:
    """Write the page and the curves of the results in a file beside it."""
    report = json.loads(path.read_text(encoding='utf-8'))
    picture = path.with_suffix('.png')
    draw(report['iou']).savefig(picture)
    write_whole(path.with_suffix('.md'), page(report, picture.name))


def table(scores: dict[str, dict[str, dict[str, list[float]]]]) -> str:
    """Return the scores as a table in Markdown."""
    sigmas = [f'{sigma:g}' for sigma in SIGMAS_MM]
    rows = [['', '', *(f'σ = {sigma} mm' for sigma in sigmas)]]
    rows.append(['---', '---', *('---:' for _ in sigmas)])
    for name in SEGMENTERS:
        for kind in KINDS:
            cells = [scores[name][sigma][kind] for sigma in sigmas]
            shown = [' … '.join(f'{100 * bound:.1f}' for bound in cell[1:]) for cell in cells]
            means = [f'{100 * cell[0]:.1f}' for cell in cells]
            rows.append(
                [name, kind, *(' ('.join(pair) + ')' for pair in zip(means, shown, strict=True))]
            )
    return '\n'.join(f'| {" | ".join(row)} |' for row in rows)


def draw(scores: dict[str, Any]) -> Figure:
    """Return curves of the scores against the noise."""
    figure, axes = plots.panels(len(KINDS), 'Maps of homes that were not seen before')
    for panel, kind in zip(axes, KINDS, strict=True):
        for color, name in enumerate(SEGMENTERS):
            cells = [scores[name][f'{sigma:g}'][kind] for sigma in SIGMAS_MM]
            middle, low, high = zip(*cells, strict=True)
            plots.curve(panel, SIGMAS_MM, middle, (low, high), name=name, color=color)
        plots.label(panel, 'noise of the depth, σ in mm', f'IoU of {kind} cells')
    plots.legend(axes[0])
    return figure
