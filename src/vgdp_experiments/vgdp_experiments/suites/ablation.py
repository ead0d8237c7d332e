"""The paper's ablation: what each way of choosing among samples adds."""

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
    with_sd,
)
from vgdp_experiments.settings import Setting
from vgdp_experiments.suite import Page, Suite

if TYPE_CHECKING:
    from vgdp_experiments.results import Results

PUBLISHED = {
    'single_sample': (0.060, 0.022),
    'voting': (0.114, 0.025),
    'guidance': (0.538, 0.010),
    'guidance_memory': (0.906, 0.010),
}
"""Success in the paper's ablation, mean and standard deviation over trials."""

MEANING = {
    'single_sample': 'one sample of the policy',
    'voting': 'the most frequent of many samples',
    'guidance': 'the sample of the highest value',
    'guidance_memory': 'the same with the best-plan memory',
    'gradient_guidance': 'samples pulled towards high values, with memory',
    'greedy': 'greedy steps on the values, no sample',
    'vgdp': 'the whole planner',
    'frontier': 'exploration of the nearest frontier',
}

TEXT = """\
# What each part of the planner adds

The rows of the paper's ablation and beyond, all with the same weights.

`{command}`

{origin}

{explanation}

{table}
"""


def page(results: Results) -> Page:
    """Show the results beside the paper's."""
    parts = []
    for place in results.places.values():
        over_greedy = place.scores('greedy')
        rows = [
            (
                f'`{name}`',
                MEANING[name],
                with_sd(*PUBLISHED[name]) if name in PUBLISHED else MISSING,
                success(scores),
                ratio(scores),
                ratio(over_greedy[name]),
            )
            for name, scores in place.scores().items()
        ]
        headings = (
            'method',
            'what it is',
            'published',
            'success',
            'SPL / frontier',
            'SPL / greedy',
        )
        parts.append(f'## {describe(place)}\n\n{markdown_table(headings, rows)}\n')
        parts.append(f'\n{details(place)}\n')
    return Page(
        TEXT.format(
            command=command('vgdp eval ablation', results, SUITE.settings, SUITE.variants),
            origin=origin(results),
            explanation=explanation(),
            table='\n'.join(parts).rstrip(),
        )
    )


SUITE = Suite(
    name='ablation',
    settings={'15-view2': Setting(15, view_range=2)},
    variants={name: Variant(name) for name in MEANING},
    page=page,
)

add_arguments = partial(sweep.add_arguments, SUITE)
run = partial(sweep.run, SUITE)
