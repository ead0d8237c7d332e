"""Where the cells of a grid lie in the world."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class GridGeometry:
    """Placement of a grid in its frame, as in ``nav_msgs/OccupancyGrid`` without rotation.

    Attributes:
        rows: Height of the grid in cells.
        cols: Width of the grid in cells.
        resolution: Side of a cell in metres.
        origin_x: x of the lower-left corner of cell (0, 0) in metres.
        origin_y: y of the lower-left corner of cell (0, 0) in metres.
    """

    rows: int
    cols: int
    resolution: float
    origin_x: float = 0.0
    origin_y: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a grid without cells or without a finite, positive scale."""
        if self.rows < 1 or self.cols < 1:
            msg = f'A grid needs at least one cell, got {self.rows} x {self.cols}.'
            raise ValueError(msg)
        if not (math.isfinite(self.resolution) and self.resolution > 0):
            msg = f'The resolution must be finite and above 0 m, got {self.resolution}.'
            raise ValueError(msg)
        if not (math.isfinite(self.origin_x) and math.isfinite(self.origin_y)):
            msg = f'The origin must be finite, got ({self.origin_x}, {self.origin_y}).'
            raise ValueError(msg)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return self.rows, self.cols

    def contains(self, row: int, col: int) -> bool:
        """Tell whether the cell (row, col) is on the grid."""
        return 0 <= row < self.rows and 0 <= col < self.cols

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """Return the cell (row, col) that holds the point; it may lie off the grid.

        Raises:
            ValueError: If the point is not finite.
        """
        if not (math.isfinite(x) and math.isfinite(y)):
            msg = f'A position must be finite, got ({x}, {y}).'
            raise ValueError(msg)
        return (
            math.floor((y - self.origin_y) / self.resolution),
            math.floor((x - self.origin_x) / self.resolution),
        )

    def center_of(self, row: int, col: int) -> tuple[float, float]:
        """Return the centre (x, y) of the cell (row, col) in metres."""
        return (
            self.origin_x + (col + 0.5) * self.resolution,
            self.origin_y + (row + 0.5) * self.resolution,
        )
