"""The diffusion process: forward noise, and one step back by DDPM or DDIM.

Legend, with the symbols of Ho et al. 2020 (DDPM) and Song et al. 2021 (DDIM):
    alpha_bar   ᾱ_i, the share of the signal left at diffusion step i
    clean       x_0, the action plan as analog bits
    noisy       x_i, the plan at diffusion step i
    noise       ε, a sample of N(0, I)
"""

from __future__ import annotations

import math
from typing import Literal

import torch
from torch import Tensor

Prediction = Literal['epsilon', 'sample']
"""What the network predicts: the noise ε, or the clean sample x_0."""


def cosine_alpha_bars(steps: int) -> Tensor:
    """Return ᾱ_0 … ᾱ_{N−1} of the cosine schedule (Nichol and Dhariwal 2021), float64 (N,)."""

    def signal(fraction: float) -> float:
        return math.cos((fraction + 0.008) / 1.008 * math.pi / 2) ** 2

    betas = [min(1 - signal((i + 1) / steps) / signal(i / steps), 0.999) for i in range(steps)]
    return torch.cumprod(1 - torch.tensor(betas, dtype=torch.float64), dim=0)


class DiffusionProcess:
    """Noise for training and denoising steps for sampling, on a cosine schedule.

    Args:
        steps: Diffusion steps N of training.
        prediction: What the network predicts.
    """

    def __init__(self, steps: int, prediction: Prediction) -> None:
        if steps < 1:
            msg = f'A diffusion process needs at least one step, got {steps}.'
            raise ValueError(msg)
        self.steps = steps
        self.prediction = prediction
        self.alpha_bars = cosine_alpha_bars(steps)

    def add_noise(self, clean: Tensor, noise: Tensor, step: Tensor) -> Tensor:
        """Sample x_i = √ᾱ_i x_0 + √(1 − ᾱ_i) ε.

        Args:
            clean: x_0, (B, C, T).
            noise: ε, (B, C, T).
            step: i of each sample, int64 (B,).
        """
        alpha_bar = self.alpha_bars.to(clean)[step][:, None, None]
        return alpha_bar.sqrt() * clean + (1 - alpha_bar).sqrt() * noise

    def sampling_steps(self, count: int) -> list[int]:
        """Return `count` diffusion steps, evenly spread down from N − 1.

        The last one is not 0, where hardly any noise is left to take away, but as far from the
        end as the others from one another.

        Raises:
            ValueError: If count is not in 1 … N.
        """
        if not 1 <= count <= self.steps:
            msg = f'The number of sampling steps must be in 1 … {self.steps}, got {count}.'
            raise ValueError(msg)
        return [round(self.steps * left / count) - 1 for left in range(count, 0, -1)]

    def predict_clean(self, output: Tensor, noisy: Tensor, step: int) -> Tensor:
        """Turn the network's output at step i into x_0, clipped to the range of the bits."""
        alpha_bar = float(self.alpha_bars[step])
        if self.prediction == 'epsilon':
            clean = (noisy - math.sqrt(1 - alpha_bar) * output) / math.sqrt(alpha_bar)
        else:
            clean = output
        return clean.clamp(-1, 1)

    def step_back(
        self, clean: Tensor, noisy: Tensor, step: int, previous: int, noise: Tensor | None
    ) -> Tensor:
        """Sample x_previous from the predicted x_0 and x_i.

        DDIM (Song et al. 2021, eq. 12): without noise (σ = 0) the step is deterministic. DDPM
        (Ho et al. 2020, eq. 7) is the same formula with the posterior's own σ.

        Args:
            clean: Predicted x_0, (B, C, T).
            noisy: x_i, (B, C, T).
            step: i.
            previous: The diffusion step to go to, below i; −1 for the end, which returns x_0.
            noise: ε for a DDPM step, None for a DDIM step.
        """
        if previous < 0:
            return clean
        alpha_bar = float(self.alpha_bars[step])
        alpha_bar_previous = float(self.alpha_bars[previous])
        predicted_noise = (noisy - math.sqrt(alpha_bar) * clean) / math.sqrt(1 - alpha_bar)
        sigma = 0.0
        if noise is not None:
            sigma = math.sqrt(
                (1 - alpha_bar_previous) / (1 - alpha_bar) * (1 - alpha_bar / alpha_bar_previous)
            )
        direction = math.sqrt(max(1 - alpha_bar_previous - sigma**2, 0.0)) * predicted_noise
        sample = math.sqrt(alpha_bar_previous) * clean + direction
        return sample if noise is None else sample + sigma * noise
