"""Trains the value function and the belief filter.

The default preset learns the rules of the world first (`train_dynamics`), then, in rounds of
policy iteration, what unseen space is worth: it explores mazes greedily on its own values and
regresses on what finding the goal did cost from there. The paper's preset learns everything from
expert demonstrations.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn
from torch.nn import functional
from tqdm import tqdm

from vgdp_experiments.data import load_demonstrations
from vgdp_experiments.map_codes import unpack
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.rollouts import ExplorationSteps, explore
from vgdp_experiments.train_dynamics import motion_loss, train_dynamics
from vgdp_experiments.training import (
    Ema,
    TrainingLog,
    learning_rate,
    load_checkpoint,
    save_checkpoint,
)
from vgdp_experiments.worlds import training_maze
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.config import Config, preset
from vgdp_planner.value import WORTH_SCALE, ValueNetwork
from vgdp_planner.weights import save_weights

if TYPE_CHECKING:
    import argparse

    from numpy.typing import NDArray
    from torch import Tensor

EXPLORATION_GROUPS = ((15, 1), (15, 2), (15, 2), (15, 3), (12, 2), (20, 2))
"""(size, view range) of the mazes of a round, one share each."""

EXPLORED_AT_ONCE = 256
CHECKPOINT_EVERY = 500
GRADIENT_NORM = 1.0
TURNED_SHARE = 0.5


@dataclass(frozen=True)
class ValueTraining:
    """Settings of a training run.

    Attributes:
        preset: Which preset to train.
        out: Folder for weights, logs and checkpoints.
        seed: Of everything random.
        dynamics_steps: Optimisation steps on the rules of the world (default preset).
        rounds: Rounds of exploring and regressing (default preset).
        mazes: Mazes that are explored in each round (default preset).
        steps: Optimisation steps of a round; of the whole training for the paper's preset.
        batch: Samples of a step.
        learning_rate: Initial learning rate; it falls to zero over the last round.
        ema: Decay of the averaged weights.
        data: Expert demonstrations (the paper's preset).
        threads: CPU threads.
    """

    preset: str = 'default'
    out: str = 'runs/value'
    seed: int = 0
    dynamics_steps: int = 3000
    rounds: int = 3
    mazes: int = 3072
    steps: int = 2000
    batch: int = 128
    learning_rate: float = 1e-3
    ema: float = 0.995
    data: str = 'runs/demonstrations.npz'
    threads: int = 2


class ValueParts(nn.Module):
    """The value network and the belief filter, which are trained and kept together."""

    def __init__(self, value: ValueNetwork, belief: BeliefFilter) -> None:
        super().__init__()
        self.value = value
        self.belief = belief


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, ValueTraining)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code."""
    settings = read_settings(ValueTraining, arguments)
    torch.set_num_threads(settings.threads)
    torch.manual_seed(settings.seed)
    config = preset(settings.preset)
    network, belief_filter = ValueNetwork(config.value), BeliefFilter()
    boundary = config.value.unseen == 'boundary'
    train = train_from_exploration if boundary else train_from_demonstrations
    scores = train(network, belief_filter, settings)
    write_value(Path(settings.out), config, network, belief_filter, settings, scores)
    print(f'Value function written to {settings.out}.')  # noqa: T201
    return 0


def write_value(
    folder: Path,
    config: Config,
    network: ValueNetwork,
    belief_filter: BeliefFilter,
    settings: ValueTraining,
    scores: dict[str, float],
) -> None:
    """Write the trained value function and belief filter."""
    tensors = ValueParts(network, belief_filter).state_dict()
    save_weights(folder, config, tensors, {'value': {**asdict(settings), 'losses': scores}})


def train_from_exploration(
    network: ValueNetwork, belief_filter: BeliefFilter, settings: ValueTraining
) -> dict[str, float]:
    """Train the default preset in place; returns the last losses."""
    folder = Path(settings.out)
    folder.mkdir(parents=True, exist_ok=True)
    worth_parameters = [
        *network.trunk.parameters(),
        *network.unseen_worth.parameters(),
        *network.unseen_level.parameters(),
    ]
    optimizer = torch.optim.AdamW(worth_parameters, lr=settings.learning_rate, weight_decay=1e-2)
    both = ValueParts(network, belief_filter)
    ema = Ema(both, settings.ema)
    done = load_checkpoint(folder, both, ema, optimizer, asdict(settings))
    losses: dict[str, float] = {}
    if done == 0:
        losses = train_dynamics(network, belief_filter, settings.dynamics_steps, settings.seed)
        ema = Ema(both, settings.ema)
    log = TrainingLog(folder, ['step', 'loss', 'mean_cost', 'learning_rate'])
    explorer = ValueNetwork(network.config)
    for round_index in range(done // settings.steps, settings.rounds):
        explorer.load_state_dict(
            {
                name.removeprefix('value.'): value
                for name, value in ema.average.items()
                if name.startswith('value.')
            }
        )
        samples = _explore_groups(explorer, settings, round_index)
        mean_cost = float(np.concatenate([group.costs for group in samples]).mean())
        first = max(done, round_index * settings.steps)
        rng = np.random.default_rng([settings.seed, 2, round_index, first])
        progress = tqdm(
            range(first, (round_index + 1) * settings.steps),
            desc=f'worth, round {round_index + 1} of {settings.rounds}',
            unit='step',
        )
        for step in progress:
            rate = learning_rate(step, settings.rounds * settings.steps, settings.learning_rate)
            for group in optimizer.param_groups:
                group['lr'] = rate
            loss = worth_loss(network, samples[rng.integers(len(samples))], settings.batch, rng)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(worth_parameters, GRADIENT_NORM)
            optimizer.step()
            ema.update(both)
            if step % 50 == 0:
                log.write(step, loss=float(loss.detach()), mean_cost=mean_cost, learning_rate=rate)
            if (step + 1) % CHECKPOINT_EVERY == 0:
                save_checkpoint(folder, step + 1, both, ema, optimizer, asdict(settings))
            losses['worth'] = float(loss.detach())
        losses['mean_cost'] = mean_cost
    log.close()
    ema.copy_to(both)
    return losses


def _explore_groups(
    explorer: ValueNetwork, settings: ValueTraining, round_index: int
) -> list[ExplorationSteps]:
    """Explore the mazes of a round with the averaged network, one group for each kind of maze."""
    share = max(1, settings.mazes // len(EXPLORATION_GROUPS))
    samples = []
    with tqdm(
        total=share * len(EXPLORATION_GROUPS),
        desc=f'exploring, round {round_index + 1} of {settings.rounds}',
        unit='maze',
    ) as progress:
        for number, (size, view_range) in enumerate(EXPLORATION_GROUPS):
            for begin in range(0, share, EXPLORED_AT_ONCE):
                rng = np.random.default_rng([settings.seed, 3, round_index, number, begin])
                count = min(EXPLORED_AT_ONCE, share - begin)
                mazes = [training_maze(size, rng) for _ in range(count)]
                samples.append(explore(mazes, explorer, view_range, rng))
                progress.update(count)
    return samples


def worth_loss(
    network: ValueNetwork, samples: ExplorationSteps, batch: int, rng: np.random.Generator
) -> Tensor:
    """Return the Huber loss of the worth of where the explorer was heading to.

    The maps are turned and mirrored at random.
    """
    chosen = rng.integers(len(samples.codes), size=batch)
    codes, targets = _turned(samples.codes[chosen], samples.targets[chosen], rng)
    worth = network.worth_of_unseen(torch.from_numpy(unpack(codes)))
    rows, cols = torch.from_numpy(targets).T
    predicted = worth[torch.arange(batch), rows, cols] / WORTH_SCALE
    actual = -torch.from_numpy(samples.costs[chosen]) / WORTH_SCALE
    weights = torch.from_numpy(samples.weights[chosen])
    errors = functional.huber_loss(predicted, actual, reduction='none', delta=0.5)
    return (weights * errors).sum() / weights.sum().clamp_min(1e-6)


def _turned(
    codes: NDArray[np.uint8], cells: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Turn and mirror square maps (N, H, H) together with cells (N, 2), all alike."""
    last = codes.shape[1] - 1
    swap, flip_rows, flip_cols = rng.random(3) < TURNED_SHARE
    if swap:
        codes, cells = codes.transpose(0, 2, 1), cells[:, ::-1]
    if flip_rows:
        codes, cells = codes[:, ::-1], cells * [-1, 1] + [last, 0]
    if flip_cols:
        codes, cells = codes[:, :, ::-1], cells * [1, -1] + [0, last]
    return np.ascontiguousarray(codes), np.ascontiguousarray(cells)


def train_from_demonstrations(
    network: ValueNetwork, belief_filter: BeliefFilter, settings: ValueTraining
) -> dict[str, float]:
    """Train the paper's preset in place; returns the last losses.

    The loss is the cross-entropy of the expert's action under Â_logit and under Q(b, a), as the
    appendix says; the expert's own moves train the motion models.
    """
    demonstrations = load_demonstrations(Path(settings.data))
    folder = Path(settings.out)
    folder.mkdir(parents=True, exist_ok=True)
    both = ValueParts(network, belief_filter)
    optimizer = torch.optim.RAdam(both.parameters(), lr=settings.learning_rate)
    ema = Ema(both, settings.ema)
    done = load_checkpoint(folder, both, ema, optimizer, asdict(settings))
    log = TrainingLog(folder, ['step', 'mask', 'action', 'motion', 'filter_motion'])
    losses: dict[str, float] = {}
    for step in tqdm(range(done, settings.steps), desc='value', unit='step'):
        rng = np.random.default_rng([settings.seed, 4, step])
        batch = demonstrations.sample(settings.batch, rng)
        terms = demonstration_losses(both, batch.maps, batch.cells, batch.actions[:, 0])
        optimizer.zero_grad()
        torch.stack(list(terms.values())).sum().backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        ema.update(both)
        losses = {name: float(term.detach()) for name, term in terms.items()}
        if step % 50 == 0:
            log.write(step, **losses)
        if (step + 1) % CHECKPOINT_EVERY == 0:
            save_checkpoint(folder, step + 1, both, ema, optimizer, asdict(settings))
    log.close()
    ema.copy_to(both)
    return losses


def demonstration_losses(
    both: ValueParts,
    maps: NDArray[np.float32],
    cells: NDArray[np.int64],
    actions: NDArray[np.int64],
) -> dict[str, Tensor]:
    """Return the losses of the paper's value function on demonstrations.

    Args:
        both: The value network and the belief filter.
        maps: (N, 3, H, W).
        cells: (N, 2).
        actions: The expert's actions, (N,).
    """
    network, belief_filter = both.value, both.belief
    map_tensor, expert = torch.from_numpy(maps), torch.from_numpy(actions)
    rows, cols = torch.from_numpy(cells).T
    here = torch.arange(len(maps)), slice(None), rows, cols
    logits, _ = network.action_logits(map_tensor)
    values = network(map_tensor)
    return {
        'mask': functional.cross_entropy(logits[here], expert),
        'action': functional.cross_entropy(values.q_values[here], expert),
        'motion': motion_loss(network.motion),
        'filter_motion': motion_loss(belief_filter.motion),
    }
