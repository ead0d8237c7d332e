"""What training the learned methods of the search has in common."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.parallel import Team, training_team
from vgdp_experiments.preset_settings import require_positive
from vgdp_experiments.search.learned.batches import HomeBatches
from vgdp_experiments.search.learned.demonstrations import load_homes
from vgdp_experiments.training import optimise

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from torch import Tensor, nn


@dataclass(frozen=True)
class SearchTraining:
    """Settings of a training run.

    Attributes:
        data: Folder of `vgdp data homes-expert`.
        leave_out: Names of homes that are not trained on, with commas between them: with the one
            that is evaluated left out in turn, this is cross-validation over scenes.
        initial: Folder with weights to begin with; those that come with the package if empty.
        out: Folder for weights, logs and checkpoints.
        seed: Of everything random.
        steps: Optimisation steps.
        batch: Decisions of a step.
        learning_rate: Initial learning rate; it falls to zero over the second half.
        ema: Decay of the averaged weights.
        device: Where to train; one process on 'cpu' is what this is made for.
        checkpoint_every: Steps between two checkpoints.
        threads: CPU threads.
    """

    data: str = 'runs/homes-expert'
    leave_out: str = ''
    initial: str = ''
    out: str = 'runs/search'
    seed: int = 0
    steps: int = 600
    batch: int = 16
    learning_rate: float = 5e-4
    ema: float = 0.99
    device: str = 'cpu'
    checkpoint_every: int = 100
    threads: int = 2

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self, ('steps', 'batch', 'checkpoint_every', 'threads'))


def add_arguments(parser: argparse.ArgumentParser, defaults: SearchTraining) -> None:
    """Add the settings as options, with the defaults of a method."""
    add_settings(parser, SearchTraining)
    parser.set_defaults(**asdict(defaults))


def train_networks(
    arguments: argparse.Namespace,
    begin: Callable[[SearchTraining], tuple[nn.Module, nn.Module]],
    inputs: Callable[[HomeBatches, SearchTraining, int], Sequence[tuple[Tensor, ...]]],
    save: Callable[[Any, Path, dict[str, Any]], None],
) -> int:
    """Train a method as the options say and write its weights; returns the exit code.

    Args:
        arguments: Of the command.
        begin: Returns the networks as training begins, and their losses.
        inputs: Returns what the losses are called with at a step, for each pass of it.
        save: Writes the networks, with how they came about, into a folder.
    """
    settings = read_settings(SearchTraining, arguments)
    torch.set_num_threads(settings.threads)
    leave_out = [name for name in settings.leave_out.split(',') if name]
    batches = HomeBatches(load_homes(Path(settings.data), leave_out))
    with training_team(settings.device) as team:
        _require_one(team)
        torch.manual_seed(settings.seed)
        networks, objective = begin(settings)
        networks.to(team.device)
        begun = time.process_time()
        losses = optimise(
            networks, objective, lambda step: inputs(batches, settings, step), settings, team
        )
        minutes = (time.process_time() - begun) / 60
    save(networks, Path(settings.out), _record(settings, batches, losses, minutes))
    print(f'Weights written to {settings.out}, after {minutes:.1f} CPU minutes.')  # noqa: T201
    return 0


def _require_one(team: Team) -> None:
    if team.size > 1:
        msg = f'The methods of the search are trained by one process, not by {team.size}.'
        raise ValueError(msg)


def _record(
    settings: SearchTraining, batches: HomeBatches, losses: dict[str, float], minutes: float
) -> dict[str, Any]:
    """Return how weights came about, for the record."""
    first = batches.homes[0].settings
    same = ('episodes', 'seed', 'width', 'min_expert_steps', 'max_steps')
    return {
        # Where things lie on a machine plays no part.
        **asdict(settings),
        'data': Path(settings.data).name,
        'out': Path(settings.out).name,
        'initial': Path(settings.initial).name,
        'homes': [home.name for home in batches.homes],
        'decisions': sum(map(len, batches.homes)),
        'demonstrations': {name: first[name] for name in same},
        'cpu_minutes': round(minutes, 1),
        'losses': losses,
    }
