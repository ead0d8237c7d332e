"""Worlds that are no mazes, without training for them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from vgdp_experiments import sweep
from vgdp_experiments.jobs import Variant
from vgdp_experiments.pages import (
    MISSING,
    command,
    describe,
    details,
    explanation,
    markdown_table,
    origin,
    ratio,
    success,
)
from vgdp_experiments.settings import Setting
from vgdp_experiments.suite import Page, Suite

if TYPE_CHECKING:
    from collections.abc import Collection

    from vgdp_experiments.results import Results

METHODS = ('vgdp', 'greedy', 'frontier', 'clairvoyant')

SETTINGS = {
    'rooms': Setting((30, 45), view_range=3, budget=1500, kind='rooms'),
    'caves': Setting((40, 40), view_range=3, budget=1500, kind='caves'),
    'obstacles': Setting((30, 45), view_range=3, budget=1500, kind='obstacles'),
    'loops': Setting((31, 31), view_range=2, budget=1500, kind='loops'),
    # Whoever explores all of it takes some 1500 steps.
    'office': Setting(view_range=3, budget=3000, map='office'),
}

TEXT = """\
# Worlds other than mazes

Rooms with doors, caves, obstacle fields, mazes with loops and a map of the map server. Each world
has its own parameters, drawn widely; in the map, starts and goals are drawn.

`{command}`

{origin}

{explanation}

## Success, and SPL over that of nearest-frontier exploration

{table}
"""


def page(results: Results, text: str = TEXT, known: Collection[str] = tuple(SETTINGS)) -> Page:
    """Show the results.

    Args:
        results: Of the worlds, or of those of `generators`.
        text: Of the page.
        known: All settings of that evaluation.
    """
    rows, sections = [], []
    for name, place in results.places.items():
        scores = place.scores()
        rows.append(
            (
                name,
                place.setting.describe(),
                *(success(scores[m]) if m in scores else MISSING for m in METHODS),
                *(ratio(scores[m]) if m in scores else MISSING for m in METHODS[:2]),
            )
        )
        sections.append(f'\n## {name}: {describe(place)}\n\n{details(place)}\n')
    headings = (
        'worlds',
        'setting',
        *(f'`{name}`' for name in METHODS),
        *(f'SPL: `{name}` / `frontier`' for name in METHODS[:2]),
    )
    begin = text.format(
        command=command(f'vgdp eval {results.suite}', results, known, METHODS),
        origin=origin(results),
        explanation=explanation(),
        table=markdown_table(headings, rows),
    )
    return Page(begin + ''.join(sections))


SUITE = Suite(
    name='worlds',
    settings=SETTINGS,
    variants={name: Variant(name) for name in METHODS},
    page=page,
    episodes=100,
)

add_arguments = partial(sweep.add_arguments, SUITE)
run = partial(sweep.run, SUITE)
