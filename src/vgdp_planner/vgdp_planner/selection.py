"""Plan selection: what a plan is worth, by rolling the belief forward along it (equation 9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import torch
from torch import Tensor
from torch.nn import functional

from gridnav import DONE, NUM_MOVES
from vgdp_planner.windows import cut, extent

if TYPE_CHECKING:
    from vgdp_planner.belief import BeliefFilter
    from vgdp_planner.value import Values

NO_ACTION = -1
"""Fills up plans that are shorter than others."""


@dataclass(frozen=True)
class Surroundings:
    """What value iteration found around each robot, as far as plans of `reach` steps lead.

    A belief spreads by one cell with each step, so the rest of the map plays no part, and on a
    large map scoring costs no more than on a small one. What lies off the map is 0 throughout:
    nothing is earned there and no step leads back.

    Attributes:
        beliefs: b(s), (B, h, w), cut out around where the robot may be.
        values: V(s), (B, 1, h + 2 · reach, w + 2 · reach); so are the others.
        q_values: Q(s, a), A channels.
        step_rewards: R(s, a), A channels.
        mask: Â(s, a), 8 channels.
        reach: Steps T of a plan.
    """

    beliefs: Tensor
    values: Tensor
    q_values: Tensor
    step_rewards: Tensor
    mask: Tensor
    reach: int

    @classmethod
    def cut_out(cls, values: Values, beliefs: Tensor, reach: int) -> Surroundings:
        """Cut windows of one size out of the values, around the beliefs (B, H, W)."""
        top, height = extent(beliefs.amax(dim=2) > 0)
        left, width = extent(beliefs.amax(dim=1) > 0)

        def around(field: Tensor, margin: int) -> Tensor:
            padded = functional.pad(field, (margin,) * 4)
            return cut(padded, top, left, height + 2 * margin, width + 2 * margin)

        return cls(
            around(beliefs[:, None], 0)[:, 0],
            around(values.values[:, None], reach),
            around(values.q_values, reach),
            around(values.step_rewards, reach),
            around(values.mask, reach),
            reach,
        )

    def near(self, field: Tensor, steps: int) -> Tensor:
        """Return the part of a field that a belief covers after so many steps."""
        cut = self.reach - steps
        return field[..., cut : field.shape[-2] - cut, cut : field.shape[-1] - cut]

    def after(
        self,
        belief_filter: BeliefFilter,
        beliefs: Tensor,
        actions: Tensor,
        owner: Tensor,
        steps: int,
    ) -> Tensor:
        """Return the beliefs (N, …) after one action each, one cell wider on all sides.

        Args:
            belief_filter: Predicts them.
            beliefs: After `steps` actions.
            actions: Int64 (N,).
            owner: The map that each belongs to, (N,).
            steps: How many actions came before.
        """
        valid = self.near(self.mask, steps + 1)[owner, actions.clamp_max(NUM_MOVES - 1)]
        grown = functional.pad(beliefs, (1, 1, 1, 1))
        # The filter looks at the channel of the action alone.
        return belief_filter.predict(grown, actions, valid[:, None].expand(-1, NUM_MOVES, -1, -1))


def score_plans(
    around: Surroundings,
    belief_filter: BeliefFilter,
    plans: Tensor,
    score: Literal['mean_q', 'mean_return'],
    execute: int,
) -> tuple[Tensor, Tensor]:
    """Score plans by the action values they collect under the predicted beliefs.

    'mean_q' is equation 9 of the paper: (1/|τ|) Σ_i Σ_s Q(s, a_i) b_{t+i}(s).

    'mean_return' adds to each term the reward earned before it: (1/|τ|) Σ_i (Σ_{j<i} r_j +
    Q(b_{t+i}, a_i)). Each term then is what the robot gets if it follows the plan for i + 1
    steps and the value function after that, so plans that end early, run into the unseen, or
    take longer steps are compared on equal terms.

    After Done, and where a plan ends, nothing more is collected; |τ| counts the steps until
    then for 'mean_q', while for 'mean_return' the return stays what it was.

    Args:
        around: Of the B robots.
        belief_filter: Predicts the beliefs.
        plans: Actions, int64 (B, L, T), filled up with `NO_ACTION`.
        score: Which of the two.
        execute: Steps T_a that would be executed.

    Returns:
        Scores, (B, L), and what each plan gets if it is followed for T_a steps, and the value
        function after that, (B, L).
    """
    batch, count, horizon = plans.shape
    owner = torch.arange(batch, device=plans.device).repeat_interleave(count)
    rolled = around.beliefs[owner]
    flat = plans.reshape(batch * count, horizon)
    alive = torch.ones(len(flat), dtype=torch.bool, device=plans.device)
    earned = torch.zeros(len(flat), device=plans.device)
    current, at_first = torch.zeros_like(earned), torch.zeros_like(earned)
    total, length = torch.zeros_like(earned), torch.zeros_like(earned)
    for index in range(horizon):
        actions = flat[:, index]
        alive = alive & (actions != NO_ACTION)
        actions = actions.clamp_min(0)

        def expect(field: Tensor) -> Tensor:
            of_actions = around.near(field, index)[owner, actions]  # noqa: B023
            return (rolled * of_actions).sum(dim=(1, 2))  # noqa: B023

        action_values = expect(around.q_values)
        current = torch.where(alive, earned + action_values, current)
        if index < execute:
            at_first = current
        if score == 'mean_q':
            total += action_values * alive
            length += alive
        else:
            total += current
            length += 1
        if index + 1 < horizon:
            earned += expect(around.step_rewards) * alive
            rolled = around.after(belief_filter, rolled, actions, owner, index)
        alive = alive & (actions != DONE)
    scores = total / length.clamp_min(1)
    return scores.reshape(batch, count), at_first.reshape(batch, count)


def greedy_plan(
    around: Surroundings, belief_filter: BeliefFilter, forbidden_first: Tensor
) -> Tensor:
    """Step greedily on the values: argmax_a Σ_s Q(s, a) b(s) (eq. `QMDP_policy`) at each step.

    Args:
        around: Of the B robots.
        belief_filter: Predicts the beliefs.
        forbidden_first: Actions that may not come first, bool (B, A).

    Returns:
        Actions, int64 (B, T_h), filled up with `NO_ACTION` after Done.
    """
    beliefs = around.beliefs
    owner = torch.arange(len(beliefs), device=beliefs.device)
    ended = torch.zeros(len(beliefs), dtype=torch.bool, device=beliefs.device)
    steps = []
    for index in range(around.reach):
        q_values = around.near(around.q_values, index)
        action_values = torch.einsum('bhw,bahw->ba', beliefs, q_values)
        if index == 0:
            action_values = action_values.masked_fill(forbidden_first, -torch.inf)
        best = action_values.argmax(dim=1)
        steps.append(torch.where(ended, NO_ACTION, best))
        ended = ended | (best == DONE)
        beliefs = around.after(belief_filter, beliefs, best, owner, index)
    return torch.stack(steps, dim=1)


def gain(around: Surroundings, belief_filter: BeliefFilter, plans: Tensor) -> Tensor:
    """Return by how much the expected V(s) rises along plans, one for each robot.

    Args:
        around: Of the B robots.
        belief_filter: Predicts the beliefs.
        plans: Actions, int64 (B, k).

    Returns:
        Σ_s V(s) (b_{t+k}(s) − b_t(s)), (B,).
    """
    beliefs = around.beliefs
    owner = torch.arange(len(beliefs), device=beliefs.device)
    before = (beliefs * around.near(around.values, 0)[:, 0]).sum(dim=(1, 2))
    for index, actions in enumerate(plans.T):
        beliefs = around.after(belief_filter, beliefs, actions, owner, index)
    after = (beliefs * around.near(around.values, plans.shape[1])[:, 0]).sum(dim=(1, 2))
    return after - before


def agreement(plans: Tensor, voters: int, execute: int) -> tuple[Tensor, Tensor]:
    """Count how many of the first `voters` plans begin like each plan, and how many are like it.

    Args:
        plans: Actions, int64 (B, L, T).
        voters: Plans that are counted, the first of each row.
        execute: Steps T_a that make a beginning. What comes after Done makes no difference.

    Returns:
        How many begin with the same steps, and how many are the same throughout, (B, L) each.
    """
    done = plans == DONE
    plans = torch.where(done.int().cumsum(dim=2) > 0, DONE, plans)
    same = plans[:, :, None] == plans[:, None, :voters]
    return same[..., :execute].all(dim=3).sum(dim=2), same.all(dim=3).sum(dim=2)
