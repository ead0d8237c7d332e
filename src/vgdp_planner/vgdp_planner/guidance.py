"""Value-gradient guidance: pulls samples towards high values while they are denoised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import torch
from torch import Tensor
from torch.nn import functional

from gridnav import DONE, NUM_MOVES
from vgdp_planner.analog_bits import closeness

if TYPE_CHECKING:
    from vgdp_planner.belief import BeliefFilter
    from vgdp_planner.selection import Surroundings

SHARPNESS = 2.0
"""How surely analog bits mean the nearest action: codewords mean theirs by 0.93 or more."""


def soft_actions(bits: Tensor) -> Tensor:
    """Turn analog bits (N, NUM_BITS, T) into probabilities of the actions, (N, T, A)."""
    return (SHARPNESS * closeness(bits)).softmax(dim=-1)


def soft_score(
    around: Surroundings,
    belief_filter: BeliefFilter,
    probabilities: Tensor,
    score: Literal['mean_q', 'mean_return'],
) -> Tensor:
    """Score plans whose actions are probabilities; differentiable in them.

    The belief goes on under the mixture of the actions' motion kernels, and what ends with Done
    leaves it. For probabilities of 0 and 1 this is `score_plans`.

    Args:
        around: Of the B robots.
        belief_filter: Its kernels predict the beliefs.
        probabilities: Of each action at each step, (N, T, A), the same number of plans for each
            robot, one robot after the other.
        score: As for `score_plans`.

    Returns:
        Scores, (N,).
    """
    count, horizon, _ = probabilities.shape
    owner = torch.arange(len(around.beliefs), device=probabilities.device)
    owner = owner.repeat_interleave(count // len(around.beliefs))
    # Correlation with the flipped kernels sends each cell's share where the steps lead.
    kernels = belief_filter.motion.kernels().detach().flip(-1, -2)[None]
    mass = around.beliefs[owner]
    earned = torch.zeros(count, device=probabilities.device)
    total, length = torch.zeros_like(earned), torch.zeros_like(earned)
    for index in range(horizon):
        of_step = probabilities[:, index]

        def expect(field: Tensor) -> Tensor:
            near = around.near(field, index)[owner]  # noqa: B023
            return torch.einsum('nhw,nahw->na', mass, near) * of_step  # noqa: B023

        action_values = expect(around.q_values)
        if score == 'mean_q':
            total = total + action_values.sum(dim=1)
            length = length + mass.sum(dim=(1, 2))
        else:
            total = total + earned + action_values.sum(dim=1)
            length = length + 1
            rewards = expect(around.step_rewards)[:, :NUM_MOVES].sum(dim=1)
            # What ends here keeps its value in all the terms that follow.
            earned = earned + rewards + action_values[:, DONE]
        if index + 1 < horizon:
            moves = of_step[:, :NUM_MOVES, None, None]
            grown = functional.pad(mass, (1, 1, 1, 1))[:, None]
            going = grown * moves * around.near(around.mask, index + 1)[owner]
            staying = (grown * moves - going).sum(dim=1)
            mass = functional.conv2d(going, kernels, padding=1)[:, 0] + staying
    return total / length.clamp_min(torch.finfo(total.dtype).tiny)


@dataclass(frozen=True)
class ValueGuide:
    """Classifier guidance (Dhariwal and Nichol 2021) with the score of plans for the classifier.

    Attributes:
        around: Of the B robots.
        belief_filter: Predicts the beliefs.
        score: Of the plans.
        scale: How far to follow the gradient, in bits for each cell that the score would rise.
    """

    around: Surroundings
    belief_filter: BeliefFilter
    score: Literal['mean_q', 'mean_return']
    scale: float

    def __call__(self, clean: Tensor) -> Tensor:
        """Move predicted clean plans (N, NUM_BITS, T) along ∇J; the bits stay within ±1."""
        with torch.enable_grad():
            bits = clean.detach().requires_grad_()
            scores = soft_score(self.around, self.belief_filter, soft_actions(bits), self.score)
            (gradient,) = torch.autograd.grad(scores.sum(), bits)
        return (clean + self.scale * gradient).clamp(-1, 1)
