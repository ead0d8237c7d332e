"""Room for a robot on a fine grid, and the shortest way through it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage, sparse

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Cell = tuple[int, int]

TOUCH_TOLERANCE = 1e-6
"""In cells: a robot that just touches an obstacle within this does not collide."""

COMFORT_CELLS = 4.0
"""A way keeps this many cells away from what is not clear, where there is room."""

COMFORT_PRICE = 2.0
"""A step right beside what is not clear costs as much as this many more steps."""


def inflate(obstacle: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Mark the cells whose centre is nearer to an obstacle than a radius.

    The distance is that to the obstacle's square, not to its centre. The disc is put together
    from columns: the vertical reach of each obstacle, moved sideways.

    Args:
        obstacle: (h, w).
        radius: In cells.
    """
    inflated = obstacle.copy()
    radius -= TOUCH_TOLERANCE
    if radius <= 0:
        return inflated
    sideways = np.arange(math.ceil(radius + 0.5))
    gaps = np.maximum(sideways - 0.5, 0.0)
    heights = np.ceil(np.sqrt(radius**2 - gaps**2) + 0.5).astype(int) - 1
    column = obstacle.copy()
    for height in range(int(heights[0]) + 1):
        if height:
            column[height:] |= obstacle[:-height]
            column[:-height] |= obstacle[height:]
        for offset in sideways[heights == height].tolist():
            inflated[:, offset:] |= column[:, : column.shape[1] - offset]
            inflated[:, : column.shape[1] - offset] |= column[:, offset:]
    return inflated


def room_around(clear: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return how far, in cells, each cell is from what is not clear, (h, w); 0 there."""
    if clear.all():
        return np.full(clear.shape, np.inf)
    room: NDArray[np.float64] = ndimage.distance_transform_edt(clear)
    return room


def shortest_way(
    allowed: NDArray[np.bool_], room: NDArray[np.float64], begin: Cell, end: Cell
) -> list[Cell]:
    """Return the cells from one to another, both included, each beside the one before.

    A diagonal step needs both cells beside it. The way keeps away from what is not clear where
    that is no great detour.

    Args:
        allowed: Cells that the way may lead through, (h, w).
        room: Distance of each from what is not clear, in cells, (h, w).
        begin: The first cell (row, col).
        end: The last one.

    Raises:
        ValueError: If no way leads there.
    """
    height, width = allowed.shape
    price = 1.0 + COMFORT_PRICE * np.clip(1 - (room - 1) / COMFORT_CELLS, 0.0, 1.0)
    index = np.arange(allowed.size).reshape(allowed.shape)
    sources, targets, costs = [], [], []
    for row_step, col_step in ((1, 0), (0, 1), (1, 1), (1, -1)):
        here = np.s_[: height - row_step, max(-col_step, 0) : width - max(col_step, 0)]
        there = np.s_[row_step:, max(col_step, 0) : width + min(col_step, 0)]
        free = allowed[here] & allowed[there]
        if row_step and col_step:
            free &= allowed[row_step:, here[1]] & allowed[: height - row_step, there[1]]
        sources.append(index[here][free])
        targets.append(index[there][free])
        length = math.hypot(row_step, col_step)
        costs.append(length * (price[here][free] + price[there][free]) / 2)
    graph = sparse.coo_array(
        (np.concatenate(costs), (np.concatenate(sources), np.concatenate(targets))),
        shape=(allowed.size, allowed.size),
    ).tocsr()
    first, last = (row * width + col for row, col in (begin, end))
    _, before = sparse.csgraph.dijkstra(
        graph, directed=False, indices=first, return_predecessors=True
    )
    if first != last and before[last] < 0:
        msg = f'No way leads from cell {begin} to cell {end}.'
        raise ValueError(msg)
    way = [last]
    while way[-1] != first:
        way.append(int(before[way[-1]]))
    return [divmod(cell, width) for cell in reversed(way)]
