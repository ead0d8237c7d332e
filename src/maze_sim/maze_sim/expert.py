"""The expert who knows the whole maze: shortest ways by path cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from gridnav.actions import NUM_MOVES, STEP_LENGTHS, STEPS, valid_moves

if TYPE_CHECKING:
    from numpy.typing import NDArray

TIE = 1e-9
"""Two ways whose lengths differ by no more than this many cells are equally long.

Lengths are sums a + b·√2, so on any map that fits into memory real differences are far larger and
rounding errors far smaller.
"""


def check_free(blocked: NDArray[np.bool_], cell: tuple[int, int], name: str) -> None:
    """Refuse a cell that is off the map or blocked.

    Args:
        blocked: Cells that can't be entered, (H, W).
        cell: Cell (row, col).
        name: What the cell is, for the message.

    Raises:
        ValueError: If the cell can't be entered.
    """
    row, col = cell
    height, width = blocked.shape
    if not (0 <= row < height and 0 <= col < width):
        msg = f'The {name} {cell} is off the map of {height} x {width} cells.'
        raise ValueError(msg)
    if blocked[row, col]:
        msg = f'The {name} {cell} is not a free cell.'
        raise ValueError(msg)


class Expert:
    """Shortest ways on one map.

    The map is a graph with an edge for every valid step, of length 1 or √2. Between free cells a
    step is valid in both directions or in none, so ways to a goal are searched from the goal; no
    edge leads into a wall.
    """

    def __init__(self, blocked: NDArray[np.bool_]) -> None:
        """Build the graph of the map.

        Args:
            blocked: Cells that can't be entered, (H, W).
        """
        self._blocked = blocked
        height, width = blocked.shape
        self._valid = valid_moves(blocked).reshape(NUM_MOVES, -1).T
        cells, actions = np.nonzero(self._valid)
        self._flat_steps = STEPS[:, 0] * width + STEPS[:, 1]
        targets = cells + self._flat_steps[actions]
        first_edges = np.concatenate(([0], np.cumsum(self._valid.sum(axis=1))))
        # Dijkstra of SciPy 1.13 takes 32-bit indices alone.
        self._graph = csr_array(
            (STEP_LENGTHS[actions], targets.astype(np.int32), first_edges.astype(np.int32)),
            shape=(height * width, height * width),
        )

    def cost_to_go(self, goal: tuple[int, int]) -> NDArray[np.float64]:
        """Return the length of the shortest way from every cell to the goal.

        Args:
            goal: Cell (row, col).

        Returns:
            Lengths in cells, inf where no way leads to the goal, (H, W).

        Raises:
            ValueError: If the goal is not a free cell of the map.
        """
        shape = self._blocked.shape
        check_free(self._blocked, goal, 'goal')
        costs = dijkstra(self._graph, indices=goal[0] * shape[1] + goal[1])
        return np.asarray(costs, dtype=np.float64).reshape(shape)

    def joined(self) -> NDArray[np.int32]:
        """Number the sets of cells that ways join.

        Returns:
            The same number for cells with a way between them, and one of its own for each wall,
            (H, W).
        """
        _, labels = connected_components(self._graph, connection='strong')
        return np.asarray(labels, dtype=np.int32).reshape(self._blocked.shape)

    def actions(self, start: tuple[int, int], costs: NDArray[np.float64]) -> list[int]:
        """Follow the costs down from the start to the goal that they lead to.

        Of equally good steps the one with the lowest index is taken.

        Args:
            start: Cell (row, col).
            costs: What ``cost_to_go`` returned, (H, W).

        Returns:
            The moves, without Done.

        Raises:
            ValueError: If the start is not a free cell from which the goal can be reached.
        """
        check_free(self._blocked, start, 'start')
        width = costs.shape[1]
        flat_costs = costs.ravel()
        cell = start[0] * width + start[1]
        if not np.isfinite(flat_costs[cell]):
            msg = f'No way leads from the start {start} to the goal.'
            raise ValueError(msg)
        taken = []
        while flat_costs[cell] > 0:
            moves = np.flatnonzero(self._valid[cell])
            lengths = STEP_LENGTHS[moves] + flat_costs[cell + self._flat_steps[moves]]
            action = int(moves[np.argmax(lengths <= lengths.min() + TIE)])
            taken.append(action)
            cell += int(self._flat_steps[action])
        return taken


def cost_to_go(blocked: NDArray[np.bool_], goal: tuple[int, int]) -> NDArray[np.float64]:
    """Return the length of the shortest way from every cell to the goal.

    Args:
        blocked: Cells that can't be entered, (H, W).
        goal: Cell (row, col).

    Returns:
        Lengths in cells, inf where no way leads to the goal, (H, W).

    Raises:
        ValueError: If the goal is not a free cell of the map.
    """
    return Expert(blocked).cost_to_go(goal)


def shortest_actions(
    blocked: NDArray[np.bool_], start: tuple[int, int], goal: tuple[int, int]
) -> list[int]:
    """Return the moves of a shortest way from the start to the goal, without Done.

    Of equally good steps the one with the lowest index is taken, so the answer is always the same.

    Args:
        blocked: Cells that can't be entered, (H, W).
        start: Cell (row, col).
        goal: Cell (row, col).

    Raises:
        ValueError: If start or goal is not a free cell of the map, or no way leads between them.
    """
    expert = Expert(blocked)
    return expert.actions(start, expert.cost_to_go(goal))
