"""The expert who knows the whole maze: what no planner can beat."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gridnav import DONE
from maze_sim import shortest_actions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from maze_sim import Maze


class Clairvoyant:
    """Walks the shortest way of the true maze and says Done.

    A reference, not a planner: it is the only method that is built from the mazes.
    """

    def __init__(self, mazes: Sequence[Maze]) -> None:
        """Take the mazes of a trial, in the order of its episodes."""
        self.settings: dict[str, Any] = {}
        self._mazes = mazes
        self._episodes = range(0)

    def reset(self, episodes: range, seed: int) -> None:  # noqa: ARG002
        """Begin new episodes; nothing is random."""
        self._episodes = episodes

    def act(
        self,
        partial_maps: NDArray[np.float32],  # noqa: ARG002
        cells: NDArray[np.int64],
        active: NDArray[np.bool_],
    ) -> list[list[int]]:
        """Commit to the whole rest of the way."""
        committed: list[list[int]] = [[] for _ in active]
        for row in np.flatnonzero(active).tolist():
            maze = self._mazes[self._episodes[row]]
            cell = (int(cells[row, 0]), int(cells[row, 1]))
            committed[row] = [*shortest_actions(maze.blocked, cell, maze.goal), DONE]
        return committed
