"""One growing grid from many windows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bev_mapper import GridFusion, Pose2D
from gridnav.grid import GridGeometry

U, F, X = -1, 0, 100
"""Unseen, free, obstacle."""


@dataclass
class Placed:
    """A window with its lower-left cell in the map, the robot's cell, and its stamp."""

    cells: np.ndarray
    row: int
    col: int
    robot: tuple[int, int]
    stamp: int

    def geometry(self, resolution: float, origin: tuple[float, float]) -> GridGeometry:
        """Return where it lies in a map with this origin."""
        rows, cols = self.cells.shape
        return GridGeometry(
            rows,
            cols,
            resolution,
            origin[0] + self.col * resolution,
            origin[1] + self.row * resolution,
        )


def windows() -> st.SearchStrategy[list[Placed]]:
    """Small windows all over the place, each with a stamp of its own."""
    cells = st.integers(1, 5).flatmap(
        lambda rows: st.integers(1, 5).flatmap(
            lambda cols: st.lists(
                st.sampled_from([U, F, X]), min_size=rows * cols, max_size=rows * cols
            ).map(lambda values: np.array(values, dtype=np.int8).reshape(rows, cols))
        )
    )
    places = st.integers(-30, 30)
    placed = st.builds(
        Placed, cells, places, places, st.tuples(places, places), st.integers(0, 1000)
    )
    return st.lists(placed, max_size=8, unique_by=lambda window: window.stamp)


@settings(deadline=None)
@given(
    placed=windows(),
    order=st.randoms(use_true_random=False),
    growth=st.integers(1, 20),
    resolution=st.sampled_from([0.05, 0.1, 0.3, 1.0, 7.0]),
    origin=st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000)),
)
def test_the_newest_observation_of_each_cell_wins_in_any_order(
    placed: list[Placed],
    order: object,
    growth: int,
    resolution: float,
    origin: tuple[float, float],
) -> None:
    """Held against a dictionary of cells."""
    expected: dict[tuple[int, int], int] = {}
    for window in sorted(placed, key=lambda window: window.stamp):
        for (row, col), value in np.ndenumerate(window.cells):
            if value != U:
                expected[window.row + row, window.col + col] = int(value)
        expected[window.robot] = F

    grid = GridFusion(GridGeometry(4, 6, resolution, *origin), growth=growth)
    order.shuffle(placed)  # type: ignore[attr-defined]
    start = grid.geometry
    for window in placed:
        robot = Pose2D(*start.center_of(*window.robot))
        grid.fuse(window.cells, window.geometry(resolution, origin), window.stamp, robot=robot)

    row_0 = round((origin[1] - grid.geometry.origin_y) / resolution)
    col_0 = round((origin[0] - grid.geometry.origin_x) / resolution)
    seen = {
        (int(row) - row_0, int(col) - col_0): int(grid.occupancy[row, col])
        for row, col in np.argwhere(grid.occupancy != U)
    }
    assert seen == expected
    assert grid.occupancy.shape == grid.geometry.shape
    rim = np.ones(grid.geometry.shape, dtype=np.bool_)
    rim[1:-1, 1:-1] = False
    assert not (grid.occupancy[rim] == F).any()


def window_of(rows: list[list[int]]) -> np.ndarray:
    """Return a window, written with its northernmost row first as one sees it on a screen."""
    return np.array(rows[::-1], dtype=np.int8)


def test_a_window_inside_leaves_the_size_alone() -> None:
    """Unseen cells and walls on the rim make nothing grow."""
    grid = GridFusion(GridGeometry(3, 3, 1.0))
    window = window_of([[U, U, U, U, U], [U, X, X, X, U], [U, X, F, X, U], [U, X, X, X, U]])
    grid.fuse(window, GridGeometry(4, 5, 1.0, -1.0, 0.0), stamp=1, robot=Pose2D(1.5, 1.5))
    assert grid.geometry == GridGeometry(3, 3, 1.0)
    assert np.array_equal(grid.occupancy, window_of([[X, X, X], [X, F, X], [X, X, X]]))


def test_a_free_cell_on_the_rim_makes_room_beyond_it() -> None:
    """A planner must see that there is more to see."""
    grid = GridFusion(GridGeometry(3, 3, 1.0), growth=4)
    nothing = np.array([[U]], dtype=np.int8)
    grid.fuse(nothing, GridGeometry(1, 1, 1.0), stamp=1, robot=Pose2D(2.5, 1.5))
    assert grid.geometry == GridGeometry(3, 7, 1.0)
    grid.fuse(nothing, GridGeometry(1, 1, 1.0), stamp=2, robot=Pose2D(0.5, 0.5))
    assert grid.geometry == GridGeometry(7, 11, 1.0, -4.0, -4.0)
    assert grid.occupancy[grid.geometry.cell_at(2.5, 1.5)] == F
    assert grid.occupancy[grid.geometry.cell_at(0.5, 0.5)] == F
    assert (grid.occupancy != U).sum() == 2


def test_the_cell_under_the_robot_is_free_whatever_the_window_says() -> None:
    """It stands there."""
    grid = GridFusion(GridGeometry(3, 3, 1.0))
    wall, centre = np.array([[X]], dtype=np.int8), Pose2D(1.5, 1.5)
    grid.fuse(wall, GridGeometry(1, 1, 1.0, 1.0, 1.0), stamp=1, robot=centre)
    assert grid.occupancy[1, 1] == F


@pytest.mark.parametrize('quarter', range(4))
def test_a_window_on_the_robot_turns_with_it(quarter: int) -> None:
    """The cell ahead of the robot is an obstacle, to its left it is free."""
    grid = GridFusion(GridGeometry(9, 9, 1.0))
    window = window_of([[U, F, U], [U, U, X], [U, U, U]])
    ahead = [(4, 5), (5, 4), (4, 3), (3, 4)]
    pose = Pose2D(4.5, 4.5, quarter * math.pi / 2)
    grid.fuse(window, GridGeometry(3, 3, 1.0, -1.5, -1.5), stamp=1, robot=pose, on_robot=True)
    assert grid.occupancy[4, 4] == F
    assert grid.occupancy[ahead[quarter]] == X
    assert grid.occupancy[ahead[(quarter + 1) % 4]] == F
    assert (grid.occupancy != U).sum() == 3


def test_a_turned_window_leaves_no_holes() -> None:
    """A disc of free cells stays a disc at any angle."""
    grid = GridFusion(GridGeometry(60, 60, 0.1))
    free = np.zeros((40, 40), dtype=np.int8)
    pose = Pose2D(3.0, 3.0, 0.7)
    grid.fuse(free, GridGeometry(40, 40, 0.1, -2.0, -2.0), stamp=1, robot=pose, on_robot=True)
    y, x = (np.indices((60, 60)) + 0.5) * 0.1
    disc = np.hypot(x - 3.0, y - 3.0) < 1.9
    assert (grid.occupancy[disc] == F).all()


def test_grey_values_become_ternary_and_doubtful_ones_are_left_out() -> None:
    """The map holds -1, 0 and 100 alone."""
    grid = GridFusion(GridGeometry(3, 7, 1.0))
    window = np.array([[10, 25, 40, 50, 99]], dtype=np.int8)
    grid.fuse(window, GridGeometry(1, 5, 1.0, 1.0, 1.0), stamp=1, robot=Pose2D(1.5, 1.5))
    assert grid.occupancy[1].tolist() == [U, F, F, U, X, X, U]


def test_what_does_not_fit_is_refused_and_changes_nothing() -> None:
    """Another resolution, and a map without bounds."""
    grid = GridFusion(GridGeometry(10, 10, 0.1), max_cells=10_000)
    one, here = np.zeros((1, 1), dtype=np.int8), Pose2D(0.55, 0.55)
    with pytest.raises(ValueError, match=r'local map is 0.05 m, that of the map is 0.1 m'):
        grid.fuse(one, GridGeometry(1, 1, 0.05), stamp=1, robot=here)
    with pytest.raises(ValueError, match='more than the limit of 10000'):
        grid.fuse(one, GridGeometry(1, 1, 0.1, 1e6, 0.0), stamp=1, robot=here)
    with pytest.raises(ValueError, match='more than the limit of 10000'):
        grid.fuse(one, GridGeometry(1, 1, 0.1, 0.5, 0.5), stamp=1, robot=Pose2D(-1e6, 1e6))
    assert grid.geometry == GridGeometry(10, 10, 0.1)
    assert (grid.occupancy == U).all()
    with pytest.raises(ValueError, match='limit of 99'):
        GridFusion(GridGeometry(10, 10, 0.1), max_cells=99)
    with pytest.raises(ValueError, match='at least 1 cell'):
        GridFusion(GridGeometry(10, 10, 0.1), growth=0)


def test_clear_returns_to_the_first_size() -> None:
    """And forgets what was newest."""
    grid = GridFusion(GridGeometry(3, 3, 1.0))
    wall, centre = np.array([[X]], dtype=np.int8), Pose2D(1.5, 1.5)
    grid.fuse(wall, GridGeometry(1, 1, 1.0, 10.0, 1.0), stamp=100, robot=centre)
    grid.clear()
    assert grid.geometry == GridGeometry(3, 3, 1.0)
    assert (grid.occupancy == U).all()
    grid.fuse(wall, GridGeometry(1, 1, 1.0, 2.0, 2.0), stamp=1, robot=centre)
    assert grid.occupancy.tolist() == [[U, U, U], [U, F, U], [U, U, X]]
