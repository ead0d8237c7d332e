"""Weights on disk: `model.safetensors`, `config.json` and the model card `README.md`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from vgdp_planner.config import Config

if TYPE_CHECKING:
    from collections.abc import Mapping

    from torch import Tensor

SHIPPED = Path(__file__).parent / 'weights' / 'default'
"""The weights that come with the package."""

MODEL_FILE, CONFIG_FILE = 'model.safetensors', 'config.json'


class WeightsError(ValueError):
    """A folder does not hold the weights of a planner."""


def save_weights(
    folder: str | Path, config: Config, tensors: dict[str, Tensor], training: dict[str, Any]
) -> None:
    """Write weights and configuration into a folder, creating it.

    Args:
        folder: Where to.
        config: What the tensors were made for.
        tensors: By name.
        training: How they came about (command, data, seed, scores), for the record.
    """
    save_record(folder, config.to_dict(), tensors, training)


def save_record(
    folder: str | Path,
    config: dict[str, Any],
    tensors: Mapping[str, Tensor],
    training: dict[str, Any],
) -> None:
    """Write weights of any networks with their configuration, as `save_weights` does."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    save_file({name: tensor.contiguous() for name, tensor in tensors.items()}, folder / MODEL_FILE)
    record = {'config': config, 'training': training}
    (folder / CONFIG_FILE).write_text(json.dumps(record, indent=2) + '\n', encoding='utf-8')


def read_record(folder: str | Path | None = None) -> dict[str, Any]:
    """Return what `config.json` says: the configuration and how the weights were trained.

    Raises:
        WeightsError: If there is no such file or it is damaged.
    """
    path = Path(folder or SHIPPED) / CONFIG_FILE
    try:
        record = json.loads(path.read_text(encoding='utf-8'))
    except FileNotFoundError as error:
        msg = f'There are no weights in {path.parent}: {CONFIG_FILE} is missing.'
        raise WeightsError(msg) from error
    except (OSError, ValueError) as error:
        msg = f'{path} can not be read as JSON: {error}.'
        raise WeightsError(msg) from error
    if not isinstance(record, dict) or not isinstance(record.get('config'), dict):
        msg = f'{path} holds no configuration.'
        raise WeightsError(msg)
    return record


def load_weights(folder: str | Path | None = None) -> tuple[Config, dict[str, Tensor]]:
    """Read configuration and weights from a folder; the shipped ones if None.

    Raises:
        WeightsError: If the folder does not hold them undamaged, with one sentence that says why.
    """
    record = read_record(folder)
    folder = Path(folder or SHIPPED)
    try:
        config = Config.from_dict(record['config'])
    except (TypeError, ValueError, AttributeError) as error:
        msg = f'The configuration in {folder} is not valid: {error}'
        raise WeightsError(msg) from error
    return config, read_tensors(folder)


def read_tensors(folder: Path) -> dict[str, Tensor]:
    """Return the weights in a folder by name.

    Raises:
        WeightsError: If there are none or they are damaged, with one sentence that says so.
    """
    path = folder / MODEL_FILE
    try:
        return load_file(path)
    except FileNotFoundError as error:
        msg = f'There are no weights in {folder}: {MODEL_FILE} is missing.'
        raise WeightsError(msg) from error
    except (SafetensorError, OSError) as error:
        msg = f'{path} is damaged: {error}.'
        raise WeightsError(msg) from error


def load_part(folder: str | Path | None, part: str) -> tuple[Config, dict[str, Tensor]]:
    """Read the weights of one part of a planner, under the names that its module gives them.

    Args:
        folder: As for `load_weights`. It may hold that part alone.
        part: 'policy', 'value' or 'belief'.

    Raises:
        WeightsError: If the folder does not hold that part, with one sentence that says why.
    """
    config, tensors = load_weights(folder)
    prefix = f'{part}.'
    found = {
        name.removeprefix(prefix): tensor
        for name, tensor in tensors.items()
        if name.startswith(prefix)
    }
    if not found:
        msg = f'The weights in {Path(folder or SHIPPED)} have no part named {part!r}.'
        raise WeightsError(msg)
    return config, found
