"""Segmentation by a network that was trained on synthetic homes."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from bev_mapper.segmentation.network import NetworkConfig, PixelNetwork, parameters
from bev_mapper.segmentation.pixels import (
    chosen,
    network_inputs,
    network_size,
    resized,
    spread,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from gridnav.rgbd import RgbdFrame

SHIPPED = Path(__file__).parent / 'weights'
"""The weights that come with the package."""

MODEL_FILE, CONFIG_FILE = 'model.safetensors', 'config.json'


class LearnedSegmenter:
    """Labels frames in real time on one CPU core, with all thirteen classes.

    Attributes:
        parameters: How many numbers its network has learned.
    """

    name = 'learned'

    def __init__(self, network: PixelNetwork) -> None:
        """Take a trained network."""
        self.parameters = parameters(network)
        self._network = network.fused()

    @classmethod
    def from_folder(cls, folder: Path | None = None) -> Self:
        """Load weights, the shipped ones if None.

        Raises:
            ValueError: If the folder does not hold them undamaged, with one sentence.
        """
        return cls(load_network(folder or SHIPPED))

    def labels(self, frame: RgbdFrame, points: NDArray[np.float64]) -> NDArray[np.uint8]:
        """See `Segmenter`."""
        depth = np.asarray(frame.depth, dtype=np.float32)
        height, width = depth.shape
        count = network_size(height, width, self._network.config.pixels)
        rows, cols = chosen(height, count[0]), chosen(width, count[1])
        some = np.ix_(rows, cols)
        seen = network_inputs(
            frame.color[some],
            depth[some],
            points[:, some[0], some[1]],
            resized(frame.camera, rows, cols),
            frame.camera_to_map(),
        )
        with torch.inference_mode():
            batch = torch.from_numpy(seen)[None].contiguous(memory_format=torch.channels_last)
            found = self._network(batch)[0].argmax(dim=0).to(torch.uint8).numpy()
        return spread(found, depth[some], depth)


def save_network(
    folder: Path,
    network_config: NetworkConfig,
    tensors: dict[str, Tensor],
    training: dict[str, Any],
) -> None:
    """Write weights, in half precision, and configuration into a folder, creating it.

    Args:
        folder: Where to.
        network_config: Sizes of the network.
        tensors: By name.
        training: How they came about, for the record.
    """
    folder.mkdir(parents=True, exist_ok=True)
    halves = {
        name: (tensor.half() if tensor.is_floating_point() else tensor).contiguous()
        for name, tensor in tensors.items()
    }
    save_file(halves, folder / MODEL_FILE)
    record = {'config': asdict(network_config), 'training': training}
    (folder / CONFIG_FILE).write_text(json.dumps(record, indent=2) + '\n', encoding='utf-8')


def load_network(folder: Path) -> PixelNetwork:
    """Read a network.

    Raises:
        ValueError: If the folder does not hold one undamaged, with one sentence.
    """
    record = load_record(folder)
    path = folder / MODEL_FILE
    try:
        network = PixelNetwork(NetworkConfig(**record['config']))
        network.load_state_dict(load_file(path))
    except FileNotFoundError as error:
        msg = f'There are no weights for segmentation in {folder}: {MODEL_FILE} is missing.'
        raise ValueError(msg) from error
    except (OSError, SafetensorError, RuntimeError, ValueError, TypeError) as error:
        msg = f'The weights for segmentation in {folder} are damaged: {str(error).splitlines()[0]}'
        raise ValueError(msg) from error
    return network


def load_record(folder: Path) -> dict[str, Any]:
    """Return the sizes of a network and how it was trained.

    Raises:
        ValueError: If the folder does not say so, with one sentence.
    """
    path = folder / CONFIG_FILE
    try:
        record = json.loads(path.read_text(encoding='utf-8'))
    except FileNotFoundError as error:
        msg = f'There are no weights for segmentation in {folder}: {CONFIG_FILE} is missing.'
        raise ValueError(msg) from error
    except (OSError, ValueError) as error:
        msg = f'{path} can not be read as JSON: {error}.'
        raise ValueError(msg) from error
    if isinstance(record, dict) and isinstance(record.get('config'), dict):
        return record
    msg = f'{path} holds no configuration.'
    raise ValueError(msg)
