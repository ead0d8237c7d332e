"""What may be executed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gridnav import DONE, FREE, GOAL, NUM_MOVES, OBSTACLE, STEPS
from vgdp_planner.safety import SafetyCheck


def map_of(*rows: str) -> np.ndarray:
    """Draw a partial map: '#' obstacle, '.' free, 'G' goal, '?' unseen; the first row is row 0."""
    partial_map = np.zeros((3, len(rows), len(rows[0])), dtype=np.float32)
    for row, line in enumerate(rows):
        for col, sign in enumerate(line):
            partial_map[OBSTACLE, row, col] = sign == '#'
            partial_map[FREE, row, col] = sign in '.G'
            partial_map[GOAL, row, col] = sign == 'G'
    return partial_map


def at(partial_map: np.ndarray, *cells: tuple[int, int]) -> np.ndarray:
    """Return the belief that is uniform over the cells."""
    belief = np.zeros(partial_map.shape[1:], dtype=np.float32)
    for cell in cells:
        belief[cell] += 1 / len(cells)
    return belief


@pytest.mark.parametrize(
    ('rows', 'status'),
    [
        (('.?', '##'), 'ok'),
        (('..', '##'), 'exhausted'),
        (('..#?', '..#?'), 'exhausted'),
        (('.#G', '.##'), 'unreachable'),
        (('.#G', '?##'), 'ok'),
        (('.G', '##'), 'ok'),
        (('.#', '#?'), 'exhausted'),  # No step leads between two obstacles.
    ],
)
def test_status(rows: tuple[str, ...], status: str) -> None:
    """The status tells whether the goal or anything unseen is in reach."""
    partial_map = map_of(*rows)
    assert SafetyCheck(partial_map, at(partial_map, (0, 0)), 0.1).status == status


def test_done_only_on_the_goal() -> None:
    """Done is committed on the observed goal, nowhere else, and nothing follows it."""
    partial_map = map_of('..G', '...')
    on_goal = SafetyCheck(partial_map, at(partial_map, (0, 2)), 0.1)
    beside = SafetyCheck(partial_map, at(partial_map, (0, 1)), 0.1)
    assert on_goal.committed_steps([DONE, 0, 0], 3) == [DONE]
    assert beside.committed_steps([DONE, 0], 2) == []
    assert beside.committed_steps([2, DONE, 2], 3) == [2, DONE]
    assert not beside.allowed_first[DONE]
    assert on_goal.allowed_first[DONE]


def test_unseen_cells_are_entered_one_at_a_time() -> None:
    """Only the first step may enter what has not been seen, and the robot looks after it."""
    partial_map = map_of('..??')
    assert SafetyCheck(partial_map, at(partial_map, (0, 0)), 0.1).committed_steps(
        [2, 2, 2], 3
    ) == [2]
    assert SafetyCheck(partial_map, at(partial_map, (0, 1)), 0.1).committed_steps([2, 2], 2) == [2]


def test_blurred_belief() -> None:
    """A step is out if too much of the belief would collide; the safest is left."""
    partial_map = map_of('.....', '.#.#.')
    belief = at(partial_map, (0, 0), (0, 1), (0, 2), (0, 3))
    north, east = 0, 2  # North collides from two of the four cells, east from none.
    lenient, strict = (SafetyCheck(partial_map, belief, limit) for limit in (0.6, 0.4))
    assert lenient.allowed_first[[north, east]].all()
    assert strict.allowed_first[[north, east]].tolist() == [False, True]
    nowhere_safe = SafetyCheck(map_of('.#..#'), at(map_of('.#..#'), (0, 2), (0, 3)), 0.1)
    assert nowhere_safe.allowed_first[east]


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_no_committed_step_enters_a_known_obstacle(data: st.DataObject) -> None:
    """Whatever the map, the belief and the plan: each committed step is valid and on the map."""
    height, width = data.draw(st.integers(1, 6)), data.draw(st.integers(1, 6))
    signs = st.lists(
        st.text('#.?G', min_size=width, max_size=width), min_size=height, max_size=height
    )
    partial_map = map_of(*data.draw(signs))
    row = data.draw(st.integers(0, height - 1))
    col = data.draw(st.integers(0, width - 1))
    plan = data.draw(st.lists(st.integers(0, DONE), max_size=8))
    check = SafetyCheck(partial_map, at(partial_map, (row, col)), 0.1)
    committed = check.committed_steps(plan, 8)
    assert committed == plan[: len(committed)]
    for action in committed:
        if action == DONE:
            assert partial_map[GOAL, row, col] > 0
            continue
        assert action < NUM_MOVES
        dr, dc = STEPS[action].tolist()

        def is_open(r: int, c: int) -> bool:
            return 0 <= r < height and 0 <= c < width and partial_map[OBSTACLE, r, c] == 0

        assert is_open(row + dr, col + dc)
        if dr and dc:
            assert is_open(row + dr, col) or is_open(row, col + dc)
        row, col = row + dr, col + dc
