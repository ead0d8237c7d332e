"""The labels that came with a frame, for experiments."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gridnav.rgbd import RgbdFrame


class GroundTruthSegmenter:
    """Takes a frame's own labels."""

    name = 'ground_truth'

    def labels(self, frame: RgbdFrame, points: NDArray[np.float64]) -> NDArray[np.uint8]:
        """See `Segmenter`."""
        del points
        if frame.labels is None:
            msg = f'{frame.name} has no true labels.'
            raise ValueError(msg)
        return frame.labels
