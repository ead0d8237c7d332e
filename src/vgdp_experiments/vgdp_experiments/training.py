"""What both training commands share: averaged weights, logs and checkpoints to go on from."""

from __future__ import annotations

import csv
import json
import math
from typing import TYPE_CHECKING, Any

import torch
from safetensors.torch import load_file, save_file

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor, nn

CHECKPOINT_TENSORS, CHECKPOINT_STATE = 'checkpoint.safetensors', 'checkpoint.json'


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


def save_checkpoint(
    folder: Path,
    step: int,
    module: nn.Module,
    ema: Ema,
    optimizer: torch.optim.Optimizer,
    settings: dict[str, Any],
) -> None:
    """Write everything that a training run needs to go on from here."""
    tensors = {f'model.{name}': value for name, value in module.state_dict().items()}
    tensors |= {f'ema.{name}': value for name, value in ema.average.items()}
    for index, state in optimizer.state_dict()['state'].items():
        for name, value in state.items():
            tensors[f'optimizer.{index}.{name}'] = torch.as_tensor(value)
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
    state = json.loads(path.read_text(encoding='utf-8'))
    if state['settings'] != json.loads(json.dumps(settings)):
        msg = f'{folder} holds a run with other settings; give another --out or remove it.'
        raise ValueError(msg)
    tensors = load_file(folder / CHECKPOINT_TENSORS)

    def part(prefix: str) -> dict[str, Tensor]:
        return {
            name.removeprefix(prefix): value
            for name, value in tensors.items()
            if name.startswith(prefix)
        }

    module.load_state_dict(part('model.'))
    ema.average = part('ema.')
    saved: dict[int, dict[str, Tensor]] = {}
    for name, value in part('optimizer.').items():
        index, key = name.split('.', 1)
        saved.setdefault(int(index), {})[key] = value
    optimizer.load_state_dict({**optimizer.state_dict(), 'state': saved})
    return int(state['step'])
