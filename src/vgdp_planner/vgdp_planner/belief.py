"""The belief filter: where the robot may be, predicted by a step and corrected by a view."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from gridnav import FREE, NUM_MOVES, OBSTACLE
from vgdp_planner.value import MotionModel

VIEW_KINDS, MAP_KINDS = 2, 3
"""A view says obstacle or free; the map says obstacle, free or nothing yet."""


class BeliefFilter(nn.Module):
    """Bayesian filter of equation `pomdp-belief-update` with learned T_m and O.

    The motion model has weights of its own, apart from those of value iteration (appendix,
    "Value function"). The observation function compares each cell of the view with the map
    around each cell that the robot may be in: its weights are the logarithm of how likely the
    view says one thing where the map says another, so it holds for every view range and map.
    """

    def __init__(self) -> None:
        super().__init__()
        self.motion = MotionModel()
        self.log_confusion = nn.Parameter(torch.zeros(VIEW_KINDS, MAP_KINDS))

    def predict(self, beliefs: Tensor, actions: Tensor, mask: Tensor) -> Tensor:
        """Return the beliefs after one action each: Σ_s T(s'|s, a) b(s).

        Args:
            beliefs: b(s), (N, H, W).
            actions: One action for each, int64 (N,). Done moves nothing.
            mask: Â(s, a) of the eight steps, (N, 8, H, W): where a step is invalid the robot
                stays.

        Returns:
            b(s'), (N, H, W).
        """
        moves = actions < NUM_MOVES
        steps = actions.clamp_max(NUM_MOVES - 1)
        valid = mask[torch.arange(len(mask), device=mask.device), steps]
        going = beliefs * valid * moves[:, None, None]
        # Correlation with the flipped kernel sends each cell's share where the step leads.
        kernels = self.motion.kernels()[steps].flip(-1, -2)[:, None]
        arrived = functional.conv2d(going[None], kernels, padding=1, groups=len(going))[0]
        return arrived + (beliefs - going)

    def log_likelihood(self, partial_maps: Tensor, views: Tensor) -> Tensor:
        """Return log O(s', o') up to a constant, (N, H, W).

        Args:
            partial_maps: (N, 3, H, W).
            views: What is seen around the robot, −1 unseen, 0 free, 100 obstacle,
                int8 (N, 2r + 1, 2r + 1).
        """
        seen = torch.stack([views > 0, views == 0], dim=1).to(self.log_confusion.dtype)
        kernels = torch.einsum('vm,nvij->nmij', self.log_confusion, seen)
        obstacle, free = partial_maps[:, OBSTACLE], partial_maps[:, FREE]
        kinds = torch.stack([obstacle, free, 1 - obstacle - free], dim=1)
        count, _, height, width = kinds.shape
        scores = functional.conv2d(
            kinds.reshape(1, count * MAP_KINDS, height, width),
            kernels,
            padding=views.shape[-1] // 2,
            groups=count,
        )
        return scores[0]

    def correct(self, beliefs: Tensor, partial_maps: Tensor, views: Tensor) -> Tensor:
        """Return the beliefs weighed by a view each: η O(s', o') b(s'), (N, H, W).

        Where nothing is left of a belief (the view contradicts it everywhere), the view alone
        counts, over the cells that are not known obstacles.
        """
        standable = 1 - partial_maps[:, OBSTACLE]
        scores = self.log_likelihood(partial_maps, views)
        scores = scores.masked_fill(standable == 0, -torch.inf)
        likelihood = torch.exp(scores - scores.flatten(1).amax(dim=1)[:, None, None])
        weighed = likelihood * beliefs
        total = weighed.sum(dim=(1, 2), keepdim=True)
        lost = total < torch.finfo(weighed.dtype).tiny
        weighed = torch.where(lost, likelihood, weighed)
        return weighed / weighed.sum(dim=(1, 2), keepdim=True)
