"""Trains the planner that reads images: `vgdp train search-rgbd`.

The policy learns the expert's plans by the denoising loss. Of the value function what is unseen
is worth is learned, as in mazes, by telling the better of the choices there are: here all unseen
cells in reach, and what the expert has to go from each. All begins with a planner's weights.
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
from vgdp_experiments.search.learned.rgbd import RgbdNetworks
from vgdp_experiments.search.learned.training import SearchTraining, train_networks
from vgdp_experiments.search.views import network_input
from vgdp_planner.analog_bits import NUM_BITS
from vgdp_planner.config import preset

if TYPE_CHECKING:
    import argparse

    from vgdp_experiments.search.learned.batches import HomeBatches

DEFAULTS = SearchTraining(out='runs/search-rgbd', steps=2500, batch=16, learning_rate=5e-4)

NOISES = 4
"""Noisy plans that each map is used for."""

POLICY = preset('default').policy


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    training.add_arguments(parser, DEFAULTS)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    return train_networks(arguments, begin, inputs, RgbdNetworks.save)


def begin(settings: SearchTraining) -> tuple[RgbdNetworks, RgbdLoss]:
    """Return the networks as training begins, and their losses.

    What steps are valid and where they lead is no other in homes, so that stays as it is.
    """
    networks = RgbdNetworks.from_planner(Path(settings.initial) if settings.initial else None)
    networks.requires_grad_(requires_grad=False)
    value = networks.value
    for part in (networks.views, networks.policy, value.trunk, value.unseen_worth):
        part.requires_grad_()
    return networks, RgbdLoss(networks)


class RgbdLoss(nn.Module):
    """The losses of policy and value."""

    def __init__(self, networks: RgbdNetworks) -> None:
        super().__init__()
        self.networks = networks

    def forward(
        self,
        views: Tensor,
        bearings: Tensor,
        maps: Tensor,
        cells: Tensor,
        plans: Tensor,
        noise: Tensor,
        diffusion_step: Tensor,
        look_cells: Tensor,
        distances: Tensor,
        costs: Tensor,
    ) -> dict[str, Tensor]:
        """Return the losses by name.

        Args:
            views: (B, V, 5, 36, 64).
            bearings: (B, V).
            maps: (B, 3, H, W).
            cells: Of the robots, (B, 2).
            plans: Of the expert, (B, T).
            noise: (N, bits, T).
            diffusion_step: (N,).
            look_cells: Unseen cells to look at, (B, U, 2).
            distances: How far they are, infinite for none, (B, U).
            costs: What the expert has to go from there, infinite for none, (B, K, U).
        """
        networks = self.networks
        networks.see(views, bearings, cells, (maps.shape[2], maps.shape[3]))
        beliefs = torch.zeros_like(maps[:, 0])
        beliefs[torch.arange(len(maps)), cells[:, 0], cells[:, 1]] = 1.0
        denoising = networks.policy.loss(maps, beliefs, plans, noise, diffusion_step)
        differences = choice_loss(networks.value, maps, look_cells, distances, costs)
        return {'denoising': denoising, 'differences': differences}


def inputs(batches: HomeBatches, settings: SearchTraining, step: int) -> list[tuple[Tensor, ...]]:
    """Return what the losses are called with at a step, once, turned and mirrored at random.

    Only decisions before the thing was seen: after that the way there is all that matters, which
    needs no learning.
    """
    rng = np.random.default_rng([settings.seed, 9, step])
    decisions = batches.draw(settings.batch, rng, unseen_only=True)
    batch = batches.take(decisions, POLICY.horizon)
    looks = batches.looks(decisions, batch)
    turn = Turn(int(rng.integers(TURNS)))
    count = len(batch) * NOISES
    seen = [(batches.homes[d.home], int(batches.homes[d.home].at[d.index])) for d in decisions]
    shape = (batch.maps.shape[2], batch.maps.shape[3])
    bearings = torch.from_numpy(np.stack([home.bearings[at] for home, at in seen]))
    arrays = (
        torch.stack([network_input(home.color[at], home.depth[at]) for home, at in seen]),
        turn.bearings(bearings),
        turn.maps(torch.from_numpy(batch.maps)).contiguous(),
        turn.cells(torch.from_numpy(batch.cells[:, 0]), shape),
        turn.actions(torch.from_numpy(batch.plans)),
        torch.from_numpy(rng.standard_normal((count, NUM_BITS, POLICY.horizon), dtype=np.float32)),
        torch.from_numpy(rng.integers(POLICY.diffusion_steps, size=count)),
        turn.cells(torch.from_numpy(looks.cells), shape),
        torch.from_numpy(looks.distances),
        torch.from_numpy(looks.costs),
    )
    return [arrays]
