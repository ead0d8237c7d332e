"""Trains the object-search value: `vgdp train search-object`.

It learns what is unseen is worth, as `vgdp train search-rgbd` does, but reads at which heights
there is something instead of images. All begins with a planner's value function.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from vgdp_experiments.search.learned import training
from vgdp_experiments.search.learned.batches import TURNS, Turn
from vgdp_experiments.search.learned.choices import choice_loss
from vgdp_experiments.search.learned.object_value import begin_value, height_map, save_value
from vgdp_experiments.search.learned.training import SearchTraining, train_networks

if TYPE_CHECKING:
    import argparse

    from numpy.typing import NDArray

    from vgdp_experiments.search.learned.batches import Decision, HomeBatches
    from vgdp_experiments.search.learned.rgbd import SeeingValue

DEFAULTS = SearchTraining(out='runs/search-object', steps=4000, batch=16, learning_rate=1e-3)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    training.add_arguments(parser, DEFAULTS)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    return train_networks(arguments, begin, inputs, save_value)


def begin(settings: SearchTraining) -> tuple[SeeingValue, ObjectValueLoss]:
    """Return the network as training begins, and its loss.

    What steps are valid and where they lead is no other in homes, so that stays as it is.
    """
    value = begin_value(Path(settings.initial) if settings.initial else None)
    value.requires_grad_(requires_grad=False)
    for part in (value.trunk, value.unseen_worth):
        part.requires_grad_()
    return value, ObjectValueLoss(value)


class ObjectValueLoss(nn.Module):
    """The loss of the worth of the unseen."""

    def __init__(self, value: SeeingValue) -> None:
        super().__init__()
        self.value = value

    def forward(
        self, maps: Tensor, heights: Tensor, look_cells: Tensor, distances: Tensor, costs: Tensor
    ) -> dict[str, Tensor]:
        """Return the loss by name.

        Args:
            maps: (B, 3, H, W).
            heights: (B, C, H, W).
            look_cells: Unseen cells to look at, (B, U, 2).
            distances: How far they are, infinite for none, (B, U).
            costs: What the expert has to go from there, infinite for none, (B, K, U).
        """
        self.value.seen = heights
        return {'differences': choice_loss(self.value, maps, look_cells, distances, costs)}


def inputs(batches: HomeBatches, settings: SearchTraining, step: int) -> list[tuple[Tensor, ...]]:
    """Return what the loss is called with at a step, once, turned and mirrored at random."""
    rng = np.random.default_rng([settings.seed, 9, step])
    decisions = batches.draw(settings.batch, rng, unseen_only=True)
    batch = batches.take(decisions)
    looks = batches.looks(decisions, batch)
    shape = (batch.maps.shape[2], batch.maps.shape[3])
    heights = [
        heights_at(batches, decision, corner, shape)
        for decision, corner in zip(decisions, batch.origins, strict=True)
    ]
    turn = Turn(int(rng.integers(TURNS)))
    return [
        (
            turn.maps(torch.from_numpy(batch.maps)).contiguous(),
            turn.maps(torch.from_numpy(np.stack(heights))).contiguous(),
            turn.cells(torch.from_numpy(looks.cells), shape),
            torch.from_numpy(looks.distances),
            torch.from_numpy(looks.costs),
        )
    ]


def heights_at(
    batches: HomeBatches,
    decision: Decision,
    corner: NDArray[np.float64],
    shape: tuple[int, ...],
) -> NDArray[np.float32]:
    """Return what was known of the heights at a decision, (C, H, W).

    Args:
        batches: Of the homes.
        decision: Which.
        corner: x and y of the lower left corner of the map, metres, (2,).
        shape: Rows and columns of the map.
    """
    home = batches.homes[decision.home]
    been = home.visited[decision.index]
    points = home.points[been].reshape(-1, 3)
    return height_map(points, home.positions[been], corner, shape)
