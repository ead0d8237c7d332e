"""The plots of a report, as SVG."""

from __future__ import annotations

from io import StringIO
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from vgdp_bringup.bags import NANOSECONDS
from vgdp_bringup.pictures import (
    FAINT,
    INK,
    OLD_PATH,
    PATH,
    PLAN,
    draw_way,
    with_maps,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from vgdp_bringup.bags import Bag, Episode
    from vgdp_bringup.figures import EpisodeFigures

OUTCOME_COLORS = {
    'success': '#2f9e63',
    'collision': '#d64545',
    'false_done': '#e07b39',
    'timeout': '#c99a06',
    'repeat': '#b0639b',
    'gave_up': '#7a6fd0',
    'running': '#8a93a3',
}
MAPPING, PLANNING, ACTING = '#8fb8de', PATH, PLAN
GRID_LINES = '#e6e9ef'
USUAL, OUTLIER = 0.95, 3.0
"""More than three times the 95th percentile is off the scale."""

MANY = 6
"""More curves than this get no names of their own."""

STYLE: Any = {
    # Text stays text: it can be searched, and is drawn in the reader's own font.
    'svg.fonttype': 'none',
    'svg.hashsalt': 'vgdp',
    'font.family': 'sans-serif',
    'font.size': 9.5,
}


def episode_plot(episode: Episode, figures: EpisodeFigures) -> str:
    """Draw one episode: its map, coverage, latency, delays and candidates."""
    figure = Figure(figsize=(13.5, 6.2))
    grid = figure.add_gridspec(
        2, 4, width_ratios=(1.55, 1, 1, 0.5), left=0.01, right=0.99, top=0.94, bottom=0.13,
        wspace=0.32, hspace=0.42,
    )  # fmt: skip
    way = figure.add_subplot(grid[:, 0])
    steps = with_maps(episode)
    if steps:
        draw_way(way, episode, steps, crop=True)
        _title(way, 'What was seen, and the way taken')
    else:
        way.axis('off')
        way.text(0.5, 0.5, 'No map was recorded.', ha='center', color=FAINT)
    _draw_coverage(figure.add_subplot(grid[0, 1]), [figures])
    latency = figure.add_subplot(grid[0, 2])
    _draw_latency(latency, figures)
    _draw_histogram(figure.add_subplot(grid[0, 3], sharey=latency), [figures])
    _draw_delays(figure.add_subplot(grid[1, 1]), figures)
    _draw_candidates(figure.add_subplot(grid[1, 2:]), figures)
    return _svg(figure)


def thumbnail(episode: Episode, color: str) -> str:
    """Draw the map and the way of an episode, small, in a frame of a colour."""
    figure = Figure(figsize=(1.7, 1.7))
    axes = figure.add_axes((0.03, 0.03, 0.94, 0.94))
    steps = with_maps(episode)
    if steps:
        draw_way(axes, episode, steps, crop=True)
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(color=color, linewidth=2.5)
    return _svg(figure)


def overview_plot(episodes: Sequence[EpisodeFigures]) -> str:
    """Draw many episodes together: outcomes, SPL, coverage and planning latency."""
    figure = Figure(figsize=(13.5, 3.1))
    axes = figure.subplots(1, 4, width_ratios=(0.8, 1.2, 1, 1))
    figure.subplots_adjust(left=0.075, right=0.99, top=0.87, bottom=0.17, wspace=0.3)
    _draw_outcomes(axes[0], episodes)
    _draw_spl(axes[1], episodes)
    _draw_coverage(axes[2], episodes)
    _draw_histogram(axes[3], episodes)
    return _svg(figure)


def topics_plot(bag: Bag) -> str:
    """Draw when messages came in on each topic, and where each episode began."""
    heard = [topic for topic in bag.topics if len(topic.received)]
    figure = Figure(figsize=(13.5, 0.8 + 0.24 * max(len(heard), 1)))
    axes = figure.add_axes((0.19, 0.0, 0.8, 1.0))
    height = figure.get_figheight()
    axes.set_position((0.19, 0.45 / height, 0.8, 1 - 0.75 / height))
    _title(axes, 'When messages came in')
    first = min((topic.received[0] for topic in heard), default=0)
    for row, topic in enumerate(reversed(heard)):
        seconds = (topic.received - first) / NANOSECONDS
        axes.vlines(seconds, row - 0.36, row + 0.36, color=PATH, lw=0.7, rasterized=True)
    for episode in bag.episodes:
        if episode.steps:
            begin = (episode.steps[0].observed - first) / NANOSECONDS
            axes.axvline(begin, color=PLAN, lw=1.2, ls=':')
    axes.set_yticks(range(len(heard)), [topic.name for topic in reversed(heard)])
    axes.set_ylim(-0.7, len(heard) - 0.3)
    axes.set_xlabel('seconds from the first message (dotted: an episode begins)', color=FAINT)
    _clean(axes)
    return _svg(figure)


def _cap(axes: Axes, values: Sequence[float]) -> None:
    """Don't let single outliers flatten all else; they are named at the upper edge."""
    if not values:
        return
    top = OUTLIER * float(np.quantile(values, USUAL))
    axes.set_ylim(0, None if top <= 0 or max(values) <= top else top)
    beyond = [value for value in values if value > top > 0]
    if beyond:
        longest = f'{len(beyond)} beyond, up to {max(beyond):.0f}'
        axes.text(0.99, 0.98, longest, color=FAINT, ha='right', va='top', size=8.5,
                  transform=axes.transAxes)  # fmt: skip


def _draw_coverage(axes: Axes, episodes: Sequence[EpisodeFigures]) -> None:
    _title(axes, 'Coverage: share of the cells seen')
    for episode in episodes:
        if episode.coverage:
            color = PATH if len(episodes) == 1 else OUTCOME_COLORS[episode.outcome]
            times, shares = np.array(episode.coverage).T
            width = 1.8 if len(episodes) <= MANY else 1.0
            axes.step(times, shares, where='post', color=color, lw=width, alpha=0.9)
    axes.set_ylim(0, 1.02)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.set_xlabel('seconds', color=FAINT)
    _clean(axes)


def _draw_latency(axes: Axes, episode: EpisodeFigures) -> None:
    _title(axes, 'Planning latency, ms')
    plans = [plan for plan in episode.plans if plan.planning is not None]
    times = [plan.time for plan in plans]
    latencies = [1000 * (plan.planning or 0.0) for plan in plans]
    axes.vlines(times, 0, latencies, color=OLD_PATH, lw=1)
    axes.plot(times, latencies, 'o', color=PATH, ms=3)
    if latencies:
        median = float(np.median(latencies))
        axes.axhline(median, color=PLAN, lw=1.2)
        _title(axes, f'Planning latency, ms: median {median:.0f}')
    _cap(axes, latencies)
    axes.set_xlabel('seconds', color=FAINT)
    _clean(axes)


def _draw_histogram(axes: Axes, episodes: Sequence[EpisodeFigures]) -> None:
    latencies = [
        1000 * plan.planning
        for episode in episodes
        for plan in episode.plans
        if plan.planning is not None
    ]
    sideways = len(episodes) == 1
    _title(axes, 'Distribution' if sideways else 'Planning latency, ms')
    if latencies:
        axes.hist(
            np.minimum(latencies, OUTLIER * np.quantile(latencies, USUAL)),
            bins=24,
            color=PATH,
            orientation='horizontal' if sideways else 'vertical',
        )
        if not sideways:
            median, most = np.quantile(latencies, (0.5, USUAL))
            for value in (median, most):
                axes.axvline(value, color=PLAN, lw=1.2)
            _title(axes, f'Planning, ms: p50 {median:.0f}, p95 {most:.0f}')
    if sideways:
        axes.tick_params(labelleft=False)
        axes.set_xlabel('plans', color=FAINT)
        axes.xaxis.set_major_locator(MaxNLocator(3, integer=True))
    else:
        axes.set_ylabel('plans', color=FAINT)
    _clean(axes)


def _draw_delays(axes: Axes, episode: EpisodeFigures) -> None:
    _title(axes, 'From observation to action, ms')
    numbers = np.arange(len(episode.plans))
    bottom = np.zeros(len(numbers))
    for name, color in (('mapping', MAPPING), ('planning', PLANNING), ('acting', ACTING)):
        values = np.array([1000 * (getattr(plan, name) or 0.0) for plan in episode.plans])
        axes.bar(numbers, values, 0.9, bottom=bottom, color=color, label=name)
        bottom += values
    _cap(axes, bottom.tolist())
    if len(numbers):
        axes.legend(
            loc='upper center', bbox_to_anchor=(0.5, -0.14), ncols=3, frameon=False,
            fontsize=8.5, labelcolor=FAINT, handlelength=1, columnspacing=1,
        )  # fmt: skip
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.text(1.0, -0.12, 'plan', transform=axes.transAxes, color=FAINT, ha='right', va='top')
    _clean(axes)


def _draw_candidates(axes: Axes, episode: EpisodeFigures) -> None:
    _title(axes, 'Values of the candidate plans')
    plans = [plan for plan in episode.plans if plan.best is not None]
    times = [plan.time for plan in plans]
    best, median, quarter = (
        np.array([getattr(plan, name) for plan in plans], dtype=np.float64)
        for name in ('best', 'median', 'quarter')
    )
    if times:
        axes.fill_between(times, quarter, best, color=OLD_PATH, label='upper three quarters')
        axes.plot(times, best, color=PATH, lw=1.8, label='best')
        axes.plot(times, median, color=PATH, lw=1, ls='--', label='median')
        turns = [(plan.time, plan.best) for plan in plans if plan.turned]
        if turns:
            axes.plot(*np.array(turns).T, 'o', color=PLAN, ms=4, label='leaves the plan before')
        axes.legend(
            loc='upper center', bbox_to_anchor=(0.5, -0.14), ncols=4, frameon=False,
            fontsize=8.5, labelcolor=FAINT, handlelength=1.4, columnspacing=1,
        )  # fmt: skip
    axes.text(1.0, -0.12, 'seconds', transform=axes.transAxes, color=FAINT, ha='right', va='top')
    _clean(axes)


def _draw_outcomes(axes: Axes, episodes: Sequence[EpisodeFigures]) -> None:
    _title(axes, 'Outcomes')
    names = [name for name in OUTCOME_COLORS if any(e.outcome == name for e in episodes)][::-1]
    counts = [sum(episode.outcome == name for episode in episodes) for name in names]
    axes.barh(range(len(names)), counts, 0.6, color=[OUTCOME_COLORS[name] for name in names])
    axes.set_yticks(range(len(names)), [name.replace('_', ' ') for name in names])
    for row, count in enumerate(counts):
        axes.text(count, row, f' {count}', va='center', color=INK)
    axes.set_xlim(0, 1.15 * max(counts))
    axes.set_ylim(-0.8, max(len(names), 3) - 0.2)
    axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    _clean(axes)


def _draw_spl(axes: Axes, episodes: Sequence[EpisodeFigures]) -> None:
    _title(axes, 'SPL of each episode, sorted')
    known = sorted((e.spl or 0.0, e.outcome) for e in episodes if e.spl is not None)
    if known:
        colors = [OUTCOME_COLORS[outcome] for _, outcome in known]
        values = [value for value, _ in known]
        axes.bar(range(len(known)), [max(value, 0.008) for value in values], 0.8, color=colors)
        mean = float(np.mean(values))
        axes.axhline(mean, color=INK, lw=1, ls='--')
        _title(axes, f'SPL of each episode, sorted: mean {mean:.2f}')
    axes.set_ylim(0, 1.02)
    axes.set_xticks([])
    _clean(axes)


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, loc='left', color=INK, size=10.5)


def _clean(axes: Axes) -> None:
    axes.spines[['top', 'right']].set_visible(False)
    axes.spines[['left', 'bottom']].set_color(FAINT)
    axes.tick_params(colors=FAINT, labelsize=8.5)
    axes.grid(color=GRID_LINES, lw=0.8)
    axes.set_axisbelow(True)


def _svg(figure: Figure) -> str:
    """Return a figure as SVG that is the same every time."""
    stream = StringIO()
    with mpl.rc_context(STYLE):
        figure.savefig(stream, format='svg', metadata={'Date': None})
    return stream.getvalue()
