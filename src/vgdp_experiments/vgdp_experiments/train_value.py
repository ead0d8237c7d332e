"""Trains the default preset's value function and belief filter.

The rules of the world come first (`train_dynamics`). What unseen space is worth is learned in
rounds of policy iteration: an explorer steps greedily on the values of an earlier round, what
finding the goal cost it is noted (`rollouts`), and the network learns to tell the better of the
choices that were tried. Exploring goes on beside the training, a round ahead of it.
"""

from __future__ import annotations

from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from tqdm import tqdm

from maze_sim import make_mazes
from vgdp_experiments.labels import Labels
from vgdp_experiments.map_codes import unpack
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.rollouts import ExplorationSteps, explore
from vgdp_experiments.train_dynamics import train_dynamics
from vgdp_experiments.training import (
    Ema,
    TrainingLog,
    ValueParts,
    learning_rate,
    load_checkpoint,
    save_checkpoint,
)
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.config import preset
from vgdp_planner.value import ValueNetwork
from vgdp_planner.weights import load_part, save_weights

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from torch import Tensor

EXPLORED_AT_ONCE = 128
ROUNDS_KEPT = 4
"""Explorations of so many rounds are learned from, the newest among them."""

AHEAD = 2
"""The explorer of a round steps on the values that were learned up to so many rounds earlier."""

DECAY_ROUNDS = 2
"""The learning rate falls to zero over so many rounds at the end."""

GRADIENT_NORM = 1.0
TURNED_SHARE = 0.5
COMPARED_SHARE = 0.3
"""Share of a batch where several choices were tried."""

USUAL_SIZE = 15
"""Side of the maps that the numbers of mazes and samples are meant for; larger maps get fewer."""


@dataclass(frozen=True)
class TrainingWorld:
    """A kind of world to explore.

    Attributes:
        kind: One of `maze_sim.WORLD_KINDS`.
        size: Side in cells.
        view_range: Cells that the robot sees to each side.
        share: Share of the optimisation steps.
    """

    kind: str
    size: int
    view_range: int
    share: float

    @property
    def name(self) -> str:
        """Kind, side and view range."""
        return f'{self.kind}-{self.size}-view{self.view_range}'

    @property
    def fraction(self) -> float:
        """How many maps of this size count as one of the usual size, inverted."""
        return (USUAL_SIZE / self.size) ** 2


WORLDS = (
    TrainingWorld('maze', 15, 1, 0.10),
    TrainingWorld('maze', 15, 2, 0.18),
    TrainingWorld('maze', 15, 3, 0.10),
    TrainingWorld('maze', 20, 2, 0.14),
    TrainingWorld('maze', 30, 2, 0.28),
    TrainingWorld('loops', 15, 2, 0.05),
    TrainingWorld('rooms', 20, 2, 0.04),
    TrainingWorld('rooms', 24, 3, 0.03),
    TrainingWorld('caves', 20, 2, 0.04),
    TrainingWorld('obstacles', 20, 2, 0.04),
)


@dataclass(frozen=True)
class ValueTraining:
    """Settings of a training run.

    Attributes:
        out: Folder for weights, logs, explorations and checkpoints.
        initial: Folder with weights to go on from, whose rules of the world are kept; none if
            empty.
        objective: What choices are compared by, success, spl or expert.
        patience: After so many sides of the map a success counts e times less, but for spl.
        worlds: Names of the worlds, such as maze-15-view2, separated by commas; all if empty.
        seed: Of everything random.
        dynamics_steps: Optimisation steps on the rules of the world.
        rounds: Rounds of exploring and learning.
        mazes: Worlds of the usual size that are explored in each round.
        branches: Steps of each world where other choices are tried, too.
        steps: Optimisation steps of a round.
        batch: Samples of a step, of the usual size.
        learning_rate: Initial learning rate; it falls to zero over the last rounds.
        ema: Decay of the averaged weights.
        workers: Processes that explore.
        threads: CPU threads of the training.
    """

    out: str = 'runs/value'
    initial: str = ''
    objective: str = Labels.objective
    patience: float = Labels.patience
    worlds: str = ''
    seed: int = 0
    dynamics_steps: int = 3000
    rounds: int = 6
    mazes: int = 1024
    branches: int = 4
    steps: int = 1800
    batch: int = 128
    learning_rate: float = 1e-3
    ema: float = 0.998
    workers: int = 2
    threads: int = 1


def chosen_worlds(names: str) -> list[TrainingWorld]:
    """Return worlds by their names, separated by commas; all if empty. The shares add up to 1.

    Raises:
        ValueError: If there is none of a name.
    """
    known = {world.name: world for world in WORLDS}
    chosen = [name for name in names.split(',') if name] or list(known)
    for name in chosen:
        if name not in known:
            msg = f'There is no world {name!r} to train in; there are {", ".join(known)}.'
            raise ValueError(msg)
    worlds = [known[name] for name in chosen]
    total = sum(world.share for world in worlds)
    return [replace(world, share=world.share / total) for world in worlds]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, ValueTraining)


def run(arguments: argparse.Namespace) -> int:
    """Train and write the weights; returns the exit code.

    Raises:
        ValueError: If the settings can't be used.
    """
    settings = read_settings(ValueTraining, arguments)
    chosen_worlds(settings.worlds)
    Labels(settings.objective, settings.patience)
    torch.set_num_threads(settings.threads)
    torch.manual_seed(settings.seed)
    config = preset('default')
    both = ValueParts(ValueNetwork(config.value), BeliefFilter())
    if settings.initial:
        both.value.load_state_dict(load_part(settings.initial, 'value')[1])
        both.belief.load_state_dict(load_part(settings.initial, 'belief')[1])
    losses = train(both, settings)
    training = {'value': {**asdict(settings), 'losses': losses}}
    save_weights(Path(settings.out), config, both.state_dict(), training)
    print(f'Value function written to {settings.out}.')  # noqa: T201
    return 0


def train(both: ValueParts, settings: ValueTraining) -> dict[str, float]:
    """Train in place; returns the last losses.

    A run that was stopped goes on from the last round that it finished.
    """
    folder = Path(settings.out)
    folder.mkdir(parents=True, exist_ok=True)
    network = both.value
    worth_parameters = [
        *network.trunk.parameters(),
        *network.unseen_worth.parameters(),
        *network.unseen_level.parameters(),
    ]
    optimizer = torch.optim.AdamW(worth_parameters, lr=settings.learning_rate, weight_decay=1e-2)
    ema = Ema(both, settings.ema)
    initial = {name: tensor.clone() for name, tensor in both.state_dict().items()}
    done = load_checkpoint(folder, both, ema, optimizer, asdict(settings))
    losses: dict[str, float] = {}
    if settings.initial:
        save_file(initial, folder / _INITIAL_WEIGHTS)
    with ProcessPoolExecutor(settings.workers, get_context('spawn')) as pool:
        explorations = [
            Exploration(pool, folder, settings, number) for number in range(settings.rounds)
        ]
        for number in range(done // settings.steps, settings.rounds):
            for one in explorations[max(0, number - ROUNDS_KEPT + 1) : number + AHEAD]:
                one.begin()
            if number == 0 and not settings.initial:
                losses = train_dynamics(
                    network, both.belief, settings.dynamics_steps, settings.seed
                )
                ema = Ema(both, settings.ema)
            kept = explorations[max(0, number - ROUNDS_KEPT + 1) : number + 1]
            samples = [
                ExplorationSteps.joined(of_world)
                for of_world in zip(*(one.samples() for one in kept), strict=True)
            ]
            losses |= _train_round(both, ema, optimizer, samples, settings, number)
            save_checkpoint(
                folder, (number + 1) * settings.steps, both, ema, optimizer, asdict(settings)
            )
            save_file(ema.average, folder / _WEIGHTS_OF_ROUND.format(number))
    ema.copy_to(both)
    return losses


_INITIAL_WEIGHTS = 'initial.safetensors'
_WEIGHTS_OF_ROUND = 'round_{}.safetensors'
_SAMPLES_OF_ROUND = 'round_{}_world_{}.npz'


class Exploration:
    """The exploration of one round, in other processes, kept in files for runs that go on.

    Args:
        pool: Its processes explore.
        folder: Of the training run.
        settings: Of the training run.
        number: Of the round.
    """

    def __init__(
        self, pool: ProcessPoolExecutor, folder: Path, settings: ValueTraining, number: int
    ) -> None:
        self._pool, self._folder = pool, folder
        self._settings, self._number = settings, number
        self._worlds = chosen_worlds(settings.worlds)
        self._parts: list[list[Future[ExplorationSteps]]] = []
        self._samples: list[ExplorationSteps] = []

    def _files(self) -> list[Path]:
        return [
            self._folder / _SAMPLES_OF_ROUND.format(self._number, world)
            for world in range(len(self._worlds))
        ]

    def begin(self) -> None:
        """Begin to explore, unless that was done."""
        if self._parts or self._samples or all(file.exists() for file in self._files()):
            return
        settings = self._settings
        weights = str(self._folder / _INITIAL_WEIGHTS) if settings.initial else None
        if self._number >= AHEAD:
            weights = str(self._folder / _WEIGHTS_OF_ROUND.format(self._number - AHEAD))
        labels = Labels(settings.objective, settings.patience)
        for index, world in enumerate(self._worlds):
            count = max(1, round(settings.mazes * world.share * world.fraction))
            at_once = max(1, int(EXPLORED_AT_ONCE * world.fraction))
            self._parts.append(
                [
                    self._pool.submit(
                        explore_part,
                        world,
                        min(at_once, count - first),
                        [settings.seed, 3, self._number, index, first],
                        settings.branches,
                        weights,
                        labels,
                    )
                    for first in range(0, count, at_once)
                ]
            )

    def samples(self) -> list[ExplorationSteps]:
        """Return what was explored, for each kind of world; waits until all is there."""
        if not self._samples and not self._parts:
            self._samples = [_load_steps(file) for file in self._files()]
        if not self._samples:
            total = sum(len(parts) for parts in self._parts)
            with tqdm(total=total, desc=f'exploring for round {self._number + 1}') as progress:
                for file, parts in zip(self._files(), self._parts, strict=True):
                    found = []
                    for part in parts:
                        found.append(part.result())
                        progress.update()
                    self._samples.append(ExplorationSteps.joined(found))
                    _save_steps(file, self._samples[-1])
        return self._samples


def explore_part(
    world: TrainingWorld,
    count: int,
    seed: Sequence[int],
    branches: int,
    weights: str | None,
    labels: Labels,
) -> ExplorationSteps:
    """Explore some worlds of a kind, stepping on the weights of a file or to what is nearest."""
    torch.set_num_threads(1)
    network = None
    if weights is not None:
        prefix = 'value.'
        network = ValueNetwork(preset('default').value)
        tensors = load_file(weights)
        network.load_state_dict(
            {
                name.removeprefix(prefix): tensor
                for name, tensor in tensors.items()
                if name.startswith(prefix)
            }
        )
    rng = np.random.default_rng(seed)
    worlds = make_mazes(count, world.size, int(rng.integers(2**40, 2**62)), kind=world.kind)
    return explore(worlds, network, world.view_range, branches, rng, labels)


def _save_steps(file: Path, steps: ExplorationSteps) -> None:
    partial = file.with_suffix('.part.npz')
    np.savez_compressed(
        partial, **{item.name: getattr(steps, item.name) for item in fields(steps)}
    )
    partial.replace(file)


def _load_steps(file: Path) -> ExplorationSteps:
    with np.load(file) as arrays:
        return ExplorationSteps(*(arrays[item.name] for item in fields(ExplorationSteps)))


def _train_round(
    both: ValueParts,
    ema: Ema,
    optimizer: torch.optim.Optimizer,
    samples: Sequence[ExplorationSteps],
    settings: ValueTraining,
    number: int,
) -> dict[str, float]:
    """Train on the explorations of a round; returns the last losses."""
    batches = [WorldBatches(of_world) for of_world in samples]
    rng = np.random.default_rng([settings.seed, 2, number])
    worlds = chosen_worlds(settings.worlds)
    shares = [world.share for world in worlds]
    parameters = [item for group in optimizer.param_groups for item in group['params']]
    steps = range(number * settings.steps, (number + 1) * settings.steps)
    # The rate falls in the second half of what it is told about.
    decay = DECAY_ROUNDS * settings.steps
    constant = settings.rounds * settings.steps - 2 * decay
    losses: dict[str, float] = {}
    log = TrainingLog(
        Path(settings.out), ['step', 'level', 'differences', 'regret', 'learning_rate']
    )
    for step in tqdm(steps, desc=f'worth, round {number + 1}', unit='step'):
        rate = learning_rate(step - constant, 2 * decay, settings.learning_rate)
        for group in optimizer.param_groups:
            group['lr'] = rate
        index = int(rng.choice(len(worlds), p=shares))
        size = max(1, round(settings.batch * worlds[index].fraction))
        terms = worth_losses(both.value, batches[index].draw(size, rng))
        optimizer.zero_grad()
        (terms['level'] + terms['differences']).backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(parameters, GRADIENT_NORM)
        optimizer.step()
        ema.update(both)
        losses = {name: float(term.detach()) for name, term in terms.items()}
        if step % 50 == 0:
            log.write(step, **losses, learning_rate=rate)
    log.close()
    return losses


class WorldBatches:
    """Draws batches of the explorations of one kind of world, turned and mirrored at random."""

    def __init__(self, samples: ExplorationSteps) -> None:
        compared = np.isfinite(samples.distances).sum(axis=1) > 1
        self._samples = samples
        self._kinds = [np.flatnonzero(compared), np.flatnonzero(~compared)]

    def draw(self, size: int, rng: np.random.Generator) -> ExplorationSteps:
        """Draw a batch, with the given share of steps where choices were compared."""
        first = round(size * COMPARED_SHARE)
        rows = np.concatenate(
            [
                rng.choice(kind, count)
                for kind, count in zip(self._kinds, (first, size - first), strict=True)
                if len(kind)
            ]
        )
        return turned(self._samples.take(rows), rng)


def turned(samples: ExplorationSteps, rng: np.random.Generator) -> ExplorationSteps:
    """Turn and mirror maps (N, H, W) together with the targets on them, all alike."""
    codes, targets = samples.codes, samples.targets
    swap, flip_rows, flip_cols = rng.random(3) < TURNED_SHARE
    if swap:
        codes, targets = codes.transpose(0, 2, 1), targets[..., ::-1]
    height, width = codes.shape[1:]
    if flip_rows:
        codes, targets = codes[:, ::-1], targets * [-1, 1] + [height - 1, 0]
    if flip_cols:
        codes, targets = codes[:, :, ::-1], targets * [1, -1] + [0, width - 1]
    return ExplorationSteps(
        np.ascontiguousarray(codes),
        np.ascontiguousarray(targets),
        samples.distances,
        samples.successes,
        samples.patiences,
        samples.weights,
    )


def worth_losses(network: ValueNetwork, samples: ExplorationSteps) -> dict[str, Tensor]:
    """Return the losses of what the unseen is worth, τ log(success) with the patience τ.

    'level' is the Poisson deviance of the successes, whose minimum is at their mean.
    'differences' is the cross-entropy of the successes that each of several choices would have
    brought, seen from where the explorer stood: it tells the better ones from the others. 'regret'
    is no loss to train on: the share of the success that the network's choices miss.

    Args:
        network: The value network.
        samples: A batch.
    """
    count = len(samples)
    scale = torch.from_numpy(samples.patiences)[:, None]
    with torch.autocast('cpu', dtype=torch.bfloat16):
        worth, level = network.worth_and_level(torch.from_numpy(unpack(samples.codes)))
    targets, distances = torch.from_numpy(samples.targets), torch.from_numpy(samples.distances)
    worth_there = worth.float()[torch.arange(count)[:, None], targets[..., 0], targets[..., 1]]
    successes = torch.from_numpy(samples.successes)
    tried = distances.isfinite()
    several = tried.sum(dim=1) > 1
    weights = torch.from_numpy(samples.weights)

    logarithms = (worth_there + level.float()[:, None]) / scale
    deviances = torch.where(tried, logarithms.exp() - successes * logarithms, 0.0)
    level_loss = deviances.sum(dim=1) / tried.sum(dim=1)

    looks = torch.where(tried, worth_there - distances, -torch.inf)
    from_here = torch.where(tried, successes * torch.exp(-distances / scale), 0.0)
    chances = torch.where(tried, torch.log_softmax(looks / scale, dim=1), 0.0)
    differences = -(from_here * chances).sum(dim=1)
    chosen = from_here.gather(1, looks.argmax(dim=1, keepdim=True))[:, 0]
    missed = (
        1 - (weights * chosen)[several].sum() / (weights * from_here.amax(dim=1))[several].sum()
    )
    return {
        'level': (weights * level_loss).sum() / weights.sum(),
        'differences': (weights * differences)[several].sum() / weights.sum(),
        'regret': missed,
    }
