"""The diffusion policy: plans sampled from p(τ_a | e, b), given a partial map and a belief."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from vgdp_planner.analog_bits import NUM_BITS, decode, encode
from vgdp_planner.diffusion import DiffusionProcess
from vgdp_planner.map_encoder import BeliefMapEncoder, PooledMapEncoder
from vgdp_planner.unet import ConditionalUNet

if TYPE_CHECKING:
    from vgdp_planner.config import PolicyConfig


class DiffusionPolicy(nn.Module):
    """Map encoder, U-Net and diffusion process together."""

    def __init__(self, config: PolicyConfig) -> None:
        super().__init__()
        self.config = config
        encoders = {'pooled': PooledMapEncoder, 'belief': BeliefMapEncoder}
        self.encoder = encoders[config.encoder](config.encoder_channels, config.embedding)
        self.unet = ConditionalUNet(
            NUM_BITS,
            config.channels,
            config.embedding,
            config.time_embedding,
            config.kernel,
            config.groups,
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
        return functional.mse_loss(self.unet(noisy, step, embedding), target)

    @torch.no_grad()
    def sample(
        self,
        partial_maps: Tensor,
        beliefs: Tensor,
        noise: Tensor,
        sampling_steps: int,
        sampler: Literal['ddim', 'ddpm'] = 'ddim',
    ) -> Tensor:
        """Sample L plans for each map.

        Args:
            partial_maps: (B, 3, H, W).
            beliefs: (B, H, W).
            noise: Everything random, N(0, I): (B, L, S, NUM_BITS, T_h), where S is 1 for 'ddim'
                and `sampling_steps` for 'ddpm', which draws again at each step.
            sampling_steps: Denoising steps.
            sampler: 'ddim' or 'ddpm'.

        Returns:
            Actions, int64 (B, L, T_h).
        """
        batch, count = noise.shape[:2]
        embedding = self.encoder(partial_maps, beliefs).repeat_interleave(count, dim=0)
        draws = noise.flatten(0, 1)
        plan = draws[:, 0]
        steps = self.process.sampling_steps(sampling_steps)
        for index, (step, previous) in enumerate(zip(steps, [*steps[1:], -1], strict=True)):
            at = torch.full((len(plan),), step, device=plan.device)
            clean = self.process.predict_clean(self.unet(plan, at, embedding), plan, step)
            fresh = draws[:, index + 1] if sampler == 'ddpm' and previous >= 0 else None
            plan = self.process.step_back(clean, plan, step, previous, fresh)
        return decode(plan).reshape(batch, count, -1)
