"""The denoiser of the default preset: residual layers over whole plans, made for CPUs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from vgdp_planner.unet import StepEmbedding

if TYPE_CHECKING:
    from vgdp_planner.config import PolicyConfig


class ResidualBlock(nn.Module):
    """Normalise, FiLM, and two fully connected layers whose output is added to the input."""

    def __init__(self, width: int, condition: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width, elementwise_affine=False)
        # FiLM (Perez et al. 2018): one half of the output scales the features, one shifts them.
        self.film = nn.Linear(condition, 2 * width)
        self.layers = nn.Sequential(nn.Linear(width, width), nn.SiLU(), nn.Linear(width, width))

    def forward(self, hidden: Tensor, condition: Tensor) -> Tensor:
        """Map features (B, L, width), given conditions (B, condition), to the same shape."""
        scale, shift = self.film(condition)[:, None].chunk(2, dim=-1)
        result: Tensor = hidden + self.layers(self.norm(hidden) * (1 + scale) + shift)
        return result


class ResidualDenoiser(nn.Module):
    """Denoises plans as vectors of all their bits.

    Plans of eight steps are short: there is nothing that convolutions along them would save. A
    few large matrix products take a small part of the time that the many small convolutions of a
    U-Net need.

    Args:
        bits: Channels of a plan.
        config: Sizes.
    """

    def __init__(self, bits: int, config: PolicyConfig) -> None:
        super().__init__()
        condition = config.time_embedding + config.embedding
        self.step_embedding = StepEmbedding(config.time_embedding)
        self.activation = nn.SiLU()
        self.first = nn.Linear(bits * config.horizon, config.width)
        self.blocks = nn.ModuleList(
            ResidualBlock(config.width, condition) for _ in range(config.blocks)
        )
        self.last = nn.Sequential(
            nn.LayerNorm(config.width), nn.Linear(config.width, bits * config.horizon)
        )

    def forward(self, plan: Tensor, step: Tensor, embedding: Tensor) -> Tensor:
        """Denoise plans.

        Args:
            plan: Noisy plans, (N, bits, T): N / B in a row for each map.
            step: Diffusion steps, (B,).
            embedding: Map embeddings, (B, E).

        Returns:
            The prediction, (N, bits, T).
        """
        condition = torch.cat([self.step_embedding(step), embedding], dim=-1)
        condition = self.activation(condition)
        hidden = self.first(plan.reshape(len(embedding), -1, plan[0].numel()))
        for block in self.blocks:
            hidden = block(hidden, condition)
        result: Tensor = self.last(hidden).reshape(plan.shape)
        return result
