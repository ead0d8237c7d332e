"""Files of weights that others made."""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from pathlib import Path


def read_state(path: Path) -> dict[str, torch.Tensor]:
    """Return the tensors of a PyTorch file by their names; nothing else in it is run.

    Checkpoints may have them under ``state_dict``, and each name begin with ``module.``.

    Raises:
        ValueError: If it can't be read or holds something else.
    """
    try:
        content = torch.load(path, map_location='cpu', weights_only=True)
    except (OSError, RuntimeError, ValueError, EOFError, pickle.UnpicklingError) as error:
        reason = getattr(error, 'strerror', None) or 'it is no file of PyTorch weights'
        msg = f'The weights {path} can not be read: {reason}.'
        raise ValueError(msg) from error
    state = content.get('state_dict', content) if isinstance(content, dict) else None
    if not isinstance(state, dict):
        msg = f'The weights {path} can not be read: there are none in it.'
        raise ValueError(msg)  # noqa: TRY004 - one kind of error for a file without weights
    return {key.removeprefix('module.'): value for key, value in state.items()}
