"""Wilson mazes with a start and a goal."""

from __future__ import annotations

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

MAX_MAZES = 100
"""So many mazes are tried for a start and a goal that are far enough apart."""

MAX_PAIRS = 100
"""So many pairs of start and goal are tried in one maze."""

DRAWS = 12
"""A draw of 0 to 11 picks uniformly among 2, 3 or 4 neighbours alike."""


@dataclass(frozen=True, eq=False)
class Maze:
    """A maze with a start, a goal and what the expert needs to get from one to the other.

    Attributes:
        blocked: Walls, (H, W).
        start: Free cell (row, col).
        goal: Free cell (row, col).
        expert_steps: Moves of the expert's way, without Done.
        expert_cost: Length of the expert's way in cells.
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


def wilson_maze(size: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw a maze uniformly from all spanning trees of its lattice (Wilson 1996).

    The lattice cells, (size - 1) // 2 each way, lie at odd rows and columns with one-cell walls
    between and around them. An even size keeps the spare last row and column as wall.

    Args:
        size: Side of the maze in cells, at least 5.
        rng: Source of the draws.

    Returns:
        Walls, (size, size).

    Raises:
        ValueError: If the size is too small.
    """
    side = _lattice_side(size)
    cells, parents = _spanning_tree(side, side, rng)
    row, col = np.divmod(cells, side)
    parent_row, parent_col = np.divmod(parents, side)
    blocked = np.ones((size, size), dtype=np.bool_)
    blocked[1 : 2 * side : 2, 1 : 2 * side : 2] = False
    blocked[1 + row + parent_row, 1 + col + parent_col] = False
    return blocked


def sample_maze(size: int, rng: np.random.Generator, min_expert_steps: int = 15) -> Maze:
    """Draw a Wilson maze with a start and a goal.

    The pair is uniform over all pairs of free cells with at least ``min_expert_steps`` expert
    steps between them. A maze where no such pair turns up is replaced by a new one.

    Args:
        size: Side of the maze in cells, at least 5.
        rng: Source of the draws.
        min_expert_steps: Moves that the expert needs at least.

    Raises:
        ValueError: If the size is too small, or no maze of this size has such a pair.
    """
    # A tree of n lattice cells has no way of more than 2 (n - 1) steps.
    possible = min_expert_steps <= 2 * (_lattice_side(size) ** 2 - 1)
    for _ in range(MAX_MAZES if possible else 0):
        blocked = wilson_maze(size, rng)
        expert = Expert(blocked)
        free = np.argwhere(~blocked)
        for start_index, goal_index in rng.integers(len(free), size=(MAX_PAIRS, 2)).tolist():
            start = (int(free[start_index, 0]), int(free[start_index, 1]))
            goal = (int(free[goal_index, 0]), int(free[goal_index, 1]))
            costs = expert.cost_to_go(goal)
            if costs[start] < min_expert_steps:  # no step is shorter than 1
                continue
            steps = len(expert.actions(start, costs))
            if steps >= min_expert_steps:
                return Maze(blocked, start, goal, steps, float(costs[start]))
    msg = (
        f'No maze of size {size} was found with {min_expert_steps} expert steps or more '
        'between start and goal.'
    )
    raise ValueError(msg)


def make_mazes(count: int, size: int, seed: int, min_expert_steps: int = 15) -> list[Maze]:
    """Draw mazes of which number i depends on the seed and i alone.

    Args:
        count: How many.
        size: Side of each maze in cells, at least 5.
        seed: Any integer from 0.
        min_expert_steps: Moves that the expert needs at least.

    Raises:
        ValueError: If the size is too small, or no maze of this size has such a pair.
    """
    return [
        sample_maze(size, np.random.default_rng([seed, index]), min_expert_steps)
        for index in range(count)
    ]


def _lattice_side(size: int) -> int:
    if size < MIN_SIZE:
        msg = f'A maze needs a size of at least {MIN_SIZE}, got {size}.'
        raise ValueError(msg)
    return (size - 1) // 2


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
