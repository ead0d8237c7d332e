"""The nine actions: eight steps on the grid and Done."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

STEPS: NDArray[np.int64] = np.array(
    [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)], dtype=np.int64
)
"""(Δrow, Δcol) of actions 0 to 7, shape (8, 2)."""

NUM_MOVES = len(STEPS)
DONE = NUM_MOVES
NUM_ACTIONS = NUM_MOVES + 1

STEP_LENGTHS: NDArray[np.float64] = np.append(np.hypot(STEPS[:, 0], STEPS[:, 1]), 0.0)
"""Length of each action in cells, shape (9,): 1, √2 for the diagonals, 0 for Done."""


def valid_moves(blocked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which of the eight steps are valid from each cell.

    A step is valid when its target is on the grid and not blocked; a diagonal step also needs at
    least one of the two orthogonal cells beside it to be open. Off the grid counts as blocked.
    The cell that the step starts from is not looked at.

    Args:
        blocked: Cells that can't be entered, (..., H, W).

    Returns:
        Valid steps, (..., 8, H, W).
    """
    height, width = blocked.shape[-2:]
    padding = [(0, 0)] * (blocked.ndim - 2) + [(1, 1), (1, 1)]
    padded_open = ~np.pad(blocked, padding, constant_values=True)

    def is_open(row_step: int, col_step: int) -> NDArray[np.bool_]:
        return padded_open[
            ..., 1 + row_step : 1 + row_step + height, 1 + col_step : 1 + col_step + width
        ]

    valid = [
        is_open(dr, dc) & (is_open(dr, 0) | is_open(0, dc)) if dr and dc else is_open(dr, dc)
        for dr, dc in STEPS.tolist()
    ]
    return np.stack(valid, axis=-3)
