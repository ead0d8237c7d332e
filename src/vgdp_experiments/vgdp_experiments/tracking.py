"""Keeps a belief for each robot of an evaluation, from what the robots do and see."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.special import ndtr

from gridnav import DONE, FREE, NUM_MOVES, OBSTACLE, valid_moves

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vgdp_planner.belief import BeliefFilter

HALF = 0.5
"""A cell reaches so far from its centre, in cells."""


class BeliefTracker:
    """Runs the planner's belief filter on robots whose steps slip and whose poses are noisy.

    Nothing but the maps, the views, the reported poses and the actions goes in. A view is compared
    with the map as it was before it.

    Args:
        belief_filter: With its learned motion and observation.
        slip: Share of the steps that lead beside the right cell, or nowhere.
        pose_noise: Standard deviation of the reported poses in cells.

    Attributes:
        beliefs: float32 (B, H, W).
    """

    def __init__(self, belief_filter: BeliefFilter, slip: float, pose_noise: float) -> None:
        self._filter = belief_filter
        self._slip = slip
        self._pose_noise = pose_noise
        self.beliefs = np.zeros((0, 0, 0), dtype=np.float32)

    def begin(self, partial_maps: NDArray[np.float32], reported: NDArray[np.int64]) -> None:
        """Begin with the reported poses, and with each robot on a cell that it has seen is free.

        Args:
            partial_maps: (B, 3, H, W).
            reported: Cells (row, col), (B, 2).
        """
        self.beliefs = self._measured(torch.from_numpy(partial_maps[:, FREE]), reported).numpy()

    @torch.no_grad()
    def follow(
        self,
        actions: NDArray[np.int64],
        maps_before: NDArray[np.float32],
        reported: NDArray[np.int64],
        views: NDArray[np.int8],
    ) -> None:
        """Take in one action of each robot, and what it reported and saw after that.

        Args:
            actions: (B,).
            maps_before: Partial maps without what was seen after the action, (B, 3, H, W).
            reported: Cells (row, col), (B, 2).
            views: −1 unseen, 0 free, 100 obstacle, (B, 2r + 1, 2r + 1).
        """
        maps = torch.from_numpy(maps_before)
        mask = torch.from_numpy(valid_moves(maps_before[:, OBSTACLE] > 0)).to(maps.dtype)
        before = torch.from_numpy(self.beliefs)
        beliefs = self._filter.predict(before, torch.from_numpy(actions), mask)
        if self._slip:
            # A step that slips leads beside the right cell, or nowhere.
            beside = [
                np.where(actions == DONE, DONE, (actions + turn) % NUM_MOVES) for turn in (-1, 1)
            ]
            slipped = [
                before,
                *(
                    self._filter.predict(before, torch.from_numpy(action), mask)
                    for action in beside
                ),
            ]
            beliefs = (1 - self._slip) * beliefs + self._slip * torch.stack(slipped).mean(dim=0)
        beliefs = self._measured(beliefs, reported)
        self.beliefs = self._filter.correct(beliefs, maps, torch.from_numpy(views)).numpy()

    def _measured(self, beliefs: torch.Tensor, reported: NDArray[np.int64]) -> torch.Tensor:
        """Return the beliefs weighed by the reported poses; by these alone if nothing is left."""
        rows, cols = (
            self._share(side, reported[:, axis, None])
            for axis, side in enumerate(beliefs.shape[1:])
        )
        likelihood = torch.from_numpy(rows[:, :, None] * cols[:, None, :])
        weighed = beliefs * likelihood
        lost = weighed.sum(dim=(1, 2), keepdim=True) < torch.finfo(weighed.dtype).tiny
        weighed = torch.where(lost, likelihood, weighed)
        return weighed / weighed.sum(dim=(1, 2), keepdim=True)

    def _share(self, side: int, reported: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return how likely each row, or column, is reported as the given one, (B, side).

        What would be reported off the map is reported at its edge.
        """
        cells = np.arange(side)
        if not self._pose_noise:
            return (cells == reported).astype(np.float32)
        low = np.where(reported == 0, -np.inf, reported - HALF)
        high = np.where(reported == side - 1, np.inf, reported + HALF)
        share: NDArray[np.float32] = (
            ndtr((high - cells) / self._pose_noise) - ndtr((low - cells) / self._pose_noise)
        ).astype(np.float32)
        return share
