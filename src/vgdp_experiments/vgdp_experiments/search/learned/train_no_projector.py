"""Trains the planner without the projector, end to end: `vgdp train search-no-projector`.

The policy by the denoising loss and the value by CALVIN's losses, both through the learned map.
The policy begins as the shipped planner's, the value as CALVIN trained on the projected maps of
homes, so that the learned map is asked for what both can read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from vgdp_experiments.calvin import load_calvin
from vgdp_experiments.search.learned import training
from vgdp_experiments.search.learned.lattice_batches import (
    LatticeBatch,
    draw_lattices,
    of_searches,
)
from vgdp_experiments.search.learned.no_projector import NoProjectorNetworks
from vgdp_experiments.search.learned.records import WEIGHTS
from vgdp_experiments.search.learned.training import SearchTraining, train_networks
from vgdp_experiments.train_calvin import ImitationLoss
from vgdp_planner.analog_bits import NUM_BITS
from vgdp_planner.config import preset

if TYPE_CHECKING:
    import argparse

    from vgdp_experiments.search.learned.batches import HomeBatches

DEFAULTS = SearchTraining(
    out='runs/search-no-projector', steps=1000, batch=12, learning_rate=2e-3, ema=0.99
)

NOISES = 4
"""Noisy plans that each map is used for."""

POLICY = preset('default').policy


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    training.add_arguments(parser, DEFAULTS)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    return train_networks(arguments, begin, inputs, NoProjectorNetworks.save)


def begin(settings: SearchTraining) -> tuple[NoProjectorNetworks, EndToEndLoss]:
    """Return the networks as training begins, and their losses."""
    calvin = load_calvin(settings.initial or WEIGHTS / 'calvin_2d')
    networks = NoProjectorNetworks.from_planner(calvin).train()
    networks.belief.requires_grad_(requires_grad=False)
    return networks, EndToEndLoss(networks)


def inputs(batches: HomeBatches, settings: SearchTraining, step: int) -> list[tuple[Tensor, ...]]:
    """Return what the losses are called with at a step, for each search that is drawn."""
    rng = np.random.default_rng([settings.seed, 9, step])
    passes: list[tuple[Tensor, ...]] = []
    for count in of_searches(settings.batch):
        batch = draw_lattices(batches, count, POLICY.horizon, rng)
        shape = (count * NOISES, NUM_BITS, POLICY.horizon)
        noise = rng.standard_normal(shape, dtype=np.float32)
        diffusion_step = rng.integers(POLICY.diffusion_steps, size=len(noise))
        passes.append((*batch, torch.from_numpy(noise), torch.from_numpy(diffusion_step)))
    return passes


class EndToEndLoss(nn.Module):
    """The losses of policy and value on learned maps."""

    def __init__(self, networks: NoProjectorNetworks) -> None:
        super().__init__()
        self.networks = networks
        self.imitation = ImitationLoss(networks.value)

    def forward(self, *arguments: Tensor) -> dict[str, Tensor]:
        """Return the losses by name, for the parts of a `LatticeBatch`, noise and its steps."""
        *parts, noise, diffusion_step = arguments
        batch = LatticeBatch(*parts)
        networks = self.networks
        learned = networks.learned_maps(batch.lattices(networks.lattice))
        networks.read(learned)
        cells, _, actions = batch.turned_way()
        beliefs = torch.zeros_like(learned[:, 0])
        beliefs[torch.arange(len(cells)), cells[:, 0, 0], cells[:, 0, 1]] = 1.0
        plans = batch.turned_plans()
        return {
            'denoising': networks.policy.loss(learned, beliefs, plans, noise, diffusion_step),
            **self.imitation(learned, cells, actions, batch.weights),
        }
