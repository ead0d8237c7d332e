"""The worlds that plans are demonstrated in: mazes, and some of all other kinds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from maze_sim import Maze, draw_world, sample_episode

if TYPE_CHECKING:
    import numpy as np

SHARES = {'maze': 0.6, 'loops': 0.16, 'rooms': 0.08, 'caves': 0.08, 'obstacles': 0.08}
"""How often each kind of world comes."""

LEAST_STEPS = {'maze': 15, 'loops': 15, 'rooms': 10, 'caves': 10, 'obstacles': 8}
"""Steps from start to goal at the least: ways are shorter where there are fewer walls."""


def training_maze(size: int, rng: np.random.Generator) -> Maze:
    """Draw a square world for training, with start and goal."""
    kind = str(rng.choice(list(SHARES), p=list(SHARES.values())))
    while True:
        maze = sample_episode(draw_world(kind, (size, size), rng), rng, LEAST_STEPS[kind])
        if maze is not None:
            return maze
