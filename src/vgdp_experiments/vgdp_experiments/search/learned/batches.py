"""Draws batches of demonstrations of homes: maps, views, what the expert did, what it would cost.

Letters in shapes: B decisions, V views of a position, T steps of a plan, U unseen cells, S
positions on the way to a decision, the last one first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.spatial import cKDTree

from avd_player.avd_format import GRID_M
from gridnav import DONE, FREE, NUM_MOVES, OBSTACLE, STEP_LENGTHS, STEPS, valid_moves
from vgdp_experiments.map_codes import unpack
from vgdp_experiments.rollouts import frontier_cells
from vgdp_planner.best_ways import UNREACHED, best_way_values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from torch import Tensor

    from vgdp_experiments.search.learned.demonstrations import HomeDemonstrations

OTHER_SHARE = 0.5
"""So often a decision is taken to be of a search for another thing that has not been seen."""

TURNS = 8
"""Symmetries of the grid."""

ROWS, COLS = -2, -1
"""Axes of maps."""


@dataclass(frozen=True)
class Decision:
    """What a decision is taken to be of.

    Attributes:
        home: Number of the home.
        index: Number of the decision in it.
        thing: What is looked for.
    """

    home: int
    index: int
    thing: int


@dataclass(frozen=True)
class Batch:
    """Decisions ready for training.

    Attributes:
        maps: Partial maps, float32 (B, 3, H, W). Smaller ones are extended by unseen cells.
        origins: x and y of their lower left corners in metres, float64 (B, 2).
        cells: Where the robot is and where it was before, in the map of now, int64 (B, S, 2).
        actions: What the expert does there, int64 (B, S).
        weights: 1 for each of the way's positions that there is and that is on the map, (B, S).
        plans: What the expert does from now on, int64 (B, T).
    """

    maps: NDArray[np.float32]
    origins: NDArray[np.float64]
    cells: NDArray[np.int64]
    actions: NDArray[np.int64]
    weights: NDArray[np.float32]
    plans: NDArray[np.int64]

    def __len__(self) -> int:
        """Return how many decisions there are."""
        return len(self.maps)


@dataclass(frozen=True)
class Looks:
    """What looking at unseen cells costs, and what the expert has to go after that.

    Attributes:
        cells: Cells, int64 (B, U, 2).
        distances: Of the ways there over free cells, in cells; infinite where there is no more
            cell, float32 (B, U).
        costs: Of the expert's way from there, in cells, to each thing that has not been seen;
            infinite where there is no more thing, float32 (B, K, U).
    """

    cells: NDArray[np.int64]
    distances: NDArray[np.float32]
    costs: NDArray[np.float32]


class HomeBatches:
    """Draws from the demonstrations of some homes, each home as often as any other."""

    def __init__(self, homes: Sequence[HomeDemonstrations]) -> None:
        self.homes = list(homes)
        self._places = [cKDTree(home.positions) for home in homes]
        self._all = [np.arange(len(home)) for home in homes]
        self._unseen = [
            np.array([i for i in range(len(home)) if home.thing[i] in home.open_things(i)])
            for home in homes
        ]

    def draw(
        self, count: int, rng: np.random.Generator, *, unseen_only: bool = False
    ) -> list[Decision]:
        """Draw decisions.

        Args:
            count: How many.
            rng: Draws.
            unseen_only: Whether only such decisions are drawn where the thing has not been seen.

        Raises:
            ValueError: If there are no such decisions.
        """
        candidates = self._unseen if unseen_only else self._all
        numbers = [number for number, indices in enumerate(candidates) if len(indices)]
        if not numbers:
            msg = 'In these demonstrations the thing is seen from the start.'
            raise ValueError(msg)
        drawn: list[Decision] = []
        for _ in range(count):
            number = int(rng.choice(numbers))
            drawn.append(self._decision(number, int(rng.choice(candidates[number])), rng))
        return drawn

    def draw_way(self, count: int, rng: np.random.Generator) -> list[Decision]:
        """Draw decisions of one search, which went through the same positions, in order."""
        number = int(rng.integers(len(self.homes)))
        home = self.homes[number]
        episode = int(rng.choice(home.episodes))
        of_episode = np.flatnonzero(home.episodes == episode)
        chosen = np.sort(rng.choice(of_episode, count, replace=len(of_episode) < count))
        thing = int(home.thing[chosen[0]])
        return [Decision(number, int(index), thing) for index in chosen]

    def _decision(self, number: int, index: int, rng: np.random.Generator) -> Decision:
        home = self.homes[number]
        thing = int(home.thing[index])
        hidden = home.open_things(index)
        if thing in hidden and rng.random() < OTHER_SHARE:
            thing = int(rng.choice(hidden))
        return Decision(number, index, thing)

    def take(self, decisions: Sequence[Decision], horizon: int = 1, past: int = 0) -> Batch:
        """Put decisions together.

        Args:
            decisions: Which ones.
            horizon: Steps of the plans.
            past: Earlier decisions of the same search that come with each.
        """
        sizes = np.array([self.homes[d.home].sizes[d.index] for d in decisions])
        codes = np.zeros((len(decisions), *sizes.max(axis=0)), dtype=np.uint8)
        cells = np.zeros((len(decisions), past + 1, 2), dtype=np.int64)
        actions = np.full((len(decisions), past + 1), DONE)
        weights = np.zeros((len(decisions), past + 1), dtype=np.float32)
        plans = np.zeros((len(decisions), horizon), dtype=np.int64)
        origins = np.stack([self.homes[d.home].origins[d.index] for d in decisions])
        for row, (decision, size) in enumerate(zip(decisions, sizes, strict=True)):
            home = self.homes[decision.home]
            codes[row, : size[0], : size[1]] = home.codes[decision.index, : size[0], : size[1]]
            seen = self.is_seen(decision)
            before = range(decision.index, max(decision.index - past, 0) - 1, -1)
            for place, index in enumerate(before):
                if home.episodes[index] != home.episodes[decision.index]:
                    break
                at = int(home.at[index])
                cell = cell_of(home.positions[at], origins[row])
                plan = home.plan(decision.thing, at, horizon, seen=seen)
                if place == 0:
                    plans[row] = plan
                if (cell >= 0).all() and (cell < size).all():
                    cells[row, place], actions[row, place] = cell, plan[0]
                    weights[row, place] = 1.0
        return Batch(unpack(codes), origins, cells, actions, weights, plans)

    def is_seen(self, decision: Decision) -> bool:
        """Tell whether the robot has seen the thing by then."""
        home = self.homes[decision.home]
        return bool((home.sees[decision.thing] & home.visited[decision.index]).any())

    def looks(self, decisions: Sequence[Decision], batch: Batch) -> Looks:
        """Return what looking at the unseen cells that can be walked to costs and brings.

        What the expert has to go is counted from the position nearest to the cell, and the way
        between the two there and back.
        """
        found = []
        for row, decision in enumerate(decisions):
            home = self.homes[decision.home]
            cells, distances = _ways_to_unseen(batch.maps[row], batch.cells[row, 0])
            middles = batch.origins[row] + (cells[:, ::-1] + 0.5) * GRID_M
            apart, nearest = self._places[decision.home].query(middles)
            hidden = home.open_things(decision.index)
            costs = home.first[hidden][:, nearest] + 2 * apart / GRID_M
            # Things may be out of reach from somewhere, but no robot gets there.
            kept = np.isfinite(costs).all(axis=0)
            found.append((cells[kept], distances[kept], costs[:, kept]))
        things = max((len(costs) for _, _, costs in found), default=0)
        most = max((len(cells) for cells, _, _ in found), default=0)
        looks = Looks(
            np.zeros((len(found), most, 2), dtype=np.int64),
            np.full((len(found), most), np.inf, dtype=np.float32),
            np.full((len(found), things, most), np.inf, dtype=np.float32),
        )
        for row, (cells, distances, costs) in enumerate(found):
            looks.cells[row, : len(cells)] = cells
            looks.distances[row, : len(cells)] = distances
            looks.costs[row, : len(costs), : len(cells)] = costs
        return looks


def cell_of(position: NDArray[np.float64], origin: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the cell (row, col) of a place (x, y) in the map with this corner, (2,)."""
    cell: NDArray[np.int64] = np.floor((position - origin)[::-1] / GRID_M).astype(np.int64)
    return cell


def _ways_to_unseen(
    partial_map: NDArray[np.float32], start: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the unseen cells beside free cells in reach (U, 2), and how far they are (U,)."""
    obstacle, free = partial_map[OBSTACLE] > 0, partial_map[FREE] > 0
    beginning = np.full(free.shape, UNREACHED)
    beginning[tuple(start)] = 0.0
    lengths = STEP_LENGTHS[:NUM_MOVES]
    valid = valid_moves(obstacle)
    costs = np.where(valid, lengths[:, None, None], np.inf)
    # The way back is as long as the way there.
    values = best_way_values(beginning[None], (free & (beginning < 0))[None], costs[None], STEPS)[
        0
    ]
    cells = np.argwhere(frontier_cells(partial_map[None])[0])
    framed = np.pad(values, 1, constant_values=UNREACHED)
    around = cells[:, None] + STEPS + 1
    ahead = framed[around[..., 0], around[..., 1]] - lengths
    ahead[~valid[:, cells[:, 0], cells[:, 1]].T] = UNREACHED
    best = ahead.max(axis=1, initial=UNREACHED)
    kept = best > UNREACHED / 2
    return cells[kept], -best[kept].astype(np.float32)


class Turn:
    """One of the eight symmetries of the grid, for maps, cells and actions alike.

    Args:
        number: Which, from 0 to 7; 0 leaves all as it is.
    """

    def __init__(self, number: int) -> None:
        self._swap, *flips = (bool(number & bit) for bit in (4, 2, 1))
        self._axes = [axis for axis, flip in zip((ROWS, COLS), flips, strict=True) if flip]
        signs = np.where(flips, -1, 1)
        turned = (STEPS[:, ::-1] if self._swap else STEPS) * signs
        same = (turned[:, None] == STEPS).all(axis=2)
        self._actions = torch.from_numpy(np.append(same.argmax(axis=1), DONE))

    def maps(self, maps: Tensor) -> Tensor:
        """Turn maps (..., H, W)."""
        return (maps.transpose(-1, -2) if self._swap else maps).flip(self._axes)

    def cells(self, cells: Tensor, shape: tuple[int, int]) -> Tensor:
        """Turn cells (..., 2) of maps that had this shape before they were turned."""
        if self._swap:
            cells, shape = cells.flip(-1), shape[::-1]
        turned = cells.clone()
        for axis in self._axes:
            turned[..., axis] = shape[axis] - 1 - cells[..., axis]
        return turned

    def actions(self, actions: Tensor) -> Tensor:
        """Turn actions of any shape."""
        return self._actions[actions]

    def bearings(self, bearings: Tensor) -> Tensor:
        """Turn directions, in radians from the columns' axis to the rows', of any shape."""
        if self._swap:
            bearings = math.pi / 2 - bearings
        if ROWS in self._axes:
            bearings = -bearings
        if COLS in self._axes:
            bearings = math.pi - bearings
        return bearings
