"""Training in one process, or in several that `torchrun` has started, one for each GPU."""

from __future__ import annotations

import os
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import distributed
from torch.nn.parallel import DistributedDataParallel

if TYPE_CHECKING:
    from collections.abc import Iterator

    from torch import Tensor, nn

DEVICES = ('auto', 'cpu', 'cuda')
"""Where to train; 'auto' takes the GPU where there is one."""


@dataclass(frozen=True)
class Team:
    """The processes that train together, seen from one of them.

    Attributes:
        rank: Which of them this one is; the first, 0, alone writes files and shows progress.
        size: How many there are.
        device: Where this one computes.
    """

    rank: int
    size: int
    device: torch.device

    @property
    def leads(self) -> bool:
        """Whether this process is the one that writes."""
        return self.rank == 0

    def share(self, first: int, count: int) -> slice:
        """Return this process's part of the samples first … first + count − 1.

        Raises:
            ValueError: If they can not be dealt out evenly.
        """
        if count % self.size:
            msg = f'A batch of {count} can not be dealt out evenly to {self.size} processes.'
            raise ValueError(msg)
        each = count // self.size
        return slice(first + self.rank * each, first + (self.rank + 1) * each)

    def share_gradients(self, module: nn.Module) -> nn.Module:
        """Return a module to call instead, whose gradients are the mean over the processes."""
        if self.size == 1:
            return module
        on_gpu = self.device.type == 'cuda'
        return DistributedDataParallel(module, device_ids=[self.device] if on_gpu else None)

    def mean(self, number: Tensor) -> Tensor:
        """Return the mean of a number of each process; all of them have to ask for it."""
        if self.size == 1:
            return number
        total = number.clone()
        distributed.all_reduce(total)
        return total / self.size


@contextmanager
def training_team(device: str) -> Iterator[Team]:
    """Join the processes that `torchrun` has started, if it has; yields what they are.

    Args:
        device: One of `DEVICES`.

    Raises:
        ValueError: If there is no such device here, or fewer GPUs than processes.
    """
    size = int(os.environ.get('WORLD_SIZE', '1'))
    place = int(os.environ.get('LOCAL_RANK', '0'))
    where = _device(device, place)
    if size == 1:
        yield Team(0, 1, where)
        return
    if where.type == 'cuda':
        torch.cuda.set_device(where)
    distributed.init_process_group('nccl' if where.type == 'cuda' else 'gloo')
    try:
        yield Team(distributed.get_rank(), size, where)
    finally:
        distributed.destroy_process_group()


def _device(name: str, place: int) -> torch.device:
    if name not in DEVICES:
        msg = f'The device is one of {", ".join(DEVICES)}, got {name!r}.'
        raise ValueError(msg)
    gpus = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if name == 'cpu' or (name == 'auto' and not gpus):
        return torch.device('cpu')
    if not gpus:
        msg = "There is no GPU here that PyTorch can use for the device 'cuda'."
        raise ValueError(msg)
    if place >= gpus:
        msg = (
            f'Process {place + 1} of this machine has no GPU of its own: there are {gpus}, so '
            f'start at most {gpus} with --nproc-per-node.'
        )
        raise ValueError(msg)
    return torch.device('cuda', place)
