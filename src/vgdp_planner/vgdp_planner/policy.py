"""The diffusion policy: plans sampled from p(τ_a | e, b), given a partial map and a belief."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from vgdp_planner.analog_bits import NUM_BITS, decode, encode
from vgdp_planner.diffusion import DiffusionProcess
from vgdp_planner.map_encoder import BeliefMapEncoder, PooledMapEncoder
from vgdp_planner.residual_denoiser import ResidualDenoiser
from vgdp_planner.unet import ConditionalUNet

if TYPE_CHECKING:
    from collections.abc import Callable

    from vgdp_planner.config import PolicyConfig

PLANS_AT_ONCE = 480
"""Plans that a CPU denoises at once: few enough that their features stay in its cache."""


class DiffusionPolicy(nn.Module):
    """Map encoder, denoiser and diffusion process together."""

    def __init__(self, config: PolicyConfig) -> None:
        super().__init__()
        self.config = config
        encoders = {'pooled': PooledMapEncoder, 'belief': BeliefMapEncoder}
        self.encoder = encoders[config.encoder](config.encoder_channels, config.embedding)
        self.denoiser = (
            ResidualDenoiser(NUM_BITS, config)
            if config.denoiser == 'residual'
            else ConditionalUNet(
                NUM_BITS,
                config.channels,
                config.embedding,
                config.time_embedding,
                config.kernel,
                config.groups,
                config.stage_blocks,
                config.residual_kernel,
            )
        )
        self.process = DiffusionProcess(config.diffusion_steps, config.prediction)

    def loss(
        self, partial_maps: Tensor, beliefs: Tensor, actions: Tensor, noise: Tensor, step: Tensor
    ) -> Tensor:
        """Return the denoising loss, eq. `loss_ddpm_policy` of the paper.

        Several noises may be drawn for one map, which then is encoded once: N = R·B.

        Args:
            partial_maps: (B, 3, H, W).
            beliefs: (B, H, W).
            actions: Expert plans, int64 (B, T_h).
            noise: ε, (N, NUM_BITS, T_h).
            step: Diffusion step of each sample, int64 (N,).
        """
        repeats = len(noise) // len(actions)
        clean = encode(actions).repeat(repeats, 1, 1)
        noisy = self.process.add_noise(clean, noise, step)
        embedding = self.encoder(partial_maps, beliefs).repeat(repeats, 1)
        target = noise if self.config.prediction == 'epsilon' else clean
        return functional.mse_loss(self.denoiser(noisy, step, embedding), target)

    @torch.no_grad()
    def sample(
        self,
        partial_maps: Tensor,
        beliefs: Tensor,
        noise: Tensor,
        sampling_steps: int,
        sampler: Literal['ddim', 'ddpm'] = 'ddim',
        guide: Callable[[Tensor], Tensor] | None = None,
    ) -> Tensor:
        """Sample L plans for each map.

        Args:
            partial_maps: (B, 3, H, W).
            beliefs: (B, H, W).
            noise: Everything random, N(0, I): (B, L, S, NUM_BITS, T_h), where S is 1 for 'ddim'
                and `sampling_steps` for 'ddpm', which draws again at each step.
            sampling_steps: Denoising steps.
            sampler: 'ddim' or 'ddpm'.
            guide: Turns the predicted clean plans (B · L, NUM_BITS, T_h) of each step into
                better ones.

        Returns:
            Actions, int64 (B, L, T_h).
        """
        batch, count = noise.shape[:2]
        embedding = self.encoder(partial_maps, beliefs)
        draws = noise.flatten(0, 1)
        plan = draws[:, 0]
        steps = self.process.sampling_steps(sampling_steps)
        for index, (step, previous) in enumerate(zip(steps, [*steps[1:], -1], strict=True)):
            clean = self.process.predict_clean(self._denoise(plan, step, embedding), plan, step)
            if guide is not None:
                clean = guide(clean)
            fresh = draws[:, index + 1] if sampler == 'ddpm' and previous >= 0 else None
            plan = self.process.step_back(clean, plan, step, previous, fresh)
        return decode(plan).reshape(batch, count, -1)

    def _denoise(self, plans: Tensor, step: int, embedding: Tensor) -> Tensor:
        """Denoise plans (B · L, NUM_BITS, T_h) of one step, given embeddings (B, E)."""
        count = len(plans) // len(embedding)
        together = max(PLANS_AT_ONCE // count, 1) if plans.device.type == 'cpu' else len(plans)
        parts = []
        for first in range(0, len(embedding), together):
            of_maps = embedding[first : first + together]
            steps = torch.full((len(of_maps),), step, device=plans.device)
            of_plans = plans[first * count : (first + together) * count]
            parts.append(self.denoiser(of_plans, steps, of_maps))
        return torch.cat(parts)
