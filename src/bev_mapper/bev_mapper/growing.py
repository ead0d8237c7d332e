"""How a grid makes room for what was seen beyond it."""

from __future__ import annotations

import math

from gridnav.grid import GridGeometry

Margins = tuple[tuple[int, int], tuple[int, int]]
"""Rows below and above, and columns left and right, as ``numpy.pad`` takes them."""


def grown(
    geometry: GridGeometry,
    rows: tuple[int, int],
    cols: tuple[int, int],
    *,
    growth: int,
    max_cells: int,
) -> tuple[GridGeometry, Margins] | None:
    """Return the grid that holds more cells, and by how much it is larger; None if it does.

    Args:
        geometry: Where the grid lies.
        rows: Lowest and highest row that it must hold.
        cols: Lowest and highest column.
        growth: Each side grows by whole multiples of this many cells.
        max_cells: It may not have more cells than this.

    Raises:
        ValueError: If it would.
    """
    south, west = (_chunks(-low, growth) for low in (rows[0], cols[0]))
    north = _chunks(rows[1] - geometry.rows + 1, growth)
    east = _chunks(cols[1] - geometry.cols + 1, growth)
    if not (south or north or west or east):
        return None
    height, width = geometry.rows + south + north, geometry.cols + west + east
    if height * width > max_cells:
        msg = (
            f'The map would grow to {height} x {width} cells, more than the limit of {max_cells}.'
        )
        raise ValueError(msg)
    larger = GridGeometry(
        rows=height,
        cols=width,
        resolution=geometry.resolution,
        origin_x=geometry.origin_x - west * geometry.resolution,
        origin_y=geometry.origin_y - south * geometry.resolution,
    )
    return larger, ((south, north), (west, east))


def _chunks(missing: int, growth: int) -> int:
    """Return by how many cells a side grows that lacks this many, in whole chunks."""
    return max(0, math.ceil(missing / growth) * growth)
