"""The nine actions."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gridnav.actions import DONE, NUM_ACTIONS, STEP_LENGTHS, STEPS, valid_moves


def test_steps_are_the_documented_ones() -> None:
    """The order of the steps is part of the interface."""
    expected = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
    assert STEPS.tolist() == [list(step) for step in expected]
    assert (DONE, NUM_ACTIONS) == (8, 9)
    np.testing.assert_allclose(STEP_LENGTHS, [1, 2**0.5] * 4 + [0])


@given(arrays(np.bool_, st.tuples(st.integers(1, 6), st.integers(1, 6))))
def test_valid_moves_follow_the_rule_cell_by_cell(blocked: np.ndarray) -> None:
    """Each step is valid exactly when the written rule says so."""
    height, width = blocked.shape

    def is_open(row: int, col: int) -> bool:
        return 0 <= row < height and 0 <= col < width and not blocked[row, col]

    valid = valid_moves(blocked)
    for action, (dr, dc) in enumerate(STEPS.tolist()):
        for row in range(height):
            for col in range(width):
                beside = is_open(row + dr, col) or is_open(row, col + dc)
                expected = is_open(row + dr, col + dc) and (not (dr and dc) or beside)
                assert valid[action, row, col] == expected


def test_valid_moves_keep_leading_axes() -> None:
    """A batch gives what its members give alone."""
    blocked = np.random.default_rng(0).random((2, 3, 4, 5)) < 0.4
    assert np.array_equal(valid_moves(blocked)[1, 2], valid_moves(blocked[1, 2]))
