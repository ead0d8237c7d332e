"""Partial maps: what has been observed of the world, float32 (3, H, W), each value 0 or 1.

Channel 0 marks observed obstacles, channel 1 observed free cells, channel 2 the observed goal.
A cell that is 0 in the first two has not been seen.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

OBSTACLE, FREE, GOAL = 0, 1, 2
CHANNELS = 3

UNKNOWN_VALUE, FREE_VALUE, OCCUPIED_VALUE = -1, 0, 100
"""The values of a ternary ``nav_msgs/OccupancyGrid``."""

OCCUPIED_FROM = 50
"""An occupancy of this many percent or more is an obstacle."""

FREE_UP_TO = 25
"""An occupancy of this many percent or less is free; between the two a cell counts as unseen."""


def from_occupancy(
    occupancy: NDArray[np.int8], goal: tuple[int, int] | None = None
) -> NDArray[np.float32]:
    """Turn an occupancy grid (H, W) of −1 and 0 to 100 into a partial map (3, H, W).

    Args:
        occupancy: Percent of occupancy, −1 where unknown, (H, W).
        goal: The observed goal cell (row, col), if any. A goal off the grid is left out.
    """
    partial_map = np.zeros((3, *occupancy.shape), dtype=np.float32)
    partial_map[OBSTACLE] = occupancy >= OCCUPIED_FROM
    partial_map[FREE] = (occupancy >= FREE_VALUE) & (occupancy <= FREE_UP_TO)
    if goal is not None:
        row, col = goal
        if 0 <= row < occupancy.shape[0] and 0 <= col < occupancy.shape[1]:
            partial_map[GOAL, row, col] = 1.0
    return partial_map


def to_occupancy(partial_map: NDArray[np.float32]) -> NDArray[np.int8]:
    """Turn a partial map (3, H, W) into a ternary occupancy grid (H, W) of −1, 0 and 100."""
    occupancy = np.full(partial_map.shape[1:], UNKNOWN_VALUE, dtype=np.int8)
    occupancy[partial_map[FREE] > 0] = FREE_VALUE
    occupancy[partial_map[OBSTACLE] > 0] = OCCUPIED_VALUE
    return occupancy


def as_partial_maps(array: NDArray[Any]) -> NDArray[np.float32]:
    """Check that an array holds partial maps and return it as float32.

    Args:
        array: (3, H, W) or (B, 3, H, W), each value 0 or 1, no cell both obstacle and free.

    Raises:
        ValueError: If it does not, with one sentence that says why.
    """
    maps = np.asarray(array)
    if maps.ndim not in (3, 4) or maps.shape[-3] != CHANNELS or 0 in maps.shape[-2:]:
        msg = f'A partial map has the shape (3, H, W), got {maps.shape}.'
        raise ValueError(msg)
    maps = maps.astype(np.float32, copy=False)
    if not np.isin(maps, (0.0, 1.0)).all():
        msg = 'A partial map holds only 0 and 1, got other values.'
        raise ValueError(msg)
    if (maps[..., OBSTACLE, :, :] * maps[..., FREE, :, :]).any():
        msg = 'A partial map has cells that are both obstacle and free.'
        raise ValueError(msg)
    return maps
