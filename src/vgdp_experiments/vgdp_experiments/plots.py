"""Plots of results, all in one look."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from gridnav import GridGeometry
    from vgdp_experiments.scores import Scores

INK, FAINT = '#2b303b', '#8a93a3'
COLORS = ('#3b7dd8', '#f08c2e', '#2f9e77', '#8e5bb5', '#c9485b', '#5f6877')
SHADE = 0.18
CELL_COLORS = {UNKNOWN_VALUE: '#dfe3ea', FREE_VALUE: '#ffffff', OCCUPIED_VALUE: '#3b4252'}


def panels(count: int, title: str) -> tuple[Figure, list[Axes]]:
    """Return a figure with so many panels side by side."""
    figure = Figure(figsize=(0.6 + 4.4 * count, 3.7), dpi=110, layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.01, ha='left', color=INK, size=12, weight='bold')
    axes = list(figure.subplots(1, count, squeeze=False)[0])
    for panel in axes:
        panel.grid(color=FAINT, alpha=SHADE)
        panel.tick_params(colors=INK, labelsize=9)
        for side in ('top', 'right'):
            panel.spines[side].set_visible(False)
    return figure, axes


def label(axes: Axes, x: str, y: str, ticks: Sequence[float] | None = None) -> None:
    """Name the axes; with ticks, x doubles from tick to tick."""
    axes.set_xlabel(x, color=INK)
    axes.set_title(y, loc='left', color=INK, size=11)
    if ticks is not None:
        axes.set_xscale('log', base=2)
        axes.set_xticks(list(ticks))
        axes.xaxis.set_major_formatter(ScalarFormatter())


def curve(
    axes: Axes,
    x: Sequence[float],
    y: Sequence[float],
    band: tuple[Sequence[float], Sequence[float]] | None = None,
    *,
    name: str | None = None,
    color: int = 0,
    shade: float = SHADE,
) -> None:
    """Draw a curve with a band around it, of some opacity."""
    axes.plot(x, y, 'o-', color=COLORS[color], lw=2, ms=4, label=name)
    if band is not None:
        axes.fill_between(x, *band, color=COLORS[color], alpha=shade, lw=0)


def score_curves(
    success: Axes,
    spl: Axes,
    x: Sequence[float],
    scores: Sequence[Scores],
    name: str,
    color: int,
    shade: float = SHADE,
) -> None:
    """Draw success and SPL by path cost with their 95 % intervals, each in a panel of its own."""
    summaries = [score.summary for score in scores]
    curve(
        success,
        x,
        [summary.success for summary in summaries],
        ([s.success_low for s in summaries], [s.success_high for s in summaries]),
        name=name,
        color=color,
        shade=shade,
    )
    curve(
        spl,
        x,
        [summary.spl for summary in summaries],
        ([s.spl_interval[0] for s in scores], [s.spl_interval[1] for s in scores]),
        name=name,
        color=color,
        shade=shade,
    )


def mark_shipped(axes: Axes, x: float) -> None:
    """Draw a line upright at the shipped value of what varies."""
    axes.axvline(x, color=INK, ls=':', lw=1.2, label='shipped')


def mark_greedy(axes: Axes, y: float) -> None:
    """Draw a line level with what greedy steps reach."""
    axes.axhline(y, color=FAINT, ls='--', lw=1.2, label='greedy')


def legend(axes: Axes) -> None:
    """Say what the curves of a panel are."""
    axes.legend(frameon=False, fontsize=9, labelcolor=INK)


def draw_map(axes: Axes, occupancy: NDArray[np.int8], geometry: GridGeometry) -> None:
    """Draw a map of -1, 0 and 100 (H, W) where it lies, in metres."""
    picture = np.zeros((*geometry.shape, 3), dtype=np.uint8)
    for value, color in CELL_COLORS.items():
        picture[occupancy == value] = list(bytes.fromhex(color[1:]))
    east = geometry.origin_x + geometry.cols * geometry.resolution
    north = geometry.origin_y + geometry.rows * geometry.resolution
    extent = (geometry.origin_x, east, geometry.origin_y, north)
    axes.imshow(picture, origin='lower', extent=extent, interpolation='nearest')
    axes.set_facecolor(CELL_COLORS[UNKNOWN_VALUE])
