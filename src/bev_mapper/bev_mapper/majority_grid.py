"""The paper's projection: what most points of a cell are decides."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_mapper.evidence_grid import LOWEST_FLOOR_M
from bev_mapper.growing import grown
from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE
from gridnav.rgbd import CLASSES

if TYPE_CHECKING:
    from bev_mapper.evidence_grid import Crop
    from bev_mapper.voxel_cloud import CloudPoints
    from gridnav.grid import GridGeometry

FREE_CLASSES = tuple(CLASSES.index(name) for name in ('ceiling', 'floor'))


class MajorityGrid:
    """Cells that are free where most points are floor or ceiling, and else obstacles.

    It is made from the whole cloud each time, so what it costs is bounded by the cloud's size.

    Attributes:
        geometry: Where the grid lies now.
        occupancy: -1 without points, 0 free, 100 obstacle, int8 (H, W).
        probability: Percent of the points that are obstacles, -1 without points, int8 (H, W).
    """

    def __init__(self, geometry: GridGeometry, crop: Crop, *, growth: int, max_cells: int) -> None:
        """Start without points; see `EvidenceGrid`."""
        self._crop = crop
        self._growth = growth
        self._max_cells = max_cells
        self._initial_geometry = geometry
        self.clear()

    def clear(self) -> None:
        """Forget everything and return to the first size."""
        self.geometry = self._initial_geometry
        self.occupancy = np.full(self.geometry.shape, UNKNOWN_VALUE, dtype=np.int8)
        self.probability = self.occupancy.copy()

    def project(self, cloud: CloudPoints) -> None:
        """Make the grid from a cloud.

        Raises:
            ValueError: If the map would grow beyond its limit; it is as it was.
        """
        heights = cloud.positions[:, 2]
        free = np.isin(cloud.labels, FREE_CLASSES)
        low = np.where(free, LOWEST_FLOOR_M, self._crop.low)
        used = (heights >= low) & (heights < self._crop.high)
        x, y = cloud.positions[used, :2].T
        cols = np.floor((x - self.geometry.origin_x) / self.geometry.resolution).astype(np.int64)
        rows = np.floor((y - self.geometry.origin_y) / self.geometry.resolution).astype(np.int64)
        if self._growth and len(rows):
            found = grown(
                self.geometry,
                (int(rows.min()) - 1, int(rows.max()) + 1),
                (int(cols.min()) - 1, int(cols.max()) + 1),
                growth=self._growth,
                max_cells=self._max_cells,
            )
            if found is not None:
                self.geometry, ((south, _), (west, _)) = found
                rows += south
                cols += west
        height, width = self.geometry.shape
        inside = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
        cells = (rows * width + cols)[inside]
        points = np.bincount(cells, minlength=height * width)
        obstacles = np.bincount(cells, ~free[used][inside], minlength=height * width)
        share = (obstacles / np.maximum(points, 1)).reshape(height, width)
        seen = points.reshape(height, width) > 0
        self.probability = np.where(seen, np.rint(100 * share), UNKNOWN_VALUE).astype(np.int8)
        blocked = np.where(share >= 0.5, OCCUPIED_VALUE, FREE_VALUE)  # noqa: PLR2004 - half
        self.occupancy = np.where(seen, blocked, UNKNOWN_VALUE).astype(np.int8)
