"""What training commands share: the loop, averaged weights, logs, checkpoints to go on from."""

from __future__ import annotations

import csv
import json
import math
from collections import deque
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from safetensors.torch import load_file, save_file
from torch import nn
from torch.nn.parallel import DistributedDataParallel
from tqdm import tqdm

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from torch import Tensor

    from vgdp_experiments.parallel import Team
    from vgdp_experiments.search.learned.training import SearchTraining
    from vgdp_experiments.train_calvin import CalvinTraining
    from vgdp_experiments.train_policy import PolicyTraining
    from vgdp_experiments.train_segmentation import SegmentationTraining
    from vgdp_experiments.train_value_paper import PaperValueTraining
    from vgdp_planner.belief import BeliefFilter
    from vgdp_planner.value import ValueNetwork

CHECKPOINT_TENSORS, CHECKPOINT_STATE = 'checkpoint.safetensors', 'checkpoint.json'

FREE_TO_CHANGE = ('out', 'device', 'threads', 'checkpoint_every')
"""Settings that may differ when a run goes on: they are about where it runs, not about what."""

LOG_EVERY = 50
LOSSES_KEPT = 100
GRADIENT_NORM = 1.0


class ValueParts(nn.Module):
    """The value network and the belief filter, which are trained and kept together."""

    def __init__(self, value: ValueNetwork, belief: BeliefFilter) -> None:
        super().__init__()
        self.value = value
        self.belief = belief


class Ema:
    """Exponential moving average of a module's parameters."""

    def __init__(self, module: nn.Module, decay: float) -> None:
        self.decay = decay
        self.average = {name: value.detach().clone() for name, value in module.named_parameters()}

    @torch.no_grad()
    def update(self, module: nn.Module) -> None:
        """Move the average towards the module's parameters."""
        for name, value in module.named_parameters():
            self.average[name].lerp_(value, 1 - self.decay)

    def copy_to(self, module: nn.Module) -> None:
        """Overwrite the module's parameters by the average."""
        module.load_state_dict({**module.state_dict(), **self.average})


class TrainingLog:
    """Writes the same numbers to a CSV file and, where it is installed, to TensorBoard."""

    def __init__(self, folder: Path, columns: list[str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / 'log.csv'
        self._columns = columns
        if not self._path.exists():
            self._append(columns)
        try:
            from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415
        except ImportError:
            self._writer = None
        else:
            self._writer = SummaryWriter(str(folder))

    def _append(self, row: list[Any]) -> None:
        with self._path.open('a', newline='', encoding='utf-8') as file:
            csv.writer(file).writerow(row)

    def write(self, step: int, **numbers: float) -> None:
        """Log numbers of one step; columns without a number stay empty."""
        row = {'step': step, **{name: f'{value:.6g}' for name, value in numbers.items()}}
        self._append([row.get(column, '') for column in self._columns])
        if self._writer is not None:
            for name, value in numbers.items():
                self._writer.add_scalar(name, value, step)

    def close(self) -> None:
        """Flush what TensorBoard holds back."""
        if self._writer is not None:
            self._writer.close()


def learning_rate(step: int, total: int, initial: float) -> float:
    """Return the rate of a step: constant for the first half, then a cosine down to zero."""
    late = max(0.0, 2 * step / total - 1)
    return initial * 0.5 * (1 + math.cos(math.pi * late))


def optimise(
    model: nn.Module,
    objective: nn.Module,
    inputs: Callable[[int], Sequence[tuple[Tensor, ...]]],
    settings: PolicyTraining
    | PaperValueTraining
    | CalvinTraining
    | SegmentationTraining
    | SearchTraining,
    team: Team,
    *,
    weight_decay: float = 0.0,
    mixed: bool = False,
) -> dict[str, float]:
    """Train a model in place, from where the last checkpoint left it.

    Args:
        model: What is trained; its averaged weights are what comes out.
        objective: Holds the model and returns its losses by name; their sum is minimised.
        inputs: Returns what the objective is called with at a step by this process: one tuple
            for each pass, whose gradients are added up. It depends on the step alone.
        settings: Of the run.
        team: The processes that train together.
        weight_decay: Share of the weights, times the learning rate, that each step takes off.
        mixed: Whether to compute in bfloat16; the weights stay in float32.

    Returns:
        The last losses, averaged over a hundred steps; empty if there was nothing left to do.
    """
    folder = Path(settings.out)
    optimizer = torch.optim.RAdam(
        model.parameters(),
        lr=settings.learning_rate,
        weight_decay=weight_decay,
        decoupled_weight_decay=True,
    )
    ema = Ema(model, settings.ema)
    done = load_checkpoint(folder, model, ema, optimizer, asdict(settings))
    shared = team.share_gradients(objective)
    log: TrainingLog | None = None
    recent: deque[dict[str, Tensor]] = deque(maxlen=LOSSES_KEPT)
    steps = tqdm(range(done, settings.steps), desc='training', unit='step', disable=not team.leads)
    for step in steps:
        rate = learning_rate(step, settings.steps, settings.learning_rate)
        for group in optimizer.param_groups:
            group['lr'] = rate
        optimizer.zero_grad()
        recent.append(_add_gradients(shared, inputs(step), team, mixed=mixed))
        torch.nn.utils.clip_grad_norm_(model.parameters(), GRADIENT_NORM)
        optimizer.step()
        ema.update(model)
        if step % LOG_EVERY == 0:
            losses = _mean_losses(recent, team)
            if team.leads:
                log = log or TrainingLog(folder, ['step', *losses, 'learning_rate'])
                log.write(step, **losses, learning_rate=rate)
        if team.leads and (step + 1) % settings.checkpoint_every == 0:
            save_checkpoint(folder, step + 1, model, ema, optimizer, asdict(settings))
    if log is not None:
        log.close()
    ema.copy_to(model)
    return _mean_losses(recent, team)


def _add_gradients(
    shared: nn.Module, passes: Sequence[tuple[Tensor, ...]], team: Team, *, mixed: bool
) -> dict[str, Tensor]:
    """Add up the gradients of the mean loss over some passes; returns the mean losses by name."""
    means: dict[str, Tensor] = {}
    for index, arguments in enumerate(passes):
        # The gradients are sent to the others once, after the last pass.
        waits = isinstance(shared, DistributedDataParallel) and index + 1 < len(passes)
        with shared.no_sync() if waits else nullcontext():  # type: ignore[operator]
            with torch.autocast(team.device.type, torch.bfloat16, enabled=mixed):
                losses: dict[str, Tensor] = shared(*arguments)
            total = torch.stack(list(losses.values())).sum() / len(passes)
            total.backward()  # type: ignore[no-untyped-call]
        for name, loss in losses.items():
            means[name] = means.get(name, 0) + loss.detach() / len(passes)
    return means


def _mean_losses(recent: Sequence[dict[str, Tensor]], team: Team) -> dict[str, float]:
    names = recent[0] if recent else ()
    return {
        name: float(team.mean(torch.stack([losses[name] for losses in recent]).mean()))
        for name in names
    }


def save_checkpoint(
    folder: Path,
    step: int,
    module: nn.Module,
    ema: Ema,
    optimizer: torch.optim.Optimizer,
    settings: dict[str, Any],
) -> None:
    """Write everything that a training run needs to go on from here."""
    tensors = {'step': torch.tensor(step)}
    tensors |= {f'model.{name}': value for name, value in module.state_dict().items()}
    tensors |= {f'ema.{name}': value for name, value in ema.average.items()}
    for index, state in optimizer.state_dict()['state'].items():
        for name, value in state.items():
            tensors[f'optimizer.{index}.{name}'] = torch.as_tensor(value)
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / f'{CHECKPOINT_TENSORS}.part'
    save_file({name: value.contiguous() for name, value in tensors.items()}, partial)
    partial.replace(folder / CHECKPOINT_TENSORS)
    state = {'step': step, 'settings': settings}
    (folder / CHECKPOINT_STATE).write_text(json.dumps(state, indent=2) + '\n', encoding='utf-8')


def load_checkpoint(
    folder: Path,
    module: nn.Module,
    ema: Ema,
    optimizer: torch.optim.Optimizer,
    settings: dict[str, Any],
) -> int:
    """Restore a training run; returns the steps it has behind it, 0 if there is none.

    Raises:
        ValueError: If the run in the folder was started with other settings.
    """
    path = folder / CHECKPOINT_STATE
    if not path.exists():
        return 0
    begun_with = json.loads(path.read_text(encoding='utf-8'))['settings']
    differing = [
        name
        for name, value in json.loads(json.dumps(settings)).items()
        if name not in FREE_TO_CHANGE and begun_with.get(name) != value
    ]
    if differing:
        msg = (
            f'{folder} holds a run with other settings ({", ".join(differing)}); give another '
            '--out or remove it.'
        )
        raise ValueError(msg)
    tensors = load_file(folder / CHECKPOINT_TENSORS)

    def part(prefix: str) -> dict[str, Tensor]:
        return {
            name.removeprefix(prefix): value
            for name, value in tensors.items()
            if name.startswith(prefix)
        }

    module.load_state_dict(part('model.'))
    ema.average = {
        name: value.to(ema.average[name].device) for name, value in part('ema.').items()
    }
    saved: dict[int, dict[str, Tensor]] = {}
    for name, value in part('optimizer.').items():
        index, key = name.split('.', 1)
        saved.setdefault(int(index), {})[key] = value
    optimizer.load_state_dict({**optimizer.state_dict(), 'state': saved})
    return int(tensors['step'])
