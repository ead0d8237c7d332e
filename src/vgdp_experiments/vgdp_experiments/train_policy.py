"""Trains the diffusion policy on demonstrations."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn

from vgdp_experiments.data import Demonstrations, load_demonstrations
from vgdp_experiments.parallel import Team, training_team
from vgdp_experiments.preset_settings import (
    add_preset_settings,
    read_preset_settings,
    require_positive,
)
from vgdp_experiments.training import optimise
from vgdp_planner.analog_bits import NUM_BITS
from vgdp_planner.config import preset
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.weights import save_weights

if TYPE_CHECKING:
    import argparse

    from torch import Tensor

PRECISIONS = ('auto', 'float32', 'bfloat16')


@dataclass(frozen=True)
class PolicyTraining:
    """Settings of a training run.

    Attributes:
        preset: Which preset to train; it decides what the other settings are by default.
        data: Demonstrations.
        out: Folder for weights, logs and checkpoints.
        seed: Of everything random.
        steps: Optimisation steps.
        batch: Maps of a pass, those of all processes together.
        accumulation: Passes whose gradients make one step.
        noises: Noisy plans that each map of a pass is used for.
        learning_rate: Initial learning rate; it falls to zero over the second half.
        weight_decay: Weight decay, decoupled from the gradients.
        ema: Decay of the averaged weights.
        device: Where to train: 'cpu', 'cuda' for a GPU, or 'auto' for a GPU where there is one.
        precision: 'float32', 'bfloat16' for mixed precision, or 'auto' for that on a GPU alone.
        checkpoint_every: Steps between two checkpoints.
        threads: CPU threads of each process.
    """

    preset: str = 'default'
    data: str = 'runs/demonstrations.npz'
    out: str = 'runs/policy'
    seed: int = 0
    steps: int = 16000
    batch: int = 64
    accumulation: int = 1
    noises: int = 4
    learning_rate: float = 1e-3
    weight_decay: float = 1e-3
    ema: float = 0.995
    device: str = 'auto'
    precision: str = 'auto'
    checkpoint_every: int = 1000
    threads: int = 2

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(
            self, ('steps', 'batch', 'accumulation', 'noises', 'checkpoint_every', 'threads')
        )
        if self.precision not in PRECISIONS:
            msg = f'The precision is one of {", ".join(PRECISIONS)}, got {self.precision!r}.'
            raise ValueError(msg)


SETTINGS = {
    'default': PolicyTraining(),
    # The appendix's table of hyperparameters: 60 epochs of 10000 steps.
    'paper': PolicyTraining(
        preset='paper',
        data='runs/demonstrations-paper.npz',
        out='runs/policy-paper',
        steps=600_000,
        batch=32,
        accumulation=2,
        noises=1,
        learning_rate=2e-4,
        weight_decay=0.0,
        checkpoint_every=10_000,
    ),
}
"""How each preset is trained unless the options say otherwise."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_preset_settings(parser, SETTINGS)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    settings = read_preset_settings(arguments, SETTINGS)
    torch.set_num_threads(settings.threads)
    config = preset(settings.preset)
    demonstrations = load_demonstrations(Path(settings.data))
    demonstrations.require_horizon(config.policy.horizon)
    with training_team(settings.device) as team:
        torch.manual_seed(settings.seed)
        policy = DiffusionPolicy(config.policy).to(team.device)
        losses = train(policy, demonstrations, settings, team)
        if team.leads:
            tensors = {f'policy.{name}': value for name, value in policy.state_dict().items()}
            record = {
                **asdict(settings),
                'demonstrations': demonstrations.settings,
                'losses': losses,
            }
            save_weights(settings.out, config, tensors, {'policy': record})
            print(f'Policy written to {settings.out}.')  # noqa: T201
    return 0


def train(
    policy: DiffusionPolicy, demonstrations: Demonstrations, settings: PolicyTraining, team: Team
) -> dict[str, float]:
    """Train a policy in place; returns the last losses, averaged over a hundred steps."""
    automatic = team.device.type == 'cuda' and torch.cuda.is_bf16_supported()
    return optimise(
        policy,
        DenoisingLoss(policy),
        lambda step: passes(policy, demonstrations, settings, team, step),
        settings,
        team,
        weight_decay=settings.weight_decay,
        mixed=settings.precision == 'bfloat16' or (settings.precision == 'auto' and automatic),
    )


class DenoisingLoss(nn.Module):
    """The loss of a policy as a module, so that several processes can share its gradients."""

    def __init__(self, policy: DiffusionPolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, *arguments: Tensor) -> dict[str, Tensor]:
        """Return the denoising loss; see `DiffusionPolicy.loss`."""
        return {'denoising': self.policy.loss(*arguments)}


def passes(
    policy: DiffusionPolicy,
    demonstrations: Demonstrations,
    settings: PolicyTraining,
    team: Team,
    step: int,
) -> list[tuple[Tensor, ...]]:
    """Return what the loss is called with at a step, for each pass of this process.

    Everything is drawn for all processes alike and then dealt out, so how many there are plays
    no part. Each map comes with several noises and diffusion steps.
    """
    config = policy.config
    rng = np.random.default_rng([settings.seed, 6, step])
    count = settings.batch * settings.accumulation
    chosen = demonstrations.draw(count, rng)
    shape = (settings.noises, count)
    noise = rng.standard_normal((*shape, NUM_BITS, config.horizon), dtype=np.float32)
    diffusion_step = rng.integers(config.diffusion_steps, size=shape)
    made = []
    for first in range(0, count, settings.batch):
        part = team.share(first, settings.batch)
        batch = demonstrations.take(chosen[part])
        beliefs = np.zeros(batch.maps[:, 0].shape, dtype=np.float32)
        beliefs[np.arange(len(beliefs)), batch.cells[:, 0], batch.cells[:, 1]] = 1.0
        arrays = (
            batch.maps,
            beliefs,
            batch.actions[:, : config.horizon],
            noise[:, part].reshape(-1, *noise.shape[2:]),
            diffusion_step[:, part].reshape(-1),
        )
        made.append(tuple(torch.from_numpy(array).to(team.device) for array in arrays))
    return made
