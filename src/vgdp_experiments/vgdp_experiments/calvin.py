"""CALVIN, the differentiable planner that the paper compares with and builds its values on.

After S. Ishida and J. F. Henriques, "Towards real-world navigation with deep differentiable
planners" (CVPR 2022), for the nine actions on a grid. Legend, with their symbols:
    available   Â(s, a) = σ(Â_logit − Â_thresh), learned from the partial map
    kernels     T̂(s'|s, a), where an available step leads: a softmax over 3 x 3 cells each
    rewards     R̂(s, a), from R̂_m of what is available and R̂_f of what is not
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn
from torch.nn import functional

from gridnav import NUM_ACTIONS, NUM_MOVES
from vgdp_planner.map_encoder import with_inside
from vgdp_planner.weights import CONFIG_FILE, MODEL_FILE, WeightsError, read_record, save_record

SHIPPED = Path(__file__).parent / 'weights' / 'calvin'
"""The weights that come with the package."""

KERNEL_SIDE = 3

MOTION_SCALE = 10.0
"""Factor of the motion logits, as theirs have it: a sharp softmax is far from a flat one."""

FIRST_STEP_COST = 0.1
"""What every step costs before training."""


@dataclass(frozen=True)
class CalvinConfig:
    """Sizes and hyperparameters.

    Attributes:
        channels: Channels of the network of the available actions.
        gamma: Discount factor γ.
        rounds: Rounds of value iteration for each cell of the map's longer side:
            K = rounds · max(H, W), theirs at 15 x 15.
    """

    channels: int = 150
    gamma: float = 0.99
    rounds: int = 4


class CalvinValues(NamedTuple):
    """What CALVIN makes of partial maps.

    Attributes:
        q_values: Q(s, a), (B, A, H, W).
        logits: Â_logit(s, a), (B, A, H, W).
        available: Â(s, a), (B, A, H, W).
    """

    q_values: Tensor
    logits: Tensor
    available: Tensor


class Calvin(nn.Module):
    """Available actions, rewards and value iteration on a partial map.

    Two things differ from theirs, both to its advantage here. R̂_m of a step is never positive:
    learned freely it is, as imitation asks for moves and not for short ways, and then walking in
    a circle pays. And the network of the available actions is told what lies off the map.

    Args:
        config: Sizes and hyperparameters.
        inputs: Channels of a map, with one that tells what lies off it.
    """

    def __init__(self, config: CalvinConfig, inputs: int = 4) -> None:
        super().__init__()
        self.config = config
        self.availability = nn.Sequential(
            nn.Conv2d(inputs, config.channels, KERNEL_SIDE, padding=KERNEL_SIDE // 2),
            nn.ReLU(),
            nn.Conv2d(config.channels, NUM_ACTIONS + 1, 1),
        )
        offsets = KERNEL_SIDE**2
        first_cost = float(np.log(np.expm1(FIRST_STEP_COST)))
        self.motion_logits = nn.Parameter(torch.zeros(NUM_MOVES, offsets))
        self.step_cost = nn.Parameter(torch.full((NUM_MOVES, offsets), first_cost))
        self.done_reward = nn.Parameter(torch.zeros(1))
        self.failure_cost = nn.Parameter(torch.zeros(()))

    def log_kernels(self) -> Tensor:
        """Return log T̂, (8, 9): for each step and each of the cells around, row by row."""
        return (MOTION_SCALE * self.motion_logits).log_softmax(dim=1)

    def forward(self, partial_maps: Tensor, allowed: Tensor | None = None) -> CalvinValues:
        """Run K rounds of value iteration.

        Args:
            partial_maps: (B, 3, H, W).
            allowed: 0 where an action is known not to be available, else 1, (B, A, H, W); 1
                everywhere if None.
        """
        embedding = self.availability(with_inside(partial_maps))
        logits, threshold = embedding[:, :NUM_ACTIONS], embedding[:, NUM_ACTIONS:]
        available = torch.sigmoid(logits - threshold)
        if allowed is not None:
            available = available * allowed
        kernels = self.log_kernels().exp()
        q_values = self._iterate(self.rewards(available), available, kernels)
        return CalvinValues(q_values, logits, available)

    def rewards(self, available: Tensor) -> Tensor:
        """Return R̂(s, a) of actions as available as that, (B, A, H, W)."""
        kernels = self.log_kernels().exp()
        step_rewards = -(kernels * functional.softplus(self.step_cost)).sum(dim=1)
        motion_rewards = torch.cat([step_rewards, self.done_reward])[:, None, None]
        failure_reward = -functional.softplus(self.failure_cost)
        return available * motion_rewards + (1 - available) * failure_reward

    def _iterate(self, rewards: Tensor, available: Tensor, kernels: Tensor) -> Tensor:
        """Return Q(s, a) = R̂ + γ Â Σ_s' T̂(s'|s, a) max_a' Q(s', a') after K rounds, (B, A, H, W).

        Nothing comes after Done, nor after an action that was not available.
        """
        # With the maps last, one matrix product does for all cells of all maps, and its
        # gradient takes a quarter of the time of a convolution's.
        rewards = rewards.permute(1, 2, 3, 0).contiguous()
        moves, done = rewards[:NUM_MOVES], rewards[NUM_MOVES]
        going = self.config.gamma * available[:, :NUM_MOVES].permute(1, 2, 3, 0).contiguous()
        height, width = moves.shape[1:3]
        windows = [
            np.s_[row : row + height, col : col + width]
            for row in range(KERNEL_SIDE)
            for col in range(KERNEL_SIDE)
        ]
        values, of_moves = rewards.amax(dim=0), moves
        for _ in range(self.config.rounds * max(height, width)):
            padded = functional.pad(values, (0, 0, 1, 1, 1, 1))
            around = torch.stack([padded[window] for window in windows])
            ahead = (kernels @ around.flatten(1)).view_as(moves)
            of_moves = torch.addcmul(moves, going, ahead)
            values = torch.maximum(of_moves.amax(dim=0), done)
        return torch.cat([of_moves, done[None]]).permute(3, 0, 1, 2)


def save_calvin(folder: str | Path, model: Calvin, training: dict[str, Any]) -> None:
    """Write weights, configuration and how they came about into a folder, creating it."""
    save_record(folder, asdict(model.config), model.state_dict(), training)


def load_calvin(folder: str | Path = SHIPPED) -> Calvin:
    """Read what `save_calvin` has written.

    Raises:
        WeightsError: If the folder does not hold it, with one sentence that says why.
    """
    path = Path(folder)
    if not (path / CONFIG_FILE).exists() or not (path / MODEL_FILE).exists():
        msg = f'There are no weights of CALVIN in {path}; make them with `vgdp train calvin`.'
        raise WeightsError(msg)
    try:
        model = Calvin(CalvinConfig(**read_record(path)['config']))
        model.load_state_dict(load_file(path / MODEL_FILE))
    except (TypeError, ValueError, RuntimeError, OSError, SafetensorError) as error:
        msg = f'{path} does not hold undamaged weights of CALVIN.'
        raise WeightsError(msg) from error
    return model.eval()
