"""Worlds of several kinds, and episodes in them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gridnav.actions import valid_moves
from gridnav.grid import GridGeometry
from maze_sim.expert import Expert, cost_to_go
from maze_sim.layouts import draw_caves, draw_obstacles, draw_rooms
from maze_sim.map_file import read_map
from maze_sim.mazes import MIN_SIZE, Maze, lattice_shape, to_shape, wilson_maze

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from maze_sim.mazes import Shape

MAX_WORLDS = 100
"""So many worlds are tried for a start and a goal that are far enough apart."""

MAX_PAIRS = 100
"""So many pairs of start and goal are tried in one world."""

MOST_OPEN = 0.6
"""Up to this share of the walls that separate two free cells is taken away to make loops."""


def draw_loops(shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw a Wilson maze and take some of its walls away.

    Args:
        shape: Rows and columns.
        rng: Source of the draws.

    Returns:
        Walls, (H, W).
    """
    return open_walls(wilson_maze(shape, rng), rng.uniform(0.0, MOST_OPEN), rng)


def open_walls(
    blocked: NDArray[np.bool_], share: float, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Take away a share of the walls between two free cells, which makes loops.

    Args:
        blocked: Walls, (H, W).
        share: Probability of each such wall to go.
        rng: Source of the draws.

    Returns:
        The walls that are left, (H, W).
    """
    to_neighbours = valid_moves(blocked)
    between = blocked & (
        (to_neighbours[0] & to_neighbours[4]) | (to_neighbours[2] & to_neighbours[6])
    )
    left: NDArray[np.bool_] = blocked & ~(between & (rng.random(blocked.shape) < share))
    return left


_DRAW: dict[str, Callable[[Shape, np.random.Generator], NDArray[np.bool_]]] = {
    'maze': wilson_maze,
    'loops': draw_loops,
    'rooms': draw_rooms,
    'caves': draw_caves,
    'obstacles': draw_obstacles,
}

WORLD_KINDS = tuple(_DRAW)
"""The kinds of worlds that can be drawn."""


def draw_world(kind: str, shape: Shape, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw a world of a kind, with parameters of its own.

    Args:
        kind: One of ``WORLD_KINDS``.
        shape: Rows and columns, each at least 5.
        rng: Source of the draws.

    Returns:
        Walls, (H, W).

    Raises:
        ValueError: If there is no such kind or the shape is too small.
    """
    _check(kind, shape)
    return _DRAW[kind](shape, rng)


def sample_episode(
    blocked: NDArray[np.bool_], rng: np.random.Generator, min_expert_steps: int = 15
) -> Maze | None:
    """Draw a start and a goal on a map.

    The pair is uniform over all pairs of free cells with a way between them of at least
    ``min_expert_steps`` expert steps.

    Args:
        blocked: Cells that can't be entered, (H, W).
        rng: Source of the draws.
        min_expert_steps: Moves that the expert needs at least.

    Returns:
        The map with start and goal, or None if no such pair has turned up.
    """
    free = np.argwhere(~blocked)
    if not len(free):
        return None
    expert = Expert(blocked)
    labels = expert.joined()
    sizes = np.bincount(labels.ravel())
    for start_index, goal_index in rng.integers(len(free), size=(MAX_PAIRS, 2)).tolist():
        start = (int(free[start_index, 0]), int(free[start_index, 1]))
        goal = (int(free[goal_index, 0]), int(free[goal_index, 1]))
        label = labels[start]
        if labels[goal] != label or sizes[label] <= min_expert_steps:
            continue
        costs = expert.cost_to_go(goal)
        if costs[start] < min_expert_steps:  # no step is shorter than 1
            continue
        steps = len(expert.actions(start, costs))
        if steps >= min_expert_steps:
            return Maze(blocked, start, goal, steps, float(costs[start]))
    return None


def wall_off(maze: Maze, rng: np.random.Generator) -> Maze:
    """Put a wall around the goal, somewhere between it and the start, so that no way is left.

    Args:
        maze: With at least 3 expert steps between start and goal.
        rng: Source of the draws.

    Raises:
        ValueError: If start and goal are too close for a wall between them.
    """
    # No step changes the distance to the goal by more than √2, so none crosses a belt that wide.
    farthest = maze.expert_cost - math.sqrt(2.0)
    if farthest <= 1.0:
        msg = f'No wall fits between the start {maze.start} and the goal {maze.goal}.'
        raise ValueError(msg)
    distance = rng.uniform(1.0, farthest)
    costs = cost_to_go(maze.blocked, maze.goal)
    belt = (costs >= distance) & (costs <= distance + math.sqrt(2.0))
    return Maze(maze.blocked | belt, maze.start, maze.goal, 0, math.inf)


class Worlds:
    """Draws worlds of a kind, or takes one from a file, and draws starts and goals in them.

    Attributes:
        geometry: Where the worlds lie: at the origin, in cells of 1 m, or as their file says.
    """

    def __init__(
        self,
        size: int | Shape = 15,
        kind: str = 'maze',
        *,
        map_file: str = '',
        min_expert_steps: int = 15,
        reachable: bool = True,
    ) -> None:
        """Choose the worlds.

        Args:
            size: Side of each world in cells, or its rows and columns, each at least 5.
            kind: One of ``WORLD_KINDS``.
            map_file: A map of a map server, instead of a size and a kind; none if empty.
            min_expert_steps: Moves that the expert needs at least.
            reachable: Whether a way leads to the goals. If not, the worlds are the same but for a
                wall between start and goal.

        Raises:
            ValueError: If an argument is out of range or the file can't be used.
        """
        self._kind = kind
        self._min_expert_steps = min_expert_steps
        self._reachable = reachable
        self._map: NDArray[np.bool_] | None = None
        if map_file:
            self._map, self.geometry = read_map(map_file)
            self._name = f'map {map_file}'
            return
        rows, cols = to_shape(size)
        _check(kind, (rows, cols))
        self.geometry = GridGeometry(rows, cols, 1.0)
        self._name = f'kind {kind!r} and size {rows} x {cols}'

    @property
    def shape(self) -> Shape:
        """Rows and columns of each world."""
        return self.geometry.shape

    def sample(self, rng: np.random.Generator) -> Maze:
        """Draw a world with a start and a goal.

        The pair is uniform over all pairs of free cells with a way of at least the promised
        length. A world where no such pair turns up is replaced by a new one.

        Args:
            rng: Source of the draws.

        Raises:
            ValueError: If no such pair was found.
        """
        steps = self._min_expert_steps
        for _ in range(MAX_WORLDS if self._possible() else 0):
            blocked = self._map
            if blocked is None:
                blocked = draw_world(self._kind, self.shape, rng)
            maze = sample_episode(blocked, rng, steps)
            if maze is not None:
                return maze if self._reachable else wall_off(maze, rng)
        msg = (
            f'No world of {self._name} was found with {steps} expert steps or more between start '
            'and goal.'
        )
        raise ValueError(msg)

    def _possible(self) -> bool:
        """Tell whether ways can be long enough, as far as that is known at once."""
        if self._map is not None or self._kind != 'maze':
            return True
        # A tree of n lattice cells has no way of more than 2 (n - 1) steps.
        return self._min_expert_steps <= 2 * (math.prod(lattice_shape(self.shape)) - 1)


def sample_maze(
    size: int | Shape, rng: np.random.Generator, min_expert_steps: int = 15, *, kind: str = 'maze'
) -> Maze:
    """Draw a world with a start and a goal; see ``Worlds``.

    Args:
        size: Side of the world in cells, or its rows and columns, each at least 5.
        rng: Source of the draws.
        min_expert_steps: Moves that the expert needs at least.
        kind: One of ``WORLD_KINDS``.

    Raises:
        ValueError: If the size is too small, there is no such kind, or no world of this size and
            kind has such a pair.
    """
    return Worlds(size, kind, min_expert_steps=min_expert_steps).sample(rng)


def make_mazes(
    count: int,
    size: int | Shape,
    seed: int,
    min_expert_steps: int = 15,
    *,
    kind: str = 'maze',
    map_file: str = '',
    reachable: bool = True,
) -> list[Maze]:
    """Draw worlds of one shape, of which number i depends on the seed and i alone.

    Args:
        count: How many.
        size: Side of each world in cells, or its rows and columns, each at least 5.
        seed: Any integer from 0.
        min_expert_steps: Moves that the expert needs at least.
        kind: One of ``WORLD_KINDS``.
        map_file: A map of a map server, instead of a size and a kind; none if empty.
        reachable: Whether a way leads to the goals. If not, the worlds are the same but for a wall
            between start and goal.

    Raises:
        ValueError: If an argument is out of range, the file can't be used, or no world has such a
            pair.
    """
    worlds = Worlds(
        size, kind, map_file=map_file, min_expert_steps=min_expert_steps, reachable=reachable
    )
    return [worlds.sample(np.random.default_rng([seed, index])) for index in range(count)]


def _check(kind: str, shape: Shape) -> None:
    if kind not in _DRAW:
        msg = f'The kind of a world is one of {", ".join(WORLD_KINDS)}, got {kind!r}.'
        raise ValueError(msg)
    if min(shape) < MIN_SIZE:
        msg = f'A world needs sides of at least {MIN_SIZE} cells, got {shape[0]} x {shape[1]}.'
        raise ValueError(msg)
