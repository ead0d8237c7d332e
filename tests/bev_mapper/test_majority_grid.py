"""The paper's projection."""

from __future__ import annotations

import numpy as np
import pytest

from bev_mapper.evidence_grid import Crop
from bev_mapper.majority_grid import MajorityGrid
from bev_mapper.voxel_cloud import CloudPoints
from gridnav.grid import GridGeometry
from gridnav.rgbd import CLASSES, UNLABELLED

FLOOR, CEILING, TABLE = (CLASSES.index(name) for name in ('floor', 'ceiling', 'table'))


def cloud(*points: tuple[float, float, float, int]) -> CloudPoints:
    """Return a cloud of points (x, y, z, label)."""
    values = np.array(points)
    colors = np.zeros((len(points), 3), dtype=np.uint8)
    return CloudPoints(values[:, :3], colors, values[:, 3].astype(np.uint8))


def test_most_points_of_a_cell_decide() -> None:
    """Floor and ceiling are free, all others obstacles, half is enough."""
    grid = MajorityGrid(GridGeometry(1, 5, 1.0), Crop(), growth=0, max_cells=100)
    grid.project(
        cloud(
            (0.5, 0.5, 0.0, FLOOR), (0.4, 0.5, 1.4, CEILING), (0.3, 0.5, 0.7, TABLE),
            (1.5, 0.5, 0.0, FLOOR), (1.4, 0.5, 0.7, TABLE),
            (2.5, 0.5, 0.7, UNLABELLED), (3.5, 0.5, 9.0, TABLE), (3.5, 0.5, 0.01, TABLE),
        )
    )  # fmt: skip
    assert grid.occupancy.tolist() == [[0, 100, 100, -1, -1]]
    assert grid.probability.tolist() == [[33, 50, 100, -1, -1]]


def test_the_paper_s_map_of_50_by_50() -> None:
    """Any fixed extent; what is beyond it is left out."""
    rng = np.random.default_rng(0)
    places = rng.uniform(-6, 6, (5000, 2))
    labels = np.where(np.abs(places).max(axis=1) < 3, FLOOR, TABLE).astype(np.uint8)
    heights = np.where(labels == FLOOR, 0.0, 1.0)
    points = CloudPoints(
        np.column_stack([places, heights]), np.zeros((5000, 3), dtype=np.uint8), labels
    )
    grid = MajorityGrid(GridGeometry(50, 50, 0.2, -5.0, -5.0), Crop(), growth=0, max_cells=2500)
    grid.project(points)
    assert grid.occupancy.shape == (50, 50)
    assert set(np.unique(grid.occupancy[10:40, 10:40])) <= {-1, 0}
    assert set(np.unique(grid.occupancy[:10])) <= {-1, 100}


def test_it_grows_and_is_bounded() -> None:
    """As the other grid."""
    grid = MajorityGrid(GridGeometry(3, 3, 1.0), Crop(), growth=3, max_cells=100)
    grid.project(cloud((-1.5, 1.5, 0.0, FLOOR), (1.5, 1.5, 0.0, FLOOR)))
    assert grid.geometry == GridGeometry(3, 6, 1.0, -3.0, 0.0)
    assert np.argwhere(grid.occupancy == 0).tolist() == [[1, 1], [1, 4]]
    with pytest.raises(ValueError, match='more than the limit of 100'):
        grid.project(cloud((1.5, 50.5, 0.0, FLOOR), (1.5, 1.5, 0.0, FLOOR)))
    assert grid.geometry == GridGeometry(3, 6, 1.0, -3.0, 0.0)
    grid.clear()
    assert grid.geometry == GridGeometry(3, 3, 1.0)
