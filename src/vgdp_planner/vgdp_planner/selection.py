"""Plan selection: what a plan is worth, by rolling the belief forward along it (equation 9)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import torch
from torch import Tensor

from gridnav import DONE

if TYPE_CHECKING:
    from vgdp_planner.belief import BeliefFilter
    from vgdp_planner.value import Values

NO_ACTION = -1
"""Fills up plans that are shorter than others."""


def _expect(beliefs: Tensor, of_actions: Tensor, owner: Tensor, actions: Tensor) -> Tensor:
    """Return Σ_s b(s) f(s, a) for each belief (N, H, W) and its action (N,)."""
    return (beliefs * of_actions[owner, actions]).sum(dim=(1, 2))


def score_plans(
    values: Values,
    belief_filter: BeliefFilter,
    beliefs: Tensor,
    plans: Tensor,
    score: Literal['mean_q', 'mean_return'],
) -> Tensor:
    """Score plans by the action values they collect under the predicted beliefs.

    'mean_q' is equation 9 of the paper: (1/|τ|) Σ_i Σ_s Q(s, a_i) b_{t+i}(s).

    'mean_return' adds to each term the reward earned before it: (1/|τ|) Σ_i (Σ_{j<i} r_j +
    Q(b_{t+i}, a_i)). Each term then is what the robot gets if it follows the plan for i + 1
    steps and the value function after that, so plans that end early, run into the unseen, or
    take longer steps are compared on equal terms.

    After Done, and where a plan ends, nothing more is collected; |τ| counts the steps until
    then for 'mean_q', while for 'mean_return' the return stays what it was.

    Args:
        values: Of the B maps.
        belief_filter: Predicts the beliefs.
        beliefs: b_t, (B, H, W).
        plans: Actions, int64 (B, L, T), filled up with `NO_ACTION`.
        score: Which of the two.

    Returns:
        Scores, (B, L).
    """
    batch, count, horizon = plans.shape
    owner = torch.arange(batch, device=plans.device).repeat_interleave(count)
    rolled = beliefs[owner]
    mask = values.mask[owner]
    flat = plans.reshape(batch * count, horizon)
    alive = torch.ones(len(flat), dtype=torch.bool, device=plans.device)
    earned = torch.zeros(len(flat), device=plans.device)
    current = torch.zeros_like(earned)
    total, length = torch.zeros_like(earned), torch.zeros_like(earned)
    for index in range(horizon):
        actions = flat[:, index]
        alive = alive & (actions != NO_ACTION)
        actions = actions.clamp_min(0)
        action_values = _expect(rolled, values.q_values, owner, actions)
        if score == 'mean_q':
            total += action_values * alive
            length += alive
        else:
            current = torch.where(alive, earned + action_values, current)
            total += current
            length += 1
            earned += _expect(rolled, values.step_rewards, owner, actions) * alive
        if index + 1 < horizon:
            rolled = belief_filter.predict(rolled, actions, mask)
        alive = alive & (actions != DONE)
    return (total / length.clamp_min(1)).reshape(batch, count)


def greedy_plan(
    values: Values,
    belief_filter: BeliefFilter,
    beliefs: Tensor,
    horizon: int,
    forbidden_first: Tensor,
) -> Tensor:
    """Step greedily on the values: argmax_a Σ_s Q(s, a) b(s) (eq. `QMDP_policy`) at each step.

    Args:
        values: Of the B maps.
        belief_filter: Predicts the beliefs.
        beliefs: b_t, (B, H, W).
        horizon: Steps T_h of the plan.
        forbidden_first: Actions that may not come first, bool (B, A).

    Returns:
        Actions, int64 (B, T_h), filled up with `NO_ACTION` after Done.
    """
    ended = torch.zeros(len(beliefs), dtype=torch.bool, device=beliefs.device)
    steps = []
    for index in range(horizon):
        action_values = torch.einsum('bhw,bahw->ba', beliefs, values.q_values)
        if index == 0:
            action_values = action_values.masked_fill(forbidden_first, -torch.inf)
        best = action_values.argmax(dim=1)
        steps.append(torch.where(ended, NO_ACTION, best))
        ended = ended | (best == DONE)
        beliefs = belief_filter.predict(beliefs, best, values.mask)
    return torch.stack(steps, dim=1)
