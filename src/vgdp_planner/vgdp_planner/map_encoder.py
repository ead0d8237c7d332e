"""Networks that read a partial map: the paper's encoder and the fully convolutional trunk."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from vgdp_planner.windows import cut, extent

if TYPE_CHECKING:
    from collections.abc import Sequence


class ChannelNorm(nn.Module):
    """Divide each cell's features by their root mean square, so that map size plays no part."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.scale = nn.Parameter(torch.ones(channels))

    def forward(self, features: Tensor) -> Tensor:
        """Normalise (B, C, H, W) over C."""
        mean_square = features.square().mean(dim=1, keepdim=True)
        return features * torch.rsqrt(mean_square + 1e-6) * self.scale[:, None, None]


class ConvBlock(nn.Module):
    """Normalise, convolve, activate, convolve, and add to the input."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            ChannelNorm(channels),
            nn.Conv2d(channels, channels, 3, padding=1),
            nn.SiLU(),
            nn.Conv2d(channels, channels, 3, padding=1),
        )

    def forward(self, features: Tensor) -> Tensor:
        """Map (B, C, H, W) to the same shape."""
        return features + self.layers(features)


class MapTrunk(nn.Module):
    """A fully convolutional U-Net over a map of any size.

    Three scales (1, 1/2, 1/4) let each cell's features depend on a wide surrounding at little
    cost. Nothing is pooled over the whole map, so what is learned on small maps holds on large
    ones.

    Args:
        inputs: Channels of the map.
        channels: Channels of the three scales.
    """

    STRIDE = 4

    REACH = 32
    """The features in a square of `STRIDE` cells a side, and next to it, depend on nothing that is
    farther from it than this. It is a multiple of `STRIDE`."""

    def __init__(self, inputs: int, channels: Sequence[int]) -> None:
        super().__init__()
        fine, middle, coarse = channels
        self.stem = nn.Conv2d(inputs, fine, 3, padding=1)
        self.fine_in = ConvBlock(fine)
        self.down_1 = nn.Conv2d(fine, middle, 2, stride=2)
        self.middle_in = ConvBlock(middle)
        self.down_2 = nn.Conv2d(middle, coarse, 2, stride=2)
        self.coarse = nn.Sequential(ConvBlock(coarse), ConvBlock(coarse))
        self.up_1 = nn.ConvTranspose2d(coarse, middle, 2, stride=2)
        self.middle_out = ConvBlock(middle)
        self.up_2 = nn.ConvTranspose2d(middle, fine, 2, stride=2)
        self.fine_out = nn.Sequential(ConvBlock(fine), ChannelNorm(fine))

    def forward(self, maps: Tensor) -> Tensor:
        """Map (B, inputs, H, W) to features (B, channels[0], H, W)."""
        height, width = maps.shape[-2:]
        padded = functional.pad(maps, (0, -width % self.STRIDE, 0, -height % self.STRIDE))
        fine = self.fine_in(self.stem(padded))
        middle = self.middle_in(self.down_1(fine))
        coarse = self.coarse(self.down_2(middle))
        middle = self.middle_out(middle + self.up_1(coarse))
        fine = self.fine_out(fine + self.up_2(middle))
        return fine[..., :height, :width]


def with_inside(partial_maps: Tensor) -> Tensor:
    """Append a channel of ones, (B, 3, H, W) to (B, 4, H, W).

    Convolutions pad with zeros, which would make what lies off the map look like unseen cells;
    the ones tell the two apart.
    """
    return torch.cat([partial_maps, torch.ones_like(partial_maps[:, :1])], dim=1)


class PooledMapEncoder(nn.Module):
    """The paper's environment encoder (appendix, "Plan generation module").

    Three convolutional blocks (kernel 3, stride 1, padding 1, group normalisation with eight
    groups), global average pooling, two fully connected layers.

    Args:
        channels: Channels of the three blocks.
        embedding: Length of the embedding.
    """

    def __init__(self, channels: Sequence[int], embedding: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, outputs in zip([3, *channels[:-1]], channels, strict=True):
            layers += [
                nn.Conv2d(inputs, outputs, 3, padding=1),
                nn.GroupNorm(8, outputs),
                nn.SiLU(),
            ]
        self.convolutions = nn.Sequential(*layers)
        self.fully_connected = nn.Sequential(
            nn.Linear(channels[-1], embedding), nn.SiLU(), nn.Linear(embedding, embedding)
        )

    def forward(self, partial_maps: Tensor, beliefs: Tensor) -> Tensor:  # noqa: ARG002
        """Encode partial maps (B, 3, H, W) as (B, embedding); the belief is not looked at."""
        pooled: Tensor = self.fully_connected(self.convolutions(partial_maps).mean(dim=(-2, -1)))
        return pooled


class BeliefMapEncoder(nn.Module):
    """Features where the robot may be, soft-indexed by the belief: e = f(Σ_s b(s) φ(s)).

    Args:
        channels: Channels of the three scales of the trunk that makes φ.
        embedding: Length of the embedding.
    """

    def __init__(self, channels: Sequence[int], embedding: int) -> None:
        super().__init__()
        # The belief is an input, too: features may say how things lie as seen from the robot.
        self.trunk = MapTrunk(inputs=5, channels=channels)
        self.project = nn.Conv2d(channels[0], embedding, 3, padding=1)
        self.fully_connected = nn.Sequential(nn.SiLU(), nn.Linear(embedding, embedding))

    def forward(self, partial_maps: Tensor, beliefs: Tensor) -> Tensor:
        """Encode partial maps (B, 3, H, W) and beliefs (B, H, W) as (B, embedding)."""
        maps = torch.cat([with_inside(partial_maps), beliefs[:, None]], dim=1)
        maps = _what_matters(maps, beliefs)
        beliefs = maps[:, -1]
        features = self.trunk(maps)
        # Indexing a convolution's output is indexing its inputs, moved by each of the kernel's
        # offsets: no need to convolve where the robot can't be.
        moved = functional.unfold(beliefs[:, None], 3, padding=1).flip(1)
        inputs = torch.einsum('bcs,bks->bck', features.flatten(2), moved).flatten(1)
        indexed = functional.linear(inputs, self.project.weight.flatten(1), self.project.bias)
        embedding: Tensor = self.fully_connected(indexed)
        return embedding


def _what_matters(maps: Tensor, beliefs: Tensor) -> Tensor:
    """Cut maps (B, C, H, W) to what plays a part in the features next to where the robots may be.

    The windows begin where coarse cells of the trunk do, so the features are those of the whole
    map, and on a large map they cost no more than on a small one.
    """
    stride = MapTrunk.STRIDE
    height, width = maps.shape[-2:]
    maps = functional.pad(maps, (0, -width % stride, 0, -height % stride))
    top, rows = _squares_around(beliefs.amax(dim=2))
    left, cols = _squares_around(beliefs.amax(dim=1))
    return cut(maps, stride * top, stride * left, stride * rows, stride * cols)


def _squares_around(beliefs: Tensor) -> tuple[Tensor, int]:
    """Return where the squares within reach of beliefs (B, N) begin (B,), and their number."""
    reach = MapTrunk.REACH // MapTrunk.STRIDE
    squares = functional.max_pool1d(beliefs, MapTrunk.STRIDE, ceil_mode=True)
    return extent(functional.max_pool1d(squares, 2 * reach + 1, 1, reach) > 0)
