"""What is what in a picture or in a cloud: everything that names the classes of points.

A `Segmenter` labels the pixels of each frame as it comes. A `CloudSegmenter` labels the cloud that
many frames made, now and then; until then its points have the labels of a `Segmenter`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from bev_mapper.segmentation.geometric import GeometricSegmenter
from bev_mapper.segmentation.ground_truth import GroundTruthSegmenter

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from gridnav.rgbd import RgbdFrame


class Segmenter(Protocol):
    """Labels the pixels of frames."""

    @property
    def name(self) -> str:
        """What people call it."""

    def labels(self, frame: RgbdFrame, points: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the class of each pixel, `gridnav.rgbd.UNLABELLED` where it has none, (H, W).

        Args:
            frame: The frame, thinned to the pixels that the mapper uses; its depth is in metres,
                float32, and 0 where nothing was measured.
            points: Of the pixels: x and y in the frame of the map and the height above the floor,
                in metres, (3, H, W). What it holds where the depth is 0 says nothing.

        Raises:
            ValueError: If the frame lacks what is needed, with one sentence that says what.
        """


@runtime_checkable
class CloudSegmenter(Protocol):
    """Labels points of a cloud."""

    @property
    def name(self) -> str:
        """What people call it."""

    def cloud_labels(
        self, positions: NDArray[np.float64], colors: NDArray[np.uint8]
    ) -> NDArray[np.uint8]:
        """Return the class of each point, (N,).

        Args:
            positions: Metres, z up and 0 on the floor, (N, 3).
            colors: RGB, (N, 3).
        """


SEGMENTERS = ('geometric', 'learned', 'dgcnn', 'swin3d', 'ground_truth')
"""The names that `make_segmenter` knows."""

__all__ = [
    'SEGMENTERS',
    'CloudSegmenter',
    'GeometricSegmenter',
    'GroundTruthSegmenter',
    'Segmenter',
    'make_segmenter',
]


def make_segmenter(name: str, weights: Path | None = None) -> Segmenter | CloudSegmenter:
    """Build a segmenter.

    Args:
        name: One of `SEGMENTERS`.
        weights: Of 'dgcnn' and 'swin3d', which come without, the file; of 'learned', a folder
            with others than the shipped ones.

    Raises:
        ValueError: If it can't be, with one sentence that says why.
    """
    # Those with networks are loaded late, as they load PyTorch.
    if name == 'geometric':
        return GeometricSegmenter()
    if name == 'ground_truth':
        return GroundTruthSegmenter()
    if name == 'learned':
        from bev_mapper.segmentation.learned import LearnedSegmenter  # noqa: PLC0415

        return LearnedSegmenter.from_folder(weights)
    if name == 'dgcnn':
        file = _given(name, weights)
        from bev_mapper.segmentation.dgcnn import DgcnnSegmenter  # noqa: PLC0415

        return DgcnnSegmenter.from_file(file)
    if name == 'swin3d':
        file = _given(name, weights)
        from bev_mapper.segmentation.swin3d import Swin3dSegmenter  # noqa: PLC0415

        return Swin3dSegmenter.from_file(file)
    msg = f'There is no segmenter {name!r}, only {", ".join(SEGMENTERS)}.'
    raise ValueError(msg)


def _given(name: str, weights: Path | None) -> Path:
    if weights is None:
        msg = f'The segmenter {name!r} comes without weights: say where the file with yours is.'
        raise ValueError(msg)
    if not weights.is_file():
        msg = f'The weights {weights} can not be read: there is no such file.'
        raise ValueError(msg)
    return weights
