"""Batches for what learns on a lattice: decisions of one search, which share its views.

Letters in shapes: B decisions, K positions, V views of a position, S positions on the way.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from gridnav import GOAL
from vgdp_experiments.search.learned.batches import TURNS, Turn, cell_of
from vgdp_experiments.search.learned.lattice import LatticePointNet, cell_shift, heading_of
from vgdp_experiments.search.learned.train_calvin_2d import PAST, way_weights
from vgdp_experiments.search.views import network_input

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vgdp_experiments.search.learned.batches import HomeBatches

SEARCHES = 3
"""So many searches are drawn for an optimisation step."""


class LatticeBatch(NamedTuple):
    """What is learned from at a step.

    Attributes:
        views: Of all positions that the robot has been to, (K · V, 5, 36, 64).
        points: Metres in the map, NaN for none, (K · V, 9, 16, 3).
        origin: x and y of the corner of the first map, (2,).
        shifts: From the cells of the first map to those of each, (B, 2).
        visited: To which of the positions it had been, bool (B, K).
        given: The goal, and where the robot stood, (B, 2, H, W).
        cells: Where it is and where it was before, (B, S, 2).
        headings: Of the move that led there, (B, S).
        actions: What the expert does there, (B, S).
        weights: How much that counts, (B, S).
        plans: What the expert does from now on, (B, T).
        turn: How to turn the maps; see `Turn`.
    """

    views: Tensor
    points: Tensor
    origin: Tensor
    shifts: Tensor
    visited: Tensor
    given: Tensor
    cells: Tensor
    headings: Tensor
    actions: Tensor
    weights: Tensor
    plans: Tensor
    turn: Tensor

    def lattices(self, net: LatticePointNet) -> Tensor:
        """Return the lattices with what is given, turned, (B, C + 2, H, W)."""
        points = net(self.views, self.points, self.origin)
        of_position = points.views // (len(self.views) // self.visited.shape[1])
        shape = (self.given.shape[2], self.given.shape[3])
        made = [
            points.lattice(shape, shift, visited[of_position])
            for shift, visited in zip(self.shifts, self.visited, strict=True)
        ]
        whole = torch.cat([torch.stack(made), self.given], dim=1)
        return Turn(int(self.turn)).maps(whole).contiguous()

    def turned_way(self) -> tuple[Tensor, Tensor, Tensor]:
        """Return cells, headings and actions of the way, turned as the lattices are."""
        turn = Turn(int(self.turn))
        shape = (self.given.shape[2], self.given.shape[3])
        return (
            turn.cells(self.cells, shape),
            turn.actions(self.headings),
            turn.actions(self.actions),
        )

    def turned_plans(self) -> Tensor:
        """Return the expert's plans, turned as the lattices are, (B, T)."""
        return Turn(int(self.turn)).actions(self.plans)


def of_searches(count: int) -> list[int]:
    """Deal decisions of a step out to some searches: those of one are too much alike."""
    return [part for part in ((count + left) // SEARCHES for left in range(SEARCHES)) if part]


def draw_lattices(
    batches: HomeBatches, count: int, horizon: int, rng: np.random.Generator
) -> LatticeBatch:
    """Draw decisions of one search.

    Args:
        batches: Of the homes.
        count: How many decisions.
        horizon: Steps of the expert's plans.
        rng: Draws.
    """
    decisions = batches.draw_way(count, rng)
    home = batches.homes[decisions[0].home]
    batch = batches.take(decisions, horizon, PAST)
    visited = home.visited[[decision.index for decision in decisions]]
    places = np.flatnonzero(visited.any(axis=0))
    stood = np.zeros_like(batch.maps[:, :1])
    shifts = []
    for row, origin in enumerate(batch.origins):
        cells = np.stack(
            [cell_of(home.positions[at], origin) for at in np.flatnonzero(visited[row])]
        )
        inside = (cells >= 0).all(axis=1) & (cells < stood.shape[2:]).all(axis=1)
        stood[row, 0, cells[inside, 0], cells[inside, 1]] = 1.0
        shifts.append(cell_shift(tuple(batch.origins[0]), tuple(origin)))
    given = np.concatenate([batch.maps[:, GOAL : GOAL + 1], stood], axis=1)
    color = home.color[places].reshape(-1, *home.color.shape[2:])
    depth = home.depth[places].reshape(-1, *home.depth.shape[2:])
    points = home.points[places].reshape(-1, *home.points.shape[2:])
    return LatticeBatch(
        network_input(color, depth),
        torch.from_numpy(points),
        torch.from_numpy(batch.origins[0]).float(),
        torch.stack(shifts),
        torch.from_numpy(visited[:, places]),
        torch.from_numpy(given),
        torch.from_numpy(batch.cells),
        torch.from_numpy(_headings(batch.cells, batch.weights)),
        torch.from_numpy(batch.actions),
        torch.from_numpy(way_weights(batch)),
        torch.from_numpy(batch.plans),
        torch.tensor(int(rng.integers(TURNS))),
    )


def _headings(cells: NDArray[np.int64], weights: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return along which of the eight directions the robot came to cells (B, S, 2), (B, S).

    The way's last cell comes first. Where nobody knows where it came from, it is 2: along x.
    """
    apart = np.zeros_like(cells)
    apart[:, :-1] = (cells[:, :-1] - cells[:, 1:]) * (weights[:, 1:, None] > 0)
    return heading_of(np.arctan2(apart[..., 0], apart[..., 1]))
