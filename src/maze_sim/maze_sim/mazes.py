"""Wilson mazes with a start and a goal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from maze_sim.expert import Expert, check_free

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

MIN_SIZE = 5
"""The smallest maze has 2 x 2 lattice cells: below that there is nothing to choose."""

Shape = tuple[int, int]

DRAWS = 12
"""A draw of 0 to 11 picks uniformly among 2, 3 or 4 neighbours alike."""


@dataclass(frozen=True, eq=False)
class Maze:
    """A maze with a start, a goal and what the expert needs to get from one to the other.

    Attributes:
        blocked: Walls, (H, W).
        start: Free cell (row, col).
        goal: Free cell (row, col).
        expert_steps: Moves of the expert's way, without Done; 0 if no way leads to the goal.
        expert_cost: Length of the expert's way in cells; inf if no way leads to the goal.
    """

    blocked: NDArray[np.bool_]
    start: tuple[int, int]
    goal: tuple[int, int]
    expert_steps: int
    expert_cost: float

    def __post_init__(self) -> None:
        """Refuse a start or goal that is not a free cell."""
        check_free(self.blocked, self.start, 'start')
        check_free(self.blocked, self.goal, 'goal')

    @classmethod
    def solved(
        cls, blocked: NDArray[np.bool_], start: tuple[int, int], goal: tuple[int, int]
    ) -> Maze:
        """Make a maze of any map: the expert's way is found here.

        Raises:
            ValueError: If start or goal is not a free cell, or no way leads between them.
        """
        expert = Expert(blocked)
        costs = expert.cost_to_go(goal)
        return cls(blocked, start, goal, len(expert.actions(start, costs)), float(costs[start]))

    @property
    def reachable(self) -> bool:
        """Whether a way leads from the start to the goal."""
        return math.isfinite(self.expert_cost)


def wilson_maze(size: int | Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw a maze uniformly from all spanning trees of its lattice (Wilson 1996).

    The lattice cells, (side - 1) // 2 each way, lie at odd rows and columns with one-cell walls
    between and around them. An even side keeps the spare last row or column as wall.

    Args:
        size: Side of the maze in cells, or its rows and columns, each at least 5.
        rng: Source of the draws.

    Returns:
        Walls, (H, W).

    Raises:
        ValueError: If the size is too small.
    """
    shape = to_shape(size)
    return joined_walls(shape, *_spanning_tree(*lattice_shape(shape), rng))


def joined_walls(
    shape: Shape, cells: NDArray[np.integer], others: NDArray[np.integer]
) -> NDArray[np.bool_]:
    """Return the walls around lattice cells of which some are joined.

    Args:
        shape: Rows and columns of the maze, each at least 5.
        cells: Flat indices of lattice cells, (N,).
        others: The neighbour that each of them is joined to, (N,).

    Returns:
        Walls, (H, W).
    """
    rows, cols = lattice_shape(shape)
    row, col = np.divmod(cells, cols)
    other_row, other_col = np.divmod(others, cols)
    blocked = np.ones(shape, dtype=np.bool_)
    blocked[1 : 2 * rows : 2, 1 : 2 * cols : 2] = False
    blocked[1 + row + other_row, 1 + col + other_col] = False
    return blocked


def to_shape(size: int | Shape) -> Shape:
    """Return rows and columns, which are the same if one number is given for both."""
    return (int(size), int(size)) if isinstance(size, int | np.integer) else (size[0], size[1])


def lattice_shape(shape: Shape) -> Shape:
    """Return how many lattice cells a maze has each way.

    Raises:
        ValueError: If a side is too small.
    """
    if min(shape) < MIN_SIZE:
        msg = f'A maze needs a size of at least {MIN_SIZE}, got {min(shape)}.'
        raise ValueError(msg)
    return (shape[0] - 1) // 2, (shape[1] - 1) // 2


def _spanning_tree(
    rows: int, cols: int, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Draw a uniform spanning tree of a lattice by loop-erased random walks.

    Returns:
        Every lattice cell but the root and its parent, both flat indices (rows * cols - 1,).
    """
    neighbours = _neighbour_table(rows, cols)
    count = rows * cols
    draws = _draws(rng, 4 * count)
    root = count // 2
    in_tree = [False] * count
    in_tree[root] = True
    # Where the walk left each cell the last time: following it from the start skips the loops.
    left_to = [root] * count
    for start in range(count):
        cell = start
        while not in_tree[cell]:
            left_to[cell] = neighbours[cell][next(draws)]
            cell = left_to[cell]
        cell = start
        while not in_tree[cell]:
            in_tree[cell] = True
            cell = left_to[cell]
    cells = np.delete(np.arange(count), root)
    return cells, np.array(left_to)[cells]


@lru_cache(maxsize=32)
def _neighbour_table(rows: int, cols: int) -> tuple[tuple[int, ...], ...]:
    """Return, for each lattice cell, its neighbours repeated to the number of draws."""
    table = []
    for row in range(rows):
        for col in range(cols):
            around = ((row - 1, col), (row, col - 1), (row, col + 1), (row + 1, col))
            found = [r * cols + c for r, c in around if 0 <= r < rows and 0 <= c < cols]
            table.append(tuple(found * (DRAWS // len(found))))
    return tuple(table)


def _draws(rng: np.random.Generator, batch: int) -> Iterator[int]:
    """Yield endless draws of 0 to 11, fetched from the generator in batches."""
    batches = iter(lambda: rng.integers(DRAWS, size=batch, dtype=np.uint8).tolist(), None)
    return chain.from_iterable(batches)
