"""Nearest-frontier exploration (Yamauchi 1997): what anyone could use instead of a planner."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from gridnav import DONE, FREE, GOAL, NUM_MOVES, OBSTACLE, STEP_LENGTHS, STEPS, valid_moves

if TYPE_CHECKING:
    from numpy.typing import NDArray

TIE = 1e-9
"""Two ways whose lengths differ by no more than this many cells are equally long."""

NO_TARGET = -1


class NearestFrontier:
    """Goes to the nearest frontier cell until the goal is seen, then to the goal.

    A frontier cell is an observed free cell from which a step leads, as far as the map tells, to
    a cell that has not been seen. The robot walks over observed free cells alone. It keeps its
    target while that is a frontier cell, then takes the next. Of equally near cells it takes the
    first in row order, and of equally short ways always the same, so nothing is random. It stops
    when it can reach neither the goal nor a frontier cell.
    """

    def __init__(self) -> None:
        """Start without episodes."""
        self.settings: dict[str, Any] = {}
        self._targets = np.empty(0, dtype=np.int64)

    def reset(self, episodes: range, seed: int) -> None:  # noqa: ARG002
        """Begin new episodes without targets; nothing is random."""
        self._targets = np.full(len(episodes), NO_TARGET)

    def act(
        self,
        partial_maps: NDArray[np.float32],
        cells: NDArray[np.int64],
        active: NDArray[np.bool_],
    ) -> list[list[int]]:
        """Commit to one step of each way, or to Done on the goal."""
        committed: list[list[int]] = [[] for _ in active]
        rows = np.flatnonzero(active)
        maps = partial_maps[rows] > 0
        width = maps.shape[3]
        steps = _known_steps(maps[:, FREE])
        starts = cells[rows, 0] * width + cells[rows, 1]
        distances = _distances(steps, starts, width)
        targets = self._choose(rows, maps, starts, distances)
        self._targets[rows] = targets
        actions = _first_actions(steps, distances, targets, width)
        for row, target, action in zip(
            rows.tolist(), targets.tolist(), actions.tolist(), strict=True
        ):
            if target != NO_TARGET:
                committed[row] = [action]
        return committed

    def _choose(
        self,
        rows: NDArray[np.int64],
        maps: NDArray[np.bool_],
        starts: NDArray[np.int64],
        distances: NDArray[np.float64],
    ) -> NDArray[np.int64]:
        """Return each robot's target as a flat cell, (N,)."""
        each = np.arange(len(rows))
        wanted = _frontier_cells(maps).reshape(distances.shape)
        # What can be seen from where the robot stands has been seen.
        wanted[each, starts] = False
        wanted &= np.isfinite(distances)
        kept = self._targets[rows]
        keeps = (kept != NO_TARGET) & wanted[each, kept]
        wanted[keeps] = False
        wanted[each[keeps], kept[keeps]] = True
        goals = maps[:, GOAL].reshape(distances.shape) & np.isfinite(distances)
        wanted = np.where(goals.any(axis=1, keepdims=True), goals, wanted)
        costs = np.where(wanted, distances, np.inf)
        nearest = (costs <= costs.min(axis=1, keepdims=True) + TIE).argmax(axis=1)
        return np.where(wanted.any(axis=1), nearest, NO_TARGET)


def _frontier_cells(maps: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which observed free cells have a step into the unseen, (N, H, W)."""
    unseen = ~(maps[:, OBSTACLE] | maps[:, FREE])
    height, width = unseen.shape[1:]
    padded = np.pad(unseen, ((0, 0), (1, 1), (1, 1)))
    leads_to_unseen = np.stack(
        [
            padded[:, 1 + dr : 1 + dr + height, 1 + dc : 1 + dc + width]
            for dr, dc in STEPS.tolist()
        ],
        axis=1,
    )
    steps = valid_moves(maps[:, OBSTACLE]) & leads_to_unseen
    return maps[:, FREE] & steps.any(axis=1)


def _known_steps(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which steps between observed free cells are valid, (N, H * W, 8)."""
    steps = valid_moves(~free) & free[:, None]
    return np.moveaxis(steps, 1, -1).reshape(len(free), -1, NUM_MOVES)


def _distances(
    steps: NDArray[np.bool_], starts: NDArray[np.int64], width: int
) -> NDArray[np.float64]:
    """Return the length of the shortest way from each start to each cell, (N, H * W).

    All maps are parts of one graph that no edge connects, so that one search does for them all.
    """
    count, cells, _ = steps.shape
    nodes = count * cells
    origins, actions = np.nonzero(steps.reshape(nodes, NUM_MOVES))
    graph = csr_array(
        (
            STEP_LENGTHS[actions],
            (origins + _offsets(width)[actions]).astype(np.int32),
            np.concatenate(([0], np.cumsum(steps.reshape(nodes, NUM_MOVES).sum(axis=1)))).astype(
                np.int32
            ),  # Older SciPy searches with such indices alone.
        ),
        shape=(nodes, nodes),
    )
    sources = np.arange(count) * cells + starts
    distances: NDArray[np.float64] = dijkstra(graph, indices=sources, min_only=True)
    return distances.reshape(count, cells)


def _first_actions(
    steps: NDArray[np.bool_],
    distances: NDArray[np.float64],
    targets: NDArray[np.int64],
    width: int,
) -> NDArray[np.int64]:
    """Follow the distances down from the targets and return the last step, turned round, (N,).

    Where the robot is on its target already, that is Done.
    """
    count, cells, _ = steps.shape
    flat_steps = steps.reshape(-1, NUM_MOVES)
    flat_distances = distances.ravel()
    offsets = _offsets(width)
    actions = np.full(count, DONE)
    walking = np.flatnonzero(targets != NO_TARGET)
    at = walking * cells + targets[walking]
    while True:
        on_the_way = flat_distances[at] > 0
        walking, at = walking[on_the_way], at[on_the_way]
        if not len(walking):
            return actions
        lengths = STEP_LENGTHS[:NUM_MOVES] + flat_distances.take(
            at[:, None] + offsets, mode='clip'
        )
        downhill = flat_steps[at] & (lengths <= flat_distances[at, None] + TIE)
        back = downhill.argmax(axis=1)
        # Actions half a turn apart are four indices apart.
        actions[walking] = (back + NUM_MOVES // 2) % NUM_MOVES
        at = at + offsets[back]


def _offsets(width: int) -> NDArray[np.int64]:
    """Return what each step adds to a flat cell, (8,)."""
    return STEPS[:, 0] * width + STEPS[:, 1]
