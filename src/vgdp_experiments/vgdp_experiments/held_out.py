"""Worlds from generators that nothing is trained on, to see what carries over to them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from maze_sim import sample_episode
from maze_sim.mazes import joined_walls, lattice_shape, to_shape
from maze_sim.worlds import MAX_WORLDS

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from maze_sim import Maze
    from maze_sim.mazes import Shape

AROUND = ((-1, 0), (0, -1), (0, 1), (1, 0))

MOST_SCATTERED = 0.35
"""Scattered obstacles block up to this share of the cells."""


def growing_tree(shape: Shape, rng: np.random.Generator, *, newest: bool) -> NDArray[np.bool_]:
    """Draw a maze that grows from one cell, by one free neighbour of a cell at a time.

    Args:
        shape: Rows and columns.
        rng: Source of the draws.
        newest: Whether it grows at the newest cell that has room beside it, which makes long
            winding corridors (depth-first search), or at any, which makes many short dead ends
            (after Prim).

    Returns:
        Walls, (H, W).
    """
    rows, cols = lattice_shape(shape)
    blocked = np.ones(shape, dtype=np.bool_)
    first = (int(rng.integers(rows)), int(rng.integers(cols)))
    blocked[2 * first[0] + 1, 2 * first[1] + 1] = False
    growing = [first]
    while growing:
        index = len(growing) - 1 if newest else int(rng.integers(len(growing)))
        row, col = growing[index]
        beside = [
            (row + dr, col + dc)
            for dr, dc in AROUND
            if 0 <= row + dr < rows
            and 0 <= col + dc < cols
            and blocked[2 * (row + dr) + 1, 2 * (col + dc) + 1]
        ]
        if not beside:
            growing.pop(index)
            continue
        to_row, to_col = beside[int(rng.integers(len(beside)))]
        blocked[row + to_row + 1, col + to_col + 1] = False
        blocked[2 * to_row + 1, 2 * to_col + 1] = False
        growing.append((to_row, to_col))
    return blocked


def kruskal(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw a maze by opening walls in random order, where they part what is not joined yet.

    That makes many short dead ends.

    Args:
        shape: Rows and columns.
        rng: Source of the draws.

    Returns:
        Walls, (H, W).
    """
    rows, cols = lattice_shape(shape)
    number = np.arange(rows * cols).reshape(rows, cols)
    one = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    other = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    order = 1.0 + rng.permutation(len(one))
    tree = minimum_spanning_tree(coo_array((order, (one, other)), shape=(rows * cols,) * 2))
    return joined_walls(shape, *tree.nonzero())


def sidewinder(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw a maze of runs along the rows, each joined to the row above at one of its cells.

    That gives one long corridor along a side. Which side it is, is drawn too.

    Args:
        shape: Rows and columns.
        rng: Source of the draws.

    Returns:
        Walls, (H, W).
    """
    turned = bool(rng.integers(2))
    rows, cols = lattice_shape(shape)[:: -1 if turned else 1]
    blocked = np.ones((2 * rows + 1, 2 * cols + 1), dtype=np.bool_)
    blocked[1::2, 1::2] = False
    blocked[1, 1:-1] = False
    for row in range(1, rows):
        ends = np.flatnonzero(np.append(rng.random(cols - 1) < 1 / 2, True))
        for first, last in zip(np.append(0, ends[:-1] + 1), ends, strict=True):
            blocked[2 * row + 1, 2 * first + 1 : 2 * last + 2] = False
            blocked[2 * row, 2 * int(rng.integers(first, last + 1)) + 1] = False
    return _anyhow(blocked.T if turned else blocked, shape, rng)


def binary_tree(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw a maze where each cell is joined to the one above or to the one at its left.

    That gives two long corridors along the sides and ways that lead to their corner. Which corner
    it is, is drawn too.

    Args:
        shape: Rows and columns.
        rng: Source of the draws.

    Returns:
        Walls, (H, W).
    """
    rows, cols = lattice_shape(shape)
    blocked = np.ones((2 * rows + 1, 2 * cols + 1), dtype=np.bool_)
    blocked[1::2, 1::2] = False
    row, col = np.indices((rows, cols)).reshape(2, -1)[:, 1:]
    up = np.where((row > 0) & (col > 0), rng.random(len(row)) < 1 / 2, row > 0)
    blocked[2 * row + 1 - up, 2 * col + up] = False
    return _anyhow(blocked, shape, rng)


def _anyhow(
    blocked: NDArray[np.bool_], shape: Shape, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Mirror a maze by chance and put it into a map, which may have a spare row or column."""
    walls = np.ones(shape, dtype=np.bool_)
    mirrored = blocked[:: 1 - 2 * int(rng.integers(2)), :: 1 - 2 * int(rng.integers(2))]
    walls[: mirrored.shape[0], : mirrored.shape[1]] = mirrored
    return walls


def division(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw a maze by dividing a room with walls of one door each, again and again.

    That makes long straight walls.

    Args:
        shape: Rows and columns.
        rng: Source of the draws.

    Returns:
        Walls, (H, W).
    """
    rows, cols = lattice_shape(shape)
    blocked = np.ones(shape, dtype=np.bool_)
    blocked[1 : 2 * rows, 1 : 2 * cols] = False
    rooms = [(0, rows, 0, cols)]
    while rooms:
        top, bottom, left, right = rooms.pop()
        height, width = bottom - top, right - left
        if min(height, width) < 2:  # noqa: PLR2004 - a corridor
            continue
        if height > width or (height == width and rng.random() < 1 / 2):
            wall = int(rng.integers(top + 1, bottom))
            blocked[2 * wall, 2 * left + 1 : 2 * right] = True
            blocked[2 * wall, 2 * int(rng.integers(left, right)) + 1] = False
            rooms += [(top, wall, left, right), (wall, bottom, left, right)]
        else:
            wall = int(rng.integers(left + 1, right))
            blocked[2 * top + 1 : 2 * bottom, 2 * wall] = True
            blocked[2 * int(rng.integers(top, bottom)) + 1, 2 * wall] = False
            rooms += [(top, bottom, left, wall), (top, bottom, wall, right)]
    return blocked


def scattered(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Block each cell by chance, with one probability for a world, (H, W)."""
    blocked: NDArray[np.bool_] = rng.random(shape) < rng.uniform(0.0, MOST_SCATTERED)
    return blocked


_DRAW: dict[str, Callable[[Shape, np.random.Generator], NDArray[np.bool_]]] = {
    'prim': partial(growing_tree, newest=False),
    'depth_first': partial(growing_tree, newest=True),
    'kruskal': kruskal,
    'sidewinder': sidewinder,
    'binary_tree': binary_tree,
    'division': division,
    'scattered': scattered,
}

HELD_OUT_KINDS = tuple(_DRAW)
"""The kinds that can be drawn here. `maze_sim.WORLD_KINDS`, which are trained on, are others."""


def held_out_maze(kind: str, size: int | Shape, rng: np.random.Generator) -> Maze:
    """Draw a world with a start and a goal that are 15 steps or more apart.

    Args:
        kind: One of `HELD_OUT_KINDS`.
        size: Side of the world in cells, or its rows and columns.
        rng: Source of the draws.

    Raises:
        ValueError: If no world of this size and kind has such a pair.
    """
    for _ in range(MAX_WORLDS):
        maze = sample_episode(_DRAW[kind](to_shape(size), rng), rng)
        if maze is not None:
            return maze
    msg = f'No world of the kind {kind!r} and the size {size} has 15 steps from start to goal.'
    raise ValueError(msg)
