"""Line of sight in a window around the robot.

A cell is seen when some ray from the robot's cell centre reaches any part of it, its corners
included, without passing through the inside of a wall. Walls are seen too.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from itertools import product
from math import gcd
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

Cell = tuple[int, int]


@dataclass(frozen=True)
class _SightLines:
    """The ways in which each cell of a window can be seen.

    Attributes:
        blockers: The cells of the window that must be free, one row per way, (N, k) flat window
            indices, filled up with the centre, which never blocks.
        first: The first way of each cell of the window, ((2r + 1)²,).
    """

    blockers: NDArray[np.int64]
    first: NDArray[np.int64]


def visible_cells(
    blocked: NDArray[np.bool_], cells: NDArray[np.int64], view_range: int
) -> NDArray[np.bool_]:
    """Tell which cells of the windows around the robots are seen.

    Args:
        blocked: Walls, (B, H, W).
        cells: The robots' cells (row, col) on the map, (B, 2).
        view_range: Cells that a view reaches to each side, r, at least 1.

    Returns:
        Seen cells, (B, 2r + 1, 2r + 1), the robot in the middle. Cells off the map are not seen.

    Raises:
        ValueError: If the view range is below 1.
    """
    _, height, width = blocked.shape
    span = np.arange(-view_range, view_range + 1)
    rows = cells[:, 0, None] + span
    cols = cells[:, 1, None] + span
    row_on_map = (rows >= 0) & (rows < height)
    col_on_map = (cols >= 0) & (cols < width)
    on_map: NDArray[np.bool_] = row_on_map[:, :, None] & col_on_map[:, None, :]
    batch = np.arange(len(cells))
    windows = blocked[
        batch[:, None, None],
        rows.clip(0, height - 1)[:, :, None],
        cols.clip(0, width - 1)[:, None, :],
    ]
    seen = visible_in_windows(windows.reshape(len(cells), -1), view_range)
    return seen.reshape(on_map.shape) & on_map


def visible_in_windows(walls: NDArray[np.bool_], view_range: int) -> NDArray[np.bool_]:
    """Tell which cells are seen from the middle of each window.

    Args:
        walls: Windows of walls, (B, (2r + 1)²). The robot's own cell in the middle never blocks.
        view_range: Cells that a view reaches to each side, r, at least 1.

    Returns:
        Seen cells, (B, (2r + 1)²).

    Raises:
        ValueError: If the view range is below 1.
    """
    lines = _sight_lines(view_range)
    # Cells first: whole rows of the batch are then gathered and combined at once.
    by_cell = walls.T.copy()
    by_cell[len(by_cell) // 2] = False
    shut = by_cell[lines.blockers[:, 0]]
    for blockers in lines.blockers.T[1:]:
        shut |= by_cell[blockers]
    hidden: NDArray[np.bool_] = np.logical_and.reduceat(shut, lines.first, axis=0)
    return np.ascontiguousarray(~hidden.T)


@cache
def _sight_lines(view_range: int) -> _SightLines:
    """Find every smallest set of cells that must be free for a cell of the window to be seen.

    Rays to the corners of cells are enough: turn any other ray until it meets a corner, and it
    still touches every cell that it reached and has crossed no others on the way.
    """
    if view_range < 1:
        msg = f'The view range must be at least 1, got {view_range}.'
        raise ValueError(msg)
    corners = range(1, 2 * view_range + 2, 2)
    slopes = {(a // gcd(a, b), b // gcd(a, b)) for a, b in product(corners, corners)}
    ways: defaultdict[Cell, set[frozenset[Cell]]] = defaultdict(set)
    for slope in slopes:
        for cell, crossed in _trace(slope, view_range):
            for up, right in product((1, -1), (1, -1)):
                mirrored = frozenset((up * row, right * col) for row, col in crossed)
                ways[up * cell[0], right * cell[1]].add(mirrored)

    side = 2 * view_range + 1
    span = range(-view_range, view_range + 1)
    smallest = [_smallest(ways[cell]) for cell in product(span, span)]
    depth = max(1, *(len(way) for cell_ways in smallest for way in cell_ways))
    center = (side * side) // 2
    blockers = [
        [row * side + col + center for row, col in way] + [center] * (depth - len(way))
        for cell_ways in smallest
        for way in cell_ways
    ]
    counts = [len(cell_ways) for cell_ways in smallest]
    return _SightLines(np.array(blockers), np.cumsum([0, *counts[:-1]]))


def _trace(slope: tuple[int, int], view_range: int) -> list[tuple[Cell, frozenset[Cell]]]:
    """Follow the ray of a slope (rows, cols), both positive, until it leaves the window.

    Returns:
        The cells that it touches, each with the cells it crossed before, without the robot's own.
    """
    rise, run = slope
    row = col = 0
    crossed: frozenset[Cell] = frozenset()
    touched = [((0, 0), crossed)]
    while row <= view_range and col <= view_range:
        # The ray leaves the cell at its upper edge after (2 row + 1) / rise, at its right edge
        # after (2 col + 1) / run; at the same time means through the corner.
        to_edge = (2 * row + 1) * run
        to_side = (2 * col + 1) * rise
        if to_edge == to_side:
            touched += [((row + 1, col), crossed), ((row, col + 1), crossed)]
        row, col = row + (to_edge <= to_side), col + (to_side <= to_edge)
        touched.append(((row, col), crossed))
        crossed |= {(row, col)}
    return [(cell, before) for cell, before in touched if max(cell) <= view_range]


def _smallest(ways: set[frozenset[Cell]]) -> list[list[Cell]]:
    """Return the sets that contain no other one, in a fixed order."""
    kept = [way for way in ways if not any(other < way for other in ways)]
    return sorted(sorted(way) for way in kept)
