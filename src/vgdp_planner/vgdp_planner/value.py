"""The value function: action mask, rewards and value iteration on a partial map.

Legend, with the symbols of the paper:
    mask        Â(s, a), how valid each step is from each cell
    T_m         where a valid step leads, a 3 x 3 kernel for each step
    R_m, R_f    rewards of valid and invalid steps
    values      V(s); q_values Q(s, a), with Q(s, Done) last
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from gridnav import FREE, GOAL, NUM_ACTIONS, NUM_MOVES, OBSTACLE, STEP_LENGTHS
from vgdp_planner.best_ways import UNREACHED, best_way_values
from vgdp_planner.map_encoder import MapTrunk, with_inside

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vgdp_planner.config import ValueConfig

WORTH_SCALE = 50.0
"""Cells that an output of 1 of the unseen-worth network stands for."""

CHECK_EVERY = 8
"""Rounds of value iteration between two looks at the residual, which would cost more than they."""


FLIPS: tuple[tuple[int, ...], ...] = ((), (-1,), (-2,), (-2, -1))
"""Axes to mirror a map along; with rows and columns swapped as well, its eight symmetries."""

LEAST_MASK = 0.5
"""A step less valid than this is no way: trying it until it succeeds would cost too much."""


@dataclass(frozen=True)
class Values:
    """What value iteration found.

    Attributes:
        values: V(s), (B, H, W).
        q_values: Q(s, a), (B, A, H, W).
        reached: Cells from which the goal or something unseen can be reached, bool (B, H, W).
        mask: Â(s, a) of the eight steps, (B, 8, H, W).
        step_rewards: R(s, a) of equation 8, (B, A, H, W).
        rounds: Rounds of value iteration that were run.
        residual: Largest change of a value in the last round.
        offsets: What was taken off the worth of the unseen because the goal was seen, (B,).
    """

    values: Tensor
    q_values: Tensor
    reached: Tensor
    mask: Tensor
    step_rewards: Tensor
    rounds: int
    residual: float
    offsets: Tensor

    def without_offsets(self, values: Tensor) -> Tensor:
        """Return values (B, …) as costs to come: with the offset back where it was taken off."""
        offsets = self.offsets.view(-1, *[1] * (values.ndim - 1))
        return torch.where(values <= -offsets, values + offsets, values)

    def shown(self, row: int) -> NDArray[np.float32]:
        """Return V(s) of one map for showing, (H, W), NaN where nothing is in reach."""
        values = self.without_offsets(self.values)[row]
        values = torch.where(self.reached[row], values, torch.nan)
        array: NDArray[np.float32] = values.detach().cpu().numpy()
        return array


class MotionModel(nn.Module):
    """Where each of the eight steps leads: a softmax over the 3 x 3 cells around, T̂_m.

    The kernels are translation invariant and start from a Gaussian (appendix, "Value function").
    """

    def __init__(self) -> None:
        super().__init__()
        offsets = torch.arange(3.0) - 1
        distance = offsets[:, None] ** 2 + offsets[None, :] ** 2
        self.logits = nn.Parameter((-distance / 2).expand(NUM_MOVES, 3, 3).clone())

    def kernels(self) -> Tensor:
        """Return T̂_m, (8, 3, 3): the probability of each offset (Δrow + 1, Δcol + 1)."""
        return self.logits.flatten(1).softmax(dim=-1).view_as(self.logits)

    def most_likely(self) -> Tensor:
        """Return the kernels with all their weight on the most likely cell, (8, 3, 3)."""
        best = self.logits.flatten(1).argmax(dim=-1)
        one_hot = functional.one_hot(best, 9).view_as(self.logits)
        return one_hot.to(self.logits.dtype)


class ValueNetwork(nn.Module):
    """Rewards of equation 8 and value iteration (eq. `QMDP_bellman`) on a partial map.

    Attributes:
        reads_map_alone: Whether a map that is the same has the same worth again.
    """

    reads_map_alone = True

    def __init__(self, config: ValueConfig) -> None:
        super().__init__()
        self.config = config
        boundary = config.unseen == 'boundary'
        inputs = 4 if boundary else 3
        # The mask is a matter of a cell and its neighbours: one 3 x 3 convolution, then 1 x 1.
        hidden = config.action_channels
        self.action_embedding = nn.Sequential(
            nn.Conv2d(inputs, hidden, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(hidden, hidden, 1),
            nn.ReLU(),
            nn.Conv2d(hidden, NUM_ACTIONS + 1, 1),
        )
        self.motion = MotionModel()
        if boundary:
            # R_m is what a step costs, for each cell it may lead to; R_f a price for each step.
            self.motion_reward = nn.Parameter(torch.zeros(NUM_MOVES, 3, 3))
            self.invalid_reward = nn.Parameter(torch.full((NUM_MOVES,), config.invalid_reward))
            self.trunk = MapTrunk(inputs, config.trunk_channels)
            # Zero at first: the robot goes to what is nearest. The level takes up what all unseen
            # cells of a map have in common, which changes no decision, so that the worth of each
            # is left with what tells them apart.
            self.unseen_worth = nn.Conv2d(config.trunk_channels[0], 1, 1)
            self.unseen_level = nn.Linear(config.trunk_channels[0], 1)
            for layer in (self.unseen_worth, self.unseen_level):
                nn.init.zeros_(layer.weight)
                layer.bias.data.zero_()  # type: ignore[union-attr]
        else:
            # R_m and R_f are kernels over the partial map, zero at first (appendix).
            shape = (NUM_ACTIONS, 3, config.reward_kernel, config.reward_kernel)
            self.motion_reward = nn.Parameter(torch.zeros(shape))
            self.invalid_reward = nn.Parameter(torch.zeros(shape))

    def action_logits(self, partial_maps: Tensor) -> tuple[Tensor, Tensor]:
        """Return Â_logit (B, A, H, W) and Â_thresh (B, 1, H, W) of partial maps (B, 3, H, W)."""
        boundary = self.config.unseen == 'boundary'
        inputs = with_inside(partial_maps) if boundary else partial_maps
        embedding = self.action_embedding(inputs)
        return embedding[:, :NUM_ACTIONS], embedding[:, NUM_ACTIONS:]

    def action_mask(self, partial_maps: Tensor) -> Tensor:
        """Return Â(s, a) = σ(Â_logit − Â_thresh), (B, A, H, W)."""
        logits, threshold = self.action_logits(partial_maps)
        return torch.sigmoid(logits - threshold)

    def worth_and_level(self, partial_maps: Tensor) -> tuple[Tensor, Tensor]:
        """Return what tells the unseen cells apart (B, H, W), and what they share (B,)."""
        features = self.trunk(with_inside(partial_maps))
        worth = WORTH_SCALE * self.unseen_worth(features)[:, 0]
        level = WORTH_SCALE * self.unseen_level(features.mean(dim=(-2, -1)))[:, 0]
        return worth, level

    def worth_of_unseen(self, partial_maps: Tensor) -> Tensor:
        """Return the learned worth of being able to look at each cell, (B, H, W).

        The mean of what the network says to the map turned and mirrored in all eight ways: what
        it is mistaken about differs from one to the other, what it knows does not.
        """
        total = torch.zeros_like(partial_maps[:, 0])
        for swapped in (False, True):
            maps = partial_maps.transpose(-1, -2) if swapped else partial_maps
            # Convolutions are fastest on a CPU with the channels of a cell side by side.
            turned = torch.cat([maps.flip(axes) for axes in FLIPS])
            turned = turned.contiguous(memory_format=torch.channels_last)
            worth, level = self.worth_and_level(turned)
            parts = (worth + level[:, None, None]).chunk(len(FLIPS))
            back = torch.stack(
                [part.flip(axes) for axes, part in zip(FLIPS, parts, strict=True)]
            ).sum(dim=0)
            total = total + (back.transpose(-1, -2) if swapped else back)
        return total / (2 * len(FLIPS))

    def forward(self, partial_maps: Tensor, worth: Tensor | None = None) -> Values:
        """Run value iteration.

        Args:
            partial_maps: (B, 3, H, W).
            worth: What `worth_of_unseen` says to these maps, (B, H, W), where it was asked
                already ('boundary').
        """
        if self.config.unseen == 'boundary':
            if worth is None:
                worth = self.worth_of_unseen(partial_maps)
            return self._iterate_to_boundary(partial_maps, worth)
        return self._iterate_everywhere(partial_maps)

    def _rounds(self, partial_maps: Tensor) -> int:
        side = max(partial_maps.shape[-2:])
        return self.config.rounds * (side if self.config.rounds_grow else 1)

    def _kernels(self) -> Tensor:
        expected = self.config.transition == 'expected'
        return self.motion.kernels() if expected else self.motion.most_likely()

    def _iterate_everywhere(self, partial_maps: Tensor) -> Values:
        """Value iteration of the paper: every cell alike, K rounds, discounted."""
        mask = self.action_mask(partial_maps)
        kernels = self._kernels()
        padding = self.config.reward_kernel // 2
        valid_reward = functional.conv2d(partial_maps, self.motion_reward, padding=padding)
        invalid_reward = functional.conv2d(partial_maps, self.invalid_reward, padding=padding)
        rewards = invalid_reward * (1 - mask) + mask * valid_reward  # Equation 8.
        steps, done = mask[:, :NUM_MOVES], rewards[:, NUM_MOVES:]
        values = torch.zeros_like(partial_maps[:, 0])
        q_values = rewards
        before = values
        for _ in range(self._rounds(partial_maps)):
            ahead = functional.conv2d(values[:, None], kernels[:, None], padding=1)
            # An invalid step leaves the robot where it is; Done ends the episode.
            ahead = steps * ahead + (1 - steps) * values[:, None]
            moves = rewards[:, :NUM_MOVES] + self.config.gamma * ahead
            q_values = torch.cat([moves, done], dim=1)
            before, values = values, q_values.amax(dim=1)
        residual = float((values - before).detach().abs().max())
        reached = torch.ones_like(values, dtype=torch.bool)
        rounds = self._rounds(partial_maps)
        offsets = values.new_zeros(len(values))
        return Values(values, q_values, reached, steps, rewards, rounds, residual, offsets)

    def _best_way_values(self, boundary_values: Tensor, free: Tensor, costs: Tensor) -> Tensor:
        best = self.motion.logits.flatten(1).argmax(dim=-1)
        steps = torch.stack([best // 3 - 1, best % 3 - 1], dim=1)
        found = best_way_values(
            *(tensor.detach().cpu().numpy() for tensor in (boundary_values, free, costs, steps))
        )
        return torch.from_numpy(found).to(boundary_values.device)

    def _iterate_to_boundary(self, partial_maps: Tensor, worth: Tensor) -> Values:
        """Value iteration over the observed free cells, up to the goal and to what is unseen.

        The goal and the unseen cells keep their values: 0 for the goal, the learned worth for
        what is unseen. A goal in reach beats anything unseen, so once it was seen the unseen is
        worth less than any way to it.

        With γ = 1 and steps that lead to one cell each, the fixed point is the value of the best
        way: Q = Â (r + V') + (1 − Â) (r_f + V) is at rest where V = V' − cost / Â. The search
        for the shortest ways finds it at once, value iteration starts there, and the residual
        says whether that is the end of it. A way of n steps otherwise takes n rounds.
        """
        obstacle, free, goal = (partial_maps[:, channel] > 0 for channel in (OBSTACLE, FREE, GOAL))
        unseen = ~(obstacle | free | goal)
        goal_seen = goal.flatten(1).any(dim=1)
        longest_way = float(partial_maps[0, 0].numel()) * float(STEP_LENGTHS.max())
        offsets = longest_way * goal_seen
        # A worth above 0 would be a cost below 0; and no offset may reach into ways to the goal.
        worth = torch.where(goal_seen[:, None, None], worth.clamp_max(0), worth)
        worth = worth - offsets[:, None, None]
        boundary_values = torch.where(goal, 0.0, torch.where(unseen, worth, UNREACHED))
        fixed = unseen | goal | obstacle

        mask = self.action_mask(partial_maps)[:, :NUM_MOVES]
        kernels = self._kernels()
        reward = (kernels * self.motion_reward).sum(dim=(1, 2))
        shape = (1, NUM_MOVES, 1, 1)
        # Equation 8, where the sum over s' of T_m R_m is the same everywhere.
        rewards = self.invalid_reward.view(shape) * (1 - mask) + mask * reward.view(shape)
        gamma = self.config.gamma

        def back_up(values: Tensor) -> Tensor:
            """Return Q of the eight steps; an invalid step leaves the robot where it is."""
            around = functional.pad(values[:, None], (1, 1, 1, 1), value=UNREACHED)
            ahead = functional.conv2d(around, kernels[:, None])
            return rewards + gamma * (mask * ahead + (1 - mask) * values[:, None])

        values = boundary_values
        if gamma == 1 and self.config.transition == 'most_likely':
            costs = torch.where(mask > LEAST_MASK, -rewards / mask, torch.inf)
            values = self._best_way_values(boundary_values, free & ~fixed, costs)
        rounds, residual = 0, float('inf')
        while rounds < self._rounds(partial_maps) and residual > self.config.tolerance:
            # The first look comes at once: the start may be the end already.
            for _ in range(CHECK_EVERY if rounds else 1):
                before = values
                moves = back_up(values)
                values = torch.where(fixed, boundary_values, moves.amax(dim=1))
                values = values.clamp_min(UNREACHED)
                rounds += 1
            residual = float((values - before).abs().max())
        reached = ~obstacle & (values > UNREACHED / 2)
        lowest = torch.where(reached, values, 0.0).flatten(1).amin(dim=1)[:, None, None]
        # The belief may leak into cells that reach nothing: these count as bad, not as endless.
        values = torch.where(reached, values, lowest + self.config.invalid_reward)
        done = torch.where(goal, 0.0, values + self.config.invalid_reward)[:, None]
        # What is unseen ends the plan: whatever comes after is in its worth already.
        ended = unseen[:, None]
        q_values = torch.where(ended, values[:, None], torch.cat([back_up(values), done], dim=1))
        step_rewards = torch.cat([rewards, torch.zeros_like(done)], dim=1) * ~ended
        return Values(
            values, q_values, reached, mask * ~ended, step_rewards, rounds, residual, offsets
        )
