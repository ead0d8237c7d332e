"""Swin3D (Yang et al. 2023), the paper's choice, with the user's own CUDA installation."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from bev_mapper.segmentation.weights import read_state
from gridnav.rgbd import CLASSES

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

VOXEL_M = 0.04

SETTINGS: dict[str, Any] = {
    'depths': [2, 4, 9, 4, 4],
    'window_sizes': [5, 7, 7, 7, 7],
    'quant_sizes': 4,
    'up_k': 3,
    'drop_path_rate': 0.3,
    'num_layers': 5,
    'num_classes': len(CLASSES),
    'stem_transformer': True,
    'upsample': 'linear_attn',
    'first_down_stride': 2,
    'knn_down': True,
    'in_channels': 6,
    'cRSE': 'XYZ_RGB',
    'fp16_mode': 0,
}
"""What the published S3DIS models have in common."""

WIDTHS = {
    48: {'channels': [48, 96, 192, 384, 384], 'num_heads': [6, 6, 12, 24, 24]},
    80: {'channels': [80, 160, 320, 640, 640], 'num_heads': [10, 10, 20, 40, 40]},
}
"""What differs between the small and the large one, by the width of the last layer."""

LAST_LAYER = 'classifier.0.weight'


class Swin3dSegmenter:
    """Labels whole clouds at once."""

    name = 'swin3d'

    def __init__(self, network: Any, sparse_tensor: Any, device: str) -> None:  # noqa: ANN401
        """Take a `Swin3DUNet`, MinkowskiEngine's `SparseTensor`, and where to compute."""
        self._network = network.to(device).eval()
        self._sparse_tensor = sparse_tensor
        self._device = device

    @classmethod
    def from_file(cls, path: Path) -> Swin3dSegmenter:
        """Load the weights of one of the published S3DIS models.

        Raises:
            ValueError: If Swin3D is not installed, or the file is not one of these.
        """
        try:
            # By name, as they are no dependencies: whoever wants them builds them.
            sparse_tensor = import_module('MinkowskiEngine').SparseTensor
            make_network = import_module('Swin3D.models').Swin3DUNet
        except ImportError as error:
            msg = (
                'Swin3D is not installed here: it needs the packages Swin3D and MinkowskiEngine, '
                f'built for CUDA ({error}).'
            )
            raise ValueError(msg) from error
        state = {key.removeprefix('backbone.'): value for key, value in read_state(path).items()}
        width = WIDTHS.get(len(state.get(LAST_LAYER, ())))
        if width is None:
            msg = f'The weights {path} are not those of a Swin3D for the 13 classes of S3DIS.'
            raise ValueError(msg)
        network = make_network(**SETTINGS, **width)
        try:
            network.load_state_dict(state)
        except RuntimeError as error:
            msg = f'The weights {path} are not those of a Swin3D for the 13 classes of S3DIS.'
            raise ValueError(msg) from error
        return cls(network, sparse_tensor, 'cuda' if torch.cuda.is_available() else 'cpu')

    def cloud_labels(
        self, positions: NDArray[np.float64], colors: NDArray[np.uint8]
    ) -> NDArray[np.uint8]:
        """See `CloudSegmenter`."""
        # One point for each voxel of the network; the others take its label.
        places = ((positions - positions.min(axis=0)) / VOXEL_M).astype(np.float32)
        _, first, inverse = np.unique(
            places.astype(np.int32), axis=0, return_index=True, return_inverse=True
        )
        # It was trained with the second axis upright, and with places within their voxels.
        xyz = torch.from_numpy(places[first][:, [0, 2, 1]]).to(self._device)
        rgb = torch.from_numpy(colors[first] / np.float32(127.5) - 1).float().to(self._device)
        batch = torch.zeros((len(xyz), 1), device=self._device)
        where = torch.cat([batch, xyz], dim=1)
        points = self._sparse_tensor(torch.cat([rgb, xyz - xyz.int()], dim=1), where.int())
        # As in its own code: colours of exactly 1 would fall out of the table of its embedding.
        signal = self._sparse_tensor(
            features=torch.cat([where, rgb / 1.001], dim=1),
            coordinate_map_key=points.coordinate_map_key,
            coordinate_manager=points.coordinate_manager,
        )
        with torch.inference_mode():
            scores = self._network(points, signal)
        labels: NDArray[np.uint8] = scores.argmax(dim=1).cpu().numpy().astype(np.uint8)
        return labels[inverse.reshape(-1)]
