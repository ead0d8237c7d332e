"""The weights of what is learned for searches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from vgdp_planner.weights import WeightsError, read_record, read_tensors

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import nn

WEIGHTS = Path(__file__).parents[2] / 'weights' / 'search'
"""Folder of the weights that come with the package, with a folder for each method."""

Networks = TypeVar('Networks', bound='nn.Module')


def load_networks(
    folder: Path | None, method: str, what: str, build: Callable[[dict[str, Any]], Networks]
) -> Networks:
    """Read the networks of a method.

    Args:
        folder: As `save_record` of the planner wrote it; what comes with the package if None.
        method: Its name among the learned ones.
        what: It is called in a sentence.
        build: Makes the networks from their configuration.

    Raises:
        WeightsError: If the folder does not hold them, with one sentence that says why.
    """
    folder = folder or WEIGHTS / method
    config, tensors = read_record(folder)['config'], read_tensors(folder)
    try:
        networks = build(config)
        networks.load_state_dict(tensors)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        msg = f'The weights in {folder} are none of {what}.'
        raise WeightsError(msg) from error
    return networks.eval()
