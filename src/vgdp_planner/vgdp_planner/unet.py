"""The one-dimensional conditional U-Net that denoises action plans (appendix, U-Net table)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

if TYPE_CHECKING:
    from collections.abc import Sequence


class StepEmbedding(nn.Module):
    """Sinusoidal embedding of the diffusion step, then two fully connected layers."""

    frequencies: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        half = size // 2
        frequencies = torch.exp(-math.log(10000.0) / (half - 1) * torch.arange(half))
        self.register_buffer('frequencies', frequencies, persistent=False)
        self.layers = nn.Sequential(
            nn.Linear(size, 4 * size), nn.SiLU(), nn.Linear(4 * size, size)
        )

    def forward(self, step: Tensor) -> Tensor:
        """Embed diffusion steps (B,) as (B, size)."""
        angles = step[:, None] * self.frequencies
        embedding: Tensor = self.layers(torch.cat([angles.sin(), angles.cos()], dim=-1))
        return embedding


def conv_block(inputs: int, outputs: int, kernel: int, groups: int) -> nn.Sequential:
    """Return a convolution over time with group normalisation and SiLU."""
    return nn.Sequential(
        nn.Conv1d(inputs, outputs, kernel, padding=kernel // 2),
        nn.GroupNorm(groups, outputs),
        nn.SiLU(),
    )


class ConditionalResidualBlock(nn.Module):
    """Two convolutional blocks, FiLM on the first one's output, and a residual connection.

    The connection is a convolution of its own, the table's "Res1d"; where its kernel is 1 and the
    channels stay as they are, it hands on what comes in.
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        condition: int,
        kernel: int,
        groups: int,
        residual_kernel: int,
    ) -> None:
        super().__init__()
        self.first = conv_block(inputs, outputs, kernel, groups)
        self.second = conv_block(outputs, outputs, kernel, groups)
        # FiLM (Perez et al. 2018): one half of the output scales the channels, one shifts them.
        self.film = nn.Sequential(nn.SiLU(), nn.Linear(condition, 2 * outputs))
        handed_on = inputs == outputs and residual_kernel == 1
        self.residual = (
            nn.Identity()
            if handed_on
            else nn.Conv1d(inputs, outputs, residual_kernel, padding=residual_kernel // 2)
        )

    def forward(self, plan: Tensor, condition: Tensor) -> Tensor:
        """Map plans (N, inputs, T), given conditions (B, condition), to (N, outputs, T).

        Each condition holds for N / B plans in a row.
        """
        film = self.film(condition).repeat_interleave(len(plan) // len(condition), dim=0)
        scale, shift = film[..., None].chunk(2, dim=1)
        hidden = self.second(self.first(plan) * (1 + scale) + shift)
        result: Tensor = hidden + self.residual(plan)
        return result


class ConditionalUNet(nn.Module):
    """The U-Net of the plan generator.

    Each stage has the same number of conditional residual blocks, and there are two in the
    middle. Between stages the plan is halved in length by a convolution of stride 2, which also
    widens it to the next stage's channels, and doubled again by a transposed convolution; the
    upward stages see the downward ones' outputs beside their own. There is no resampling in the
    last stage of either path.

    Args:
        bits: Channels of the plan.
        channels: Channels of the downward stages.
        condition: Length of the map embedding.
        time_embedding: Length of the embedding of the diffusion step.
        kernel: Kernel size.
        groups: Groups of the group normalisation.
        stage_blocks: Residual blocks of a stage.
        residual_kernel: Kernel size of the residual connections.
    """

    def __init__(
        self,
        bits: int,
        channels: Sequence[int],
        condition: int,
        time_embedding: int,
        kernel: int,
        groups: int,
        stage_blocks: int,
        residual_kernel: int,
    ) -> None:
        super().__init__()
        self.step_embedding = StepEmbedding(time_embedding)

        def stage(inputs: int, outputs: int, blocks: int = stage_blocks) -> nn.ModuleList:
            sizes = [(inputs, outputs), *[(outputs, outputs)] * (blocks - 1)]
            return nn.ModuleList(
                ConditionalResidualBlock(
                    *size, time_embedding + condition, kernel, groups, residual_kernel
                )
                for size in sizes
            )

        # Down: the first stage widens from the bits, the others were widened by the downsampling.
        self.down = nn.ModuleList(
            stage(bits if index == 0 else width, width) for index, width in enumerate(channels)
        )
        pairs = list(pairwise(channels))
        self.downsample = nn.ModuleList(
            nn.Conv1d(width, wider, 3, stride=2, padding=1) for width, wider in pairs
        )
        self.middle = stage(channels[-1], channels[-1], blocks=2)
        self.up = nn.ModuleList(stage(2 * wider, width) for width, wider in reversed(pairs))
        self.upsample = nn.ModuleList(
            nn.ConvTranspose1d(width, width, 4, stride=2, padding=1)
            for width, _ in reversed(pairs)
        )
        self.final = nn.Sequential(
            conv_block(channels[0], channels[0], kernel, groups),
            nn.Conv1d(channels[0], bits, 1),
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

        def run(blocks: nn.Module, plan: Tensor) -> Tensor:
            for block in blocks.children():
                plan = block(plan, condition)
            return plan

        skips = []
        for index, blocks in enumerate(self.down):
            plan = run(blocks, plan)
            skips.append(plan)
            if index < len(self.downsample):
                plan = self.downsample[index](plan)
        plan = run(self.middle, plan)
        for blocks, upsample in zip(self.up, self.upsample, strict=True):
            plan = upsample(run(blocks, torch.cat([plan, skips.pop()], dim=1)))
        result: Tensor = self.final(plan)
        return result
