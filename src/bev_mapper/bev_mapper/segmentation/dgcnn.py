"""DGCNN (Wang et al. 2019) with the user's own weights, trained on S3DIS."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import nn

from bev_mapper.segmentation.weights import read_state
from gridnav.rgbd import CLASSES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Block = tuple[NDArray[np.float64], NDArray[np.int64]]

NEIGHBOURS = 20
SLOPE = 0.2
"""Of the leaky rectifier below 0."""

BLOCK_M, STRIDE_M = 1.0, 0.5
"""Side of a block and from one to the next: each point lies in four of them."""

MAX_POINTS = 4096
MIN_POINTS = 64
"""Blocks of fewer points are left out, unless a point would remain without a label."""

MIN_HEIGHT_M = 3.0
"""The room is taken to be at least this high."""


class DgcnnSegmenter:
    """Labels clouds in blocks of one metre, of which each point has several votes.

    Attributes:
        progress: Goes through the blocks, for whoever wants to show how far that is.
    """

    name = 'dgcnn'

    def __init__(self, network: Dgcnn, seed: int = 0) -> None:
        """Take a network; the seed chooses points where a block has too many."""
        self._network = network.eval()
        self._seed = seed
        self.progress: Callable[[Sequence[Block]], Iterable[Block]] = iter

    @classmethod
    def from_file(cls, path: Path) -> DgcnnSegmenter:
        """Load the weights of a PyTorch file.

        Raises:
            ValueError: If it can't be read or holds those of another network.
        """
        network = Dgcnn()
        # The batch norms stand in there twice, under names of their own as well.
        state = {key: value for key, value in read_state(path).items() if not key.startswith('bn')}
        try:
            network.load_state_dict(state)
        except RuntimeError as error:
            msg = f'The weights {path} are not those of a DGCNN for the 13 classes of S3DIS.'
            raise ValueError(msg) from error
        return cls(network)

    def cloud_labels(
        self, positions: NDArray[np.float64], colors: NDArray[np.uint8]
    ) -> NDArray[np.uint8]:
        """See `CloudSegmenter`."""
        low = positions.min(axis=0)
        # Heights count from the floor.
        low[2] = 0.0
        shifted = np.maximum(positions - low, 0.0)
        room = np.maximum(shifted.max(axis=0), [1e-6, 1e-6, MIN_HEIGHT_M])
        features = np.concatenate([shifted, colors / 255.0, shifted / room], axis=1)
        votes = np.zeros((len(positions), len(CLASSES)), dtype=np.float32)
        generator = np.random.default_rng(self._seed)
        for centre, members in self.progress(list(_blocks(shifted, generator))):
            block = features[members].astype(np.float32)
            block[:, :2] -= centre
            with torch.inference_mode():
                scores = self._network(torch.from_numpy(block.T.copy()))
            votes[members] += scores.softmax(dim=0).T.numpy()
        labels: NDArray[np.uint8] = votes.argmax(axis=1).astype(np.uint8)
        return labels


def _blocks(positions: NDArray[np.float64], generator: np.random.Generator) -> Iterator[Block]:
    """Yield the centre and the points of blocks, no more than `MAX_POINTS` at once."""
    lonely = np.ones(len(positions), dtype=np.bool_)
    tiles = np.floor(positions[:, :2] / STRIDE_M).astype(np.int64)
    rows_of = int(tiles[:, 1].max()) + 2
    # A point of a tile lies in the blocks that begin there, one to the left, and one below.
    starts = (tiles[:, None] - np.array([[0, 0], [1, 0], [0, 1], [1, 1]])).reshape(-1, 2)
    numbers = (starts[:, 0] + 1) * rows_of + starts[:, 1] + 1
    points = np.repeat(np.arange(len(positions)), 4)
    order = np.argsort(numbers, kind='stable')
    _, firsts = np.unique(numbers[order], return_index=True)
    groups = np.split(order, firsts[1:])
    # Small ones last, so that they are taken only for those whom no other block holds.
    for group in sorted(groups, key=len, reverse=True):
        members = points[group]
        if len(members) < MIN_POINTS and not lonely[members].any():
            continue
        lonely[members] = False
        centre = starts[group[0]] * STRIDE_M + BLOCK_M / 2
        members = generator.permutation(members)
        for part in np.array_split(members, -(-len(members) // MAX_POINTS)):
            yield centre, part


class Dgcnn(nn.Module):
    """The network for semantic segmentation, its layers named as in public weights."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = _layer(18, 64)
        self.conv2 = _layer(64, 64)
        self.conv3 = _layer(128, 64)
        self.conv4 = _layer(64, 64)
        self.conv5 = _layer(128, 64)
        self.conv6 = _layer(192, 1024, flat=True)
        self.conv7 = _layer(1216, 512, flat=True)
        self.conv8 = _layer(512, 256, flat=True)
        self.conv9 = nn.Conv1d(256, len(CLASSES), 1, bias=False)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return the scores of the classes (13, N) from the features of points (9, N)."""
        # The first graph joins points that are near each other in the room.
        first = self._edges(points, points[6:], self.conv1, self.conv2)
        second = self._edges(first, first, self.conv3, self.conv4)
        third = self._edges(second, second, self.conv5)
        together = torch.cat([first, second, third])[None]
        whole = self.conv6(together).amax(dim=2, keepdim=True).expand(-1, -1, points.shape[1])
        scores: torch.Tensor = self.conv9(
            self.conv8(self.conv7(torch.cat([whole, together], dim=1)))
        )
        return scores[0]

    @staticmethod
    def _edges(values: torch.Tensor, places: torch.Tensor, *layers: nn.Module) -> torch.Tensor:
        """EdgeConv: the most that layers make of the differences to the nearest points."""
        count = min(NEIGHBOURS, values.shape[1])
        distances = torch.cdist(places.T, places.T)
        nearest = distances.topk(count, largest=False).indices
        around = values[:, nearest]
        centre = values[:, :, None].expand(-1, -1, count)
        edges = torch.cat([around - centre, centre])[None]
        for layer in layers:
            edges = layer(edges)
        return edges[0].amax(dim=2)


def _layer(inputs: int, outputs: int, *, flat: bool = False) -> nn.Sequential:
    norm: Any
    convolution: Any
    convolution, norm = (nn.Conv1d, nn.BatchNorm1d) if flat else (nn.Conv2d, nn.BatchNorm2d)
    return nn.Sequential(
        convolution(inputs, outputs, 1, bias=False), norm(outputs), nn.LeakyReLU(SLOPE)
    )
