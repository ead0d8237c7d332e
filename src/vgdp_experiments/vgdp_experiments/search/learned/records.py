"""Weights of learned methods on disk: `model.safetensors` and `config.json`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from vgdp_planner.weights import CONFIG_FILE, MODEL_FILE, WeightsError, read_record

if TYPE_CHECKING:
    from collections.abc import Mapping

    from torch import Tensor

WEIGHTS = Path(__file__).parents[2] / 'weights' / 'search'
"""Folder of the weights that come with the package."""


def save_record(
    folder: Path,
    tensors: Mapping[str, Tensor],
    config: dict[str, Any],
    training: dict[str, Any],
) -> None:
    """Write weights, configuration and how they came about into a folder, creating it."""
    folder.mkdir(parents=True, exist_ok=True)
    save_file({name: tensor.contiguous() for name, tensor in tensors.items()}, folder / MODEL_FILE)
    record = {'config': config, 'training': training}
    (folder / CONFIG_FILE).write_text(json.dumps(record, indent=2) + '\n', encoding='utf-8')


def load_record(folder: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Read what `save_record` wrote: configuration and weights.

    Raises:
        WeightsError: If the folder does not hold them, with one sentence that says why.
    """
    record = read_record(folder)
    try:
        return record['config'], load_file(folder / MODEL_FILE)
    except FileNotFoundError as error:
        msg = f'There are no weights in {folder}: {MODEL_FILE} is missing.'
        raise WeightsError(msg) from error
    except (SafetensorError, OSError) as error:
        msg = f'{folder / MODEL_FILE} is damaged: {error}.'
        raise WeightsError(msg) from error
