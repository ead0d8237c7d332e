"""A bounded cloud of everything seen, in voxels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gridnav.rgbd import CLASSES, UNLABELLED

if TYPE_CHECKING:
    from numpy.typing import NDArray

KINDS = len(CLASSES) + 1
"""Votes are counted for each class and, last, for having none."""

DROPPED_SHARE = 0.1
"""When the cloud is full, this part of it makes room at once, so that it seldom has to."""

MAX_VOTES = np.iinfo(np.uint16).max

_AXIS_BITS = 21
_OFFSET = 1 << (_AXIS_BITS - 1)
_EMPTY = np.int64(-1)
_MIXER = np.uint64(0x9E3779B97F4A7C15)
"""2⁶⁴ divided by the golden ratio: products with it spread neighbouring keys (Knuth)."""


@dataclass(frozen=True)
class CloudPoints:
    """The voxels of a cloud as points.

    Attributes:
        positions: Means of the points in each voxel, metres in the frame of the map, (N, 3).
        colors: Their mean colours, uint8 (N, 3).
        labels: The class that most of them had, uint8 (N,).
    """

    positions: NDArray[np.float64]
    colors: NDArray[np.uint8]
    labels: NDArray[np.uint8]


class VoxelCloud:
    """Voxels in a hash table with open addressing.

    What a frame costs depends on how many points it has, not on how large the cloud is. The
    cloud never has more than `max_voxels`; then those that were not seen for longest make room.

    Attributes:
        voxel: Side of a voxel in metres.
        dropped: How many voxels had to make room so far.
    """

    def __init__(self, voxel: float, max_voxels: int) -> None:
        """Start empty.

        Args:
            voxel: Side of a voxel in metres.
            max_voxels: There are never more voxels than this.
        """
        self.voxel = voxel
        self.max_voxels = max_voxels
        self.clear()

    def __len__(self) -> int:
        """Return how many voxels there are."""
        return self._count

    def clear(self) -> None:
        """Forget everything."""
        # Zeros take no memory before they are written to.
        count = self.max_voxels
        self._keys = np.zeros(count, dtype=np.int64)
        self._means = np.zeros((count, 6), dtype=np.float64)
        self._weights = np.zeros(count, dtype=np.float64)
        self._votes = np.zeros((count, KINDS), dtype=np.uint16)
        self._seen = np.zeros(count, dtype=np.int64)
        self._count = 0
        self._frames = 0
        self.dropped = 0
        self._slots = 1 << max(4, (2 * count - 1).bit_length())
        self._make_table()

    def merge(
        self,
        positions: NDArray[np.float64],
        colors: NDArray[np.uint8],
        labels: NDArray[np.uint8],
    ) -> None:
        """Take in the points of a frame.

        Args:
            positions: Metres in the frame of the map, (3, N).
            colors: (N, 3).
            labels: Indices of classes or `UNLABELLED`, (N,).
        """
        self._frames += 1
        if not len(labels):
            return
        keys, means, weights, votes = _summarise(positions, colors, labels, self.voxel)
        if len(keys) > self.max_voxels:
            self.dropped += len(keys) - self.max_voxels
            keys, means = keys[: self.max_voxels], means[: self.max_voxels]
            weights, votes = weights[: self.max_voxels], votes[: self.max_voxels]
        found = self._find(keys)
        self._seen[found[found >= 0]] = self._frames
        new = found < 0
        missing = self._count + int(new.sum()) - self.max_voxels
        if missing > 0:
            self._drop(max(missing, int(DROPPED_SHARE * self.max_voxels)))
            found = self._find(keys)
            new = found < 0
        first = self._count
        self._count += int(new.sum())
        found[new] = np.arange(first, self._count)
        self._insert(keys[new], found[new])
        self._keys[found[new]] = keys[new]
        self._means[first : self._count] = 0.0
        self._weights[first : self._count] = 0.0
        self._votes[first : self._count] = 0

        self._weights[found] += weights
        share = (weights / self._weights[found])[:, None]
        self._means[found] += share * (means - self._means[found])
        total = self._votes[found].astype(np.int64) + votes
        self._votes[found] = np.minimum(total, MAX_VOTES)
        self._seen[found] = self._frames

    def points(self) -> CloudPoints:
        """Return all voxels as points."""
        means = self._means[: self._count]
        return CloudPoints(
            means[:, :3].copy(), np.rint(means[:, 3:]).astype(np.uint8), self._labels()
        )

    def relabel(self, labels: NDArray[np.uint8]) -> None:
        """Replace the labels of all voxels (N,), in the order of `points`; votes go on from it."""
        kinds = np.minimum(labels, KINDS - 1)
        votes = self._votes[: self._count]
        weights = np.maximum(votes.sum(axis=1), 1)
        votes[:] = 0
        votes[np.arange(self._count), kinds] = np.minimum(weights, MAX_VOTES)

    def _labels(self) -> NDArray[np.uint8]:
        most = self._votes[: self._count].argmax(axis=1)
        kinds: NDArray[np.uint8] = most.astype(np.uint8)
        kinds[kinds == KINDS - 1] = UNLABELLED
        return kinds

    def _drop(self, number: int) -> None:
        """Drop the voxels that were not seen for longest, never one of the present frame."""
        count = self._count
        order = np.argsort(self._seen[:count], kind='stable')
        old = order[:number]
        old = old[self._seen[old] < self._frames]
        keep = np.ones(count, dtype=np.bool_)
        keep[old] = False
        left = int(keep.sum())
        for array in self._arrays():
            array[:left] = array[:count][keep]
        self.dropped += count - left
        self._count = left
        self._make_table()
        self._insert(self._keys[:left], np.arange(left))

    def _arrays(self) -> list[NDArray[Any]]:
        return [self._keys, self._means, self._weights, self._votes, self._seen]

    def _make_table(self) -> None:
        self._table = np.full(self._slots, -1, dtype=np.int32)

    def _hash(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        shift = np.uint64(64 - (self._slots.bit_length() - 1))
        return ((keys.view(np.uint64) * _MIXER) >> shift).astype(np.int64)

    def _find(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return where keys (N,) are in the arrays, -1 where they are not."""
        found = np.full(len(keys), -1, dtype=np.int64)
        slots = self._hash(keys)
        asked = np.arange(len(keys))
        while len(asked):
            entries = self._table[slots]
            used = entries >= 0
            asked, slots, entries = asked[used], slots[used], entries[used]
            match = self._keys[entries] == keys[asked]
            found[asked[match]] = entries[match]
            asked, slots = asked[~match], (slots[~match] + 1) & (self._slots - 1)
        return found

    def _insert(self, keys: NDArray[np.int64], places: NDArray[np.int64]) -> None:
        """Enter keys (N,) that are not in the table, all different."""
        slots = self._hash(keys)
        while len(places):
            free = self._table[slots] < 0
            self._table[slots[free]] = places[free]
            # Of several keys that want one slot the last one written got it.
            lost = self._table[slots] != places
            places, slots = places[lost], (slots[lost] + 1) & (self._slots - 1)


def _summarise(
    positions: NDArray[np.float64],
    colors: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    voxel: float,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return the voxels of points: keys (V,), means (V, 6), weights (V,), votes (V, KINDS)."""
    cells = np.floor(positions / voxel).astype(np.int64)
    low = cells.min(axis=1, keepdims=True)
    spans = (cells.max(axis=1) - low[:, 0] + 1).tolist()
    cells -= low
    number = (cells[0] * spans[1] + cells[1]) * spans[2] + cells[2]
    # Neighbours in the picture are neighbours in the room: there is much that is sorted already.
    order = np.argsort(number, kind='stable')
    number = number[order]
    first = np.append(True, number[1:] != number[:-1])
    group = np.empty_like(order)
    group[order] = np.cumsum(first) - 1

    begins = order[first]
    cells = cells[:, begins] + (low + _OFFSET)
    keys = (cells[0] << 2 * _AXIS_BITS) | (cells[1] << _AXIS_BITS) | cells[2]
    count = len(keys)
    weights = np.bincount(group).astype(np.float64)
    means = np.stack([np.bincount(group, values) for values in (*positions, *colors.T)], axis=1)
    votes = np.bincount(group * KINDS + np.minimum(labels, KINDS - 1), minlength=count * KINDS)
    return keys, means / weights[:, None], weights, votes.reshape(count, KINDS)
