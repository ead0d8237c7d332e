"""Where a robot can stand in a home, and the true plan, both from what rays meet."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from avd_player.homes.home import FREE, OCCUPIED, OUTSIDE, TruePlan
from avd_player.homes.rays import NOTHING
from gridnav.actions import NUM_MOVES, STEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avd_player.homes.rays import Caster

STEP = 0.30
"""Positions lie at multiples of this, in metres."""

ROBOT_RADIUS = 0.20
"""Metres."""

ROBOT_HEIGHT = 1.5
"""What is higher is not in the robot's way, metres."""

LOWEST = 0.05
"""What is lower is not in the robot's way, metres."""

RESOLUTION = 0.05
"""Side of the cells of the true plan, metres."""

FINE = 3
"""Free space is looked at in cells this much smaller."""

FULL = 0.3
"""A cell of the plan is occupied where this share of it is."""


class FreeSpace(NamedTuple):
    """Where a robot can stand.

    Attributes:
        plan: What is where.
        positions: Where it can stand, x and y in metres, (P, 2).
        moves: Position that each of the eight steps leads to, -1 for none, (P, 8).
    """

    plan: TruePlan
    positions: NDArray[np.float64]
    moves: NDArray[np.int64]


def find_free_space(
    caster: Caster,
    origin: tuple[float, float],
    shape: tuple[int, int],
    outline: tuple[float, float, float, float],
) -> FreeSpace:
    """Find where a robot can stand.

    Args:
        caster: Casts rays at the home.
        origin: South-western corner of the plan, multiples of `STEP`.
        shape: Rows and columns of the plan.
        outline: West, south, east and north of the building, metres.
    """
    step = RESOLUTION / FINE
    rows, columns = shape
    x = origin[0] + (np.arange(columns * FINE) + 0.5) * step
    y = origin[1] + (np.arange(rows * FINE) + 0.5) * step
    rays = np.zeros((len(y), len(x), 6), np.float32)
    rays[..., 0], rays[..., 1], rays[..., 2] = x[None], y[:, None], ROBOT_HEIGHT
    rays[..., 5] = 1.0
    above = caster.cast(rays)
    rays[..., 5] = -1.0
    hit = caster.cast(rays)
    # What is met from behind is the inside of something, and nothing at all that of a wall. A look
    # down alone would miss what stands on the floor, as it may meet the floor instead of its base.
    inside = (hit['primitive_ids'] == NOTHING) | (hit['primitive_normals'][..., 2] <= 0)
    inside |= (above['primitive_ids'] != NOTHING) & (above['primitive_normals'][..., 2] > 0)
    taken = inside | (hit['t_hit'] < ROBOT_HEIGHT - LOWEST)
    share = taken.reshape(rows, FINE, columns, FINE).mean((1, 3))
    cells = np.where(share > FULL, OCCUPIED, FREE).astype(np.uint8)
    west, south, east, north = outline
    middle_x, middle_y = x[FINE // 2 :: FINE], y[FINE // 2 :: FINE]
    cells[:, (middle_x < west) | (middle_x > east)] = OUTSIDE
    cells[(middle_y < south) | (middle_y > north)] = OUTSIDE
    plan = TruePlan(cells, origin[0], origin[1], RESOLUTION)
    return FreeSpace(plan, *_positions(taken, origin, step))


def _positions(
    taken: NDArray[np.bool_], origin: tuple[float, float], step: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the largest set of positions that moves join, and the moves."""
    clear = ndimage.distance_transform_edt(~taken) * step
    spacing = round(STEP / step)

    def clearance(rows: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance from corners of cells to the nearest taken one."""
        row = rows.round().astype(int).clip(1, taken.shape[0] - 1)
        column = columns.round().astype(int).clip(1, taken.shape[1] - 1)
        around = [clear[row - a, column - b] for a in (0, 1) for b in (0, 1)]
        nearest: NDArray[np.float64] = np.minimum.reduce(around)
        return nearest

    columns, rows = np.meshgrid(
        np.arange(0.0, taken.shape[1], spacing), np.arange(0.0, taken.shape[0], spacing)
    )
    free = clearance(rows, columns) >= ROBOT_RADIUS
    padded = np.pad(free, 1)
    height, width = free.shape

    def shifted(up: int, right: int) -> NDArray[np.bool_]:
        return padded[1 + up : 1 + up + height, 1 + right : 1 + right + width]

    ways = np.zeros((*free.shape, NUM_MOVES), np.bool_)
    for action, (up, right) in enumerate(STEPS.tolist()):
        way = free & shifted(up, right)
        if up and right:
            way &= shifted(up, 0) | shifted(0, right)
        for part in (0.25, 0.5, 0.75):
            between = clearance(rows + up * spacing * part, columns + right * spacing * part)
            way &= between >= ROBOT_RADIUS - step
        ways[..., action] = way

    start, moved = np.nonzero(ways.reshape(-1, NUM_MOVES))
    end = start + STEPS[moved, 0] * width + STEPS[moved, 1]
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(free.size, free.size))
    _, group = connected_components(graph, directed=False)
    counts = np.bincount(group[free.ravel()], minlength=1)
    kept = np.flatnonzero(free.ravel() & (group == counts.argmax()))
    number = np.full(free.size, -1)
    number[kept] = np.arange(len(kept))
    moves = np.full((free.size, NUM_MOVES), -1)
    moves[start, moved] = number[end]
    x = origin[0] + columns.ravel()[kept] * step
    y = origin[1] + rows.ravel()[kept] * step
    return np.stack([x, y], 1).round(6), moves[kept]
