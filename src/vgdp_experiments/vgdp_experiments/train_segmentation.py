"""Trains the segmentation of RGB-D frames on views of synthetic homes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from bev_mapper.segmentation.learned import save_network
from bev_mapper.segmentation.network import NetworkConfig, PixelNetwork
from gridnav.rgbd import CLASSES, UNLABELLED
from vgdp_experiments.home_views import Views
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.parallel import Team, training_team
from vgdp_experiments.preset_settings import require_positive
from vgdp_experiments.spoiled_views import spoil
from vgdp_experiments.train_policy import PRECISIONS
from vgdp_experiments.training import optimise

if TYPE_CHECKING:
    import argparse

    from numpy.typing import NDArray
    from torch import Tensor

FREE = ('ceiling', 'floor')
"""Classes that are no obstacles."""

FREE_WEIGHT = 0.5
"""What it counts that free is told from obstacle, besides telling the classes."""

RARE = 0.01
"""Classes count by one over the square root of how frequent they are plus this."""


@dataclass(frozen=True)
class SegmentationTraining:
    """Settings of a training run.

    Attributes:
        views: Folder of `vgdp data homes-views`.
        out: Folder for weights, logs and checkpoints.
        seed: Of everything random.
        steps: Optimisation steps.
        batch: Views of a step, those of all processes together.
        learning_rate: Initial learning rate; it falls to zero over the second half.
        weight_decay: Weight decay, decoupled from the gradients.
        ema: Decay of the averaged weights.
        device: Where to train: 'cpu', 'cuda' for a GPU, or 'auto' for a GPU where there is one.
        precision: 'float32', 'bfloat16' for mixed precision, or 'auto' for the latter.
        checkpoint_every: Steps between two checkpoints.
        threads: CPU threads of each process.
    """

    views: str = 'runs/homes-views'
    out: str = 'runs/segmentation'
    seed: int = 0
    steps: int = 4000
    batch: int = 16
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    ema: float = 0.995
    device: str = 'auto'
    precision: str = 'auto'
    checkpoint_every: int = 250
    threads: int = 2

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self, ('steps', 'batch', 'checkpoint_every', 'threads'))
        if self.precision not in PRECISIONS:
            msg = f'The precision is one of {", ".join(PRECISIONS)}, got {self.precision!r}.'
            raise ValueError(msg)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, SegmentationTraining)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    settings = read_settings(SegmentationTraining, arguments)
    torch.set_num_threads(settings.threads)
    views = Views(Path(settings.views))
    with training_team(settings.device) as team:
        torch.manual_seed(settings.seed)
        config = NetworkConfig()
        network = PixelNetwork(config).to(team.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        losses = train(network, views, settings, team)
        if team.leads:
            record = {**asdict(settings), 'homes': asdict(views.settings), 'losses': losses}
            save_network(Path(settings.out), config, network.state_dict(), record)
            print(f'Weights written to {settings.out}.')  # noqa: T201
    return 0


def train(
    network: PixelNetwork, views: Views, settings: SegmentationTraining, team: Team
) -> dict[str, float]:
    """Train a network in place; returns the last losses, averaged over a hundred steps."""
    objective = SegmentationLoss(network, class_weights(views)).to(team.device)
    return optimise(
        network,
        objective,
        lambda step: [batch(views, settings, team, step)],
        settings,
        team,
        weight_decay=settings.weight_decay,
        mixed=settings.precision != 'float32',
    )


def class_weights(views: Views) -> Tensor:
    """Return what each class counts, 1 on the average of all pixels, (13,)."""
    counts = np.bincount(views.labels.reshape(-1), minlength=UNLABELLED + 1)[: len(CLASSES)]
    shares = counts / counts.sum()
    weights = 1.0 / np.sqrt(shares + RARE)
    return torch.from_numpy(weights / (weights * shares).sum()).float()


class SegmentationLoss(nn.Module):
    """Cross-entropy of the classes, and of free against obstacle."""

    def __init__(self, network: PixelNetwork, weights: Tensor) -> None:
        super().__init__()
        self.network = network
        self.weights: Tensor
        self.register_buffer('weights', weights, persistent=False)
        free = torch.tensor([name in FREE for name in CLASSES])
        self.is_free: Tensor
        self.register_buffer('is_free', free, persistent=False)

    def forward(self, seen: Tensor, labels: Tensor) -> dict[str, Tensor]:
        """Return the losses for what is seen (B, 9, H, W) with true classes (B, H, W)."""
        scores = self.network(seen).float()
        known = labels != UNLABELLED
        classes = functional.cross_entropy(scores, labels, self.weights, ignore_index=UNLABELLED)
        log_odds = scores[:, self.is_free].logsumexp(1) - scores[:, ~self.is_free].logsumexp(1)
        truth = self.is_free[labels.clamp(max=len(CLASSES) - 1)].float()
        free = functional.binary_cross_entropy_with_logits(log_odds[known], truth[known])
        return {'classes': classes, 'free': FREE_WEIGHT * free}


def batch(
    views: Views, settings: SegmentationTraining, team: Team, step: int
) -> tuple[Tensor, Tensor]:
    """Return what this process sees at a step and the true classes.

    Everything is drawn for all processes alike and then dealt out; each view is seen once before
    any is seen again.
    """
    first = step * settings.batch
    part = range(first, first + settings.batch)[team.share(0, settings.batch)]
    samples = []
    for index in part:
        epoch, place = divmod(index, len(views))
        order = _order(len(views), settings.seed, epoch)
        rng = np.random.default_rng([settings.seed, 8, index])
        samples.append(spoil(views[int(order[place])], rng))
    seen = torch.from_numpy(np.stack([sample.seen for sample in samples]))
    labels = torch.from_numpy(np.stack([sample.labels for sample in samples])).long()
    return (
        seen.to(team.device, memory_format=torch.channels_last),
        labels.to(team.device),
    )


@lru_cache(maxsize=2)
def _order(count: int, seed: int, epoch: int) -> NDArray[np.int64]:
    """Return the order in which views are seen."""
    return np.random.default_rng([seed, 7, epoch]).permutation(count)
