"""Pictures of searches, and what went wrong in words."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gridnav import DONE, Outcome
from vgdp_experiments import plots
from vgdp_experiments.search.evaluate import open_home
from vgdp_experiments.search.home_setting import HomeSetting
from vgdp_experiments.search.loop import search
from vgdp_experiments.search.registry import SEARCHERS

if TYPE_CHECKING:
    import argparse

    from matplotlib.figure import Figure

    from avd_player.simulation import ActiveVisionSimulation
    from gridnav.metrics import EpisodeResult
    from vgdp_experiments.search.evaluate import Home
    from vgdp_experiments.search.loop import SearchStep
    from vgdp_experiments.search.searchers import Searcher

PATH, SEEN, START, TARGET = '#3b7dd8', '#f08c2e', '#2f9e77', '#d64545'

DEFAULT_OUT = Path('search.png')
MARGIN_M = 0.3


class Search(NamedTuple):
    """A search that has ended.

    Attributes:
        result: How.
        way: Index of the position after each action, the start first.
        sighted: Number of actions before the goal was on the map, None if it never was.
        steps: What was decided.
    """

    result: EpisodeResult
    way: list[int]
    sighted: int | None
    steps: list[SearchStep]


def follow(home: Home, searcher: Searcher, seed: int) -> Search:
    """Search, and note the way."""
    simulation = home.simulation
    steps: list[SearchStep] = []
    result = search(simulation, searcher, seed, mapper=home.mapper, on_step=steps.append)
    way, sighted = [simulation.start], None
    for step in steps:
        if sighted is None and step.observation.grid.goal != 'none':
            sighted = len(way) - 1
        for action in step.committed:
            if action != DONE and len(way) <= result.steps:
                there = int(simulation.scene.moves[way[-1], action])
                way.append(there if there >= 0 else way[-1])
    return Search(result, way, sighted, steps)


def explain(found: Search, simulation: ActiveVisionSimulation) -> str:
    """Say how a search ended, and what went wrong."""
    result = found.result
    positions = simulation.scene.positions
    apart = min(
        float(np.hypot(*(positions[found.way[-1]] - target[:2]))) for target in simulation.targets
    )
    if result.outcome is Outcome.SUCCESS:
        return (
            f'Found after {result.steps} actions on a way of {result.path_cost:.1f} steps; the '
            f'shortest has {result.expert_cost:.1f}.'
        )
    if result.outcome is Outcome.FALSE_DONE:
        if not simulation.target_seen:
            return f'Done was said {apart:.1f} m from the bottle, which was never in sight.'
        return (
            f'Done was said {apart:.1f} m from the bottle: more than '
            f'{simulation.rules.reach:g} m, and not at the position nearest to it.'
        )
    tried = f'{len(set(found.way))} of {len(positions)} positions visited'
    how = (
        f'After {result.steps} actions the budget was spent'
        if result.outcome is Outcome.TIMEOUT
        else f'After {result.steps} actions the robot gave up'
    )
    if not simulation.target_seen:
        return f'{how}; the bottle was never in sight, with {tried}.'
    last = found.steps[-1].observation.grid.goal if found.steps else 'none'
    why = {
        'none': 'its place was not believed any more',
        'ok': 'the robot did not get there, although the map has a way',
        'unreachable': 'no way leads there on the map',
        'occupied': 'on the map there is no free place near it',
        'outside': 'it seemed to be off the map',
    }[last]
    return f'{how}; the bottle was seen, but {why}. {tried.capitalize()}.'


def draw(found: Search, home: Home, title: str) -> Figure:
    """Draw the map at the end, the way, and what was seen of the bottle."""
    simulation, positions = home.simulation, home.simulation.scene.positions
    figure, (axes,) = plots.panels(1, title)
    figure.set_size_inches(7.0, 7.0)
    axes.grid(visible=False)
    grid = home.mapper.grid
    plots.draw_map(axes, grid.occupancy, grid.geometry)
    axes.plot(*positions.T, '.', color=plots.FAINT, ms=2, label='positions')
    way = positions[found.way]
    axes.plot(*way.T, '-', color=PATH, lw=2, label='way')
    if found.sighted is not None:
        axes.plot(*way[found.sighted], 'D', color=SEEN, ms=7, label='bottle seen from here')
    axes.plot(*way[0], 'o', color=START, ms=9, label='start')
    axes.plot(*way[-1], 's', color=PATH, ms=9, label='end')
    if simulation.sightings.points:
        x, y, _ = np.stack(simulation.sightings.points).T
        axes.plot(x, y, 'x', color=SEEN, ms=6, label='sightings')
    x, y, _ = np.stack(simulation.targets).T
    axes.plot(x, y, '*', color=TARGET, ms=14, label='bottle')
    low, high = positions.min(axis=0) - MARGIN_M, positions.max(axis=0) + MARGIN_M
    low, high = np.minimum(low, [x.min(), y.min()]), np.maximum(high, [x.max(), y.max()])
    axes.set(xlim=(low[0] - 1, high[0] + 1), ylim=(low[1] - 1, high[1] + 1), aspect='equal')
    plots.label(axes, 'x (m)', '')
    axes.set_title(explain(found, simulation), loc='left', color=plots.INK, size=9, wrap=True)
    axes.legend(fontsize=8, loc='upper left', framealpha=0.8)
    return figure


def draw_search(args: argparse.Namespace) -> int:
    """Run and draw one search; returns the exit status.

    Raises:
        ValueError: If the options don't say which, or the scene can't be used.
        OSError: If the picture can't be written.
    """
    scene, _, seed = args.picture.rpartition(':')
    names = args.method or ['vgdp']
    if not scene or not seed.isdecimal() or len(names) != 1 or names[0] not in SEARCHERS:
        msg = (
            f'A picture needs a scene and a seed, such as Home_113_1:0, got {args.picture!r}, '
            f'and one --method of {", ".join(SEARCHERS)}, got {" ".join(names)}.'
        )
        raise ValueError(msg)
    home = open_home(args.data, HomeSetting(scene), 0)
    found = follow(home, SEARCHERS[names[0]](args), int(seed))
    out = args.out or DEFAULT_OUT
    out.parent.mkdir(parents=True, exist_ok=True)
    figure = draw(found, home, f'{scene}, seed {seed}, {names[0]}')
    figure.savefig(out, bbox_inches='tight')
    print(f'{explain(found, home.simulation)} Drawn in {out}.')  # noqa: T201
    return 0
