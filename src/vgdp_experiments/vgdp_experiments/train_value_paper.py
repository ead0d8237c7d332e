"""Trains the paper's value function and belief filter on expert demonstrations."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from gridnav import FREE, OBSTACLE
from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE
from maze_sim import visible_cells
from vgdp_experiments.data import Demonstrations, load_demonstrations
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.parallel import Team, training_team
from vgdp_experiments.preset_settings import require_positive
from vgdp_experiments.train_dynamics import WRONG_VIEWS, motion_loss
from vgdp_experiments.training import ValueParts, optimise
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.config import preset
from vgdp_planner.value import ValueNetwork
from vgdp_planner.weights import save_weights

if TYPE_CHECKING:
    import argparse

    from numpy.typing import NDArray
    from torch import Tensor

VIEW_RANGE = 2
"""Of the views that the observation function learns from; it holds for every range."""


@dataclass(frozen=True)
class PaperValueTraining:
    """Settings of a training run; the defaults are the appendix's, 60 epochs of 10000 steps.

    Attributes:
        data: Expert demonstrations.
        out: Folder for weights, logs and checkpoints.
        seed: Of everything random.
        steps: Optimisation steps.
        batch: Samples of a pass, those of all processes together.
        accumulation: Passes whose gradients make one step.
        learning_rate: Initial learning rate; it falls to zero over the second half.
        ema: Decay of the averaged weights.
        device: Where to train: 'cpu', 'cuda' for a GPU, or 'auto' for a GPU where there is one.
        checkpoint_every: Steps between two checkpoints.
        threads: CPU threads of each process.
    """

    data: str = 'runs/demonstrations-paper.npz'
    out: str = 'runs/value-paper'
    seed: int = 0
    steps: int = 600_000
    batch: int = 32
    accumulation: int = 2
    learning_rate: float = 5e-3
    ema: float = 0.995
    device: str = 'auto'
    checkpoint_every: int = 10_000
    threads: int = 2

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self, ('steps', 'batch', 'accumulation', 'checkpoint_every', 'threads'))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, PaperValueTraining)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    settings = read_settings(PaperValueTraining, arguments)
    torch.set_num_threads(settings.threads)
    config = preset('paper')
    demonstrations = load_demonstrations(Path(settings.data))
    with training_team(settings.device) as team:
        torch.manual_seed(settings.seed)
        both = ValueParts(ValueNetwork(config.value), BeliefFilter()).to(team.device)
        losses = train(both, demonstrations, settings, team)
        if team.leads:
            record = {**asdict(settings), 'losses': losses}
            save_weights(settings.out, config, both.state_dict(), {'value': record})
            print(f'Value function written to {settings.out}.')  # noqa: T201
    return 0


def train(
    both: ValueParts, demonstrations: Demonstrations, settings: PaperValueTraining, team: Team
) -> dict[str, float]:
    """Train value function and belief filter in place; returns the last losses.

    In float32: rounds of value iteration would add up the errors of a shorter format.
    """
    return optimise(
        both,
        ImitationLoss(both),
        lambda step: passes(demonstrations, settings, team, step),
        settings,
        team,
    )


class ImitationLoss(nn.Module):
    """The losses of the paper's value function and belief filter.

    The cross-entropy of the expert's action under Â_logit and under Q(b, a), as the appendix
    says. The expert's own moves train the motion models, and what is seen along its ways the
    observation function, by how much of the belief it leaves in the true cell.
    """

    def __init__(self, both: ValueParts) -> None:
        super().__init__()
        self.both = both

    def forward(
        self, maps: Tensor, cells: Tensor, actions: Tensor, views: Tensor
    ) -> dict[str, Tensor]:
        """Return the losses by name.

        Args:
            maps: (N, 3, H, W).
            cells: (N, 2).
            actions: The expert's, (N,).
            views: What is seen from the cells, int8 (N, 2r + 1, 2r + 1).
        """
        network, belief_filter = self.both.value, self.both.belief
        here = torch.arange(len(maps), device=maps.device)
        rows, cols = cells.T
        logits, _ = network.action_logits(maps)
        q_values = network(maps).q_values
        free = maps[:, FREE]
        posterior = belief_filter.correct(free / free.sum(dim=(1, 2), keepdim=True), maps, views)
        return {
            'mask': functional.cross_entropy(logits[here, :, rows, cols], actions),
            'action': functional.cross_entropy(q_values[here, :, rows, cols], actions),
            'motion': motion_loss(network.motion),
            'filter_motion': motion_loss(belief_filter.motion),
            'observation': -posterior[here, rows, cols].clamp_min(1e-12).log().mean(),
        }


def passes(
    demonstrations: Demonstrations, settings: PaperValueTraining, team: Team, step: int
) -> list[tuple[Tensor, ...]]:
    """Return what the losses are called with at a step, for each pass of this process.

    Everything is drawn for all processes alike and then dealt out, so how many there are plays
    no part.
    """
    rng = np.random.default_rng([settings.seed, 4, step])
    count = settings.batch * settings.accumulation
    chosen = demonstrations.draw(count, rng)
    side = 2 * VIEW_RANGE + 1
    wrong = rng.random((count, side, side)) < WRONG_VIEWS
    made = []
    for first in range(0, count, settings.batch):
        part = team.share(first, settings.batch)
        batch = demonstrations.take(chosen[part])
        views = views_of(batch.maps, batch.cells, wrong[part])
        arrays = (batch.maps, batch.cells, batch.actions[:, 0], views)
        made.append(tuple(torch.from_numpy(array).to(team.device) for array in arrays))
    return made


def views_of(
    maps: NDArray[np.float32], cells: NDArray[np.int64], wrong: NDArray[np.bool_]
) -> NDArray[np.int8]:
    """Return what is seen from cells as far as the partial maps tell.

    Args:
        maps: (N, 3, H, W).
        cells: (N, 2).
        wrong: Cells of the views that say the wrong thing, (N, 2r + 1, 2r + 1).

    Returns:
        Views as occupancy, int8 (N, 2r + 1, 2r + 1).
    """
    side = wrong.shape[1]
    margin = side // 2
    obstacle, free = maps[:, OBSTACLE] > 0, maps[:, FREE] > 0
    padding = ((0, 0), (margin, margin), (margin, margin))
    span = np.arange(side)
    window = (
        np.arange(len(maps))[:, None, None],
        cells[:, 0, None, None] + span[:, None],
        cells[:, 1, None, None] + span[None, :],
    )
    occupied, known = np.pad(obstacle, padding)[window], np.pad(obstacle | free, padding)[window]
    seen = visible_cells(obstacle, cells, margin) & known
    says = np.where(occupied ^ wrong, OCCUPIED_VALUE, FREE_VALUE)
    views: NDArray[np.int8] = np.where(seen, says, UNKNOWN_VALUE).astype(np.int8)
    return views
