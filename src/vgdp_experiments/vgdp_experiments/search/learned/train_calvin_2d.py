"""Trains CALVIN on the projected maps of homes: `vgdp train search-calvin-2d`.

By imitation, as its paper does and as for mazes (`vgdp train calvin`), whose weights it begins
with.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from vgdp_experiments.calvin import SHIPPED, Calvin, load_calvin, save_calvin
from vgdp_experiments.search.learned import training
from vgdp_experiments.search.learned.batches import TURNS, Turn
from vgdp_experiments.search.learned.training import SearchTraining, train_networks
from vgdp_experiments.train_calvin import CalvinTraining, ImitationLoss

if TYPE_CHECKING:
    import argparse
    from pathlib import Path
    from typing import Any

    from numpy.typing import NDArray
    from torch import Tensor

    from vgdp_experiments.search.learned.batches import Batch, HomeBatches

DEFAULTS = SearchTraining(
    out='runs/search-calvin-2d', steps=1000, batch=16, learning_rate=5e-3, ema=0.99
)

PAST, PAST_WEIGHT = CalvinTraining.past, CalvinTraining.past_weight


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    training.add_arguments(parser, DEFAULTS)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    return train_networks(arguments, begin, inputs, save)


def begin(settings: SearchTraining) -> tuple[Calvin, ImitationLoss]:
    """Return the network as training begins, and its losses."""
    model = load_calvin(settings.initial or SHIPPED).train()
    return model, ImitationLoss(model)


def inputs(batches: HomeBatches, settings: SearchTraining, step: int) -> list[tuple[Tensor, ...]]:
    """Return what the losses are called with at a step, once, turned and mirrored at random."""
    rng = np.random.default_rng([settings.seed, 9, step])
    batch = batches.take(batches.draw(settings.batch, rng), past=PAST)
    turn = Turn(int(rng.integers(TURNS)))
    maps = turn.maps(torch.from_numpy(batch.maps)).contiguous()
    return [(maps, *turned_way(batch, turn))]


def turned_way(batch: Batch, turn: Turn) -> tuple[Tensor, Tensor, Tensor]:
    """Return cells (B, S, 2), actions (B, S) and weights (B, S) as `ImitationLoss` has them."""
    shape = (batch.maps.shape[2], batch.maps.shape[3])
    return (
        turn.cells(torch.from_numpy(batch.cells), shape),
        turn.actions(torch.from_numpy(batch.actions)),
        torch.from_numpy(way_weights(batch)),
    )


def way_weights(batch: Batch) -> NDArray[np.float32]:
    """Return how much each step of ways counts: the less the longer ago it was, (B, S)."""
    return batch.weights * PAST_WEIGHT ** np.arange(PAST + 1, dtype=np.float32)


def save(model: Calvin, folder: Path, record: dict[str, Any]) -> None:
    """Write weights, configuration and how they came about into a folder, creating it."""
    save_calvin(folder, model, record)
