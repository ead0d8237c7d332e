"""Evaluates the segmentation of RGB-D frames on homes that it has not seen."""

from __future__ import annotations

import json
import platform
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tqdm import tqdm

from avd_player.homes.noise import DepthNoise, add_noise
from bev_mapper.segmentation import GeometricSegmenter
from bev_mapper.segmentation.learned import SHIPPED, LearnedSegmenter, load_record
from bev_mapper.unprojection import depth_in_metres, unproject
from gridnav.rgbd import CLASSES, UNLABELLED, Pose3D, RgbdFrame
from vgdp_experiments.files import write_whole
from vgdp_experiments.home_views import Views
from vgdp_experiments.report import current_versions
from vgdp_experiments.train_segmentation import FREE

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bev_mapper.segmentation import Segmenter
    from vgdp_experiments.home_views import View

TEST_FOLDER = 'runs/homes-views-test'

SIGMAS_MM = (0.0, 10.0, 30.0, 100.0)

DRAWS = 1000
"""How often homes are drawn anew to see how much the scores depend on them."""

INTERVAL = (2.5, 97.5)
"""Percentiles: a confidence of 95 %."""

IS_FREE = np.array([name in FREE for name in CLASSES])

CARD = """\
# Weights of the learned segmentation

A U-Net of {parameters:,} parameters that names the class of each pixel of an RGB-D frame:
{classes}. It sees colour, depth, the
height above the floor, how upright surfaces are, and where each pixel looks; it computes on
{pixels:,} pixels of a frame and spreads the classes to the others by their depth. Made for
`bev_mapper.segmentation.LearnedSegmenter`: robots with a depth camera 0.4 m to 1.7 m above the
floor of a home, whose pose in space is known to a few centimetres and degrees.

`model.safetensors` holds the tensors, `config.json` the sizes and the training settings.

## Data

It was trained on synthetic homes alone: {homes} homes of `vgdp avd synth`'s kind, drawn from the
seed {seed}, with {views} views each. No home of another seed was used, so all that
`vgdp avd synth` makes with any other seed are new to it. Each time a view is used, part of it is
cut out, mirrored and spoiled anew: noise, waves and steps in the depth, holes at edges, on dark
and on far surfaces and in whole regions, errors of the floor's height and tilt, larger and smaller
worlds, other colours and light.

```
{commands}
```

Everything random comes from the seeds in these commands. Losses at the end: {losses}.

## Scores

{tested} homes of the seed {test_seed} with {test_views} views each, cameras drawn as in training,
depth with Gaussian noise of the standard deviation σ; all pixels whose depth is known.
Intersection over union, in percent; ± is half of the 95 % interval over homes.

{scores}

A frame of 640 x 480, thinned as the mapper does, takes {milliseconds:.0f} ms of a
processor's time ({machine}).

## Limits

{limits}
"""


def summary(confusion: NDArray[np.int64]) -> dict[str, Any]:
    """Return scores with their intervals over homes.

    Args:
        confusion: Pixels by home, true class and class that was found, (homes, 13, 13).
    """
    homes = len(confusion)
    drawn = np.random.default_rng(0).integers(homes, size=(DRAWS, homes))
    # The first is as it is, the others are with homes drawn anew.
    many = np.concatenate([confusion.sum(axis=0)[None], confusion[drawn].sum(axis=1)])
    per_class, free = class_iou(many), class_iou(free_confusion(many))
    return {
        'mean_iou': _with_interval(mean_iou(many)),
        'accuracy': _with_interval(accuracy(many)),
        'obstacle_iou': _with_interval(free[:, 0]),
        'free_iou': _with_interval(free[:, 1]),
        'iou': {name: _with_interval(per_class[:, i]) for i, name in enumerate(CLASSES)},
    }


def _with_interval(scores: NDArray[np.float64]) -> list[float]:
    """Return the first score and the interval of the others."""
    known = scores[1:][np.isfinite(scores[1:])]
    bounds = np.percentile(known, INTERVAL).tolist() if len(known) else [np.nan, np.nan]
    return [round(float(number), 5) for number in (scores[0], *bounds)]


def class_iou(confusion: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the intersection over union of each class, NaN without one, (N, C)."""
    right = np.diagonal(confusion, axis1=-2, axis2=-1)
    union = confusion.sum(axis=-1) + confusion.sum(axis=-2) - right
    with np.errstate(invalid='ignore'):
        return np.asarray(right / union, dtype=np.float64)


def mean_iou(confusion: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean over the classes that are there, (N,)."""
    return np.asarray(np.nanmean(class_iou(confusion), axis=-1), dtype=np.float64)


def accuracy(confusion: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the share of the pixels that are right, (N,)."""
    right = np.trace(confusion, axis1=-2, axis2=-1)
    return np.asarray(right / confusion.sum(axis=(-2, -1)), dtype=np.float64)


def free_confusion(confusion: NDArray[np.int64]) -> NDArray[np.int64]:
    """Join the classes to obstacle and free, (N, 2, 2)."""
    groups = np.stack([~IS_FREE, IS_FREE]).astype(np.int64)
    joined: NDArray[np.int64] = groups @ confusion @ groups.T
    return joined


def frame_of(view: View, sigma_mm: float, rng: np.random.Generator) -> RgbdFrame:
    """Return a view as a frame, with noise in its depth."""
    depth = view.depth
    if sigma_mm:
        depth = add_noise(depth, DepthNoise(sigma=sigma_mm), rng)
    return RgbdFrame(
        name=f'a view of home {view.home}',
        stamp=0,
        color=view.color,
        depth=depth_in_metres(depth),
        camera=view.camera,
        pose=Pose3D(),
        mount=view.mount,
        labels=view.labels,
    )


def evaluate(segmenter: Segmenter, views: Views, sigma_mm: float) -> dict[str, Any]:
    """Return the scores on all views, and the median of a frame's processor time in ms."""
    confusion = np.zeros((views.settings.homes, len(CLASSES), len(CLASSES)), dtype=np.int64)
    seconds = []
    for index in tqdm(range(len(views)), desc=f'{segmenter.name}, {sigma_mm:g} mm', unit='view'):
        view = views[index]
        rng = np.random.default_rng([views.settings.seed, 9, index])
        frame = frame_of(view, sigma_mm, rng)
        points = unproject(frame.depth.astype(np.float32), frame.camera, frame.camera_to_map())
        begin = time.process_time()
        labels = segmenter.labels(frame, points)
        seconds.append(time.process_time() - begin)
        used = (frame.depth > 0) & (view.labels != UNLABELLED)
        pairs = view.labels[used].astype(np.int64) * len(CLASSES) + labels[used]
        counts = np.bincount(pairs, minlength=len(CLASSES) ** 2)
        confusion[view.home - 1] += counts.reshape(len(CLASSES), len(CLASSES))
    return summary(confusion) | {'milliseconds': 1000 * float(np.median(seconds))}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        '--views',
        type=Path,
        default=Path(TEST_FOLDER),
        help='folder of `vgdp data homes-views` with a seed of its own',
    )
    parser.add_argument('--weights', type=Path, default=SHIPPED, help='default: the shipped ones')
    parser.add_argument('--threads', type=int, default=1, help='CPU threads (default: 1)')
    parser.add_argument('--out', type=Path, help='JSON file for the scores')
    parser.add_argument(
        '--limits', type=Path, help='text for the model card, which is then written'
    )


def run(arguments: argparse.Namespace) -> int:
    """Evaluate and show the scores; returns the exit code.

    Raises:
        ValueError: If the homes are those of the training, or files can't be read.
    """
    torch.set_num_threads(arguments.threads)
    views = Views(arguments.views)
    record = load_record(arguments.weights)
    trained_on = record['training'].get('homes', {}).get('seed')
    if trained_on == views.settings.seed:
        msg = f'The weights were trained on homes of the seed {trained_on}; draw views of another.'
        raise ValueError(msg)
    learned = LearnedSegmenter.from_folder(arguments.weights)
    results: dict[str, Any] = {'learned': {}, 'geometric': {}}
    for sigma in SIGMAS_MM:
        results['learned'][f'{sigma:g}'] = evaluate(learned, views, sigma)
        scores = evaluate(GeometricSegmenter(), views, sigma)
        # It knows three classes only, so the others say nothing.
        kept = ('free_iou', 'obstacle_iou', 'milliseconds')
        results['geometric'][f'{sigma:g}'] = {name: scores[name] for name in kept}
    report = {
        'views': asdict(views.settings),
        'interval_percentiles': INTERVAL,
        'sigma_mm': results,
        'versions': current_versions(),
    }
    table = score_table(results)
    print(table)  # noqa: T201
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(arguments.out, json.dumps(report, indent=2) + '\n')
    if arguments.limits:
        text = card(record, learned, views, results, arguments.limits.read_text(encoding='utf-8'))
        write_whole(arguments.weights / 'README.md', text)
    return 0


def score_table(results: dict[str, Any]) -> str:
    """Return the scores as a table in Markdown."""
    learned, geometric = results['learned'], results['geometric']
    sigmas = list(learned)
    rows = [['', *(f'σ = {sigma} mm' for sigma in sigmas)], ['---', *('---:' for _ in sigmas)]]

    def add(name: str, numbers: Sequence[Sequence[float]]) -> None:
        rows.append([name, *(_percent(number) for number in numbers)])

    add('**mean of the classes**', [scores['mean_iou'] for scores in learned.values()])
    for name in CLASSES:
        add(name, [scores['iou'][name] for scores in learned.values()])
    add('right pixels', [scores['accuracy'] for scores in learned.values()])
    for kind, title in (('free_iou', 'free'), ('obstacle_iou', 'obstacle')):
        add(f'**{title}**', [scores[kind] for scores in learned.values()])
        add(f'{title}, geometric', [scores[kind] for scores in geometric.values()])
    return '\n'.join(f'| {" | ".join(row)} |' for row in rows)


def _percent(number: Sequence[float]) -> str:
    value, low, high = number
    return f'{100 * value:.1f} ± {50 * (high - low):.1f}'


def _processor() -> str:
    """Return what the system calls its processor, and whether PyTorch uses its wide registers."""
    path = Path('/proc/cpuinfo')
    lines = path.read_text(encoding='utf-8').splitlines() if path.exists() else []
    names = [line.split(':', 1)[1].strip() for line in lines if line.startswith('model name')]
    name = names[0] if names else platform.machine()
    return f'{name}, {torch.backends.cpu.get_cpu_capability()}'


def card(
    record: dict[str, Any],
    learned: LearnedSegmenter,
    views: Views,
    results: dict[str, Any],
    limits: str,
) -> str:
    """Return the model card."""
    training = record['training']
    homes, tested = training['homes'], views.settings

    def command(words: str, settings: dict[str, Any], **others: str) -> str:
        options = ' '.join(
            f'--{name.replace("_", "-")} {value}'
            for name, value in (settings | others).items()
            if not isinstance(value, dict)
        )
        return f'vgdp {words} {options}'

    return CARD.format(
        parameters=learned.parameters,
        classes=', '.join(CLASSES[:7]) + ',\n' + ', '.join(CLASSES[7:]),
        pixels=record['config']['pixels'],
        homes=homes['homes'],
        seed=homes['seed'],
        views=homes['views'],
        commands='\n'.join(
            [
                command('data homes-views', homes, out=training['views']),
                command('train segmentation', training),
                command('data homes-views', asdict(tested), out=TEST_FOLDER),
                f'vgdp eval segmentation --views {TEST_FOLDER}',
            ]
        ),
        losses=', '.join(f'{name} {value:.4g}' for name, value in training['losses'].items()),
        tested=tested.homes,
        test_seed=tested.seed,
        test_views=tested.views,
        scores=score_table(results),
        milliseconds=results['learned']['0']['milliseconds'],
        machine=_processor(),
        limits=limits.strip(),
    )
