"""The grid that the planner steps on, and how its steps are ways on the map under it.

`coarsening` makes one of a map. Letters in shapes: H, W the planning grid, h, w the cells of the
map under it, N points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

from gridnav import OBSTACLE, GridGeometry
from vgdp_planner.ways import room_around, shortest_way

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Cell = tuple[int, int]
Point = tuple[float, float]

GoalState = Literal['none', 'ok', 'outside', 'occupied', 'unreachable']

BELIEF_SIGMAS = 3.0
"""A belief ends this many standard deviations around the pose."""

LEAST_BELIEF = 1e-3
"""A block with a smaller share of the belief has none."""


class OutsideMapError(ValueError):
    """The robot is not on the map."""


class OccupiedError(ValueError):
    """The robot is at an obstacle, with no clear place near by."""


@dataclass(frozen=True)
class GridSettings:
    """How a map becomes a planning grid.

    Attributes:
        robot_radius: Of the circle around the robot that must stay clear, in metres.
        resolution: Side of a block in metres, rounded to whole cells of the map; 0 for one cell.
        max_cells: Blocks become larger rather than more than this many.
        keep_resolution: Whether blocks stay as they are where smaller ones would cut off less: a
            robot that moves by whole blocks can't use those.
        goal_tolerance: Where the goal is at an obstacle, the nearest place up to this far from it
            will do, in metres, and one a block and the robot's radius away in any case.
        goal_reach: Any place this near to the goal will do that was seen to be free, in metres.
        center: A place, (x, y) in metres, that lies in the middle of a block; blocks begin at
            multiples of their side if None.
    """

    robot_radius: float = 0.0
    resolution: float = 0.0
    max_cells: int = 40_000
    keep_resolution: bool = False
    goal_tolerance: float = 0.0
    goal_reach: float = 0.0
    center: Point | None = None

    @classmethod
    def from_parameters(
        cls,
        *,
        robot_radius: float = 0.0,
        planning_resolution: float = 0.0,
        max_planning_cells: int = 40_000,
        goal_tolerance: float = 0.0,
        goal_reach: float = 0.0,
        **_: object,
    ) -> GridSettings:
        """Return what parameters of the node say, of which all others are passed over."""
        return cls(
            robot_radius,
            planning_resolution,
            max_planning_cells,
            goal_tolerance=goal_tolerance,
            goal_reach=goal_reach,
        )


@dataclass(frozen=True)
class Ground:
    """The cells of the map under a planning grid.

    Attributes:
        clear: Where the robot's centre may be, bool (h, w).
        standable: The pieces of ground that count, bool (h, w).
        geometry: Where these cells lie.
        factor: How many make the side of a block.
        start: The cell that the robot is in, or a clear one near by.
        goal: The cell of the goal, or a clear one near by, where it is in reach.
    """

    clear: NDArray[np.bool_]
    standable: NDArray[np.bool_]
    geometry: GridGeometry
    factor: int
    start: Cell
    goal: Cell | None

    def stand(self, block: Cell) -> Cell:
        """Return where to stand in an open block: at the goal, or where there is room."""
        k = self.factor
        if self.goal is not None and (self.goal[0] // k, self.goal[1] // k) == block:
            return self.goal
        row, col = block[0] * k, block[1] * k
        top, left = max(row - k, 0), max(col - k, 0)
        room = room_around(self.clear[top : row + 2 * k, left : col + 2 * k])
        room = room[row - top : row - top + k, col - left : col - left + k]
        span = np.arange(k) - (k - 1) / 2
        # Half a block of room is enough; then the middle is better.
        merit = np.minimum(room, k / 2) - np.hypot(span[:, None], span) / (4 * k)
        merit[~self.standable[row : row + k, col : col + k]] = -np.inf
        best_row, best_col = divmod(int(merit.argmax()), k)
        return row + best_row, col + best_col

    def leg(self, begin: Cell, end: Cell, blocks: Sequence[Cell]) -> list[Cell]:
        """Return the cells of the map from one to another through some blocks, both included."""
        k = self.factor
        wanted = set(blocks)
        for (row, col), (next_row, next_col) in pairwise(blocks):
            # A diagonal step leads through the blocks beside it.
            wanted |= {(row, next_col), (next_row, col)}
        index = np.array(list(wanted))
        corner = index.min(axis=0)
        in_way = np.zeros(index.max(axis=0) - corner + 1, dtype=np.bool_)
        in_way[tuple((index - corner).T)] = True
        allowed = in_way.repeat(k, axis=0).repeat(k, axis=1)
        top, left = (corner * k).tolist()
        window = np.s_[top : top + allowed.shape[0], left : left + allowed.shape[1]]
        cells = shortest_way(
            allowed & self.standable[window],
            room_around(self.clear[window]),
            (begin[0] - top, begin[1] - left),
            (end[0] - top, end[1] - left),
        )
        return [(row + top, col + left) for row, col in cells]


@dataclass(frozen=True)
class PlanningGrid:
    """A map made ready for the planner.

    Attributes:
        partial_map: (3, H, W).
        geometry: Where the planning grid lies.
        start: The block that the robot is in.
        factor: Cells of the map along the side of a block.
        goal: Whether the goal is in reach as far as is known ('ok'), and if not, why.
        lost: Whether coarsening cut off the goal, or ground that is worth going to.
        ground: The cells under the blocks; None where these are the blocks themselves.
    """

    partial_map: NDArray[np.float32]
    geometry: GridGeometry
    start: Cell
    factor: int = 1
    goal: GoalState = 'none'
    lost: bool = False
    ground: Ground | None = field(default=None, repr=False)

    def way(self, blocks: Sequence[Cell], via: int | None = None) -> NDArray[np.float64]:
        """Return the points that the robot passes when it takes the planner's steps.

        Each is the centre of a clear cell of the map, and the next one is in a cell beside it. In
        the block of the goal the way ends at the goal.

        Args:
            blocks: From `start` on, each one valid step from the one before.
            via: Index of a block that the way has to go into before it goes on to the last one.

        Returns:
            (x, y) in metres, (N, 2).
        """
        if self.ground is None:
            return np.array([self.geometry.center_of(*block) for block in blocks])
        last = len(blocks) - 1
        cells = [self.ground.start]
        begun = 0
        for stop in (last,) if via is None or via >= last else (via, last):
            end = self.ground.stand(blocks[stop])
            cells += self.ground.leg(cells[-1], end, blocks[begun : stop + 1])[1:]
            begun = stop
        return np.array([self.ground.geometry.center_of(*cell) for cell in cells])

    def is_clear(self, points: NDArray[np.float64]) -> bool:
        """Tell whether the robot's centre may be at all of some points (N, 2) in metres."""
        geometry, clear = self._finest
        corner = (geometry.origin_x, geometry.origin_y)
        cols, rows = np.floor((points - corner) / geometry.resolution).astype(np.int64).T
        # Nothing is known of what is off the grid.
        inside = (rows >= 0) & (rows < geometry.rows) & (cols >= 0) & (cols < geometry.cols)
        return bool(clear[rows[inside], cols[inside]].all())

    def belief(
        self, position: Point, covariance: NDArray[np.float64]
    ) -> NDArray[np.float32] | None:
        """Return how likely the robot is in each block, by a Gaussian around its pose.

        Each cell of the map where the robot may be brings its weight to its block. `start` stays
        the most likely block.

        Args:
            position: (x, y) of the pose in metres.
            covariance: Of x and y in m², (2, 2).

        Returns:
            (H, W), sums to 1; None where it says no more than `start`.
        """
        geometry, standable = self._finest
        if self.ground is not None:
            standable = self.ground.standable
        # Where in its cell the robot is says nothing.
        covariance = covariance + np.eye(2) * geometry.resolution**2 / 12
        reach = math.ceil(
            BELIEF_SIGMAS * math.sqrt(np.linalg.eigvalsh(covariance)[-1]) / geometry.resolution
        )
        place = np.array(geometry.cell_at(*position))
        (top, left), (bottom, right) = np.maximum([place - reach, place + reach + 1], 0)
        cells = np.argwhere(standable[top:bottom, left:right]) + np.array([top, left])
        corner = np.array([geometry.origin_x, geometry.origin_y])
        offsets = (cells[:, ::-1] + 0.5) * geometry.resolution + corner - position
        distances = np.einsum('ni,ij,nj->n', offsets, np.linalg.inv(covariance), offsets)
        weights = np.where(distances <= BELIEF_SIGMAS**2, np.exp(-distances / 2), 0.0)
        belief = np.zeros(self.geometry.shape)
        np.add.at(belief, tuple((cells // self.factor).T), weights)
        belief[belief < LEAST_BELIEF * belief.sum()] = 0.0
        if np.count_nonzero(belief) <= 1:
            return None
        belief[self.start] = max(belief[self.start], 1.001 * belief.max())
        likely: NDArray[np.float32] = (belief / belief.sum()).astype(np.float32)
        return likely

    @cached_property
    def _finest(self) -> tuple[GridGeometry, NDArray[np.bool_]]:
        """The cells of the map and which of them are clear."""
        if self.ground is None:
            return self.geometry, self.partial_map[OBSTACLE] == 0
        return self.ground.geometry, self.ground.clear
