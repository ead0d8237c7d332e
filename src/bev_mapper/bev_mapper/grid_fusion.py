"""One growing grid from many windows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_mapper.growing import grown
from gridnav.partial_map import (
    FREE_VALUE,
    UNKNOWN_VALUE,
    from_occupancy,
    to_occupancy,
)
from gridnav.pose import Pose2D

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gridnav.grid import GridGeometry

RESOLUTION_TOLERANCE = 1e-5
"""Relative difference up to which two resolutions are the same (messages carry a float32)."""

DEFAULT_GROWTH = 16
DEFAULT_MAX_CELLS = 4_000_000

_NEVER = -1


class GridFusion:
    """A ternary grid of the latest observation of each cell.

    The newest observation of a cell wins, in whatever order they come. The grid grows for every
    cell that was seen outside it, and for a free cell on its rim: beyond that there is more to
    see. It does not grow for cells that were not seen.

    Attributes:
        geometry: Where the grid lies now.
        occupancy: -1 unseen, 0 free, 100 obstacle, int8 (H, W).
        growth: Cells by which a side grows at least.
        max_cells: The grid never has more cells than this.
    """

    def __init__(
        self,
        geometry: GridGeometry,
        growth: int = DEFAULT_GROWTH,
        max_cells: int = DEFAULT_MAX_CELLS,
    ) -> None:
        """Start with an unseen grid.

        Args:
            geometry: Where it lies at first.
            growth: Cells by which a side grows at least, at least 1.
            max_cells: The most cells it may have.

        Raises:
            ValueError: If the grid is too large from the start or can't grow.
        """
        if growth < 1:
            msg = f'A grid grows by at least 1 cell, got {growth}.'
            raise ValueError(msg)
        if geometry.rows * geometry.cols > max_cells:
            msg = (
                f'The map is {geometry.rows} x {geometry.cols} cells, more than the limit of '
                f'{max_cells}.'
            )
            raise ValueError(msg)
        self.growth = growth
        self.max_cells = max_cells
        self._initial_geometry = geometry
        self.clear()

    def clear(self) -> None:
        """Forget all observations and return to the first size."""
        self.geometry = self._initial_geometry
        self.occupancy = np.full(self.geometry.shape, UNKNOWN_VALUE, dtype=np.int8)
        self._seen_at = np.full(self.geometry.shape, _NEVER, dtype=np.int64)

    def check_window(self, geometry: GridGeometry) -> None:
        """Refuse a window of another resolution.

        Raises:
            ValueError: If its resolution is not that of the map.
        """
        resolution = self.geometry.resolution
        if abs(geometry.resolution - resolution) > RESOLUTION_TOLERANCE * resolution:
            msg = (
                f'The resolution of the local map is {geometry.resolution} m, that of the map is '
                f'{resolution} m.'
            )
            raise ValueError(msg)

    def fuse(
        self,
        window: NDArray[np.int8],
        geometry: GridGeometry,
        stamp: int,
        *,
        robot: Pose2D,
        on_robot: bool = False,
    ) -> None:
        """Fuse a window; the cell that the robot stands on is free, whatever the window says.

        Args:
            window: Occupancy, -1 where it tells nothing, int8 (h, w).
            geometry: Where it lies in its frame.
            stamp: Time of the observation in nanoseconds, not negative.
            robot: Pose of the robot in the frame of the map.
            on_robot: Whether the window's frame is that of the robot; else it is that of the map.

        Raises:
            ValueError: If the resolution differs or the map would grow beyond its limit; the map
                is as it was.
        """
        self.check_window(geometry)
        pose = robot if on_robot else Pose2D()
        values = to_occupancy(from_occupancy(window))
        rows, cols = np.nonzero(values != UNKNOWN_VALUE)
        resolution = self.geometry.resolution
        x = geometry.origin_x + (cols + 0.5) * resolution
        y = geometry.origin_y + (rows + 0.5) * resolution
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        map_x = np.append(pose.x + cos * x - sin * y, robot.x)
        map_y = np.append(pose.y + sin * x + cos * y, robot.y)
        self._make_room(map_x, map_y, np.append(values[rows, cols] == FREE_VALUE, True))

        # Look up each cell of the map in the window, so that a turned window leaves no holes.
        map_rows = self._span(map_y, self.geometry.origin_y, self.geometry.rows)
        map_cols = self._span(map_x, self.geometry.origin_x, self.geometry.cols)
        dx = self.geometry.origin_x + (map_cols + 0.5) * resolution - pose.x
        dy = self.geometry.origin_y + (map_rows[:, None] + 0.5) * resolution - pose.y
        window_col = np.floor((cos * dx + sin * dy - geometry.origin_x) / resolution).astype(int)
        window_row = np.floor((cos * dy - sin * dx - geometry.origin_y) / resolution).astype(int)
        inside = (
            (window_row >= 0)
            & (window_row < geometry.rows)
            & (window_col >= 0)
            & (window_col < geometry.cols)
        )
        seen = np.full(inside.shape, UNKNOWN_VALUE, dtype=np.int8)
        seen[inside] = values[window_row[inside], window_col[inside]]

        robot_row, robot_col = self.geometry.cell_at(robot.x, robot.y)
        seen[map_rows == robot_row, map_cols == robot_col] = FREE_VALUE

        patch = np.ix_(map_rows, map_cols)
        newer = (seen != UNKNOWN_VALUE) & (stamp >= self._seen_at[patch])
        self.occupancy[patch] = np.where(newer, seen, self.occupancy[patch])
        self._seen_at[patch] = np.where(newer, stamp, self._seen_at[patch])

    def _span(self, points: NDArray[np.float64], origin: float, count: int) -> NDArray[np.int64]:
        """Return the rows (or columns) of the map around points, one more at either end."""
        cells = np.floor((points - origin) / self.geometry.resolution)
        return np.arange(max(int(cells.min()) - 1, 0), min(int(cells.max()) + 2, count))

    def _make_room(
        self, x: NDArray[np.float64], y: NDArray[np.float64], free: NDArray[np.bool_]
    ) -> None:
        """Grow so that seen points (N,) lie on the map and the free ones not on its rim."""
        old = self.geometry
        rim = free.astype(np.int64)
        rows = np.floor((y - old.origin_y) / old.resolution).astype(np.int64)
        cols = np.floor((x - old.origin_x) / old.resolution).astype(np.int64)
        found = grown(
            old,
            (int((rows - rim).min()), int((rows + rim).max())),
            (int((cols - rim).min()), int((cols + rim).max())),
            growth=self.growth,
            max_cells=self.max_cells,
        )
        if found is None:
            return
        self.geometry, margins = found
        self.occupancy = np.pad(self.occupancy, margins, constant_values=UNKNOWN_VALUE)
        self._seen_at = np.pad(self._seen_at, margins, constant_values=_NEVER)
