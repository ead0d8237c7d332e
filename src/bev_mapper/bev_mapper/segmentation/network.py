"""A small U-Net (Ronneberger et al. 2015) of residual layers, made for one CPU core."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

from bev_mapper.segmentation.pixels import INPUTS
from gridnav.rgbd import CLASSES

if TYPE_CHECKING:
    from collections.abc import Sequence

CELL = 2
"""Side in pixels of the squares that the first layer takes together and the last takes apart."""


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes of the network.

    Attributes:
        widths: Channels at each scale; the first is half of the picture's, each other half of
            the one before.
        blocks: Residual blocks at each scale on the way down; there is one on the way up.
        pixels: The network sees so many pixels of a frame, or a little fewer.
    """

    widths: tuple[int, ...] = (32, 48, 80, 96)
    blocks: tuple[int, ...] = (1, 2, 2, 2)
    pixels: int = 19_200

    def __post_init__(self) -> None:
        """Check the sizes."""
        object.__setattr__(self, 'widths', tuple(self.widths))
        object.__setattr__(self, 'blocks', tuple(self.blocks))
        if not self.widths or len(self.widths) != len(self.blocks) or min(self.widths) < 1:
            msg = f'There are {len(self.blocks)} numbers of blocks for widths {self.widths}.'
            raise ValueError(msg)
        if self.pixels < 1:
            msg = f'The network sees at least one pixel, not {self.pixels}.'
            raise ValueError(msg)


class PixelNetwork(nn.Module):
    """Scores the classes of each pixel."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        widths = config.widths
        self.squares = nn.PixelUnshuffle(CELL)
        self.enter = _layer(len(INPUTS) * CELL**2, widths[0])
        self.down = nn.ModuleList(
            _layer(before, after, stride=2) for before, after in pairwise(widths)
        )
        self.encoders = nn.ModuleList(
            nn.Sequential(*(Residual(width) for _ in range(count)))
            for width, count in zip(widths, config.blocks, strict=True)
        )
        # What is seen as a whole (how noisy it is, how high the room) is told to all pixels.
        self.whole = nn.Linear(widths[-1], widths[-1])
        self.up = nn.ModuleList(nn.Conv2d(below, above, 1) for above, below in pairwise(widths))
        self.decoders = nn.ModuleList(Residual(width) for width in widths[:-1])
        self.leave = nn.Conv2d(widths[0], len(CLASSES) * CELL**2, 1)
        self.apart = nn.PixelShuffle(CELL)

    def forward(self, seen: Tensor) -> Tensor:
        """Map what is seen (B, 9, H, W), H and W even, to scores (B, 13, H, W)."""
        hidden = self.encoders[0](self.enter(self.squares(seen)))
        kept = [hidden]
        for down, encoder in zip(self.down, self.encoders[1:], strict=True):
            hidden = encoder(down(hidden))
            kept.append(hidden)
        hidden = kept.pop()
        hidden = hidden + self.whole(hidden.mean(dim=(2, 3)))[:, :, None, None]
        for up, decoder in reversed(list(zip(self.up, self.decoders, strict=True))):
            finer = kept.pop()
            coarse = functional.interpolate(up(hidden), size=finer.shape[2:], mode='nearest')
            hidden = decoder(finer + coarse)
        scores: Tensor = self.apart(self.leave(hidden))
        return scores

    def fused(self) -> PixelNetwork:
        """Return the network for use: batch norms have become parts of the layers before."""
        network = PixelNetwork(self.config)
        network.load_state_dict(self.state_dict())
        network.eval()
        for module in list(network.modules()):
            if isinstance(module, Layer):
                module.fuse()
        return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload,no-any-return]


class Layer(nn.Module):
    """A convolution and a batch norm."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.norm: nn.Module = nn.BatchNorm2d(outputs)

    def forward(self, hidden: Tensor) -> Tensor:
        """Map (B, inputs, H, W) to (B, outputs, H, W), or half of that size."""
        result: Tensor = self.norm(self.convolution(hidden))
        return result

    def fuse(self) -> None:
        """Make one layer of both."""
        if isinstance(self.norm, nn.BatchNorm2d):
            self.convolution = fuse_conv_bn_eval(self.convolution, self.norm)
            self.norm = nn.Identity()


class Residual(nn.Module):
    """Two layers whose output is added to the input."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = Layer(width, width)
        self.second = Layer(width, width)

    def forward(self, hidden: Tensor) -> Tensor:
        """Map (B, width, H, W) to the same shape."""
        added = self.second(functional.relu(self.first(hidden), inplace=True))
        return functional.relu(hidden + added, inplace=True)


def _layer(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(Layer(inputs, outputs, stride), nn.ReLU(inplace=True))


def parameters(network: nn.Module) -> int:
    """Return how many numbers a network has learned."""
    tensors: Sequence[Tensor] = list(network.parameters())
    return sum(tensor.numel() for tensor in tensors)
