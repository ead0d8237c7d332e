"""Trains the diffusion policy on demonstrations."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from tqdm import tqdm

from vgdp_experiments.data import Batch, Demonstrations, load_demonstrations
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.training import (
    Ema,
    TrainingLog,
    learning_rate,
    load_checkpoint,
    save_checkpoint,
)
from vgdp_planner.analog_bits import NUM_BITS
from vgdp_planner.config import preset
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.weights import save_weights

if TYPE_CHECKING:
    import argparse

    from torch import Tensor

CHECKPOINT_EVERY = 1000
GRADIENT_NORM = 1.0
PRECISIONS = ('float32', 'bfloat16')


@dataclass(frozen=True)
class PolicyTraining:
    """Settings of a training run.

    Attributes:
        preset: Which preset to train.
        data: Demonstrations.
        out: Folder for weights, logs and checkpoints.
        seed: Of everything random.
        steps: Optimisation steps.
        batch: Maps of a step.
        noises: Noisy plans that each map of a step is used for.
        learning_rate: Initial learning rate; it falls to zero over the second half.
        ema: Decay of the averaged weights.
        device: Where to train: 'cpu', or 'cuda' for a GPU.
        precision: 'float32', or 'bfloat16' for mixed precision where the processor is good at it.
        threads: CPU threads.
    """

    preset: str = 'default'
    data: str = 'runs/demonstrations.npz'
    out: str = 'runs/policy'
    seed: int = 0
    steps: int = 16000
    batch: int = 64
    noises: int = 4
    learning_rate: float = 1e-3
    ema: float = 0.995
    device: str = 'cpu'
    precision: str = 'float32'
    threads: int = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, PolicyTraining)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    settings = read_settings(PolicyTraining, arguments)
    if settings.precision not in PRECISIONS:
        msg = f'The precision is one of {", ".join(PRECISIONS)}, got {settings.precision!r}.'
        raise ValueError(msg)
    torch.set_num_threads(settings.threads)
    torch.manual_seed(settings.seed)
    config = preset(settings.preset)
    policy = DiffusionPolicy(config.policy).to(settings.device)
    demonstrations = load_demonstrations(Path(settings.data))
    loss = train(policy, demonstrations, settings)
    tensors = {f'policy.{name}': value.cpu() for name, value in policy.state_dict().items()}
    record = {
        **asdict(settings),
        'demonstrations': demonstrations.settings,
        'losses': {'denoising': loss},
    }
    save_weights(settings.out, config, tensors, {'policy': record})
    print(f'Policy written to {settings.out}.')  # noqa: T201
    return 0


def train(
    policy: DiffusionPolicy, demonstrations: Demonstrations, settings: PolicyTraining
) -> float:
    """Train a policy in place; returns the last loss, averaged over a hundred steps."""
    folder = Path(settings.out)
    folder.mkdir(parents=True, exist_ok=True)
    optimizer = torch.optim.RAdam(
        policy.parameters(),
        lr=settings.learning_rate,
        weight_decay=1e-3,
        decoupled_weight_decay=True,
    )
    ema = Ema(policy, settings.ema)
    done = load_checkpoint(folder, policy, ema, optimizer, asdict(settings))
    log = TrainingLog(folder, ['step', 'loss', 'learning_rate'])
    device, mixed = torch.device(settings.device), settings.precision == 'bfloat16'
    recent: list[float] = []
    for step in tqdm(range(done, settings.steps), desc='policy', unit='step'):
        rng = np.random.default_rng([settings.seed, 6, step])
        rate = learning_rate(step, settings.steps, settings.learning_rate)
        for group in optimizer.param_groups:
            group['lr'] = rate
        batch = demonstrations.sample(settings.batch, rng)
        with torch.autocast(device.type, torch.bfloat16, enabled=mixed):
            loss = denoising_loss(policy, batch, settings.noises, rng)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(policy.parameters(), GRADIENT_NORM)
        optimizer.step()
        ema.update(policy)
        recent = [*recent[-99:], float(loss.detach())]
        if step % 50 == 0:
            log.write(step, loss=float(np.mean(recent)), learning_rate=rate)
        if (step + 1) % CHECKPOINT_EVERY == 0:
            save_checkpoint(folder, step + 1, policy, ema, optimizer, asdict(settings))
    log.close()
    ema.copy_to(policy)
    return float(np.mean(recent))


def denoising_loss(
    policy: DiffusionPolicy, batch: Batch, noises: int, rng: np.random.Generator
) -> Tensor:
    """Return the denoising loss of a batch, each map with several noises and diffusion steps."""
    device = next(policy.parameters()).device
    config = policy.config
    count = noises * len(batch.maps)
    beliefs = np.zeros(batch.maps[:, 0].shape, dtype=np.float32)
    beliefs[np.arange(len(beliefs)), batch.cells[:, 0], batch.cells[:, 1]] = 1.0
    noise = rng.standard_normal((count, NUM_BITS, config.horizon), dtype=np.float32)
    step = rng.integers(config.diffusion_steps, size=count)
    arrays = (batch.maps, beliefs, batch.actions[:, : config.horizon], noise, step)
    return policy.loss(*(torch.from_numpy(array).to(device) for array in arrays))
