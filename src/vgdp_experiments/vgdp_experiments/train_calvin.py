"""Trains CALVIN by imitation of demonstrations, as its paper does."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from gridnav import STEPS
from vgdp_experiments.calvin import KERNEL_SIDE, Calvin, CalvinConfig, save_calvin
from vgdp_experiments.data import AT_ONCE, Demonstrations, load_demonstrations
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.parallel import Team, training_team
from vgdp_experiments.preset_settings import require_positive
from vgdp_experiments.training import optimise

if TYPE_CHECKING:
    import argparse

    from numpy.typing import NDArray


@dataclass(frozen=True)
class CalvinTraining:
    """Settings of a training run.

    Attributes:
        data: Demonstrations.
        out: Folder for weights, logs and checkpoints.
        seed: Of everything random.
        steps: Optimisation steps.
        batch: Maps of a step, those of all processes together.
        past: Earlier steps of the same way that each map is used for, too.
        past_weight: Weight of each such step beside that of the step after it.
        learning_rate: Initial learning rate; it falls to zero over the second half.
        ema: Decay of the averaged weights.
        device: Where to train: 'cpu', 'cuda' for a GPU, or 'auto' for a GPU where there is one.
        checkpoint_every: Steps between two checkpoints.
        threads: CPU threads of each process.
    """

    data: str = 'runs/demonstrations.npz'
    out: str = 'runs/calvin'
    seed: int = 0
    steps: int = 5000
    batch: int = 64
    past: int = 6
    past_weight: float = 0.25
    learning_rate: float = 1e-2
    ema: float = 0.995
    device: str = 'auto'
    checkpoint_every: int = 500
    threads: int = 2

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self, ('steps', 'batch', 'checkpoint_every', 'threads'))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, CalvinTraining)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    settings = read_settings(CalvinTraining, arguments)
    torch.set_num_threads(settings.threads)
    demonstrations = load_demonstrations(Path(settings.data))
    with training_team(settings.device) as team:
        torch.manual_seed(settings.seed)
        model = Calvin(CalvinConfig()).to(team.device)
        losses = train(model, demonstrations, settings, team)
        if team.leads:
            record = {
                **asdict(settings),
                'demonstrations': demonstrations.settings,
                'losses': losses,
            }
            save_calvin(settings.out, model, record)
            print(f'CALVIN written to {settings.out}.')  # noqa: T201
    return 0


def train(
    model: Calvin, demonstrations: Demonstrations, settings: CalvinTraining, team: Team
) -> dict[str, float]:
    """Train CALVIN in place; returns the last losses, averaged over a hundred steps."""
    before = steps_before(demonstrations)
    return optimise(
        model,
        ImitationLoss(model),
        lambda step: passes(demonstrations, before, settings, team, step),
        settings,
        team,
    )


def steps_before(demonstrations: Demonstrations) -> NDArray[np.int64]:
    """Find the demonstration from which each one was reached, -1 where there is none, (N,).

    Ways that were walked side by side lie in the file step by step. The step before is the last
    one whose first action leads to this cell, in a map that says nothing which this one doesn't.
    """
    cells = demonstrations.cells.astype(np.int64)
    moves = np.vstack([STEPS, np.full(2, 1 << 8)])[demonstrations.actions[:, 0]]
    reached = cells + moves
    before = np.full(len(cells), -1)
    for back in range(1, min(AT_ONCE, len(cells) - 1) + 1):
        later = np.flatnonzero((before[back:] < 0) & (reached[:-back] == cells[back:]).all(axis=1))
        earlier = demonstrations.codes[later]
        agrees = (earlier & demonstrations.codes[later + back]) == earlier
        later = later[agrees.all(axis=(1, 2))]
        before[later + back] = later
    return before


class ImitationLoss(nn.Module):
    """CALVIN's losses: the demonstrated actions under Q and under Â_logit, and where steps lead.

    All three are cross-entropies.
    """

    def __init__(self, model: Calvin) -> None:
        super().__init__()
        self.model = model

    def forward(
        self, maps: Tensor, cells: Tensor, actions: Tensor, weights: Tensor
    ) -> dict[str, Tensor]:
        """Return the losses by name.

        Args:
            maps: (N, 3, H, W).
            cells: Where the robot is now and where it was before, (N, T, 2).
            actions: What was demonstrated there, (N, T).
            weights: How much each of them counts, 0 where there is none, (N, T).
        """
        found = self.model(maps)
        index = torch.arange(len(maps), device=maps.device)[:, None]
        rows, cols = cells.unbind(dim=-1)

        def imitation(scores: Tensor) -> Tensor:
            there = scores[index, :, rows, cols].transpose(1, 2)
            errors = functional.cross_entropy(there, actions, reduction='none')
            return (weights * errors).sum() / len(maps)

        return {
            'action': imitation(found.q_values),
            'available': imitation(found.logits),
            'motion': self.motion_loss(),
        }

    def motion_loss(self) -> Tensor:
        """Return the mean negative log-likelihood of where the eight steps lead."""
        offsets = torch.from_numpy((STEPS + KERNEL_SIDE // 2) @ [KERNEL_SIDE, 1])
        log_kernels = self.model.log_kernels()
        return functional.nll_loss(log_kernels, offsets.to(log_kernels.device))


def passes(
    demonstrations: Demonstrations,
    before: NDArray[np.int64],
    settings: CalvinTraining,
    team: Team,
    step: int,
) -> list[tuple[Tensor, ...]]:
    """Return what the loss is called with at a step: once, with this process's share of it.

    Each map comes with the steps that led to it, which the larger map shows in a new light. They
    count less the longer ago they are.
    """
    rng = np.random.default_rng([settings.seed, 8, step])
    chosen = demonstrations.draw(settings.batch, rng)[team.share(0, settings.batch)]
    indices = [chosen]
    for _ in range(settings.past):
        indices.append(np.where(indices[-1] >= 0, before[indices[-1]], -1))
    way = np.stack(indices, axis=1)
    weights = (settings.past_weight ** np.arange(way.shape[1]) * (way >= 0)).astype(np.float32)
    arrays = (
        demonstrations.take(chosen).maps,
        demonstrations.cells[way].astype(np.int64),
        demonstrations.actions[way, 0].astype(np.int64),
        weights,
    )
    return [tuple(torch.from_numpy(array).to(team.device) for array in arrays)]
