"""What frames say about each cell, added up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_mapper.growing import grown
from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gridnav.grid import GridGeometry

UNIT = 0.05
"""Log-odds are counted in whole multiples of this."""

HIT, FLOOR_SEEN, LOOKED_THROUGH = 17, -17, -8
"""What a frame says about a place in which it sees an obstacle or the floor, or through which it
sees something else: probabilities of 0.70, 0.30 and 0.40."""

LOWEST, HIGHEST = -40, 70
"""Evidence is kept between probabilities of 0.12 and 0.97, so that what changes can be noticed."""

OCCUPIED_FROM, FREE_UP_TO = 0.65, 0.35
"""Probabilities from which on a cell is an obstacle, and up to which it is free."""

LAYER_M = 0.1
"""Evidence is kept for slabs of this height: what is above a chair says nothing of the chair."""

LOWEST_FLOOR_M = -0.25
"""What seems to be further below the floor than this is a reflection."""

RAY_STEP = 0.7
"""Cells between two places of a ray that are looked up."""

RAY_MARGIN = 1.5
"""A ray says nothing of the last cells before what it hit."""


@dataclass(frozen=True)
class Crop:
    """Which heights above the floor matter.

    Attributes:
        low: What is lower is no obstacle, in metres.
        high: What is higher is above the robot, in metres.
    """

    low: float = 0.08
    high: float = 1.5


@dataclass(frozen=True)
class Evidence:
    """What one frame saw, with heights above the floor; metres.

    Attributes:
        points: What was seen, (3, N).
        is_floor: Which of the points are of the floor, (N,).
        is_solid: Which are neither of the floor nor of the ceiling, (N,).
        camera: Where they were seen from, (3,).
        rays: Points up to which the camera could see, (3, M).
        robot: x and y of the robot where its footprint is to be free, else None.
    """

    points: NDArray[np.float64]
    is_floor: NDArray[np.bool_]
    is_solid: NDArray[np.bool_]
    camera: NDArray[np.float64]
    rays: NDArray[np.float64]
    robot: tuple[float, float] | None


@dataclass(frozen=True)
class Change:
    """What a frame changes on any grid that began as the one that it was worked out for.

    Attributes:
        first: Row and column of its lowest cell, counted from the first cell that the grid had.
        slabs: Evidence of obstacles to add, int8 (L, h, w).
        floor: Evidence of the floor to add, int8 (h, w).
        under: Cells under the robot, which are free, bool (h, w).
    """

    first: tuple[int, int]
    slabs: NDArray[np.int8]
    floor: NDArray[np.int8]
    under: NDArray[np.bool_]


class EvidenceGrid:
    """Log-odds of obstacles in slabs of height above each cell, and what follows for the cell.

    A cell is an obstacle where a slab of it is one. It is free where the floor was seen, or where
    the camera looked through close above the floor, and no slab says otherwise. What a frame costs
    depends on how far it sees, not on how large the map is.

    Attributes:
        geometry: Where the grid lies now.
        occupancy: -1 unknown, 0 free, 100 obstacle, int8 (H, W).
        probability: Of an obstacle in percent, -1 unknown, int8 (H, W).
    """

    def __init__(
        self,
        geometry: GridGeometry,
        crop: Crop,
        *,
        growth: int,
        max_cells: int,
        footprint: float,
        free_below: float,
        min_points: int,
    ) -> None:
        """Start with nothing known.

        Args:
            geometry: Where the grid lies at first.
            crop: Which heights matter.
            growth: Cells by which a side grows at least; 0 keeps the grid as it is.
            max_cells: The most cells it may have.
            footprint: Radius around the robot that is free, in metres.
            free_below: A cell whose floor was not seen is free where the camera looked through it
                lower than this, in metres.
            min_points: A frame must see so many points in a cell to say something about it.
        """
        if geometry.rows * geometry.cols > max_cells:
            msg = (
                f'The map is {geometry.rows} x {geometry.cols} cells, more than the limit of '
                f'{max_cells}.'
            )
            raise ValueError(msg)
        self.crop = crop
        self._growth = growth
        self._max_cells = max_cells
        self._footprint = footprint
        self._min_points = min_points
        self._layers = max(1, math.ceil((crop.high - crop.low) / LAYER_M - 1e-9))
        low_layers = math.ceil((free_below - crop.low) / LAYER_M - 1e-9)
        self._low_layers = min(max(low_layers, 0), self._layers)
        self._initial_geometry = geometry
        self.clear()

    def clear(self) -> None:
        """Forget everything and return to the first size."""
        self.geometry = self._initial_geometry
        # Rows and columns that have grown before the first ones.
        self._before = (0, 0)
        shape = self.geometry.shape
        self._slabs = np.zeros((self._layers, *shape), dtype=np.int8)
        self._floor = np.zeros(shape, dtype=np.int8)
        self.occupancy = np.full(shape, UNKNOWN_VALUE, dtype=np.int8)
        self.probability = np.full(shape, UNKNOWN_VALUE, dtype=np.int8)

    def update(self, seen: Evidence) -> None:
        """Add what a frame saw.

        Raises:
            ValueError: If the map would grow beyond its limit; it is as it was.
        """
        change = self.change_of(seen)
        if change is not None:
            self.apply(change)

    def change_of(self, seen: Evidence) -> Change | None:
        """Return what a frame changes, None for nothing; what came before plays no part."""
        height = seen.points[2]
        solid = seen.is_solid & (height >= self.crop.low) & (height < self.crop.high)
        floor = seen.is_floor & (height > LOWEST_FLOOR_M)
        places = [
            self._cells(np.take(seen.points, np.flatnonzero(solid), axis=1)),
            self._cells(np.take(seen.points, np.flatnonzero(floor), axis=1)),
            self._cells(self._looked_through(seen)),
            self._cells(self._under(seen.robot)),
        ]
        if not self._growth:
            places = [self._inside(cells) for cells in places]
        together = np.concatenate(places, axis=1)
        if not together.shape[1]:
            return None
        first_row, first_col = together[1:].min(axis=1).tolist()
        last_row, last_col = together[1:].max(axis=1).tolist()
        shape = (self._layers, last_row - first_row + 1, last_col - first_col + 1)
        layer, row, col = together
        flat = (layer * shape[1] + row - first_row) * shape[2] + col - first_col
        ends = np.cumsum([cells.shape[1] for cells in places])
        hits, ground, through, under = np.split(flat, ends[:-1])

        area = shape[1] * shape[2]
        points = np.bincount(hits, minlength=shape[0] * area).reshape(shape)
        # An obstacle of few points may stand on a floor of many: each slab counts by itself.
        hit = (points > 0) & (points.sum(axis=0) >= self._min_points)
        slabs = np.zeros(shape, dtype=np.int8)
        slabs.reshape(-1)[through] = LOOKED_THROUGH
        slabs[hit] = HIT
        points = np.bincount(ground % area, minlength=area).reshape(shape[1:])
        on_floor = points >= self._min_points
        free = np.zeros(area, dtype=np.bool_)
        free[under % area] = True
        return Change(
            first=(first_row, first_col),
            slabs=slabs,
            floor=on_floor.astype(np.int8) * np.int8(FLOOR_SEEN),
            under=free.reshape(shape[1:]),
        )

    def apply(self, change: Change) -> None:
        """Add what `change_of` returned, for this grid or for one that began as it did.

        Raises:
            ValueError: If the map would grow beyond its limit; it is as it was.
        """
        if self._growth:
            self._make_room(change)
        row, col = (at + more for at, more in zip(change.first, self._before, strict=True))
        height, width = change.floor.shape
        rows, cols = slice(row, row + height), slice(col, col + width)
        _add(self._slabs[:, rows, cols], change.slabs)
        _add(self._floor[rows, cols], change.floor)
        self._slabs[:, rows, cols][:, change.under] = LOWEST
        self._floor[rows, cols][change.under] = LOWEST
        self._conclude(rows, cols)

    def _cells(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return slab, row and column of points (3, N), counted from the first grid's, (3, N)."""
        geometry = self._initial_geometry
        cells = np.empty(points.shape, dtype=np.int64)
        for axis, (low, side) in enumerate(
            (
                (geometry.origin_x, geometry.resolution),
                (geometry.origin_y, geometry.resolution),
                (self.crop.low, LAYER_M),
            )
        ):
            cells[2 - axis] = np.floor((points[axis] - low) / side)
        np.clip(cells[0], 0, self._layers - 1, out=cells[0])
        return cells

    def _looked_through(self, seen: Evidence) -> NDArray[np.float64]:
        """Return places along the rays, within the crop, (3, N)."""
        start, resolution = seen.camera[:, None], self.geometry.resolution
        way = seen.rays - start
        length = np.sqrt((way**2).sum(axis=0))
        way /= np.maximum(length, _SHORT)
        rise = np.where(np.abs(way[2]) < _SHORT, _SHORT, way[2])
        # Where along its way a ray is within the crop.
        bounds = (np.array([[self.crop.low], [self.crop.high]]) - start[2]) / rise
        begin = np.maximum(bounds.min(axis=0), 0.0)
        end = np.minimum(bounds.max(axis=0), length - RAY_MARGIN * resolution)
        step = RAY_STEP * resolution
        counts = np.maximum(np.ceil((end - begin) / step), 0.0).astype(np.int64)
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        along = np.repeat(begin, counts) + number * step
        return np.stack(
            [
                place + np.repeat(part, counts) * along
                for place, part in zip(start, way, strict=True)
            ]
        )

    def _under(self, robot: tuple[float, float] | None) -> NDArray[np.float64]:
        """Return the centres of the cells under the robot, and its own place, (3, N)."""
        if robot is None:
            return np.empty((3, 0))
        geometry = self._initial_geometry
        reach = math.ceil(self._footprint / geometry.resolution)
        row, col = geometry.cell_at(*robot)
        offsets = range(-reach, reach + 1)
        places = np.array(
            [geometry.center_of(row + down, col + right) for down in offsets for right in offsets]
        )
        near = np.hypot(*(places - robot).T) <= self._footprint
        near[len(near) // 2] = True
        return np.vstack([places[near].T, np.zeros(near.sum())])

    def _inside(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return those of cells (3, N) that lie on the map."""
        _, rows, cols = cells
        height, width = self._initial_geometry.shape
        return cells[:, (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)]

    def _make_room(self, change: Change) -> None:
        """Grow so that the cells of a change lie on the map and not on its rim."""
        # The rim stays unknown, so that a planner sees that there is more to see.
        row, col = (at + more for at, more in zip(change.first, self._before, strict=True))
        height, width = change.floor.shape
        found = grown(
            self.geometry,
            (row - 1, row + height),
            (col - 1, col + width),
            growth=self._growth,
            max_cells=self._max_cells,
        )
        if found is None:
            return
        self.geometry, margins = found
        self._before = (self._before[0] + margins[0][0], self._before[1] + margins[1][0])
        self._slabs = np.pad(self._slabs, ((0, 0), *margins))
        self._floor = np.pad(self._floor, margins)
        self.occupancy = np.pad(self.occupancy, margins, constant_values=UNKNOWN_VALUE)
        self.probability = np.pad(self.probability, margins, constant_values=UNKNOWN_VALUE)

    def _conclude(self, rows: slice, cols: slice) -> None:
        """Say what follows from the evidence of a part of the grid."""
        slabs, floor = self._slabs[:, rows, cols], self._floor[rows, cols]
        highest = slabs.max(axis=0)
        low = slabs[: self._low_layers].min(axis=0, initial=0)
        evidence = np.where(highest > 0, highest, np.minimum(floor, low))
        self.occupancy[rows, cols] = _OCCUPANCY[evidence - LOWEST]
        self.probability[rows, cols] = _PERCENT[evidence - LOWEST]


_SHORT = 1e-9
"""Stands for a length of nothing."""

_EVIDENCE = UNIT * np.arange(LOWEST, HIGHEST + 1)
_PROBABILITY = 1.0 / (1.0 + np.exp(-_EVIDENCE))
_PERCENT = np.where(_EVIDENCE == 0.0, UNKNOWN_VALUE, np.rint(100 * _PROBABILITY)).astype(np.int8)
_OCCUPANCY = np.select(
    [_PROBABILITY >= OCCUPIED_FROM, _PROBABILITY <= FREE_UP_TO],
    [OCCUPIED_VALUE, FREE_VALUE],
    UNKNOWN_VALUE,
).astype(np.int8)
"""What follows from each amount of evidence, from `LOWEST` on."""


def _add(evidence: NDArray[np.int8], change: NDArray[np.int8]) -> None:
    """Add evidence within its bounds, which leave an int8 room for one change."""
    evidence += change
    np.clip(evidence, LOWEST, HIGHEST, out=evidence)
