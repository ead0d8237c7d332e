"""Trains CALVIN-3D by imitation: `vgdp train search-calvin-3d`.

Where moves lead and what they cost begins as CALVIN has learned it in mazes; all that has to do
with the lattice begins with nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from vgdp_experiments.calvin import load_calvin
from vgdp_experiments.search.learned import training
from vgdp_experiments.search.learned.calvin_3d import Calvin3D, Calvin3DConfig
from vgdp_experiments.search.learned.lattice_batches import (
    LatticeBatch,
    draw_lattices,
    of_searches,
)
from vgdp_experiments.search.learned.training import SearchTraining, train_networks
from vgdp_experiments.train_calvin import ImitationLoss

if TYPE_CHECKING:
    import argparse

    from vgdp_experiments.search.learned.batches import HomeBatches

DEFAULTS = SearchTraining(
    out='runs/search-calvin-3d', steps=3000, batch=12, learning_rate=1e-2, ema=0.99
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    training.add_arguments(parser, DEFAULTS)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    return train_networks(arguments, begin, inputs, Calvin3D.save)


def begin(settings: SearchTraining) -> tuple[Calvin3D, HeadingImitation]:
    """Return the network as training begins, and its losses."""
    model = Calvin3D(Calvin3DConfig())
    if settings.initial:
        model = Calvin3D.load(Path(settings.initial)).train()
    else:
        learned = load_calvin().state_dict()
        of_moves = {n: t for n, t in learned.items() if not n.startswith('availability.')}
        model.load_state_dict({**model.state_dict(), **of_moves})
    return model, HeadingImitation(model)


def inputs(batches: HomeBatches, settings: SearchTraining, step: int) -> list[tuple[Tensor, ...]]:
    """Return what the losses are called with at a step, for each search that is drawn."""
    rng = np.random.default_rng([settings.seed, 9, step])
    return [draw_lattices(batches, count, 1, rng) for count in of_searches(settings.batch)]


class HeadingImitation(ImitationLoss):
    """CALVIN's losses where Q depends on the heading, too."""

    model: Calvin3D

    def forward(self, *arguments: Tensor) -> dict[str, Tensor]:
        """Return the losses by name, for the parts of a `LatticeBatch`."""
        batch = LatticeBatch(*arguments)
        found = self.model(batch.lattices(self.model.lattice))
        cells, headings, actions = batch.turned_way()
        index = torch.arange(len(cells))[:, None]
        rows, cols = cells.unbind(dim=-1)

        def imitation(scores: Tensor) -> Tensor:
            errors = functional.cross_entropy(scores.transpose(1, 2), actions, reduction='none')
            return (batch.weights * errors).sum() / len(cells)

        return {
            'action': imitation(found.q_values[index, headings, :, rows, cols]),
            'available': imitation(found.logits[index, :, rows, cols]),
            'motion': self.motion_loss(),
        }
