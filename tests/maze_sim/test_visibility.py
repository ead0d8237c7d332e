"""Line of sight against drawings, against an independent reference and for its properties."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.maze_sim.drawing import characters, find, walls

from maze_sim import visible_cells, wilson_maze
from maze_sim.visibility import visible_in_windows

if TYPE_CHECKING:
    from numpy.typing import NDArray

NEVER = np.iinfo(np.int64).max


@cache
def ray_times(view_range: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Follow many rays through a window, those through the corners of cells among them.

    Returns:
        When each ray first touches each closed cell, and when it enters its inside, ``NEVER`` if
        it doesn't, both (rays, cells); exact, in a unit of time of its own for each ray.
    """
    corners = np.arange(-2 * view_range - 1, 2 * view_range + 2, 2)
    dense = np.arange(-97, 98)
    directions = {(int(a), int(b)) for a in corners for b in corners}
    directions |= {(int(a), int(b)) for a in dense for b in (-97, 97)}
    directions |= {(b, a) for a, b in directions}
    span = np.arange(-view_range, view_range + 1)
    rows, cols = (grid.ravel() for grid in np.meshgrid(span, span, indexing='ij'))
    touch, cross = [], []
    for direction in directions:
        enters = np.zeros(len(rows), dtype=np.int64)
        leaves = np.full(len(rows), NEVER)
        speed, other_speed = direction
        for cells, towards, scale in ((rows, speed, other_speed), (cols, other_speed, speed)):
            if towards == 0:  # the ray stays in the middle of this row or column
                leaves[cells != 0] = -1
                continue
            # In half cells; both coordinates reach a line after a multiple of this unit of time.
            near, far = 2 * np.abs(cells) - 1, 2 * np.abs(cells) + 1
            near[cells == 0] = 0
            ahead = (np.sign(cells) * np.sign(towards)) >= 0
            unit = max(abs(scale), 1)
            enters = np.maximum(enters, near * unit)
            leaves = np.where(ahead, np.minimum(leaves, far * unit), -1)
        touch.append(np.where(enters <= leaves, enters, NEVER))
        cross.append(np.where(enters < leaves, enters, NEVER))
    return np.array(touch), np.array(cross)


def reference(window: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which cells of one window are seen by any of many rays, (2r + 1, 2r + 1)."""
    touch, cross = ray_times(len(window) // 2)
    blocking = window.ravel().copy()
    blocking[len(blocking) // 2] = False
    stopped = np.where(blocking, cross, NEVER).min(axis=1)
    seen = ((touch <= stopped[:, None]) & (touch < NEVER)).any(axis=0)
    return np.asarray(seen).reshape(window.shape)


def look(drawing: str, view_range: int) -> list[str]:
    """Draw what the ``@`` of a drawing sees: ``?`` is unseen, ``*`` off the map."""
    row, col = find(drawing, '@')
    seen = visible_cells(walls(drawing)[None], np.array([(row, col)]), view_range)[0]
    side = 2 * view_range + 1
    signs = np.pad(characters(drawing), view_range, constant_values='*')
    window = signs[row : row + side, col : col + side]
    assert not seen[window == '*'].any()
    return [''.join(line) for line in np.where(seen | (window == '*'), window, '?').tolist()]


@pytest.mark.parametrize(
    ('view_range', 'drawing', 'expected'),
    [
        pytest.param(
            2, '..... ..... ..@.. ..... .....', '..... ..... ..@.. ..... .....', id='open field'
        ),
        pytest.param(
            2, '..... .###. .#@#. .###. .....', '????? ?###? ?#@#? ?###? ?????', id='walled in'
        ),
        pytest.param(
            2, '..... .#.#. .#@#. .###. .....', '?...? ?#.#? ?#@#? ?###? ?????', id='gap'
        ),
        pytest.param(
            2,
            '..... ..#.. .#@#. .###. .....',
            '..?.. ..#.. ?#@#? ?###? ?????',
            id='between diagonal walls',
        ),
        pytest.param(
            3,
            '######## #.....## #.###.## #@#.#.## #.#....# #...#.## ########',
            '**###?? **#..?? **#.#?? **#@#?? **#.#?? **#..?? **###??',
            id='corridor',
        ),
        pytest.param(
            3,
            '....... ....... ....... ..#@... ....... ....... .......',
            '....... ....... ?...... ??#@... ?...... ....... .......',
            id='shadow of one wall',
        ),
        pytest.param(2, '@.# ..# ###', '***** ***** **@.# **..# **###', id='corner of the map'),
    ],
)
def test_views_as_drawn(view_range: int, drawing: str, expected: str) -> None:
    """Hand-drawn windows are seen as the rule says."""
    assert look(drawing, view_range) == expected.split()


@pytest.mark.parametrize('view_range', [1, 2, 3, 4, 6])
def test_random_windows_agree_with_many_rays(view_range: int) -> None:
    """What a thousand rays reach is seen, and nothing else."""
    rng = np.random.default_rng(view_range)
    side = 2 * view_range + 1
    windows = rng.random((400, side, side)) < rng.uniform(0.05, 0.7, (400, 1, 1))
    seen = visible_in_windows(windows.reshape(400, -1), view_range).reshape(windows.shape)
    for window, cells in zip(windows, seen, strict=True):
        assert (cells == reference(window)).all()


@pytest.mark.parametrize('view_range', [1, 2, 3, 5])
def test_mazes_agree_with_many_rays(view_range: int) -> None:
    """The views from all free cells of a maze are those of the rays, its border included."""
    blocked = wilson_maze(12, np.random.default_rng(0))
    cells = np.argwhere(~blocked)
    seen = visible_cells(np.repeat(blocked[None], len(cells), axis=0), cells, view_range)
    padded = np.pad(blocked, view_range, constant_values=True)
    on_map = np.pad(np.ones_like(blocked), view_range)
    side = 2 * view_range + 1
    for (row, col), view in zip(cells.tolist(), seen, strict=True):
        window = np.s_[row : row + side, col : col + side]
        assert (view == reference(padded[window]) & on_map[window]).all()


windows_around = st.integers(1, 4).flatmap(
    lambda view_range: arrays(np.bool_, (2 * view_range + 1, 2 * view_range + 1))
)


def view(window: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return what is seen of one window, (2r + 1, 2r + 1)."""
    return visible_in_windows(window.reshape(1, -1), len(window) // 2).reshape(window.shape)


@settings(deadline=None)
@given(windows_around)
def test_view_turns_and_mirrors_with_the_window(window: NDArray[np.bool_]) -> None:
    """No direction is special."""
    assert (view(window[::-1]) == view(window)[::-1]).all()
    assert (view(window.T) == view(window).T).all()


@settings(deadline=None)
@given(windows_around, st.data())
def test_removing_a_wall_hides_nothing(window: NDArray[np.bool_], data: st.DataObject) -> None:
    """What was seen stays in sight when a wall goes."""
    fewer = window & data.draw(arrays(np.bool_, window.shape))
    assert (view(window) <= view(fewer)).all()


@settings(deadline=None)
@given(windows_around)
def test_neighbours_are_always_seen_and_walls_tell_nothing_of_what_they_hide(
    window: NDArray[np.bool_],
) -> None:
    """The eight neighbours are in sight, and unseen cells have no say in the view."""
    seen = view(window)
    middle = len(window) // 2
    assert seen[middle - 1 : middle + 2, middle - 1 : middle + 2].all()
    assert (view(window & seen) == seen).all()
    assert (view(window | ~seen) == seen).all()


def test_robots_own_cell_never_blocks_and_the_window_stays_as_it_is() -> None:
    """A robot that stands in a wall looks out of it, and the caller's array is not written."""
    window = np.ones((1, 9), dtype=np.bool_)
    assert visible_in_windows(window, 1).all()
    assert window.all()


def test_each_robot_looks_at_its_own_map() -> None:
    """Maps and robots of a batch are paired."""
    blocked = np.stack([walls('.#. .#. .#.'), walls('... ... ...')])
    seen = visible_cells(blocked, np.array([(1, 0), (1, 0)]), 2)
    assert seen[:, 2].tolist() == [
        [False, False, True, True, False],
        [False, False, True, True, True],
    ]


def test_view_range_below_1_is_refused() -> None:
    """A view must reach somewhere."""
    with pytest.raises(ValueError, match='at least 1, got 0'):
        visible_cells(np.zeros((1, 3, 3), dtype=np.bool_), np.array([(1, 1)]), 0)
