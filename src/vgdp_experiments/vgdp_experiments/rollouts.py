"""Rollouts of the explorer that steps greedily on a value function, to learn what they cost.

Until the goal is seen an explorer does not know where it is, so one rollout that looks for
nothing and explores everything tells what every goal would have cost: the way until it is seen,
and on to it. The steps of the rollout are labelled with a mean over all goals that were still
possible (`labels`), and that varies much less than what reaching a single goal brings.

What decides is not what a choice costs but what it costs beside the others. So some steps are
taken again in another way: the explorer is put back to where it was, with what it knew, and sent
to another frontier. The costs of such siblings differ by the choice alone, in one and the same
world.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from scipy.ndimage import label

from gridnav import DONE, FREE, GOAL, NUM_MOVES, OBSTACLE, STEP_LENGTHS, STEPS, valid_moves
from maze_sim import MazeSimulation, cost_to_go
from vgdp_experiments.labels import Labels
from vgdp_experiments.map_codes import pack, unpack
from vgdp_planner.best_ways import UNREACHED, best_way_values
from vgdp_planner.value import ValueNetwork
from vgdp_planner.weights import load_part

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from maze_sim import Maze

PULL = 1000.0
"""Added to the worth of a cell that the explorer is sent to, whatever it thinks of it."""

LEAST_GOAL_COST = 15.0
"""Goals of the labels lie at least this far from the start, as those of the episodes do."""

CHOICES = 4
"""No more choices of one step are tried than this."""

CHOICE_TEMPERATURE = 3.0
"""Cells by which a choice may look worse and still be tried about a third as often."""

CLOSE_CALL = 12.0
"""Choices that look worse by more cells than this are not tried."""

LATE_SIDES = 10.0
"""What a choice leads to is followed over so many sides of the map. What is found later counts as
found then, for all the choices of a step alike."""

KEPT_SHARE = 0.25
"""Share of the steps that are kept whose choice was not compared with others."""


@dataclass(frozen=True)
class ExplorationSteps:
    """Steps of explorations, each with the choices that were tried there.

    Attributes:
        codes: What had been seen, packed, uint8 (N, H, W).
        targets: The unseen cells (row, col) that the explorer was heading to, (N, K, 2).
        distances: How far they are, float32 (N, K); inf where there is no further choice.
        successes: What the possible goals that had not been seen bring on average once the
            explorer is there, as a share of what they would with nothing to come, float32 (N, K).
        patiences: Cost in cells after which a success counts e times less, float32 (N,).
        weights: What all these goals had left to bring, over the number of goals, float32 (N,).
    """

    codes: NDArray[np.uint8]
    targets: NDArray[np.int64]
    distances: NDArray[np.float32]
    successes: NDArray[np.float32]
    patiences: NDArray[np.float32]
    weights: NDArray[np.float32]

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.codes)

    def take(self, rows: NDArray[np.integer] | NDArray[np.bool_]) -> ExplorationSteps:
        """Return some of the steps."""
        return ExplorationSteps(*(getattr(self, item.name)[rows] for item in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence[ExplorationSteps]) -> ExplorationSteps:
        """Join steps on maps of one shape."""
        return cls(
            *(np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(cls))
        )


class GreedyExplorer:
    """Steps greedily on a value function in many mazes, solving again only what has changed.

    Args:
        network: The value function. Its worth of the unseen counts; what steps cost and where
            they lead is known here.
        shape: (B, H, W).
        pulls: Added to the worth of each cell until it is seen, (B, H, W); none if None.
    """

    def __init__(
        self,
        network: ValueNetwork | None,
        shape: tuple[int, int, int],
        pulls: NDArray[np.float32] | None = None,
    ) -> None:
        self._network = network
        self._pulls = np.zeros(shape, dtype=np.float32) if pulls is None else pulls.copy()
        self._known = np.full(shape[0], -1)
        self.actions_at = np.zeros(shape, dtype=np.int64)
        self.reached = np.zeros(shape, dtype=np.bool_)

    def look(self, maps: NDArray[np.float32], active: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Take in partial maps (B, 3, H, W); returns the active rows that were solved anew.

        Afterwards `actions_at` holds the best action at each cell and `reached` tells where
        anything worth going to is in reach, both (B, H, W).
        """
        unseen = (maps[:, OBSTACLE] == 0) & (maps[:, FREE] == 0)
        self._pulls *= unseen
        known = (~unseen).sum(axis=(1, 2)) + maps[:, GOAL].sum(axis=(1, 2), dtype=np.int64)
        rows = np.flatnonzero(active & (known != self._known))
        self._known = known
        if len(rows):
            worth = worth_of_unseen(self._network, maps[rows]) + self._pulls[rows]
            self.actions_at[rows], self.reached[rows] = best_actions(maps[rows], worth)
        return rows

    def at(self, cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the best actions at cells (B, 2), and whether anything is in reach there."""
        place = np.arange(len(cells)), cells[:, 0], cells[:, 1]
        return self.actions_at[place], self.reached[place]


def load_explorer(folder: str | Path) -> ValueNetwork:
    """Load a value function that a `GreedyExplorer` can step on.

    Raises:
        WeightsError: If the folder holds no value function.
        ValueError: If it is one that has no worth of the unseen, such as the paper's.
    """
    config, tensors = load_part(folder, 'value')
    if config.value.unseen != 'boundary':
        msg = f'The value function in {folder} says nothing of what unseen cells are worth.'
        raise ValueError(msg)
    network = ValueNetwork(config.value)
    network.load_state_dict(tensors)
    return network


@torch.no_grad()
def worth_of_unseen(
    network: ValueNetwork | None, maps: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the network's worth of the unseen cells of maps (B, 3, H, W), (B, H, W).

    From one look at each map, not eight, and in bfloat16, which is exact to about a fifth of a
    cell: explorations are many. Without a network all is worth 0, and what is nearest is best.
    """
    if network is None:
        return np.zeros(maps[:, 0].shape, dtype=np.float32)
    with torch.autocast('cpu', dtype=torch.bfloat16):
        worth, level = network.worth_and_level(torch.from_numpy(maps))
        found: NDArray[np.float32] = (worth + level[:, None, None]).float().numpy()
    return found


def best_actions(
    maps: NDArray[np.float32], worth: NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the best action at each cell and whether anything is in reach there, (B, H, W).

    Args:
        maps: (B, 3, H, W).
        worth: Of the unseen cells, (B, H, W).
    """
    obstacle, free, goal = (maps[:, channel] > 0 for channel in (OBSTACLE, FREE, GOAL))
    seen_goal = goal.any(axis=(1, 2), keepdims=True)
    worth = np.where(seen_goal, np.minimum(worth, 0.0) - 2.0 * maps[0, 0].size, worth)
    boundary = np.where(goal, 0.0, np.where(obstacle | free, UNREACHED, worth))
    lengths = STEP_LENGTHS[:NUM_MOVES, None, None]
    costs = np.where(valid_moves(obstacle), lengths, np.inf)
    values = best_way_values(boundary, free & ~goal, costs, STEPS)
    framed = np.pad(values, ((0, 0), (1, 1), (1, 1)), constant_values=UNREACHED)
    height, width = values.shape[1:]
    ahead = np.stack(
        [framed[:, 1 + dr : 1 + dr + height, 1 + dc : 1 + dc + width] for dr, dc in STEPS.tolist()]
        + [np.where(goal, 0.0, 2 * UNREACHED)],
        axis=1,
    )
    ahead[:, :NUM_MOVES] -= costs
    return ahead.argmax(axis=1), ~obstacle & (values > UNREACHED / 2)


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


@dataclass(frozen=True)
class _Notes:
    """What was noted of an exploration, step by step.

    Attributes:
        rows: Which maze, (N,).
        codes: What was known, (N, H, W).
        cells: Where the explorer was, (N, 2).
        targets: The unseen cells that it was heading to, (N, 2).
        distances: How far they were, (N,).
        spent: What the way there had cost, (N,).
        successes: What the possible goals that had not been seen bring, seen from there, (N,).
        patiences: Cost after which that falls e times, (N,).
        weights: What the goals had left to bring, (N,); 0 leaves a step out.
    """

    rows: NDArray[np.int64]
    codes: NDArray[np.uint8]
    cells: NDArray[np.int64]
    targets: NDArray[np.int64]
    distances: NDArray[np.float64]
    spent: NDArray[np.float64]
    successes: NDArray[np.float64]
    patiences: NDArray[np.float64]
    weights: NDArray[np.float64]

    def as_steps(self, rows: NDArray[np.integer]) -> ExplorationSteps:
        """Return some of the steps with the one choice that was made there."""
        targets = np.zeros((len(rows), CHOICES, 2), dtype=np.int64)
        distances = np.full((len(rows), CHOICES), np.inf, dtype=np.float32)
        successes = np.zeros((len(rows), CHOICES), dtype=np.float32)
        targets[:, 0] = self.targets[rows]
        distances[:, 0] = self.distances[rows]
        patiences = self.patiences[rows]
        successes[:, 0] = self.successes[rows] * np.exp(self.distances[rows] / patiences)
        return ExplorationSteps(
            self.codes[rows],
            targets,
            distances,
            successes,
            patiences.astype(np.float32),
            self.weights[rows].astype(np.float32),
        )


def explore(
    mazes: Sequence[Maze],
    network: ValueNetwork | None,
    view_range: int,
    branches: int,
    rng: np.random.Generator,
    labels: Labels,
) -> ExplorationSteps:
    """Explore mazes completely and label the steps with what finding a goal brings on average.

    Args:
        mazes: Of one shape. The goals are not used: all cells far enough from the start are.
        network: The explorer steps greedily on its values.
        view_range: Cells that a view reaches to each side.
        branches: Steps of each maze where other choices are tried, too.
        rng: Source of the choice of these, and of the steps that are kept.
        labels: What the steps are labelled with.
    """
    ways = _ways(mazes)
    late = LATE_SIDES * max(ways.shape[1:])
    notes = _explore(mazes, ways, network, view_range, labels, late)
    steps = _branches(notes, len(mazes), branches, rng)
    groups = notes.as_steps(steps)
    rows, choices, targets, distances = _other_choices(notes, steps, groups, network, rng)
    parts = [notes.as_steps(_some(notes, rng))]
    # In shares as large as the first, to keep the memory in bounds.
    for begin in range(0, len(rows), len(mazes)):
        part = slice(begin, begin + len(mazes))
        origin = steps[rows[part]]
        again = [
            replace(mazes[notes.rows[step]], start=tuple(notes.cells[step].tolist()))
            for step in origin.tolist()
        ]
        pulls = np.zeros((len(again), *ways.shape[1:]), dtype=np.float32)
        pulls[np.arange(len(again)), targets[part, 0], targets[part, 1]] = PULL
        sibling = _explore(
            again,
            ways[notes.rows[origin]],
            network,
            view_range,
            labels,
            late,
            _Before(notes.codes[origin], notes.spent[origin], pulls),
        )
        # Each row was looked at before its first step.
        first = np.searchsorted(sibling.rows[: len(again)], np.arange(len(again)))
        place = rows[part], choices[part]
        groups.targets[place] = targets[part]
        groups.distances[place] = distances[part]
        groups.successes[place] = sibling.successes[first] * np.exp(
            distances[part] / notes.patiences[origin]
        )
        parts.append(sibling.as_steps(_some(sibling, rng)))
    compared = np.isfinite(groups.distances).sum(axis=1) > 1
    return ExplorationSteps.joined([*parts, groups.take(compared)])


def explored_spl(
    mazes: Sequence[Maze], network: ValueNetwork | None, view_range: int
) -> NDArray[np.float64]:
    """Explore mazes completely; returns the SPL that each goal would have brought, on average.

    Args:
        mazes: B of one shape. All cells far enough from the start are goals.
        network: The explorer steps greedily on its values.
        view_range: Cells that a view reaches to each side.

    Returns:
        The mean over all goals of each maze, (B,).
    """
    notes = _explore(mazes, _ways(mazes), network, view_range, Labels('spl'), np.inf)
    # Each maze was looked at before its first step, when nothing was spent.
    return notes.successes[: len(mazes)]


def _ways(mazes: Sequence[Maze]) -> NDArray[np.float64]:
    """Return the shortest ways from the starts to where a goal may be, inf elsewhere."""
    ways = np.stack([cost_to_go(maze.blocked, maze.start) for maze in mazes])
    ways[ways < LEAST_GOAL_COST] = np.inf
    return ways


def _some(notes: _Notes, rng: np.random.Generator) -> NDArray[np.int64]:
    return np.flatnonzero((notes.weights > 0) & (rng.random(len(notes.rows)) < KEPT_SHARE))


@dataclass(frozen=True)
class _Before:
    """What came before an exploration that goes on from the middle of another one.

    Attributes:
        known: What had been seen, packed, (B, H, W).
        spent: What the way had cost, (B,).
        pulls: Added to the worth of the unseen from there on, (B, H, W).
    """

    known: NDArray[np.uint8]
    spent: NDArray[np.float64]
    pulls: NDArray[np.float32]


def _explore(
    mazes: Sequence[Maze],
    ways: NDArray[np.float64],
    network: ValueNetwork | None,
    view_range: int,
    labels: Labels,
    late: float,
    before: _Before | None = None,
) -> _Notes:
    """Explore mazes: completely, or, what goes on from another exploration, until it is late.

    Args:
        mazes: B of one shape.
        ways: Shortest ways from where all began to where the goal may be, inf elsewhere,
            (B, H, W).
        network: The explorer steps greedily on its values.
        view_range: Cells that a view reaches to each side.
        labels: What the steps are labelled with.
        late: What is found after such a cost, in cells, counts as found then.
        before: What came before.
    """
    count = len(mazes)
    height, width = mazes[0].blocked.shape
    simulation = MazeSimulation(mazes, view_range, max_steps=20 * height * width)
    explorer = GreedyExplorer(network, (count, height, width), before.pulls if before else None)
    known = unpack(before.known) if before else np.zeros((count, 3, height, width), np.float32)
    found_at = np.full((count, height, width), np.inf)
    noted: list[tuple[NDArray[Any], ...]] = []
    while simulation.active.any():
        maps = np.maximum(simulation.partial_maps, known)
        maps[:, GOAL] = 0.0
        _note_found(found_at, maps, simulation)
        rows = explorer.look(maps, simulation.active)
        actions, reached = explorer.at(simulation.cells)
        ended = ~reached | (simulation.path_costs >= late) if before else ~reached
        simulation.give_up(np.flatnonzero(ended))
        if not noted:
            stuck = np.flatnonzero(~simulation.active)
            if len(stuck):
                msg = f'There is nothing to explore from the start of the mazes {stuck.tolist()}.'
                raise ValueError(msg)
        rows = rows[simulation.active[rows]]
        cells = simulation.cells[rows].copy()
        targets, distances = _follow(explorer.actions_at[rows], maps[rows], cells)
        noted.append(
            (rows, pack(maps[rows]), cells, targets, distances, simulation.path_costs[rows])
        )
        simulation.step(np.where(simulation.active, actions, DONE))
    rows, codes, cells, targets, distances, cost = (
        np.concatenate(part) for part in zip(*noted, strict=True)
    )
    if labels.objective == 'expert':
        to_come = _expert_costs([mazes[row] for row in rows], cells, targets, distances)
    else:
        to_come = np.minimum(found_at[rows] - cost[:, None, None], late)
    possible = np.isfinite(ways)
    spent = cost + before.spent[rows] if before else cost
    goals = possible[rows] & (codes == 0)
    successes, patiences, left = labels.of(goals, to_come, spent, ways[rows])
    weights = left / np.maximum(possible.sum(axis=(1, 2))[rows], 1)
    return _Notes(rows, codes, cells, targets, distances, spent, successes, patiences, weights)


def _expert_costs(
    mazes: Sequence[Maze],
    cells: NDArray[np.int64],
    targets: NDArray[np.int64],
    distances: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return what reaching each cell costs one who goes to a target and then knows all, (N, H, W).

    Where the target turns out to be an obstacle, that is seen before the first step.
    """
    costs = np.empty((len(mazes), *mazes[0].blocked.shape))
    for index, maze in enumerate(mazes):
        target = tuple(targets[index].tolist())
        if maze.blocked[target]:
            costs[index] = cost_to_go(maze.blocked, tuple(cells[index].tolist()))
        else:
            costs[index] = distances[index] + cost_to_go(maze.blocked, target)
    return costs


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


def _branches(
    notes: _Notes, mazes: int, branches: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Draw some steps of each maze, those before which much was open more often."""
    # The largest of random numbers raised to 1 / weight are a draw by weight without repetition.
    keys = np.where(notes.weights > 0, np.log(rng.random(len(notes.rows))), -np.inf)
    keys /= np.maximum(notes.weights, 1e-9)
    order = np.lexsort((-keys, notes.rows))
    begins = np.searchsorted(notes.rows[order], np.arange(mazes))
    rank = np.arange(len(order)) - begins[notes.rows[order]]
    return order[(rank < branches) & (notes.weights[order] > 0)]


def _other_choices(
    notes: _Notes,
    steps: NDArray[np.int64],
    groups: ExplorationSteps,
    network: ValueNetwork | None,
    rng: np.random.Generator,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Draw other frontiers that the explorer could have gone to, the better looking more often.

    Returns:
        Row of the group (M,), number of the choice (M,), cell (M, 2) and distance (M,).
    """
    maps = unpack(groups.codes)
    worth = worth_of_unseen(network, maps)
    frontier = frontier_cells(maps)
    distances = _distances(maps, frontier, notes.cells[steps])
    looks = np.where(np.isfinite(distances), worth - distances, -np.inf)
    # Cells that touch belong to one frontier: (map, row, col), never from map to map.
    touching = np.zeros((3, 3, 3), dtype=np.bool_)
    touching[1] = True
    labels, count = label(np.isfinite(looks), structure=touching)
    where = np.flatnonzero(labels)
    ranked = where[np.lexsort((-looks.ravel()[where], labels.ravel()[where]))]
    begins = np.searchsorted(labels.ravel()[ranked], np.arange(1, count + 1))
    best = ranked[begins]
    rows, row, col = np.unravel_index(best, labels.shape)
    # The frontier that the explorer did go to is no other choice.
    chosen = labels[np.arange(len(steps)), groups.targets[:, 0, 0], groups.targets[:, 0, 1]]
    best_looks = looks.reshape(len(steps), -1).max(axis=1)
    close = looks.ravel()[best] > best_looks[rows] - CLOSE_CALL
    other = close & (np.arange(1, count + 1) != chosen[rows])
    rows, row, col, best = rows[other], row[other], col[other], best[other]
    # The largest of values with Gumbel noise are a draw by their softmax without repetition.
    keys = looks.ravel()[best] / CHOICE_TEMPERATURE + rng.gumbel(size=len(best))
    order = np.lexsort((-keys, rows))
    rank = np.arange(len(order)) - np.searchsorted(rows[order], rows[order])
    order = order[rank < CHOICES - 1]
    rank = np.arange(len(order)) - np.searchsorted(rows[order], rows[order])
    cells = np.stack([row, col], axis=1)[order]
    return rows[order], rank + 1, cells, distances.ravel()[best[order]]


def _distances(
    maps: NDArray[np.float32], frontier: NDArray[np.bool_], cells: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return how far each frontier cell is from the explorers' cells (N, 2), inf elsewhere."""
    obstacle, free = maps[:, OBSTACLE] > 0, maps[:, FREE] > 0
    boundary = np.full(free.shape, UNREACHED)
    here = np.arange(len(cells)), cells[:, 0], cells[:, 1]
    boundary[here] = 0.0
    # Steps are as long there as back, so search from the frontier: over cells known to be free.
    framed = np.pad(free, ((0, 0), (1, 1), (1, 1)))
    height, width = free.shape[1:]
    valid = valid_moves(obstacle)
    for action, (dr, dc) in enumerate(STEPS.tolist()):
        valid[:, action] &= framed[:, 1 + dr : 1 + dr + height, 1 + dc : 1 + dc + width]
    costs = np.where(valid, STEP_LENGTHS[:NUM_MOVES, None, None], np.inf)
    others = free | frontier
    others[here] = False
    values = best_way_values(boundary, others, costs, STEPS).astype(np.float64)
    return np.where(frontier & (values > UNREACHED / 2), -values, np.inf)
