"""The learned methods of the search, and what they are trained on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vgdp_experiments.search.learned.records import WEIGHTS
from vgdp_experiments.search.learned.searchers import (
    Calvin2DSearcher,
    Calvin3DSearcher,
    NoProjectorSearcher,
    ObjectValueSearcher,
    RgbdSearcher,
)
from vgdp_planner.weights import SHIPPED as PLANNER

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from vgdp_experiments.search.searchers import Searcher

LEARNED: dict[str, Callable[[Path | None], Searcher]] = {
    'vgdp_object': ObjectValueSearcher,
    'vgdp_rgbd': RgbdSearcher,
    'calvin_2d': Calvin2DSearcher,
    'calvin_3d': Calvin3DSearcher,
    'no_projector': NoProjectorSearcher,
}
"""Makes each method from a folder of weights, or from those that come with the package if None."""


def used_weights(method: str, folder: Path | None) -> dict[str, Path]:
    """Return the folders of the weights that a method uses, by what they belong to.

    Args:
        method: Any; what is not learned for searches uses none of these.
        folder: With a folder for each method; those that come with the package if None.
    """
    if method not in LEARNED:
        return {}
    own = {method: (folder or WEIGHTS) / method}
    return own | {'planner': PLANNER} if method == 'vgdp_object' else own


__all__ = ['LEARNED', 'used_weights']
