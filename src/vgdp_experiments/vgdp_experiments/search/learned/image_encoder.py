"""What the robot sees as channels of its map: small images, encoded and laid over the cells."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from vgdp_experiments.search.views import CHANNELS

MAX_OFF_RAD = math.pi / 6
"""A view says something of the cells whose bearing is no further from its own than this."""


class ViewEncoder(nn.Module):
    """A small CNN that turns each view into an embedding, trained from scratch.

    Three convolutions of stride 2, the mean over the image, one fully connected layer.

    Args:
        embedding: Length of the embedding.
    """

    def __init__(self, embedding: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, outputs in ((CHANNELS, 16), (16, 24), (24, 32)):
            layers += [nn.Conv2d(inputs, outputs, 3, stride=2, padding=1), nn.SiLU()]
        self.convolutions = nn.Sequential(*layers)
        self.last = nn.Linear(32, embedding)

    def forward(self, views: Tensor) -> Tensor:
        """Encode views (N, 5, 36, 64) as (N, embedding), each value from −1 to 1."""
        pooled = self.convolutions(views).mean(dim=(-2, -1))
        embedding: Tensor = self.last(pooled).tanh()
        return embedding


def laid_out(
    embeddings: Tensor, bearings: Tensor, cells: Tensor, shape: tuple[int, int]
) -> Tensor:
    """Lay embeddings of views over the map: each cell gets that of the view which looks its way.

    So an embedding is joined to the partial map where the map says something of the same part of
    the home. Cells that no view looks at, and the robot's own, get zeros.

    Args:
        embeddings: (B, V, E).
        bearings: Where the views look, NaN for views that are not there, (B, V).
        cells: The robot's (row, col), (B, 2).
        shape: Rows and columns of the map.

    Returns:
        (B, E, H, W).
    """
    rows = torch.arange(shape[0], device=cells.device)[None, :, None] - cells[:, 0, None, None]
    cols = torch.arange(shape[1], device=cells.device)[None, None, :] - cells[:, 1, None, None]
    towards = torch.atan2(rows.float(), cols.float())
    off = (towards[:, None] - bearings[:, :, None, None]).nan_to_num(math.pi)
    off = torch.atan2(off.sin(), off.cos()).abs()
    nearest, view = off.min(dim=1)
    sees = (nearest <= MAX_OFF_RAD) & ((rows != 0) | (cols != 0))
    owner = torch.arange(len(cells), device=cells.device)[:, None, None]
    return embeddings[owner, view].movedim(-1, 1) * sees[:, None]
