"""The lattice point net: maps whose cells hold learned features of the points seen in them.

After CALVIN's projector (S. Ishida and J. F. Henriques, "Towards real-world navigation with deep
differentiable planners", CVPR 2022): a CNN gives each pixel of an RGB-D view features, its depth
and the known pose put it into a cell of a lattice, a small network looks at it together with
its height and where in the cell it is, and each cell keeps the largest of each feature over all
of its points and views. Nobody says what is floor and what is not: what the features mean is
learned from what is done with them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from avd_player.avd_format import GRID_M
from gridnav import GOAL, NUM_MOVES
from vgdp_experiments.search.views import CHANNELS, STRIDE, network_input

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vgdp_experiments.search.views import SmallViews
    from vgdp_planner.planning_grid import PlanningGrid

PIXEL_FEATURES = 16

PLACE_INPUTS = 3
"""Of a point: its height, and where in its cell it is."""

HIGHEST_M = 2.0
"""What is higher is left out: ceilings and lamps are in nobody's way."""


class Points(NamedTuple):
    """Points of views with their features. N points.

    Attributes:
        features: At least 0, (N, C).
        cells: (row, col) of each, which may be off the map, (N, 2).
        views: Number of the view of each, (N,).
    """

    features: Tensor
    cells: Tensor
    views: Tensor

    def joined(self, others: Points) -> Points:
        """Return a point for each cell, with the largest of each feature there, of one view."""
        cells, index = torch.unique(
            torch.cat([self.cells, others.cells]), dim=0, return_inverse=True
        )
        largest = _largest(torch.cat([self.features, others.features]), index, len(cells))
        return Points(largest, cells, torch.zeros(len(cells), dtype=torch.long))

    def lattice(self, shape: tuple[int, int], shift: Tensor, kept: Tensor | None = None) -> Tensor:
        """Return the largest of each feature in each cell of a map, 0 where there is no point.

        Args:
            shape: Rows and columns of the map.
            shift: Added to the cells, as the map may have another corner, (2,).
            kept: Which of the points count, bool (N,); all if None.

        Returns:
            (C, H, W).
        """
        rows, cols = shape
        cells = self.cells + shift
        inside = ((cells >= 0) & (cells < torch.tensor(shape))).all(dim=1)
        inside = inside if kept is None else inside & kept
        index = cells[inside, 0] * cols + cells[inside, 1]
        largest = _largest(self.features[inside], index, rows * cols)
        return largest.T.reshape(-1, rows, cols)


class LatticePointNet(nn.Module):
    """Puts learned features of RGB-D views into the cells of a map.

    Args:
        features: Of a cell.
    """

    def __init__(self, features: int) -> None:
        super().__init__()
        self.features = features
        self.pixels = nn.Sequential(
            nn.Conv2d(CHANNELS, PIXEL_FEATURES, STRIDE, stride=STRIDE),
            nn.ReLU(),
            nn.Conv2d(PIXEL_FEATURES, PIXEL_FEATURES, 3, padding=1),
            nn.ReLU(),
        )
        self.points = nn.Sequential(
            nn.Linear(PIXEL_FEATURES + PLACE_INPUTS, 2 * features),
            nn.ReLU(),
            nn.Linear(2 * features, features),
            nn.ReLU(),
        )

    def forward(self, views: Tensor, points: Tensor, origin: Tensor) -> Points:
        """Return the features of all points, and where they are.

        Args:
            views: (V, 5, 36, 64).
            points: Where every fourth pixel is, metres, NaN for nowhere, (V, 9, 16, 3).
            origin: x and y of the lower left corner of the map, (2,).
        """
        flat = points.flatten(0, 2)
        kept = flat.isfinite().all(dim=1) & (flat[:, 2] < HIGHEST_M)
        of_pixels = self.pixels(views).movedim(1, -1).flatten(0, 2)[kept]
        places = flat[kept]
        steps = (places[:, :2] - origin) / GRID_M
        cells = steps.floor()
        inputs = torch.cat([of_pixels, places[:, 2:], steps - cells - 0.5], dim=1)
        owners = torch.arange(len(views))
        owners = owners.repeat_interleave(points[0, ..., 0].numel())[kept]
        return Points(self.points(inputs), cells.flip(1).long(), owners)


class LatticeMemory:
    """The lattice of an episode, which grows with the views.

    Args:
        net: Makes the features.
    """

    def __init__(self, net: LatticePointNet) -> None:
        self._net = net
        self.begin()

    def begin(self) -> None:
        """Forget everything: a new episode begins."""
        self._origin: tuple[float, float] | None = None
        self._points: Points | None = None
        self._stood: list[Tensor] = []

    @torch.no_grad()
    def look(self, views: SmallViews, grid: PlanningGrid) -> Tensor:
        """Take in what the robot sees, and return the lattice where the planning grid lies.

        Of the grid nothing is read but where it lies, the robot's cell, and the goal's.

        Returns:
            With the goal and where the robot stood as the last channels, (1, C + 2, H, W).
        """
        geometry = grid.geometry
        corner = geometry.origin_x, geometry.origin_y
        self._origin = self._origin or corner
        shift = cell_shift(self._origin, corner)
        read = network_input(views.color, views.depth)
        origin = torch.tensor(self._origin, dtype=torch.float32)
        seen = self._net(read, torch.from_numpy(views.points), origin)
        self._points = seen if self._points is None else self._points.joined(seen)
        self._stood.append(torch.tensor(grid.start) - shift)
        goal = torch.from_numpy(grid.partial_map[None, GOAL])
        stood = torch.zeros_like(goal)
        rows, cols = self.stood(grid).T
        stood[0, rows, cols] = 1.0
        lattice = self._points.lattice(geometry.shape, shift)
        return torch.cat([lattice, goal, stood])[None]

    def stood(self, grid: PlanningGrid) -> Tensor:
        """Return the cells of a planning grid where the robot stood, look by look, (S, 2)."""
        corner = grid.geometry.origin_x, grid.geometry.origin_y
        return torch.stack(self._stood) + cell_shift(self._origin or corner, corner)


def _largest(features: Tensor, places: Tensor, count: int) -> Tensor:
    """Return the largest of each feature at each of some places, 0 where there is none.

    Args:
        features: At least 0, (N, C).
        places: Which of the places each belongs to, (N,).
        count: Number of the places.

    Returns:
        (count, C).
    """
    empty = torch.zeros(count, features.shape[1])
    return empty.scatter_reduce(0, places[:, None].expand_as(features), features, 'amax')


def cell_shift(corner: tuple[float, float], other: tuple[float, float]) -> Tensor:
    """Return what is added to cells (row, col) of a map where the corner (x, y) is another, (2,).

    The corners are whole cells apart.
    """
    apart = (torch.tensor(corner) - torch.tensor(other)) / GRID_M
    return apart.flip(0).round().long()


def heading_of(bearings: NDArray[np.floating]) -> NDArray[np.int64]:
    """Return which of the eight moves goes in a direction, in radians from x to y."""
    # Move 2 goes along x and move 0 along y.
    eighths = np.rint(bearings / (np.pi / 4)).astype(np.int64)
    return (2 - eighths) % NUM_MOVES
