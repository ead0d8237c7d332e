"""The loss of the worth of the unseen: telling the better of the choices that there are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from torch import Tensor

    from vgdp_experiments.search.learned.rgbd import SeeingValue

PATIENCE_CELLS = 15.0
"""Of two choices, one that costs so many cells more counts e times less."""

NO_CHANCE = -1e6
"""Logarithm, about, of the chance of what can't be chosen; infinity times 0 would not be 0."""


def choice_loss(
    value: SeeingValue, maps: Tensor, look_cells: Tensor, distances: Tensor, costs: Tensor
) -> Tensor:
    """Return the cross-entropy of the successes γ^cost that each choice would bring.

    As in `train_value.worth_losses`, but as shares of a decision's choices: how far a thing is
    plays no part. All things that have not been seen count alike, as each might be the one that
    is looked for.

    Args:
        value: Has been told what is seen.
        maps: (B, 3, H, W).
        look_cells: Unseen cells to look at, (B, U, 2).
        distances: How far they are, infinite for none, (B, U).
        costs: What the expert has to go from there to each thing, infinite for none, (B, K, U).
    """
    worth, _ = value.worth_and_level(value.with_seen(maps))
    index = torch.arange(len(maps))[:, None]
    there = worth[index, look_cells[..., 0], look_cells[..., 1]]
    tried = distances.isfinite()
    to_see = costs.isfinite().any(dim=2).float()
    whole = (-distances[:, None] - costs).masked_fill(~tried[:, None], -torch.inf)
    better = (whole / PATIENCE_CELLS).clamp_min(NO_CHANCE).softmax(dim=2)
    # There may be nothing left to look at, and so no cost.
    to_see /= to_see.sum(dim=1, keepdim=True).clamp_min(1)
    better = torch.einsum('bk,bku->bu', to_see, better)
    chosen = (there - distances).masked_fill(~tried, -torch.inf) / PATIENCE_CELLS
    chosen = chosen.clamp_min(NO_CHANCE).log_softmax(dim=1)
    return -(better * chosen).sum(dim=1).mean()
