"""Any occupancy grid as the planner needs it, and the planner's steps as ways on that grid.

A SLAM's map has cells much smaller than a step. So it is inflated by the radius of the robot and
coarsened: ``factor`` × ``factor`` cells of the map, a block, make a cell of the planning grid. The
planner knows open and closed blocks only, and may step between any two open ones. So that each
such step has a way on the map, and none is lost:

1. A cell of the map is *clear* when the robot's centre may be there: no obstacle reaches into the
   circle of the robot around it. Unseen cells are clear as far as is known.
2. *Ground* is what is clear and connected with the robot. Everything else is closed.
3. Of the ground in a block one connected piece counts: the one of which most was seen to be free,
   or the one with the robot or the goal in it. A block that has one is open.
4. Where two open blocks side by side have pieces that do not touch, the lesser one is closed. So
   every step that is left leads through ground: that of its two blocks for a step along an axis,
   of three of them for a diagonal one.
5. Where all this cut off the goal, or as much ground as a block has, further than a block away
   from all that is left, it is done again with blocks of half the side. Ground that was not seen
   counts only where nothing else is left to see. Blocks of one cell cut off nothing.

Letters in shapes: as in `planning_grid`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from gridnav import FREE, GOAL, OBSTACLE, GridGeometry
from gridnav.partial_map import (
    CHANNELS,
    FREE_UP_TO,
    FREE_VALUE,
    OCCUPIED_FROM,
    UNKNOWN_VALUE,
    from_occupancy,
)
from vgdp_planner.planning_grid import (
    Cell,
    GoalState,
    GridSettings,
    Ground,
    OccupiedError,
    OutsideMapError,
    PlanningGrid,
    Point,
)
from vgdp_planner.ways import inflate

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from numpy.typing import NDArray

FAR_BLOCKS = 50
"""A goal further than this from all that is known, and than that is wide, is left out: the grid
has to reach to the goal."""


def make_planning_grid(
    occupancy: NDArray[np.int8],
    geometry: GridGeometry,
    position: Point,
    goal: Point | None = None,
    settings: GridSettings | None = None,
    *,
    visited: Collection[Point] = (),
    blocked: Collection[Point] = (),
) -> PlanningGrid:
    """Make a map ready for the planner.

    A map is taken as it is where blocks are its cells and the robot has no radius. Any other is
    cropped to what is known, with a rim of unseen blocks around it, as nothing is known of what
    lies beyond a map. Blocks lie at the same places in the map's frame, wherever the origin of a
    growing map moves.

    Args:
        occupancy: Percent of occupancy, −1 where unknown, (rows, cols).
        geometry: Where the map lies.
        position: Of the robot, (x, y) in metres.
        goal: Position of the goal, if it is known.
        settings: Radius of the robot and size of the planning grid.
        visited: Where the robot has been: nothing is left to see there, whatever the map says.
        blocked: Where it could not get to: there is an obstacle there, whatever the map says.

    Raises:
        OutsideMapError: If the robot is not on the map.
        OccupiedError: If there is no clear place near the robot.
    """
    settings = settings or GridSettings()
    cell = geometry.cell_at(*position)
    if not geometry.contains(*cell):
        msg = (
            f'The robot at {position} m is not on the map of {geometry.rows} x {geometry.cols} '
            f'cells.'
        )
        raise OutsideMapError(msg)
    factor = max(1, round(settings.resolution / geometry.resolution))
    if factor == 1 and settings.robot_radius == 0:
        partial_map = from_occupancy(occupancy, None if goal is None else geometry.cell_at(*goal))
        for row, col in _cells_of(geometry, blocked):
            partial_map[:, row, col] = 0.0
            partial_map[OBSTACLE, row, col] = 1.0
        state: GoalState = 'none'
        if goal is not None:
            state = 'ok' if partial_map[GOAL].any() else 'outside'
        return PlanningGrid(partial_map, geometry, cell, goal=state)
    coarsening = _Coarsening(occupancy, geometry, cell, goal, settings)
    while coarsening.cells(factor) > settings.max_cells:
        factor += 1
    grid = coarsening.grid(factor, visited, blocked)
    while (
        grid.lost
        and not settings.keep_resolution
        and factor > 1
        and coarsening.cells(factor // 2) <= settings.max_cells
    ):
        factor //= 2
        grid = coarsening.grid(factor, visited, blocked)
    return grid


def _cells_of(geometry: GridGeometry, places: Iterable[Point]) -> Iterator[Cell]:
    """Yield the cells of places that are on the grid."""
    for place in places:
        cell = geometry.cell_at(*place)
        if geometry.contains(*cell):
            yield cell


class _Coarsening:
    """Makes planning grids of different blocks from one map.

    Args:
        occupancy: Percent of occupancy, −1 where unknown, (rows, cols).
        geometry: Where the map lies.
        robot: Its cell on the map.
        goal: Position of the goal in metres, if it is known.
        settings: Radius of the robot and where blocks lie.
    """

    def __init__(
        self,
        occupancy: NDArray[np.int8],
        geometry: GridGeometry,
        robot: Cell,
        goal: Point | None,
        settings: GridSettings,
    ) -> None:
        self._occupancy = occupancy
        self._geometry = geometry
        self._radius = settings.robot_radius
        self._center = settings.center
        self._goal_tolerance = settings.goal_tolerance
        self._goal_reach = settings.goal_reach
        self._goal_place = goal
        self._robot = np.array(robot)
        self._goal = None if goal is None else np.array(geometry.cell_at(*goal))
        known = occupancy > UNKNOWN_VALUE
        corners = [self._robot]
        if known.any():
            spans = [np.flatnonzero(known.any(axis=axis)) for axis in (1, 0)]
            corners += [np.array([span[end] for span in spans]) for end in (0, -1)]
        self._low, self._high = np.min(corners, axis=0), np.max(corners, axis=0)

    def _anchor(self, factor: int) -> NDArray[np.int64]:
        """Return row and column of the map's first cell, counted from where a block begins."""
        geometry = self._geometry
        if self._center is not None:
            return factor // 2 - np.array(geometry.cell_at(*self._center))
        return np.array(
            [
                round(geometry.origin_y / geometry.resolution),
                round(geometry.origin_x / geometry.resolution),
            ]
        )

    def _blocks(self, factor: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the first block and the one past the last, counted from the frame's origin."""
        low, high = self._low, self._high
        if self._goal is not None:
            far = max((low - self._goal).max(), (self._goal - high).max())
            if far <= max((high - low).max(), FAR_BLOCKS * factor):
                low, high = np.minimum(low, self._goal), np.maximum(high, self._goal)
        # Wide enough to go around what is inflated at the edge.
        rim = 1 + math.ceil(self._radius / (factor * self._geometry.resolution))
        anchor = self._anchor(factor)
        return (anchor + low) // factor - rim, (anchor + high) // factor + rim + 1

    def cells(self, factor: int) -> int:
        """Return how many cells the planning grid has."""
        first, end = self._blocks(factor)
        return int((end - first).prod())

    def grid(
        self, factor: int, visited: Collection[Point], blocked: Collection[Point]
    ) -> PlanningGrid:
        """Make the grid of blocks of one size.

        Raises:
            OccupiedError: If there is no clear place near the robot.
        """
        first, end = self._blocks(factor)
        values, fine = self._window(first, end, factor)
        clear = ~inflate(values >= OCCUPIED_FROM, self._radius / fine.resolution)
        rows, cols = (end - first).tolist()
        side = factor * fine.resolution
        geometry = GridGeometry(rows, cols, side, fine.origin_x, fine.origin_y)
        for row, col in _cells_of(geometry, blocked):
            clear[row * factor : (row + 1) * factor, col * factor : (col + 1) * factor] = False
        to_window = self._anchor(factor) - first * factor
        labels, _ = ndimage.label(clear)
        start = self._start(clear, labels, self._robot + to_window, factor)
        is_ground = labels == labels[start]
        seen_free = (values >= FREE_VALUE) & (values <= FREE_UP_TO)
        goal, state = self._place_goal(is_ground, seen_free, clear, to_window, factor)

        places = [place for place in (goal, start) if place]
        pieces = _Pieces(is_ground, seen_free, factor, places)
        blocks = _reached_blocks(pieces, _block(start, factor))
        standable = pieces.standable & _spread(blocks, factor)
        partial_map = self._partial_map(values, seen_free, standable, pieces.is_open, factor)
        for block in _cells_of(geometry, visited):
            if blocks[block]:
                partial_map[(FREE, *block)] = 1.0
        cut = is_ground & ~standable
        # What was not seen may be anything, so it counts only where nothing else is left to see.
        if (blocks & (partial_map[FREE] == 0)).any():
            cut &= seen_free
        lost = _is_cut_off(_block_counts(cut, factor), blocks, factor)
        if goal is not None and not standable[goal]:
            lost |= bool(is_ground[goal])
            state = 'unreachable'

        # A goal out of reach is not shown in a block that the robot can go to.
        if goal is not None and (state == 'ok' or not blocks[_block(goal, factor)]):
            partial_map[(GOAL, *_block(goal, factor))] = 1.0
        if state == 'ok':
            free = partial_map[FREE] > 0
            partial_map[GOAL][self._within_reach(geometry) & blocks & free] = 1.0
        ground = Ground(clear, standable, fine, factor, start, goal if state == 'ok' else None)
        return PlanningGrid(
            partial_map, geometry, _block(start, factor), factor, state, lost, ground
        )

    def _window(
        self, first: NDArray[np.int64], end: NDArray[np.int64], factor: int
    ) -> tuple[NDArray[np.int8], GridGeometry]:
        """Return the map's values between two blocks, −1 off the map, and where they lie."""
        rows, cols = ((end - first) * factor).tolist()
        top, left = (first * factor - self._anchor(factor)).tolist()
        values = np.full((rows, cols), UNKNOWN_VALUE, dtype=np.int8)
        known = self._occupancy[max(top, 0) : top + rows, max(left, 0) : left + cols]
        row, col = max(-top, 0), max(-left, 0)
        values[row : row + known.shape[0], col : col + known.shape[1]] = known
        geometry = self._geometry
        return values, replace(
            geometry,
            rows=rows,
            cols=cols,
            origin_x=geometry.origin_x + left * geometry.resolution,
            origin_y=geometry.origin_y + top * geometry.resolution,
        )

    def _start(
        self,
        clear: NDArray[np.bool_],
        labels: NDArray[np.int32],
        robot: NDArray[np.int64],
        factor: int,
    ) -> Cell:
        """Return the robot's cell, or the nearest clear one that is part of something larger.

        Raises:
            OccupiedError: If there is none near by.
        """
        if clear[tuple(robot)]:
            return int(robot[0]), int(robot[1])
        cells, distances = self._clear_around(clear, robot, self._reach(factor))
        if not len(cells):
            msg = f'There is no clear place within {self._reach(factor)} cells of the robot.'
            raise OccupiedError(msg)
        sizes = np.bincount(labels.ravel())[labels[tuple(cells.T)]]
        distances[sizes < min(factor**2, sizes.max())] = np.inf
        row, col = cells[distances.argmin()].tolist()
        return row, col

    def _place_goal(
        self,
        is_ground: NDArray[np.bool_],
        seen_free: NDArray[np.bool_],
        clear: NDArray[np.bool_],
        to_window: NDArray[np.int64],
        factor: int,
    ) -> tuple[Cell | None, GoalState]:
        """Return the cell of the goal, or of the nearest ground where an obstacle is too near.

        Ground that was seen is preferred where it is in reach, or no more than a block further
        away: what was not seen may lie behind a wall.
        """
        if self._goal is None:
            return None, 'none'
        goal = self._goal + to_window
        if (goal < 0).any() or (goal >= clear.shape).any():
            return None, 'outside'
        if clear[tuple(goal)]:
            return (int(goal[0]), int(goal[1])), 'ok'
        tolerance = math.ceil(self._goal_tolerance / self._geometry.resolution)
        cells, distances = self._clear_around(is_ground, goal, max(self._reach(factor), tolerance))
        if not len(cells):
            return None, 'occupied'
        seen = seen_free[tuple(cells.T)]
        enough = max(self._goal_reach / self._geometry.resolution, distances.min() + factor)
        if distances[seen].min(initial=np.inf) <= enough:
            distances[~seen] = np.inf
        row, col = cells[distances.argmin()].tolist()
        return (row, col), 'ok'

    def _within_reach(self, geometry: GridGeometry) -> NDArray[np.bool_]:
        """Tell which blocks have their middle in reach of the goal, (H, W)."""
        if self._goal_place is None:
            return np.zeros(geometry.shape, dtype=np.bool_)
        x, y = self._goal_place
        side = geometry.resolution
        across = geometry.origin_x + (np.arange(geometry.cols) + 0.5) * side - x
        along = geometry.origin_y + (np.arange(geometry.rows) + 0.5) * side - y
        within: NDArray[np.bool_] = np.hypot(along[:, None], across) < self._goal_reach
        return within

    def _reach(self, factor: int) -> int:
        return math.ceil(self._radius / self._geometry.resolution) + factor

    def _clear_around(
        self, clear: NDArray[np.bool_], place: NDArray[np.int64], reach: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the clear cells (N, 2) within reach of a place, and how far they are (N,)."""
        corner = np.maximum(place - reach, 0)
        top, left, bottom, right = *corner, *(place + reach + 1)
        cells = np.argwhere(clear[top:bottom, left:right]) + corner
        distances = np.hypot(*(cells - place).T)
        return cells[distances <= reach], distances[distances <= reach]

    def _partial_map(
        self,
        values: NDArray[np.int8],
        seen_free: NDArray[np.bool_],
        standable: NDArray[np.bool_],
        is_open: NDArray[np.bool_],
        factor: int,
    ) -> NDArray[np.float32]:
        """Say of each block what the planner sees of it, (3, H, W)."""
        obstacles = _block_counts(values >= OCCUPIED_FROM, factor)
        # An open block is free when half of its piece was seen to be so. Blocks that the robot
        # can't get to are shown as they are, but closed where they touch one that is open.
        piece = _block_counts(standable, factor)
        free = np.where(
            piece > 0,
            2 * _block_counts(standable & seen_free, factor) >= piece,
            2 * _block_counts(seen_free, factor) >= factor**2,
        )
        closed = ~is_open & (ndimage.binary_dilation(is_open) | (obstacles > 0))
        partial_map = np.zeros((CHANNELS, *is_open.shape), dtype=np.float32)
        partial_map[OBSTACLE] = closed
        partial_map[FREE] = free & ~closed
        return partial_map


class _Pieces:
    """One connected piece of the ground in each block.

    Args:
        is_ground: (h, w).
        seen_free: (h, w).
        factor: Side of a block.
        places: Cells whose pieces count whatever their size; the last one above all.

    Attributes:
        standable: The pieces that count, bool (h, w).
        is_open: Blocks that have one, bool (H, W).
        sizes: Cells of each block's piece, (H, W). Those that were seen to be free count for more
            than any number of others: what was seen is not given up for what may be there, such as
            the inside of a wall.
        factor: Side of a block.
    """

    def __init__(
        self,
        is_ground: NDArray[np.bool_],
        seen_free: NDArray[np.bool_],
        factor: int,
        places: Sequence[Cell],
    ) -> None:
        self.factor = factor
        self.standable = is_ground.copy()
        counts = _block_counts(is_ground, factor)
        mixed = np.argwhere((counts > 0) & (counts < factor**2))
        shape = (counts.shape[0], factor, counts.shape[1], factor)
        tiles = self.standable.reshape(shape).swapaxes(1, 2)
        seen = seen_free.reshape(shape).swapaxes(1, 2)[tuple(mixed.T)]
        tiles[tuple(mixed.T)] = self._choose(tiles[tuple(mixed.T)], seen, mixed, places)
        self.sizes = _block_counts(self.standable, factor)
        self.sizes += factor**2 * _block_counts(self.standable & seen_free, factor)
        self.is_open = counts > 0

    def _choose(
        self,
        tiles: NDArray[np.bool_],
        seen_free: NDArray[np.bool_],
        blocks: NDArray[np.int64],
        places: Sequence[Cell],
    ) -> NDArray[np.bool_]:
        """Return one piece of each tile, all (M, factor, factor); tile m is of block m."""
        if not len(tiles):
            return tiles
        k = self.factor
        # One below the other with an empty row between them, all are labelled at once.
        labels, _ = ndimage.label(np.pad(tiles, ((0, 0), (0, 1), (0, 0))).reshape(-1, k))
        labels = labels.reshape(-1, k + 1, k)[:, :k]
        sizes = np.bincount(labels.ravel())
        sizes += k**2 * np.bincount(labels[seen_free], minlength=len(sizes))
        sizes[0] = 0
        for place in places:
            for tile in np.flatnonzero((blocks == _block(place, k)).all(axis=1)):
                label = labels[tile, place[0] % k, place[1] % k]
                if label:
                    sizes[label] = sizes.max() + 1
        flat = labels.reshape(len(labels), -1)
        best = np.take_along_axis(flat, sizes[flat].argmax(axis=1)[:, None], axis=1)
        chosen: NDArray[np.bool_] = labels == best[:, :, None]
        return chosen

    def touching(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Tell whose pieces touch: with the block above (H − 1, W), to the right (H, W − 1)."""
        k = self.factor
        rows, cols = self.is_open.shape
        above = self.standable[k - 1 : -1 : k] & self.standable[k::k]
        right = self.standable[:, k - 1 : -1 : k] & self.standable[:, k::k]
        return (
            np.logical_or.reduce(above.reshape(rows - 1, cols, k), axis=2),
            np.logical_or.reduce(right.reshape(rows, k, cols - 1), axis=1),
        )


def _reached_blocks(pieces: _Pieces, start: Cell) -> NDArray[np.bool_]:
    """Close blocks until open neighbours touch; return those the robot then gets to, (H, W).

    The planner's diagonal steps need an open block beside them, so what it can get to at all it
    gets to along the axes.
    """
    is_open, sizes = pieces.is_open, pieces.sizes.astype(float)
    sizes[start] = np.inf
    above, right = pieces.touching()
    apart = [
        *((tuple(p), (p[0] + 1, p[1])) for p in _pairs(is_open[:-1] & is_open[1:] & ~above)),
        *((tuple(p), (p[0], p[1] + 1)) for p in _pairs(is_open[:, :-1] & is_open[:, 1:] & ~right)),
    ]
    for one, other in apart:
        if is_open[one] and is_open[other]:
            is_open[one if sizes[one] < sizes[other] else other] = False
    labels, _ = ndimage.label(is_open)
    reached: NDArray[np.bool_] = labels == labels[start]
    return reached


def _pairs(found: NDArray[np.bool_]) -> list[list[int]]:
    pairs: list[list[int]] = np.argwhere(found).tolist()
    return pairs


def _is_cut_off(cut: NDArray[np.int64], reached: NDArray[np.bool_], factor: int) -> bool:
    """Tell whether ground worth going to was cut off.

    Args:
        cut: How many cells of ground are left out in each block, (H, W).
        reached: Blocks that the robot gets to, (H, W).
        factor: Side of a block.
    """
    near = ndimage.binary_dilation(reached, np.ones((3, 3)))
    return bool(cut[~near].sum() >= factor**2)


def _block(cell: Cell, factor: int) -> Cell:
    return cell[0] // factor, cell[1] // factor


def _spread(blocks: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Give each cell (h, w) what its block (H, W) has."""
    return blocks.repeat(factor, axis=0).repeat(factor, axis=1)


def _block_counts(cells: NDArray[np.bool_], factor: int) -> NDArray[np.int64]:
    """Count the cells (h, w) in each block, (H, W)."""
    rows, cols = cells.shape[0] // factor, cells.shape[1] // factor
    by_row = cells.reshape(rows, factor, cols * factor).sum(axis=1, dtype=np.int32)
    counts: NDArray[np.int64] = by_row.reshape(rows, cols, factor).sum(axis=2, dtype=np.int64)
    return counts
