"""Compares what values of the unseen make of the same choices: `vgdp eval looks`.

Where a robot knows a part of a home and looks for a thing that it has not seen, it can walk to any
unseen cell in reach and look. One who knows the home knows what each of these would cost in all:
the way there, and the shortest way on from there. A choice is as good as the cost it leads to is
near to that of the best one. All things that are hidden then count alike, so a home says more
than by searches of one bottle.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tqdm import tqdm

from vgdp_experiments.files import write_whole
from vgdp_experiments.jobs import hash_of
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.pages import markdown_table
from vgdp_experiments.preset_settings import require_positive
from vgdp_experiments.search.learned.batches import HomeBatches
from vgdp_experiments.search.learned.demonstrations import load_homes
from vgdp_experiments.search.learned.object_value import begin_value, load_value
from vgdp_experiments.search.learned.records import WEIGHTS
from vgdp_experiments.search.learned.train_object import heights_at
from vgdp_planner.weights import SHIPPED as PLANNER

if TYPE_CHECKING:
    import argparse

    from numpy.typing import NDArray

    from vgdp_experiments.search.learned.batches import Decision
    from vgdp_experiments.search.learned.rgbd import SeeingValue

NEAREST = 'nearest'
"""The nearest unseen cell."""

MAZES, HOMES = 'value of mazes', 'object-search value'

FAR_CELLS = 6.0
"""A choice that costs so much more than the best one leads into a wrong room, mostly."""

Z_95 = 1.96


@dataclass(frozen=True)
class LookSettings:
    """Settings of the comparison.

    Attributes:
        data: Folder of `vgdp data homes-expert`.
        homes: Names of homes that were not trained on, with commas between them.
        weights: Folder of the object-search value; what comes with the package if empty.
        decisions: How many choices are made.
        seed: Of their drawing.
        threads: CPU threads.
        json: File to write the results to; none if empty.
    """

    data: str = 'runs/homes-expert'
    homes: str = 'Home_201_1,Home_202_1,Home_203_1,Home_204_1,Home_205_1'
    weights: str = ''
    decisions: int = 1000
    seed: int = 0
    threads: int = 2
    json: str = ''

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self, ('decisions', 'threads'))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, LookSettings)


def run(arguments: argparse.Namespace) -> int:
    """Compare, and print what came out; returns the exit code."""
    settings = read_settings(LookSettings, arguments)
    torch.set_num_threads(settings.threads)
    homes = load_homes(Path(settings.data), only=settings.homes.split(','))
    own = Path(settings.weights) if settings.weights else WEIGHTS / 'vgdp_object'
    values = {MAZES: begin_value().eval(), HOMES: load_value(own)}
    lost = lost_by_looks(HomeBatches(homes), values, settings.decisions, settings.seed)
    scores = {name: score(each) for name, each in lost.items()}
    rows = [
        (
            name,
            f'{row["mean"]:.2f} ± {row["interval"]:.2f}',
            f'{row["far"]:.3f}',
        )
        for name, row in scores.items()
    ]
    headings = ('choice', 'cells lost a choice (95 %)', f'lost more than {FAR_CELLS:g}')
    print(markdown_table(headings, rows))  # noqa: T201
    if settings.json:
        # Where things lie on a machine plays no part.
        kept = {**asdict(settings), 'data': '', 'weights': '', 'json': ''}
        found = {
            'settings': kept,
            'weights': {MAZES: hash_of(PLANNER), HOMES: hash_of(own)},
            'scores': scores,
        }
        write_whole(Path(settings.json), json.dumps(found, indent=2) + '\n')
    return 0


def score(lost: NDArray[np.float64]) -> dict[str, Any]:
    """Return mean, half the width of its 95 % interval, and the share of bad choices."""
    return {
        'mean': float(lost.mean()),
        'interval': float(Z_95 * lost.std() / len(lost) ** 0.5),
        'far': float((lost > FAR_CELLS).mean()),
    }


@torch.no_grad()
def lost_by_looks(
    batches: HomeBatches, values: dict[str, SeeingValue], count: int, seed: int
) -> dict[str, NDArray[np.float64]]:
    """Return what choices cost more than the best one, in cells, by who chooses, (count,) each.

    Each choice is drawn with a home, a decision of a search there and a thing that is hidden then.
    """
    rng = np.random.default_rng(seed)
    lost: dict[str, list[float]] = {name: [] for name in (NEAREST, *values)}
    for _ in tqdm(range(count), desc='choices'):
        [decision] = batches.draw(1, rng, unseen_only=True)
        batch = batches.take([decision])
        looks = batches.looks([decision], batch)
        if not looks.cells.shape[1]:
            continue
        costs = looks.distances[0] + looks.costs[0, _place_of(decision, batches)]
        heights = heights_at(batches, decision, batch.origins[0], batch.maps.shape[2:])
        cells = looks.cells[0]
        worths = {NEAREST: np.zeros(len(cells), dtype=np.float32)}
        for name, value in values.items():
            value.seen = torch.from_numpy(heights)[None]
            worth = value.worth_of_unseen(torch.from_numpy(batch.maps))[0].numpy()
            worths[name] = worth[cells[:, 0], cells[:, 1]]
        for name, worth in worths.items():
            chosen = (worth - looks.distances[0]).argmax()
            lost[name].append(float(costs[chosen] - costs.min()))
    return {name: np.array(each) for name, each in lost.items()}


def _place_of(decision: Decision, batches: HomeBatches) -> int:
    """Return the place of the thing of a decision among those that are hidden."""
    hidden = batches.homes[decision.home].open_things(decision.index)
    return int(np.flatnonzero(hidden == decision.thing)[0])
