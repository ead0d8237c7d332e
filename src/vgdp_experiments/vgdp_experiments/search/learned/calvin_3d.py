"""CALVIN-3D: CALVIN on a learned lattice, for a robot with a place and a heading.

The lattice point net makes the map, and what CALVIN's network says of the available actions it
says of that. A state is a cell and one of eight headings. As the robot's eight moves are those of
the compass, a move is available or not whatever the heading: it leads to a cell, as in CALVIN,
and to a heading, mostly its own direction; where it leads is learned, and so is what the turn
from a heading to the direction of a move costs.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from gridnav import NUM_MOVES
from vgdp_experiments.calvin import (
    KERNEL_SIDE,
    MOTION_SCALE,
    Calvin,
    CalvinConfig,
    CalvinValues,
)
from vgdp_experiments.search.learned.lattice import LatticePointNet
from vgdp_experiments.search.learned.records import load_networks
from vgdp_planner.weights import save_record

if TYPE_CHECKING:
    from pathlib import Path

HEADINGS = NUM_MOVES

GIVEN = 3
"""Channels beside the lattice's: the goal once it was seen, where the robot stood, and ones."""

FIRST_TURN_PRICE = -4.0
"""Through a softplus: next to nothing."""


@dataclass(frozen=True)
class Calvin3DConfig(CalvinConfig):
    """Sizes and hyperparameters.

    Attributes:
        features: Of a cell of the lattice.
    """

    channels: int = 64
    rounds: int = 2
    features: int = 16


class Calvin3D(Calvin):
    """Lattice point net, available actions, and value iteration over cells and headings."""

    def __init__(self, config: Calvin3DConfig) -> None:
        super().__init__(config, config.features + GIVEN)
        self.lattice = LatticePointNet(config.features)
        # The heading after a move begins as its own direction, rather surely.
        self.heading_logits = nn.Parameter(torch.eye(NUM_MOVES) / 2)
        self.turn_price = nn.Parameter(torch.full((HEADINGS // 2,), FIRST_TURN_PRICE))
        turned = (torch.arange(HEADINGS)[:, None] - torch.arange(NUM_MOVES)) % HEADINGS
        self.eighths: Tensor
        eighths = torch.minimum(turned, HEADINGS - turned)
        self.register_buffer('eighths', eighths, persistent=False)

    def turn_costs(self) -> Tensor:
        """Return what turning from a heading to a move's direction costs, (headings, moves)."""
        prices = functional.softplus(self.turn_price).cumsum(dim=0)
        return torch.cat([prices.new_zeros(1), prices])[self.eighths]

    def forward(self, lattices: Tensor, allowed: Tensor | None = None) -> CalvinValues:
        """Run K rounds of value iteration.

        Args:
            lattices: With the goal and where the robot stood as the last channels,
                (B, C + 2, H, W).
            allowed: As CALVIN's.

        Returns:
            As CALVIN, but Q(s, h, a) with headings h, (B, headings, A, H, W).
        """
        return super().forward(lattices, allowed)

    def _iterate(self, rewards: Tensor, available: Tensor, kernels: Tensor) -> Tensor:
        """Return Q(s, h, a) after K rounds, (B, headings, A, H, W).

        Q(s, h, a) = R̂ − turn(h, a) + γ Â Σ_s' T̂(s'|s, a) Σ_h' T̂(h'|a) max_a' Q(s', h', a').
        Nothing comes after Done, nor after an action that was not available.
        """
        moves, done = rewards[:, :NUM_MOVES], rewards[:, NUM_MOVES:]
        going = self.config.gamma * available[:, :NUM_MOVES]
        windows = kernels.view(NUM_MOVES, 1, KERNEL_SIDE, KERNEL_SIDE)
        heading_kernels = (MOTION_SCALE * self.heading_logits).softmax(dim=1)
        turns = self.turn_costs()[:, :, None, None]
        values, of_moves = done.expand(-1, HEADINGS, -1, -1), moves
        for _ in range(self.config.rounds * max(rewards.shape[2:])):
            after = torch.einsum('ah,bhrc->barc', heading_kernels, values)
            ahead = functional.conv2d(after, windows, padding=1, groups=NUM_MOVES)
            of_moves = torch.addcmul(moves, going, ahead)
            # One heading at a time: all of them at once don't fit a CPU's cache.
            best = [(of_moves - turns[heading]).amax(dim=1) for heading in range(HEADINGS)]
            values = torch.maximum(torch.stack(best, dim=1), done)
        turned = of_moves[:, None] - turns
        return torch.cat([turned, done[:, None].expand(-1, HEADINGS, -1, -1, -1)], dim=2)

    def save(self, folder: Path, training: dict[str, Any]) -> None:
        """Write weights, configuration and how they came about into a folder, creating it."""
        save_record(folder, asdict(self.config), self.state_dict(), training)

    @classmethod
    def load(cls, folder: Path | None = None) -> Calvin3D:
        """Read what `save` wrote; the weights that come with the package if None.

        Raises:
            WeightsError: If the folder does not hold it, with one sentence that says why.
        """
        return load_networks(
            folder, 'calvin_3d', 'CALVIN-3D', lambda config: cls(Calvin3DConfig(**config))
        )
