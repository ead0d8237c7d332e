"""Walls that are no mazes: rooms, caves and obstacle fields.

Each function draws its own parameters widely, so that the worlds of one kind have little in common
but the kind. Sizes of rooms and obstacles are in cells and don't grow with the map.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gridnav.actions import NUM_MOVES, STEPS
from maze_sim.expert import Expert

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

Shape = tuple[int, int]

COARSE_SIDE = 30
"""Caves on smaller maps are not drawn from coarse noise: little but one cavern would be left."""

MOST_IN_SQUARE = 4
"""A cell with more walls than these in the 3 x 3 cells around it becomes one."""

SMALLEST_CAVERN = 6
"""Caverns of fewer cells are not worth a tunnel."""

TUNNEL_STARTS = 10
"""So many cells of a cavern are looked at for a short tunnel."""

LEAST_JOINED = 0.25
"""Share of the map that must be free and joined in a cave or an obstacle field."""

TRIES = 20
"""So many caves or obstacle fields are drawn for one that is joined well enough."""

SPLIT_SHARE = 0.6
"""Share of the worlds with rooms that are split by walls; the others are dug into rock."""


def draw_rooms(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw rooms with walls of one cell and doors of one or two, all of them connected.

    Some have corridors, more than one way from room to room, or things standing in them.

    Args:
        shape: Rows and columns.
        rng: Source of the draws.

    Returns:
        Walls, (H, W), with the outer cells among them.
    """
    rooms = _split_rooms if _chance(rng, SPLIT_SHARE) else _dug_rooms
    blocked = rooms(shape, rng)
    if _chance(rng, 0.6):
        _furnish(blocked, rng.uniform(0.0, 0.25), rng)
    return blocked


def draw_caves(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw caves: noise that a cellular automaton smooths.

    Args:
        shape: Rows and columns.
        rng: Source of the draws.

    Returns:
        Walls, (H, W). Some have caverns that no way leads to.
    """
    return _best_joined(_noise_caves, shape, rng)


def draw_obstacles(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw a field of points, boxes, discs and bars, in a random mix and density.

    Args:
        shape: Rows and columns.
        rng: Source of the draws.

    Returns:
        Walls, (H, W), in half of the fields with the outer cells among them.
    """
    return _best_joined(_scattered, shape, rng)


def _largest(blocked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which cells belong to the largest set of free cells that ways join, (H, W)."""
    labels = Expert(blocked).joined()
    sizes = np.bincount(labels[~blocked], minlength=1)
    largest: NDArray[np.bool_] = ~blocked & (labels == sizes.argmax())
    return largest


def _best_joined(
    draw: Callable[[Shape, np.random.Generator], NDArray[np.bool_]],
    shape: Shape,
    rng: np.random.Generator,
) -> NDArray[np.bool_]:
    """Draw until enough of the map is joined, or take the best of the tries."""
    best, most = np.ones(shape, dtype=np.bool_), -1.0
    for _ in range(TRIES):
        blocked = draw(shape, rng)
        joined = _largest(blocked).mean()
        if joined > most:
            best, most = blocked, joined
        if joined >= LEAST_JOINED:
            break
    return best


def _chance(rng: np.random.Generator, probability: float) -> bool:
    return rng.random() < probability


def _walled(shape: Shape) -> NDArray[np.bool_]:
    """Return an empty map with the outer cells as walls."""
    blocked = np.ones(shape, dtype=np.bool_)
    blocked[1:-1, 1:-1] = False
    return blocked


def _split_rooms(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Split the map by walls with doors, and the parts again, until they are rooms."""
    blocked = _walled(shape)
    smallest = int(rng.integers(2, 6))
    largest = 2 * smallest + int(rng.integers(1, 12))
    corridors = rng.choice([0.0, 0.3])
    more_doors = rng.uniform(0.0, 0.7)
    open_plan = rng.choice([0.0, 0.15])
    parts = [(1, 1, shape[0] - 1, shape[1] - 1)]
    while parts:
        top, left, bottom, right = parts.pop()
        # The wall runs along the shorter side: turn the map so that this is along a row.
        turned = right - left > bottom - top
        walls = blocked.T if turned else blocked
        if turned:
            top, left, bottom, right = left, top, right, bottom
        if bottom - top <= largest and _chance(rng, open_plan):
            continue
        width = int(rng.integers(1, 4)) if _chance(rng, corridors) else 0
        thickness = width + 2 if width else 1
        # A wall must not end in a door.
        at = np.arange(top + smallest, bottom - smallest - thickness + 1)
        for row in {0, thickness - 1}:
            at = at[walls[at + row, left - 1] & walls[at + row, right]]
        if not len(at):
            continue
        first = int(rng.choice(at))
        last = first + thickness - 1
        for row in {first, last}:
            walls[row, left:right] = True
            _open_doors(walls[row, left:right], more_doors, rng)
        halves = (top, left, first, right), (last + 1, left, bottom, right)
        parts += [(part[1], part[0], part[3], part[2]) if turned else part for part in halves]
    return blocked


def _open_doors(wall: NDArray[np.bool_], more: float, rng: np.random.Generator) -> None:
    """Open a door in a wall, and perhaps some more where it is long."""
    for _ in range(1 + rng.binomial(1 + len(wall) // 12, more)):
        width = min(int(rng.integers(1, 3)), len(wall))
        at = int(rng.integers(0, len(wall) - width + 1))
        wall[at : at + width] = False


def _dug_rooms(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Dig rooms into rock and join each to one of those before it by a corridor."""
    height, width = shape
    blocked = np.ones(shape, dtype=np.bool_)
    most = int(rng.integers(3, 16))
    more_ways = rng.uniform(0.0, 0.5)
    centers: list[tuple[int, int]] = []
    tries = 5 + int(rng.uniform(0.5, 3.0) * height * width / (most / 2 + 1) ** 2)
    for _ in range(tries):
        rows, cols = (
            int(rng.integers(2, max(3, min(most, side // 2) + 1))) for side in (height, width)
        )
        if rows > height - 2 or cols > width - 2:
            continue
        top = int(rng.integers(1, height - rows))
        left = int(rng.integers(1, width - cols))
        if not blocked[top - 1 : top + rows + 1, left - 1 : left + cols + 1].all():
            continue
        blocked[top : top + rows, left : left + cols] = False
        center = top + rows // 2, left + cols // 2
        if centers:
            apart = np.abs(np.array(centers) - center).sum(axis=1)
            nearest = np.argsort(apart, kind='stable')
            for other in nearest[: 1 + _chance(rng, more_ways)].tolist():
                _dig(blocked, center, centers[other], rng, straight=True)
        centers.append(center)
    return blocked


def _dig(
    blocked: NDArray[np.bool_],
    start: tuple[int, int],
    end: tuple[int, int],
    rng: np.random.Generator,
    *,
    straight: bool,
) -> None:
    """Free a way from cell to cell, around one corner or in steps at random."""
    rows, cols = end[0] - start[0], end[1] - start[1]
    along_rows = np.arange(abs(rows) + abs(cols)) < abs(rows)
    if not straight:
        along_rows = rng.permutation(along_rows)
    elif _chance(rng, 0.5):
        along_rows = along_rows[::-1]
    row = start[0] + np.sign(rows) * np.cumsum(along_rows)
    col = start[1] + np.sign(cols) * np.cumsum(~along_rows)
    blocked[row, col] = False


def _furnish(blocked: NDArray[np.bool_], density: float, rng: np.random.Generator) -> None:
    """Put boxes where they cut off nothing: all free cells stay joined as they were."""
    height, width = blocked.shape
    tries = int(density * (~blocked).sum())
    sizes = rng.integers(1, 4, size=(tries, 2))
    corners = rng.integers(1, (height - 1, width - 1), size=(tries, 2))
    for (rows, cols), (top, left) in zip(sizes.tolist(), corners.tolist(), strict=True):
        bottom, right = top + rows, left + cols
        if bottom >= height or right >= width or blocked[top:bottom, left:right].any():
            continue
        around = np.concatenate(
            (
                blocked[top - 1, left - 1 : right],
                blocked[top - 1 : bottom, right],
                blocked[bottom, left : right + 1][::-1],
                blocked[top : bottom + 1, left - 1][::-1],
            )
        )
        # The free cells around the box are one run, so whoever went through it can go around.
        one_run = np.count_nonzero(around & ~np.roll(around, 1)) <= 1
        if one_run and not around.all():
            blocked[top:bottom, left:right] = True


def _noise_caves(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    height, width = shape
    # Noise that is coarser than a cell gives wider caves.
    grain = int(rng.integers(1, 4)) if min(shape) >= COARSE_SIDE else 1
    noise = rng.random((-(-height // grain), -(-width // grain))) < rng.uniform(0.38, 0.52)
    blocked = noise.repeat(grain, axis=0).repeat(grain, axis=1)[:height, :width]
    # Pillars in wide open space break it up; later rounds round them off.
    pillars = int(rng.choice([0, 0, 1, 2]))
    for round_ in range(int(rng.integers(2, 6))):
        blocked = _neighbourhood(blocked, 1) > MOST_IN_SQUARE
        if round_ < pillars:
            blocked |= _neighbourhood(blocked, 2) <= 1
    blocked[[0, -1]] = blocked[:, [0, -1]] = True
    if _chance(rng, 0.7):
        _join_caverns(blocked, rng)
    return blocked


def _neighbourhood(blocked: NDArray[np.bool_], reach: int) -> NDArray[np.int64]:
    """Return how many walls lie in the square around each cell; off the map is wall."""
    side = 2 * reach + 1
    padded = np.pad(blocked, reach, constant_values=True)
    counts: NDArray[np.int64] = sliding_window_view(padded, (side, side)).sum(axis=(2, 3))
    return counts


def _join_caverns(blocked: NDArray[np.bool_], rng: np.random.Generator) -> None:
    """Dig a tunnel from each cavern to one that is joined already; fill up the smallest."""
    joined = _largest(blocked)
    labels = Expert(blocked).joined()
    for label in np.unique(labels[~blocked & ~joined]):
        cavern = labels == label
        if cavern.sum() < SMALLEST_CAVERN:
            blocked |= cavern
            continue
        starts = rng.choice(np.argwhere(cavern), size=TUNNEL_STARTS)
        ends = np.argwhere(joined)
        apart = ((starts[:, None] - ends) ** 2).sum(axis=2)
        start, end = np.unravel_index(apart.argmin(), apart.shape)
        _dig(blocked, tuple(starts[start]), tuple(ends[end]), rng, straight=False)
        joined |= cavern


def _scattered(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    blocked = _walled(shape) if _chance(rng, 0.5) else np.zeros(shape, dtype=np.bool_)
    allowed = int(blocked.sum() + rng.uniform(0.05, 0.4) * (~blocked).sum())
    # Each kind of obstacle is missing from many fields.
    shares = rng.dirichlet([0.5] * len(OBSTACLES))
    most = int(rng.integers(2, max(3, min(12, min(shape) // 3)) + 1))
    while (missing := allowed - int(blocked.sum())) > 0:
        kind = int(rng.choice(len(OBSTACLES), p=shares))
        # Many at once, but far fewer than there is room for.
        corners = rng.integers(shape, size=(1 + missing // (4 * most**2), 2))
        for corner in corners:
            cells = corner + OBSTACLES[kind](most, rng)
            cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
            blocked[tuple(cells.T)] = True
    return blocked


def _point(most: int, rng: np.random.Generator) -> NDArray[np.int64]:  # noqa: ARG001
    return np.zeros((1, 2), dtype=np.int64)


def _box(most: int, rng: np.random.Generator) -> NDArray[np.int64]:
    return np.argwhere(np.ones(rng.integers(1, most + 1, size=2), dtype=np.bool_))


def _disc(most: int, rng: np.random.Generator) -> NDArray[np.int64]:
    radius = rng.uniform(1.0, max(1.5, most / 2))
    span = np.arange(-int(radius), int(radius) + 1)
    return np.argwhere(span[:, None] ** 2 + span**2 <= radius**2)


def _bar(most: int, rng: np.random.Generator) -> NDArray[np.int64]:
    length = int(rng.integers(2, 2 * most + 1))
    step: NDArray[np.int64] = STEPS[rng.integers(NUM_MOVES)]
    return np.arange(length)[:, None] * step


OBSTACLES = (_point, _box, _disc, _bar)
"""What fields are made of: offsets of the cells (N, 2) by the largest side."""
