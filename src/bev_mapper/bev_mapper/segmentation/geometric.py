"""Floor and ceiling by their heights, and everything in between an obstacle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gridnav.rgbd import CLASSES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gridnav.rgbd import RgbdFrame

FLOOR, CEILING, CLUTTER = (CLASSES.index(name) for name in ('floor', 'ceiling', 'clutter'))

FLOOR_M = 0.05
FLOOR_SLOPE = 0.01
"""The floor reaches up to the first, and the second for each metre of distance from the camera."""

CEILING_M = 2.3
"""All above this is ceiling."""

LOWEST_CEILING_M = 1.9
SLAB_M = 0.1
SLAB_SHARE = 0.3
"""Above the first, a slab of the second's height with this share of all points up there is ceiling
as well: walls spread over all heights."""

MIN_SLAB_POINTS = 200


class GeometricSegmenter:
    """Needs no training and knows three classes: floor, ceiling and clutter."""

    name = 'geometric'

    def labels(self, frame: RgbdFrame, points: NDArray[np.float64]) -> NDArray[np.uint8]:
        """See `Segmenter`."""
        height = points[2]
        labels = np.full(height.shape, CLUTTER, dtype=np.uint8)
        labels[height < FLOOR_M + FLOOR_SLOPE * frame.depth] = FLOOR
        high = (height > LOWEST_CEILING_M) & (frame.depth > 0)
        labels[height > _ceiling(height[high])] = CEILING
        return labels


def _ceiling(heights: NDArray[np.float64]) -> float:
    """Return from which height on all is ceiling, given the heights that may be."""
    edges = np.arange(LOWEST_CEILING_M, CEILING_M + SLAB_M, SLAB_M)
    counts, _ = np.histogram(heights, edges)
    fullest = int(counts.argmax())
    if counts[fullest] >= max(SLAB_SHARE * len(heights), MIN_SLAB_POINTS):
        return float(edges[fullest])
    return CEILING_M
