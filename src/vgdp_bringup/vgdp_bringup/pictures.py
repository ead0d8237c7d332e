"""Pictures of a recorded episode: an animation of the run and a still. Made from the bag alone."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from PIL import Image

from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE
from vgdp_bringup.bags import BagError

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from gridnav.grid import GridGeometry
    from vgdp_bringup.bags import Episode, Grid, Step

UNSEEN, FREE, WALL = range(3)
CELL_COLORS = ('#dfe3ea', '#ffffff', '#3b4252')
INK, FAINT = '#2b303b', '#8a93a3'
OLD_PATH, PATH, PLAN, ROBOT, GOAL = '#c3daf7', '#3b7dd8', '#f08c2e', '#d64545', '#f5b301'
VALUE_COLORS = 'viridis'
WORST_SHOWN = 0.25
"""The worst quarter of the candidates shares one colour."""

GIF_SECONDS = 10.0
FRAME_MS = (60, 250)
"""A frame is never shown for less or more than this, whatever ``GIF_SECONDS`` asks for."""
LAST_FRAME_MS = 2500
MAX_FRAMES = 120
"""A longer run shows every second step, or every third, and so on."""
SHADES = 5
"""Steps between two colours of the animation, for smooth edges."""
CANDIDATE_SPREAD = 0.3
"""Candidates are drawn side by side over this part of a cell, lest one hides the others."""


def save_pictures(episode: Episode, folder: Path) -> tuple[Path, Path]:
    """Draw an episode as ``run.gif`` and ``still.png``.

    Args:
        episode: With at least one step whose map was recorded.
        folder: Where the files go; it exists.

    Returns:
        The paths of the two files.

    Raises:
        BagError: If no map was recorded.
    """
    steps = with_maps(episode)
    if not steps:
        msg = 'No map was recorded, so there is nothing to draw.'
        raise BagError(msg)
    gif, still = folder / 'run.gif', folder / 'still.png'
    _save_animation(episode, steps, gif)
    _save_still(episode, steps, still)
    return gif, still


def with_maps(episode: Episode) -> list[tuple[Step, Grid]]:
    """Return each step with the latest map as of then, from the first map on."""
    steps = []
    grid = None
    for step in episode.steps:
        grid = step.map or grid
        if grid is not None:
            steps.append((step, grid))
    return steps


def _save_animation(episode: Episode, steps: list[tuple[Step, Grid]], path: Path) -> None:
    frame = _Frame(episode, steps[-1][1].geometry)
    stride = -(-len(steps) // MAX_FRAMES)
    shown = sorted({*range(0, len(steps), stride), len(steps) - 1})
    pictures = [frame.draw(steps, index) for index in shown]
    frames = [_as_palette_image(picture) for picture in pictures]
    low, high = FRAME_MS
    duration = int(np.clip(1000 * GIF_SECONDS / len(frames), low, high))
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=[duration] * (len(frames) - 1) + [LAST_FRAME_MS],
        loop=0,
    )


def _palette() -> NDArray[np.uint8]:
    """Return the colours of the animation and those between any two of them, (N, 3)."""
    names = (*CELL_COLORS, INK, FAINT, PATH, PLAN, ROBOT, GOAL)
    colors = np.array([to_rgb(name) for name in names])
    shades = [np.linspace(a, b, SHADES + 2)[1:-1] for a, b in combinations(colors, 2)]
    return (255 * np.vstack([colors, *shades])).round().astype(np.uint8)


def _as_palette_image(pixels: NDArray[np.uint8]) -> Image.Image:
    """Turn RGB (H, W, 3) into an image with the one palette of all frames, exact where it can."""
    palette = _palette()
    packed = pixels.astype(np.int64) @ (1 << 16, 1 << 8, 1)
    present, where = np.unique(packed, return_inverse=True)
    colors = np.stack([present >> 16, present >> 8 & 255, present & 255], axis=1)
    nearest = ((colors[:, None] - palette[None].astype(np.int64)) ** 2).sum(axis=2).argmin(axis=1)
    image = Image.fromarray(nearest[where].reshape(packed.shape).astype(np.uint8), 'P')
    image.putpalette(palette.tobytes())
    return image


class _Frame:
    """One picture of the animation, drawn again and again with other contents."""

    def __init__(self, episode: Episode, geometry: GridGeometry) -> None:
        self._episode = episode
        self._geometry = geometry
        figure = Figure(figsize=(5.0, 5.7), dpi=100, facecolor='white')
        self._canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.03, 0.065, 0.94, 0.825))
        _frame_axes(axes, geometry)
        figure.text(0.03, 0.955, describe_world(episode), color=INK, size=11, weight='bold')
        self._status = figure.text(0.03, 0.91, '', color=FAINT, size=10)
        self._cells = _draw_cells(axes, np.zeros(geometry.shape, dtype=np.int64), geometry)
        self._path = axes.plot([], [], color=PATH, lw=2.6, solid_capstyle='round')[0]
        self._plan = axes.plot([], [], '--o', color=PLAN, lw=2, ms=3.5)[0]
        self._goal = _draw_goal(axes, geometry)
        self._robot = _draw_robot(axes, geometry)
        axes.legend(
            [self._robot, self._goal, self._path, self._plan],
            ['robot', 'goal', 'path', 'plan'],
            loc='upper center',
            bbox_to_anchor=(0.5, -0.005),
            ncols=4,
            frameon=False,
            fontsize=9,
            labelcolor=FAINT,
        )

    def draw(self, steps: list[tuple[Step, Grid]], index: int) -> NDArray[np.uint8]:
        """Draw the run up to a step as RGB (H, W, 3)."""
        step, grid = steps[index]
        self._cells.set_data(_classes(grid, self._geometry))
        self._path.set_data(*np.array([s.position for s, _ in steps[: index + 1]]).T)
        self._robot.set_data(*np.array([step.position]).T)
        plan = _latest_plan(steps[: index + 1])
        self._plan.set_data(*(np.empty((2, 0)) if plan is None else plan.T))
        seen_goal = self._episode.goal is not None and step.stamp >= self._episode.goal_stamp
        self._goal.set_data(*(np.array([self._episode.goal]).T if seen_goal else np.empty((2, 0))))
        last = index == len(steps) - 1
        seen = np.mean(grid.cells >= 0)
        text = f'{self._episode.outcome}, ' if last else ''
        text += f'step {index}, {seen:.0%} of the map seen'
        self._status.set_text(text)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[:, :, :3].copy()


def _save_still(episode: Episode, steps: list[tuple[Step, Grid]], path: Path) -> None:
    figure = Figure(figsize=(15.5, 5.6), dpi=110, facecolor='white')
    FigureCanvasAgg(figure)
    left, middle, right = figure.subplots(1, 3)
    figure.subplots_adjust(left=0.015, right=0.945, bottom=0.03, top=0.85, wspace=0.2)
    figure.text(0.015, 0.94, describe_world(episode), color=INK, size=15, weight='bold')
    geometry = steps[-1][1].geometry
    moment = _telling_step(steps)

    _title(left, f'What was seen, and the way taken: {describe_outcome(episode)}')
    draw_way(left, episode, steps)

    step, grid = steps[moment]
    _title(middle, f'Step {moment}: {len(step.candidates)} candidate plans, by value')
    _frame_axes(middle, geometry)
    _draw_cells(middle, _classes(grid, geometry), geometry)
    _draw_path(middle, steps[: moment + 1])
    _draw_candidates(middle, step, geometry)
    _mark(middle, episode, steps[: moment + 1], geometry)

    _title(right, f'Step {moment}: the value of each cell')
    _frame_axes(right, geometry)
    _draw_cells(right, _classes(grid, geometry), geometry)
    _draw_values(right, step, grid, geometry)
    _mark(right, episode, steps[: moment + 1], geometry)
    figure.savefig(path)


def describe_world(episode: Episode) -> str:
    """Say in a few words which world it was."""
    values = episode.values
    world = 'An unknown place'
    if 'rows' in values and 'cols' in values:
        world = f'A maze of {values["rows"]} × {values["cols"]} cells'
    if 'scene' in values:
        world = f'{values["scene"]}, {values["positions"]} positions'
    if 'view_range' in values:
        world += f', view range {values["view_range"]}'
    if 'seed' in values:
        world += f', seed {values["seed"]}'
    return world


def describe_outcome(episode: Episode) -> str:
    """Say in a few words how it went."""
    text = f'{episode.outcome}'.replace('_', ' ')
    if 'steps' in episode.values:
        text += f' after {episode.values["steps"]} steps'
    return text


def draw_way(
    axes: Axes, episode: Episode, steps: list[tuple[Step, Grid]], *, crop: bool = False
) -> None:
    """Draw the latest map of some steps, at least one, with the way taken, robot and goal.

    Args:
        axes: Where to draw.
        episode: Whose steps they are.
        steps: With the map as of then.
        crop: Whether to show no more than a square around what was seen.
    """
    geometry = steps[-1][1].geometry
    _frame_axes(axes, geometry)
    if crop:
        _crop(axes, steps[-1][1])
    _draw_cells(axes, _classes(steps[-1][1], geometry), geometry)
    _draw_path(axes, steps)
    _mark(axes, episode, steps, geometry)


def _crop(axes: Axes, grid: Grid) -> None:
    """Show no more of a map than a square around what was seen."""
    rows, cols = np.nonzero(grid.cells != UNKNOWN_VALUE)
    if not len(rows):
        return
    low = np.array(grid.geometry.center_of(int(rows.min()), int(cols.min())))
    high = np.array(grid.geometry.center_of(int(rows.max()), int(cols.max())))
    half = float((high - low).max()) / 2 + grid.geometry.resolution
    (x, y) = ((low + high) / 2).tolist()
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), facecolor=CELL_COLORS[UNSEEN])


def _telling_step(steps: list[tuple[Step, Grid]]) -> int:
    """Return the step whose candidates lead to the most different places."""
    places = [
        len({tuple(candidate.points[-1]) for candidate in step.candidates})
        if step.value_map
        else 0
        for step, _ in steps
    ]
    return int(np.argmax(places))


def _latest_plan(steps: list[tuple[Step, Grid]]) -> NDArray[np.float64] | None:
    return next((step.plan for step, _ in reversed(steps) if step.plan is not None), None)


def _classes(grid: Grid, canvas: GridGeometry) -> NDArray[np.int64]:
    """Return what is known of each cell of a canvas that is at least as large as the grid."""
    classes = np.full(canvas.shape, UNSEEN)
    row, col = canvas.cell_at(*grid.geometry.center_of(0, 0))
    inside = classes[row : row + grid.geometry.rows, col : col + grid.geometry.cols]
    inside[grid.cells == FREE_VALUE] = FREE
    inside[grid.cells == OCCUPIED_VALUE] = WALL
    return classes


def _extent(geometry: GridGeometry) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top in metres."""
    left, bottom = geometry.origin_x, geometry.origin_y
    return (
        left,
        left + geometry.cols * geometry.resolution,
        bottom,
        bottom + geometry.rows * geometry.resolution,
    )


def _frame_axes(axes: Axes, geometry: GridGeometry) -> None:
    left, right, bottom, top = _extent(geometry)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect='equal', xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_color(FAINT)


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, loc='left', color=INK, size=11.5)


def _draw_cells(axes: Axes, classes: NDArray[np.int64], geometry: GridGeometry) -> Any:  # noqa: ANN401
    return axes.imshow(
        classes,
        cmap=ListedColormap(CELL_COLORS),
        vmin=UNSEEN,
        vmax=WALL,
        origin='lower',
        extent=_extent(geometry),
        interpolation='nearest',
    )


def _draw_path(axes: Axes, steps: list[tuple[Step, Grid]]) -> None:
    """Draw the way so far, fainter where it is older."""
    points = np.array([step.position for step, _ in steps])
    segments = np.stack([points[:-1], points[1:]], axis=1)
    fading = LinearSegmentedColormap.from_list('path', [OLD_PATH, PATH])
    lines = LineCollection(list(segments), cmap=fading, lw=2.6, capstyle='round')
    lines.set_array(np.arange(len(segments)))
    axes.add_collection(lines)


def _draw_candidates(axes: Axes, step: Step, geometry: GridGeometry) -> None:
    """Draw the candidates, the best one on top."""
    if not step.candidates:
        return
    ordered = sorted(step.candidates, key=lambda candidate: candidate.value)
    values = np.array([candidate.value for candidate in ordered])
    half = CANDIDATE_SPREAD * geometry.resolution / 2
    offsets = np.linspace(-half, half, len(ordered))
    lines = LineCollection(
        [candidate.points + by for candidate, by in zip(ordered, offsets, strict=True)],
        cmap=VALUE_COLORS,
        lw=1.8,
        capstyle='round',
        path_effects=[withStroke(linewidth=2.6, foreground='white')],
    )
    lines.set_array(values)
    # One hopeless plan would take all the colours.
    lines.set_clim(*_color_limits(np.quantile(values, WORST_SHOWN), values.max()))
    axes.add_collection(lines)
    _color_bar(axes, lines, 'value of the plan', extend='min')


def _draw_values(axes: Axes, step: Step, grid: Grid, geometry: GridGeometry) -> None:
    """Draw the values of the cells in whose middle the map was seen to be free."""
    if step.value_map is None:
        return
    values, cells = step.value_map.cells, step.value_map.geometry
    rows, cols = np.indices(cells.shape)
    finer, coarser = grid.geometry, cells.resolution
    row = (cells.origin_y - finer.origin_y + (rows + 0.5) * coarser) // finer.resolution
    col = (cells.origin_x - finer.origin_x + (cols + 0.5) * coarser) // finer.resolution
    inside = (row >= 0) & (row < finer.rows) & (col >= 0) & (col < finer.cols)
    free = np.zeros(cells.shape, dtype=np.bool_)
    free[inside] = grid.cells[row[inside].astype(int), col[inside].astype(int)] == FREE_VALUE
    shown = np.ma.masked_where(~free | (values < 0), values)
    if not shown.count():
        return
    image = axes.imshow(
        shown,
        cmap=VALUE_COLORS,
        origin='lower',
        extent=_extent(cells),
        interpolation='nearest',
    )
    image.set_clim(*_color_limits(float(shown.min()), float(shown.max())))
    left, right, bottom, top = _extent(geometry)
    axes.set(xlim=(left, right), ylim=(bottom, top))
    _color_bar(axes, image, 'value, % of the best')


def _color_limits(low: float, high: float) -> tuple[float, float]:
    """Return limits that are not the same."""
    return (low, high) if high > low else (low - 1.0, high)


def _color_bar(axes: Axes, mappable: Any, label: str, extend: str = 'neither') -> None:  # noqa: ANN401
    place = axes.inset_axes((1.02, 0.0, 0.03, 1.0))
    bar = axes.figure.colorbar(mappable, cax=place, extend=extend)
    bar.set_label(label, color=FAINT, labelpad=3)
    bar.ax.tick_params(colors=FAINT, labelsize=8)
    bar.outline.set_visible(False)


def _cell_size(axes: Axes, geometry: GridGeometry) -> float:
    """Return the side of a cell in points."""
    axes.apply_aspect()
    pixels = axes.transData.transform([(0.0, 0.0), (geometry.resolution, geometry.resolution)])
    return float(np.ptp(pixels[:, 1])) * 72 / axes.figure.dpi


def _draw_robot(axes: Axes, geometry: GridGeometry) -> Any:  # noqa: ANN401 - a line of matplotlib
    size = 0.7 * _cell_size(axes, geometry)
    return axes.plot([], [], 'o', color=ROBOT, ms=size, mec='white', mew=0.1 * size, zorder=4)[0]


def _draw_goal(axes: Axes, geometry: GridGeometry) -> Any:  # noqa: ANN401 - a line of matplotlib
    size = 1.0 * _cell_size(axes, geometry)
    return axes.plot([], [], '*', color=GOAL, ms=size, mec=INK, mew=0.05 * size, zorder=5)[0]


def _mark(
    axes: Axes, episode: Episode, steps: list[tuple[Step, Grid]], geometry: GridGeometry
) -> None:
    """Mark start, robot and, once it was seen, the goal."""
    start, robot = steps[0][0].position, steps[-1][0].position
    size = 0.4 * _cell_size(axes, geometry)
    axes.plot(*start, 'o', color='white', ms=size, mec=PATH, mew=0.3 * size, zorder=3)
    if episode.goal is not None and steps[-1][0].stamp >= episode.goal_stamp:
        _draw_goal(axes, geometry).set_data(*np.array([episode.goal]).T)
    _draw_robot(axes, geometry).set_data(*np.array([robot]).T)
