"""The paper's table of success rates in mazes, with the methods of this project beside it."""

from __future__ import annotations

from dataclasses import replace
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
    with_sd,
)
from vgdp_experiments.settings import Setting
from vgdp_experiments.suite import Page, Suite

if TYPE_CHECKING:
    import argparse

    from vgdp_experiments.results import PlaceResults, Results

METHODS = ('vgdp', 'greedy', 'calvin', 'single_sample', 'frontier', 'clairvoyant')

PUBLISHED_METHODS = ('CALVIN', 'Diffusion Policy', 'the paper')

PUBLISHED = {
    '15-view1': ((0.832, 0.030), (0.024, 0.015), (0.886, 0.011)),
    '15-view2': ((0.855, 0.030), (0.060, 0.022), (0.906, 0.010)),
    '15-view3': ((0.900, 0.026), (0.110, 0.031), (0.911, 0.013)),
    '20-view2': ((0.658, 0.016), (0.012, 0.010), (0.713, 0.020)),
    '30-view2': ((0.326, 0.030), (0.000, 0.000), (0.624, 0.032)),
    '30-view2-200': ((0.326, 0.030), (0.000, 0.000), (0.624, 0.032)),
}
"""Success in the paper's table, mean and standard deviation over five trials of 500 mazes, of
`PUBLISHED_METHODS`. It states no budget."""

TEXT = """\
# Mazes of the paper's table

Wilson mazes with the paper's sizes and view ranges. All methods see partial maps alone, but for
`clairvoyant`, who walks the shortest way of the true maze. `single_sample` is the plain Diffusion
Policy, `greedy` steps on the planner's values without a sample, `calvin` is trained here on the
same data, `frontier` explores the nearest frontier.

`{command}`

{origin}

{explanation}

## Success

{success}
{published}
## SPL over that of nearest-frontier exploration

{ratios}
{samples}"""

ABOUT_SAMPLES = """
## What the samples add

SPL of the whole planner over that of greedy steps on its values, on the same mazes.

{table}
"""

ABOUT_PUBLISHED = """
The paper states no budget, so its 30×30 row stands at both of ours.
"""


LARGEST = '30-view2'

SMALL_BUDGET = 200
"""Steps in which the largest mazes are looked at, too."""


def with_small_budget(places: dict[str, PlaceResults]) -> dict[str, PlaceResults]:
    """Add the largest mazes as they would have come out with the smaller budget."""
    shown = dict(places)
    if (largest := places.get(LARGEST)) is not None:
        shown[f'{LARGEST}-{SMALL_BUDGET}'] = largest.cut(SMALL_BUDGET)
    return shown


def page(results: Results, *, published: bool = True) -> Page:
    """Show the results, beside the paper's where that is asked for."""
    found = {name for place in results.places.values() for name in place.methods}
    methods = [name for name in METHODS if name in found]
    successes, ratios, over_greedy, sections = [], [], [], []
    for name, place in with_small_budget(results.places).items():
        scores = place.scores()
        theirs = [with_sd(*rate) for rate in PUBLISHED[name]] if published else []
        where = place.setting.describe()
        ours = [success(scores[m]) if m in scores else MISSING for m in methods]
        successes.append((where, *theirs, *ours))
        ratios.append((where, *(ratio(scores[m]) if m in scores else MISSING for m in methods)))
        if {'vgdp', 'greedy'} <= place.methods.keys():
            over_greedy.append((where, ratio(place.scores('greedy')['vgdp'])))
        sections.append(f'\n## {describe(place)}\n\n{details(place)}\n')
    names = [f'`{name}`' for name in methods]
    columns = [f'{name} (published)' for name in PUBLISHED_METHODS] if published else []
    text = TEXT.format(
        command=command('vgdp eval table --paper', results, SUITE.settings, SUITE.variants),
        origin=origin(results),
        explanation=explanation(),
        success=markdown_table(('mazes', *columns, *names), successes),
        published=ABOUT_PUBLISHED if published and LARGEST in results.places else '',
        ratios=markdown_table(('mazes', *names), ratios),
        samples=(
            ABOUT_SAMPLES.format(table=markdown_table(('mazes', '`vgdp` / `greedy`'), over_greedy))
            if over_greedy
            else ''
        ),
    )
    return Page(text + ''.join(sections))


SUITE = Suite(
    name='table',
    settings={
        '15-view1': Setting(15, view_range=1),
        '15-view2': Setting(15, view_range=2),
        '15-view3': Setting(15, view_range=3),
        '20-view2': Setting(20, view_range=2),
        '30-view2': Setting(30, view_range=2, budget=1000),
    },
    variants={name: Variant(name) for name in METHODS},
    page=page,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp eval table``."""
    sweep.add_arguments(SUITE, parser)
    parser.add_argument(
        '--paper', action='store_true', help="print the paper's own columns beside ours"
    )


def run(args: argparse.Namespace) -> int:
    """Run the evaluation and print its page."""
    return sweep.run(replace(SUITE, page=partial(page, published=args.paper)), args)
