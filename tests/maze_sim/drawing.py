"""Maps drawn as text, for the tests of maze_sim."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def characters(drawing: str) -> NDArray[np.str_]:
    """Return the characters of a drawing, (H, W), the first line being row 0."""
    return np.array([list(line) for line in drawing.split()])


def walls(drawing: str) -> NDArray[np.bool_]:
    """Return where a drawing has a ``#``, (H, W)."""
    blocked: NDArray[np.bool_] = characters(drawing) == '#'
    return blocked


def find(drawing: str, character: str) -> tuple[int, int]:
    """Return the cell (row, col) of the only such character of a drawing."""
    ((row, col),) = np.argwhere(characters(drawing) == character).tolist()
    return row, col
