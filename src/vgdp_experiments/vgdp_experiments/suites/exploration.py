"""What values of the unseen are worth to an explorer, over all goals that a world may have.

An explorer that looks everywhere passes all goals, so one way through a world tells the SPL of
each of them. Their mean varies much less than the SPL of the one goal of an episode, and shows
after a few hundred worlds which of two values is better.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tqdm import tqdm

from vgdp_experiments import scores
from vgdp_experiments.files import write_whole
from vgdp_experiments.jobs import hash_of
from vgdp_experiments.join import command
from vgdp_experiments.options import add_results_file, whole_number
from vgdp_experiments.pages import markdown_table, number, span
from vgdp_experiments.report import current_versions
from vgdp_experiments.results import ResultsError
from vgdp_experiments.rollouts import explored_spl, load_explorer
from vgdp_experiments.settings import Setting
from vgdp_experiments.suite import Page
from vgdp_experiments.suites import generators, table, worlds
from vgdp_experiments.train_value import USUAL_SIZE
from vgdp_planner.weights import read_record

if TYPE_CHECKING:
    import argparse

    from numpy.typing import NDArray

    from vgdp_planner.value import ValueNetwork

NAME = 'exploration'

SETTINGS: dict[str, Setting] = {
    name: setting
    for suite in (table.SUITE, worlds.SUITE, generators.SUITE)
    for name, setting in suite.settings.items()
    if isinstance(setting, Setting) and not setting.map
}

AT_ONCE = 22_500
"""Worlds are explored together up to so many cells."""

DECIMALS = 4

TEXT = """\
# What values of the unseen are worth to an explorer

Explorers step greedily on a value of the unseen until all is seen, and each goal that a world may
have counts with the SPL that it would have brought. Values are read from one look at each map, not
from eight. `frontier` goes to what is nearest.

`{command}`

{trained}

{sections}

Versions: {versions}. Intervals are of 95 %, from {resamples} bootstrap resamples of the worlds,
the same for both explorers of a ratio.
"""


def explore(setting: Setting, mazes: int, seed: int, network: ValueNetwork | None) -> list[float]:
    """Return the mean SPL over all goals of each world.

    Args:
        setting: The worlds.
        mazes: How many.
        seed: Of the worlds.
        network: The value; the nearest frontier without one.
    """
    drawn = setting.mazes(range(mazes), seed)
    at_once = max(1, AT_ONCE // drawn[0].blocked.size)
    parts = [
        explored_spl(drawn[first : first + at_once], network, setting.view_range)
        for first in range(0, mazes, at_once)
    ]
    found: list[float] = np.concatenate(parts).round(DECIMALS).tolist()
    return found


def show(path: Path) -> Page:
    """Make the page of results.

    Raises:
        ResultsError: If the file holds none.
    """
    try:
        return Page(_text(json.loads(path.read_text(encoding='utf-8'))))
    except (OSError, LookupError, TypeError, ValueError) as error:
        msg = f'{path} holds no results of an exploration: {error!r}.'
        raise ResultsError(msg) from error


def _text(values: dict[str, Any]) -> str:
    first = next(iter(values['weights']))
    sections = []
    for place in values['places']:
        spl = {name: np.array(column) for name, column in place['spl'].items()}
        rows = [
            (
                f'`{name}`',
                f'{column.mean():.4f}',
                _ratio(column, spl['frontier']),
                _ratio(column, spl[first]),
            )
            for name, column in spl.items()
        ]
        headings = ('explorer', 'SPL', 'SPL / frontier', f'SPL / {first}')
        count = len(spl['frontier'])
        sections.append(f'## {place["title"]}, {count} worlds\n\n{markdown_table(headings, rows)}')
    return TEXT.format(
        command=values['command'],
        trained='\n'.join(
            f'- `{name}` (`{made["hash"]}`): `{made["command"]}`'
            for name, made in values['weights'].items()
        ),
        sections='\n\n'.join(sections),
        versions=', '.join(f'{name} {value}' for name, value in values['versions'].items()),
        resamples=scores.RESAMPLES,
    )


def _ratio(values: NDArray[np.float64], reference: NDArray[np.float64]) -> str:
    ratio, interval = scores.ratio(values, reference)
    return f'{number(ratio)} ({span(interval)})'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp eval exploration``."""
    parser.add_argument(
        'weights',
        nargs='+',
        type=Path,
        metavar='FOLDER',
        help='with a trained value; all are compared with the first',
    )
    parser.add_argument(
        '--setting',
        nargs='+',
        choices=list(SETTINGS),
        default=['15-view2'],
        help='settings (%(default)s)',
    )
    parser.add_argument(
        '--mazes',
        type=whole_number(1),
        default=1000,
        help='worlds of 15×15, and of larger ones fewer, by their area (%(default)s)',
    )
    parser.add_argument(
        '--seed', type=whole_number(0), default=0, help='of the worlds (%(default)s)'
    )
    add_results_file(parser, NAME)


def run(args: argparse.Namespace) -> int:
    """Explore and write what came out; returns the exit status.

    Raises:
        ValueError: If the weights can't be loaded or have the same name.
        OSError: If the file can't be written.
    """
    torch.set_num_threads(1)
    explorers: dict[str, ValueNetwork | None] = {'frontier': None}
    weights = {}
    for folder in args.weights:
        if folder.name in explorers:
            msg = f'{folder} has the name of another explorer; folders need names of their own.'
            raise ValueError(msg)
        explorers[folder.name] = load_explorer(folder)
        training = read_record(folder)['training']['value']
        weights[folder.name] = {
            'hash': hash_of(folder),
            'command': command('train value', training),
        }
    places = []
    for name in args.setting:
        setting = SETTINGS[name]
        area = np.prod(np.broadcast_to(setting.size, 2))
        mazes = max(1, round(args.mazes * USUAL_SIZE**2 / int(area)))
        bar = tqdm(explorers.items(), desc=name, unit='explorer', disable=None)
        spl = {explorer: explore(setting, mazes, args.seed, value) for explorer, value in bar}
        places.append({'title': setting.seen, 'spl': spl})
    folders = ' '.join(map(str, args.weights))
    values = {
        'suite': NAME,
        'command': f'vgdp eval {NAME} {folders} --setting {" ".join(args.setting)} '
        f'--mazes {args.mazes} --seed {args.seed}',
        'versions': current_versions(),
        'weights': weights,
        'places': places,
    }
    args.out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(args.out, json.dumps(values) + '\n')
    print(show(args.out).text)  # noqa: T201
    return 0
