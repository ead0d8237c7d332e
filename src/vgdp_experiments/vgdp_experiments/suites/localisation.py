"""How fast the belief filter finds out where the robot is, from views of a known maze alone."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tqdm import tqdm

from gridnav import DONE, FREE, NUM_MOVES, OBSTACLE, valid_moves
from maze_sim import MazeSimulation, make_mazes
from vgdp_experiments import plots
from vgdp_experiments.files import write_whole
from vgdp_experiments.jobs import hash_of
from vgdp_experiments.options import add_results_file, whole_number
from vgdp_experiments.planner_options import add_planner_arguments, load_planner
from vgdp_experiments.results import ResultsError
from vgdp_experiments.suite import Page
from vgdp_planner.weights import SHIPPED

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from maze_sim import Maze
    from vgdp_planner.belief import BeliefFilter

NAME = 'localisation'

SIZE, STEPS = 15, 20
VIEW_RANGES = (1, 2, 3)

DECIMALS = 4

TEXT = """\
# Localisation

The robot knows the maze but not where it is: its belief begins uniform over all free cells of
{size}×{size} cells. It wanders, turning back only where it must, and the belief filter hears of
its steps and its views, of nothing else. Means over {mazes} mazes.

`vgdp eval localisation`

Weights: planner `{weights}`.

![Entropy and error against steps]({picture})

| view range | {headings} |
| :-- |{marks}
{rows}

Each cell: bits of entropy, how far the most likely cell is from the true one, and in how many
mazes it is the true one.
"""

SHOWN = (0, 1, 2, 5, 10, 20)
"""Steps in the table."""

CURVES = ('entropy', 'error', 'right')


def localise(
    belief_filter: BeliefFilter,
    mazes: Sequence[Maze],
    view_range: int,
    steps: int,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Let robots wander and follow where the filter believes them to be.

    Args:
        belief_filter: What is tried.
        mazes: Of one shape, B.
        view_range: Cells that a view reaches to each side.
        steps: Steps that each robot takes.
        rng: Source of the steps.

    Returns:
        Entropy of the beliefs in bits, and distance of the most likely cell from the true one in
        cells, both (steps + 1, B).
    """
    simulation = MazeSimulation(mazes, view_range, steps + 1)
    blocked = np.stack([maze.blocked for maze in mazes])
    maps = np.zeros((len(mazes), 3, *blocked.shape[1:]), dtype=np.float32)
    maps[:, OBSTACLE], maps[:, FREE] = blocked, ~blocked
    valid = valid_moves(blocked)
    mask = torch.from_numpy(valid.astype(np.float32))
    known = torch.from_numpy(maps)
    beliefs = known[:, FREE] / known[:, FREE].sum(dim=(1, 2), keepdim=True)
    each = np.arange(len(mazes))
    back = np.full(len(mazes), DONE)
    entropies, errors = [], []
    with torch.no_grad():
        for _ in range(steps + 1):
            views = torch.from_numpy(simulation.windows())
            beliefs = belief_filter.correct(beliefs, known, views)
            flat = beliefs.flatten(1).numpy().astype(np.float64)
            entropies.append(-(flat * np.log2(np.where(flat > 0, flat, 1.0))).sum(axis=1))
            likely = np.stack(np.divmod(flat.argmax(axis=1), blocked.shape[2]), axis=1)
            errors.append(np.hypot(*(likely - simulation.cells).T))
            wishes = rng.random((len(mazes), NUM_MOVES + 1))
            wishes[each, back] -= 1.0
            possible = valid[each, :, simulation.cells[:, 0], simulation.cells[:, 1]]
            actions = np.where(possible, wishes[:, :NUM_MOVES], -np.inf).argmax(axis=1)
            back = (actions + NUM_MOVES // 2) % NUM_MOVES
            beliefs = belief_filter.predict(beliefs, torch.from_numpy(actions), mask)
            simulation.step(actions)
    return np.stack(entropies), np.stack(errors)


def show(path: Path) -> Page:
    """Make the page of results.

    Raises:
        ResultsError: If the file holds none.
    """
    try:
        values = json.loads(path.read_text(encoding='utf-8'))
        return _page(values)
    except (OSError, LookupError, TypeError, ValueError) as error:
        msg = f'{path} holds no results of a localisation: {error!r}.'
        raise ResultsError(msg) from error


def _page(values: dict[str, Any]) -> Page:
    picture = f'{NAME}.png'
    figure, (left, right) = plots.panels(2, 'Where am I? From views of a known maze alone')
    plots.label(left, 'steps', 'entropy of the belief in bits')
    plots.label(right, 'steps', 'error of the most likely cell, in cells')
    for axes in (left, right):
        axes.locator_params(axis='x', integer=True)
    rows = []
    for color, (view_range, curves) in enumerate(values['view_ranges'].items()):
        steps = range(len(curves['entropy']))
        for axes, what in ((left, 'entropy'), (right, 'error')):
            plots.curve(axes, steps, curves[what], name=f'view range {view_range}', color=color)
        shown = zip(*([curves[what][at] for at in SHOWN] for what in CURVES), strict=True)
        cells = [f'{bits:.2f} bits, {error:.2f}, {right:.0%}' for bits, error, right in shown]
        rows.append(f'| {view_range} | {" | ".join(cells)} |')
    plots.legend(left)
    text = TEXT.format(
        size=values['size'],
        mazes=values['mazes'],
        weights=values['weights'],
        picture=picture,
        headings=' | '.join(f'after {at} steps' for at in SHOWN),
        marks=' --: |' * len(SHOWN),
        rows='\n'.join(rows),
    )
    return Page(text, {picture: figure})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp eval localisation``."""
    parser.add_argument(
        '--episodes', type=whole_number(1), default=500, help='mazes (%(default)s)'
    )
    add_results_file(parser, NAME)
    add_planner_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Let the filter localise robots and write what came out; returns the exit status.

    Raises:
        ValueError: If the weights can't be loaded.
        OSError: If the file can't be written.
    """
    belief_filter = load_planner(args).belief_filter.cpu()
    mazes = make_mazes(args.episodes, SIZE, seed=0)
    view_ranges = {}
    for view_range in tqdm(VIEW_RANGES, desc='view ranges', disable=None):
        entropies, errors = localise(
            belief_filter, mazes, view_range, STEPS, np.random.default_rng(0)
        )
        view_ranges[str(view_range)] = {
            'entropy': entropies.mean(axis=1).round(DECIMALS).tolist(),
            'error': errors.mean(axis=1).round(DECIMALS).tolist(),
            'right': (errors == 0).mean(axis=1).round(DECIMALS).tolist(),
        }
    values = {
        'suite': NAME,
        'weights': hash_of(args.weights or SHIPPED),
        'size': SIZE,
        'mazes': args.episodes,
        'view_ranges': view_ranges,
    }
    args.out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(args.out, json.dumps(values) + '\n')
    print(show(args.out).text)  # noqa: T201
    return 0
