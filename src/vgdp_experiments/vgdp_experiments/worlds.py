"""The mazes that the networks are trained on: Wilson mazes, many of them with loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gridnav import valid_moves
from maze_sim import Maze, cost_to_go, sample_maze, wilson_maze

if TYPE_CHECKING:
    from numpy.typing import NDArray

LOOPED_SHARE = 0.3
"""Share of the training mazes in which some walls are taken away."""

MOST_OPEN = 0.35
"""Up to this share of the walls that separate two free cells is taken away in a looped maze."""


def training_maze(size: int, rng: np.random.Generator, min_expert_steps: int = 15) -> Maze:
    """Draw a maze for training: a Wilson maze, or one with loops."""
    if rng.random() >= LOOPED_SHARE:
        return sample_maze(size, rng, min_expert_steps)
    while True:
        blocked = open_walls(wilson_maze(size, rng), rng.random() * MOST_OPEN, rng)
        free = np.argwhere(~blocked)
        start, goal = ((int(row), int(col)) for row, col in free[rng.integers(len(free), size=2)])
        # No step is longer than √2, so this is enough to have the steps.
        if (
            np.isfinite(cost := cost_to_go(blocked, goal)[start])
            and cost >= min_expert_steps * 1.5
        ):
            return Maze.solved(blocked, start, goal)


def open_walls(
    blocked: NDArray[np.bool_], share: float, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Take away a share of the walls between two free cells, which makes loops.

    Args:
        blocked: Walls, (H, W).
        share: Probability of each such wall to go.
        rng: Source of the draws.
    """
    to_neighbours = valid_moves(blocked)
    between = blocked & (
        (to_neighbours[0] & to_neighbours[4]) | (to_neighbours[2] & to_neighbours[6])
    )
    return blocked & ~(between & (rng.random(blocked.shape) < share))
