"""Windows of one size around where robots may be, cut out of larger maps."""

from __future__ import annotations

import torch
from torch import Tensor


def extent(occupied: Tensor) -> tuple[Tensor, int]:
    """Return where the occupied cells (B, N) begin (B,) and how many hold those of each row."""
    cells = occupied.shape[1]
    first = occupied.int().argmax(dim=1)
    last = cells - 1 - occupied.flip(1).int().argmax(dim=1)
    size = int((last - first).max()) + 1
    return first.clamp_max(cells - size), size


def cut(fields: Tensor, top: Tensor, left: Tensor, height: int, width: int) -> Tensor:
    """Cut a window out of each of the fields (B, C, H, W).

    Args:
        fields: Large enough for all windows.
        top: First row of each window, (B,).
        left: First column of each window, (B,).
        height: Rows of the windows.
        width: Columns of the windows.

    Returns:
        (B, C, height, width).
    """
    owner = torch.arange(len(fields), device=fields.device)[:, None, None]
    rows = top[:, None] + torch.arange(height, device=top.device)
    cols = left[:, None] + torch.arange(width, device=left.device)
    windows = fields.movedim(1, -1)[owner, rows[:, :, None], cols[:, None, :]]
    return windows.movedim(-1, 1).contiguous()
