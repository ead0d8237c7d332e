"""Partial maps and occupancy grids."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gridnav.partial_map import (
    FREE,
    GOAL,
    OBSTACLE,
    as_partial_maps,
    from_occupancy,
    to_occupancy,
)


@given(
    arrays(
        np.int8,
        st.tuples(st.integers(1, 6), st.integers(1, 6)),
        elements=st.sampled_from([-1, 0, 100]),
    )
)
def test_ternary_occupancy_comes_back(occupancy: np.ndarray) -> None:
    """to_occupancy undoes from_occupancy for -1, 0 and 100."""
    partial_map = as_partial_maps(from_occupancy(occupancy))
    assert np.array_equal(to_occupancy(partial_map), occupancy)


def test_grey_values_count_as_unseen() -> None:
    """50 and up is an obstacle, 25 and down is free, between them nobody knows."""
    partial_map = from_occupancy(np.array([[-1, 0, 25, 26, 49, 50, 100]], dtype=np.int8))
    assert partial_map[OBSTACLE].tolist() == [[0, 0, 0, 0, 0, 1, 1]]
    assert partial_map[FREE].tolist() == [[0, 1, 1, 0, 0, 0, 0]]


def test_the_goal_is_marked_where_it_is_on_the_grid() -> None:
    """A goal off the grid is left out."""
    occupancy = np.zeros((2, 3), dtype=np.int8)
    assert from_occupancy(occupancy, goal=(1, 2))[GOAL].tolist() == [[0, 0, 0], [0, 0, 1]]
    assert not from_occupancy(occupancy, goal=(2, 0))[GOAL].any()
    assert not from_occupancy(occupancy, goal=(0, -1))[GOAL].any()


@pytest.mark.parametrize(
    ('array', 'reason'),
    [
        (np.zeros((2, 4, 4)), 'shape'),
        (np.zeros((3, 0, 4)), 'shape'),
        (np.zeros((4, 4)), 'shape'),
        (np.full((3, 4, 4), 0.5), 'only 0 and 1'),
        (np.full((3, 4, 4), np.nan), 'only 0 and 1'),
        (np.ones((1, 3, 4, 4)), 'both obstacle and free'),
    ],
)
def test_what_is_no_partial_map_is_refused(array: np.ndarray, reason: str) -> None:
    """One sentence says why."""
    with pytest.raises(ValueError, match=reason):
        as_partial_maps(array)
