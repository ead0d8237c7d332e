"""Rollouts of the explorer that steps greedily on a value function, to learn what they cost.

Until the goal is seen an explorer does not know where it is, so one rollout that looks for
nothing and explores everything tells what every goal would have cost: the way until it is seen,
and on to it. The mean over all goals that were still possible is what the rollout's steps are
labelled with, and it varies much less than the cost of reaching a single goal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from gridnav import DONE, FREE, GOAL, OBSTACLE, STEP_LENGTHS, STEPS, valid_moves
from maze_sim import MazeSimulation, cost_to_go
from vgdp_experiments.map_codes import pack

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from maze_sim import Maze
    from vgdp_planner.value import ValueNetwork

PULL = 1000.0
"""Added to the worth of a cell that the explorer is sent to, whatever it thinks of it."""

LEAST_GOAL_COST = 15.0
"""Goals of the labels lie at least this far from the start, as those of the episodes do."""


@dataclass(frozen=True)
class ExplorationSteps:
    """Steps of explorations.

    Attributes:
        codes: What had been seen, packed, uint8 (N, H, W).
        targets: The unseen cell (row, col) that the explorer was heading to, (N, 2).
        costs: Expected cost that is still to come once the explorer is there, float32 (N,).
        weights: Share of the possible goals that had not been seen, float32 (N,).
    """

    codes: NDArray[np.uint8]
    targets: NDArray[np.int64]
    costs: NDArray[np.float32]
    weights: NDArray[np.float32]


class GreedyExplorer:
    """Steps greedily on a value function in many mazes, solving again only what has changed.

    Args:
        network: The value function.
        shape: (B, H, W).
        rng: Source of the detours; without it there are none. On a detour, which comes once to
            each row, the explorer is sent to a random frontier cell, so that what it would not do
            by itself is tried, too.
    """

    def __init__(
        self,
        network: ValueNetwork,
        shape: tuple[int, int, int],
        rng: np.random.Generator | None = None,
    ) -> None:
        self._network = network
        self._rng = rng
        self._tick = 0
        count, height, width = shape
        self._detour_at = np.full(count, -1)
        if rng is not None:
            self._detour_at = rng.integers(0, 4 * max(height, width), size=count)
        self._pull = np.zeros(shape, dtype=np.float32)
        self._known = np.full(count, -1)
        self.actions_at = np.zeros(shape, dtype=np.int64)
        self.reached = np.zeros(shape, dtype=np.bool_)

    def look(self, maps: NDArray[np.float32], active: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Take in partial maps (B, 3, H, W); returns the active rows that were solved anew.

        Afterwards `actions_at` holds the best action at each cell and `reached` tells where
        anything worth going to is in reach, both (B, H, W).
        """
        unseen = (maps[:, OBSTACLE] == 0) & (maps[:, FREE] == 0)
        self._pull *= unseen
        known = (~unseen).sum(axis=(1, 2)) + maps[:, GOAL].sum(axis=(1, 2), dtype=np.int64)
        stale = active & (known != self._known)
        self._known = known
        for row in np.flatnonzero(active & (self._detour_at == self._tick)):
            choices = np.argwhere(frontier_cells(maps[row, None])[0])
            if self._rng is not None and len(choices):
                self._pull[row][tuple(choices[self._rng.integers(len(choices))])] = PULL
                stale[row] = True
        self._tick += 1
        rows = np.flatnonzero(stale)
        if len(rows):
            with torch.no_grad():
                found = self._network(
                    torch.from_numpy(maps[rows]), torch.from_numpy(self._pull[rows])
                )
            self.actions_at[rows] = found.q_values.argmax(dim=1).numpy()
            self.reached[rows] = found.reached.numpy()
        return rows

    def at(self, cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the best actions at cells (B, 2), and whether anything is in reach there."""
        place = np.arange(len(cells)), cells[:, 0], cells[:, 1]
        return self.actions_at[place], self.reached[place]


def frontier_cells(partial_maps: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return the unseen cells that a step from an observed free cell leads to, (B, H, W).

    Whether the robot can get to those free cells is not looked at.
    """
    obstacle, free = partial_maps[:, OBSTACLE] > 0, partial_maps[:, FREE] > 0
    valid = valid_moves(obstacle) & free[:, None]
    height, width = free.shape[1:]
    entered = np.zeros((len(free), height + 2, width + 2), dtype=np.bool_)
    for action, (dr, dc) in enumerate(STEPS.tolist()):
        entered[:, 1 + dr : 1 + dr + height, 1 + dc : 1 + dc + width] |= valid[:, action]
    return entered[:, 1:-1, 1:-1] & ~obstacle & ~free


def explore(
    mazes: Sequence[Maze], network: ValueNetwork, view_range: int, rng: np.random.Generator
) -> ExplorationSteps:
    """Explore mazes completely and label the steps with what finding a goal costs on average.

    Args:
        mazes: Of one shape. The goals are not used: all cells far enough from the start are.
        network: The explorer steps greedily on its values.
        view_range: Cells that a view reaches to each side.
        rng: Source of the detours.
    """
    count = len(mazes)
    height, width = mazes[0].blocked.shape
    simulation = MazeSimulation(mazes, view_range, max_steps=20 * height * width)
    explorer = GreedyExplorer(network, (count, height, width), rng)
    found_at = np.full((count, height, width), np.inf)
    noted = []
    while simulation.active.any():
        maps = simulation.partial_maps.copy()
        maps[:, GOAL] = 0.0
        _note_found(found_at, maps, simulation)
        rows = explorer.look(maps, simulation.active)
        actions, reached = explorer.at(simulation.cells)
        simulation.give_up(np.flatnonzero(~reached))
        rows = rows[simulation.active[rows]]
        targets, distances = _follow(explorer.actions_at[rows], maps[rows], simulation.cells[rows])
        noted.append((rows, pack(maps[rows]), targets, simulation.path_costs[rows] + distances))
        simulation.step(np.where(simulation.active, actions, DONE))
    costs_from_start = np.stack([cost_to_go(maze.blocked, maze.start) for maze in mazes])
    possible = np.isfinite(found_at) & (costs_from_start >= LEAST_GOAL_COST)
    return _label(noted, found_at, possible)


def _note_found(
    found_at: NDArray[np.float64], maps: NDArray[np.float32], simulation: MazeSimulation
) -> None:
    """Note what it would have cost to reach each cell that is seen for the first time."""
    rows, row, col = np.nonzero((maps[:, FREE] > 0) & np.isinf(found_at))
    apart = np.abs(np.stack([row, col], axis=1) - simulation.cells[rows])
    longer, shorter = apart.max(axis=1), apart.min(axis=1)
    found_at[rows, row, col] = (
        simulation.path_costs[rows] + longer - shorter + shorter * STEP_LENGTHS[1]
    )


def _follow(
    actions_at: NDArray[np.int64], maps: NDArray[np.float32], cells: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Follow the best steps to the first unseen cell; returns it (N, 2) and the cost (N,)."""
    unseen = (maps[:, OBSTACLE] == 0) & (maps[:, FREE] == 0)
    cells = cells.copy()
    cost = np.zeros(len(cells))
    rows = np.arange(len(cells))
    for _ in range(unseen[:1].size):
        going = ~unseen[rows, cells[:, 0], cells[:, 1]]
        if not going.any():
            break
        action = np.where(going, actions_at[rows, cells[:, 0], cells[:, 1]], 0)
        cells += STEPS[action] * going[:, None]
        cost += STEP_LENGTHS[action] * going
    return cells, cost


def _label(
    noted: list[
        tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.int64], NDArray[np.float64]]
    ],
    found_at: NDArray[np.float64],
    possible: NDArray[np.bool_],
) -> ExplorationSteps:
    """Turn what was noted into labelled steps; those with nothing left to find are left out."""
    codes, targets, costs, weights = [], [], [], []
    for rows, code, target, cost_at_target in noted:
        still_open = possible[rows] & (code == 0)
        number = still_open.sum(axis=(1, 2))
        total = np.where(still_open, found_at[rows], 0.0).sum(axis=(1, 2))
        keep = number > 0
        codes.append(code[keep])
        targets.append(target[keep])
        costs.append((total[keep] / number[keep] - cost_at_target[keep]).astype(np.float32))
        shares = number[keep] / possible[rows[keep]].sum(axis=(1, 2))
        weights.append(shares.astype(np.float32))
    return ExplorationSteps(*(np.concatenate(part) for part in (codes, targets, costs, weights)))
