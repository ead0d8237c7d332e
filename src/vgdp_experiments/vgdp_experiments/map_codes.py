"""Partial maps packed into one byte a cell, for keeping many of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gridnav import FREE, GOAL, OBSTACLE

if TYPE_CHECKING:
    from numpy.typing import NDArray

FREE_BIT, OBSTACLE_BIT, GOAL_BIT = 1, 2, 4


def pack(maps: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Pack partial maps (N, 3, H, W) into codes (N, H, W)."""
    bits = np.zeros((3, 1, 1), dtype=np.float32)
    bits[FREE], bits[OBSTACLE], bits[GOAL] = FREE_BIT, OBSTACLE_BIT, GOAL_BIT
    codes: NDArray[np.uint8] = (maps * bits).sum(axis=1).astype(np.uint8)
    return codes


def unpack(codes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Unpack codes (N, H, W) into partial maps (N, 3, H, W)."""
    maps = np.empty((len(codes), 3, *codes.shape[1:]), dtype=np.float32)
    for channel, bit in ((FREE, FREE_BIT), (OBSTACLE, OBSTACLE_BIT), (GOAL, GOAL_BIT)):
        maps[:, channel] = (codes & bit) > 0
    return maps
