"""Robots whose steps slip and whose poses are noisy, with the belief filter and without."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from vgdp_experiments import plots, sweep
from vgdp_experiments.jobs import Variant
from vgdp_experiments.pages import command, describe, details, explanation, origin
from vgdp_experiments.settings import Setting
from vgdp_experiments.suite import Page, Suite

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vgdp_experiments.results import Results

POSE_NOISES = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0)
SLIPS = (0.0, 0.05, 0.1, 0.2, 0.3)

NOISE_OF_SLIPS = 1.0
"""Pose noise, in cells, where the slip varies: with none the reported cell is the true one."""

ONE_STEP = {'execute': 1}
"""Where a step may slip, what comes next is decided after it."""

SWEPT = {
    'noise': ('pose noise in cells', 'pose_noise'),
    'slip': (f'share of slipping steps, pose noise {NOISE_OF_SLIPS:g} cells', 'slip'),
}

TEXT = """\
# Robots that slip, and that don't know exactly where they are

The same planner twice: `filter` plans from the belief of its filter, `reported` takes the reported
cell for the true one. Both plan anew after every step. The map is built from true poses for both.
A step that slips leads to a cell beside the right one, or nowhere. A step into an obstacle ends
the episode, as everywhere here. Bands are 95 % intervals.

`{command}`

{origin}

{explanation}
"""


def page(results: Results) -> Page:
    """Show the results as curves."""
    text = TEXT.format(
        command=command('vgdp eval belief', results, SUITE.settings, SUITE.variants),
        origin=origin(results),
        explanation=explanation(),
    )
    pictures = {f'belief_{key}.png': _draw(results, key) for key in SWEPT}
    shown = ''.join(
        f'\n![Success and SPL against {SWEPT[key][0]}](belief_{key}.png)\n' for key in SWEPT
    )
    sections = [
        f'\n## {describe(place)}\n\n{details(place)}\n' for place in results.places.values()
    ]
    return Page(text + shown + ''.join(sections), pictures)


def _draw(results: Results, key: str) -> Figure:
    what, attribute = SWEPT[key]
    figure, (left, right) = plots.panels(2, f'Success and SPL against {what}')
    plots.label(left, what, 'success')
    plots.label(right, what, 'SPL by path cost')
    places = [place for name, place in results.places.items() if name.startswith(f'{key}-')]
    for color, name in enumerate(SUITE.variants):
        points = [
            (getattr(place.setting, attribute), place.scores()[name])
            for place in places
            if name in place.methods
        ]
        x = [at for at, _ in points]
        plots.score_curves(left, right, x, [scores for _, scores in points], name, color)
    plots.legend(left)
    return figure


SUITE = Suite(
    name='belief',
    settings={
        **{f'noise-{noise:g}': Setting(15, pose_noise=noise) for noise in POSE_NOISES},
        **{f'slip-{slip:g}': Setting(15, pose_noise=NOISE_OF_SLIPS, slip=slip) for slip in SLIPS},
    },
    variants={
        'filter': Variant('vgdp', ONE_STEP, filtered=True),
        'reported': Variant('vgdp', ONE_STEP),
    },
    page=page,
    episodes=200,
)

add_arguments = partial(sweep.add_arguments, SUITE)
run = partial(sweep.run, SUITE)
