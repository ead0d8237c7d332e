"""Grid geometry."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gridnav.grid import GridGeometry


@given(
    row=st.integers(-500, 500),
    col=st.integers(-500, 500),
    resolution=st.floats(0.01, 100.0),
    origin=st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000)),
)
def test_the_centre_of_a_cell_lies_in_it(
    row: int, col: int, resolution: float, origin: tuple[float, float]
) -> None:
    """cell_at undoes center_of, on the grid and off it."""
    geometry = GridGeometry(10, 20, resolution, *origin)
    assert geometry.cell_at(*geometry.center_of(row, col)) == (row, col)


def test_row_is_y_and_col_is_x() -> None:
    """REP-103: x east, y north."""
    geometry = GridGeometry(rows=3, cols=5, resolution=0.5, origin_x=-1.0, origin_y=2.0)
    assert geometry.center_of(row=1, col=3) == (0.75, 2.75)
    assert geometry.cell_at(x=0.75, y=2.75) == (1, 3)
    assert geometry.shape == (3, 5)
    assert geometry.contains(2, 4)
    assert not geometry.contains(3, 0)
    assert not geometry.contains(0, -1)


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        ((0, 5, 1.0), 'at least one cell'),
        ((5, 5, 0.0), 'resolution'),
        ((5, 5, math.nan), 'resolution'),
        ((5, 5, 1.0, math.inf), 'origin'),
    ],
)
def test_impossible_grids_are_refused(arguments: tuple[float, ...], reason: str) -> None:
    """A grid has cells, a scale and a place."""
    with pytest.raises(ValueError, match=reason):
        GridGeometry(*arguments)  # type: ignore[arg-type]


def test_a_point_that_is_nowhere_has_no_cell() -> None:
    """NaN and infinity are refused by name."""
    with pytest.raises(ValueError, match='nan'):
        GridGeometry(5, 5, 1.0).cell_at(math.nan, 0.0)
