"""Where the next step had better wait until the robot has looked around."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from gridnav import DONE, FREE, OBSTACLE, STEPS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

EIGHT_NEIGHBOURS = ndimage.generate_binary_structure(2, 2)


class Lookout:
    """Learns in an episode how far the robot sees, and so where something new may come into view.

    No view range is given: the farthest cell that was new from where the robot has been tells it.
    """

    def __init__(self) -> None:
        self._seen: NDArray[np.bool_] | None = None
        self._way: list[tuple[int, int]] = []
        self._view_range = 1

    def look(self, partial_map: NDArray[np.float32], cell: tuple[int, int]) -> None:
        """Take in a partial map (3, H, W), seen from the cell and on the way to it."""
        seen = (partial_map[OBSTACLE] > 0) | (partial_map[FREE] > 0)
        if self._seen is None:
            new = np.argwhere(seen)
        elif self._seen.shape == seen.shape:
            new = np.argwhere(seen & ~self._seen)
        else:
            # The map was extended, and cells have other places: nothing can be learnt from it.
            new = np.empty((0, 2), dtype=np.int64)
        self._seen = seen
        if len(new):
            places = np.array([cell, *self._way])
            apart = np.abs(new[:, None] - places).max(axis=2).min(axis=1)
            self._view_range = max(self._view_range, int(apart.max()))

    def before_looking(
        self, partial_map: NDArray[np.float32], cell: tuple[int, int], actions: Sequence[int]
    ) -> list[int]:
        """Return the first actions, up to where something new may come into view.

        Args:
            partial_map: (3, H, W).
            cell: Where the robot is, (row, col).
            actions: What may be executed from there.
        """
        self._way = []
        for index, action in enumerate(actions):
            if action == DONE:
                break
            if index > 0 and self._may_see_more(partial_map, cell):
                return list(actions[:index])
            cell = cell[0] + int(STEPS[action, 0]), cell[1] + int(STEPS[action, 1])
            self._way.append(cell)
        return list(actions)

    def _may_see_more(self, partial_map: NDArray[np.float32], cell: tuple[int, int]) -> bool:
        """Tell whether anything unseen lies beside open cells that are joined to this one.

        What can be seen can be walked to in the window of the view, so this is never too rarely.
        """
        row, col = cell
        top, left = max(row - self._view_range, 0), max(col - self._view_range, 0)
        window = partial_map[
            :2, top : row + self._view_range + 1, left : col + self._view_range + 1
        ]
        unseen = (window[OBSTACLE] == 0) & (window[FREE] == 0)
        if not unseen.any():
            return False
        parts, _ = ndimage.label(window[FREE] > 0, structure=EIGHT_NEIGHBOURS)
        here = parts == parts[row - top, col - left]
        return bool((unseen & ndimage.binary_dilation(here, EIGHT_NEIGHBOURS)).any())
