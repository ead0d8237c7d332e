"""Quality against the time that is spent on a decision: denoising steps and candidates."""

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

    from vgdp_experiments.results import PlaceResults, Results

SWEPT = {
    'sampling_steps': ('denoising steps of a sample', (1, 2, 4, 8, 16, 32)),
    'candidates': ('candidates', (1, 2, 4, 8, 16, 32, 64)),
}
"""Settings of the planner, what they are and the values that they get, one at a time."""

TITLES = ('success', 'SPL by path cost', 'ms a decision, in batches')

TEXT = """\
# Quality against sampling

One setting of the planner at a time gets other values; the rest stays as shipped. The dotted line
is the shipped value, the dashed one `greedy`: steps on the same values without any sample.
Bands are 95 % intervals.

`{command}`

{origin}

{explanation}
"""


def page(results: Results) -> Page:
    """Show the results as curves."""
    sections = []
    pictures = {}
    for name, place in results.places.items():
        sections.append(f'\n## {describe(place)}\n')
        for setting, (what, _) in SWEPT.items():
            file = f'curves_{name}_{setting}.png'
            pictures[file] = _draw(place, setting)
            sections.append(f'\n![Success, SPL and time against {what}]({file})\n')
        sections.append(f'\n{details(place)}\n')
    text = TEXT.format(
        command=command('vgdp eval curves', results, SUITE.settings, SUITE.variants),
        origin=origin(results),
        explanation=explanation(),
    )
    return Page(text + ''.join(sections), pictures)


def _draw(place: PlaceResults, setting: str) -> Figure:
    what, values = SWEPT[setting]
    figure, panels = plots.panels(3, f'{place.setting.describe()}: {what}')
    scores = place.scores()
    x = [value for value in values if f'{setting}-{value}' in scores]
    found = [scores[f'{setting}-{value}'] for value in x]
    success, spl, time = panels
    for axes, title in zip(panels, TITLES, strict=True):
        plots.label(axes, what, title, ticks=values)
    plots.score_curves(success, spl, x, found, 'vgdp', 0)
    plots.curve(time, x, [score.ms_per_decision for score in found], name='vgdp')
    time.set_ylim(bottom=0)
    if 'vgdp' in scores:
        shipped = place.methods['vgdp'].settings['planner'][setting]
        for axes in panels:
            plots.mark_shipped(axes, shipped)
    if 'greedy' in scores:
        greedy = scores['greedy']
        plots.mark_greedy(success, greedy.summary.success)
        plots.mark_greedy(spl, greedy.summary.spl)
        plots.mark_greedy(time, greedy.ms_per_decision)
    plots.legend(spl)
    return figure


SUITE = Suite(
    name='curves',
    settings={'15-view2': Setting(15, view_range=2)},
    variants={
        'vgdp': Variant('vgdp'),
        'greedy': Variant('greedy'),
        **{
            f'{setting}-{value}': Variant('vgdp', {setting: value})
            for setting, (_, values) in SWEPT.items()
            for value in values
        },
        'frontier': Variant('frontier'),
    },
    page=page,
    episodes=200,
)

add_arguments = partial(sweep.add_arguments, SUITE)
run = partial(sweep.run, SUITE)
