"""Windows and poses of equal stamp, episode by episode."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bev_mapper import GridFusion, LocalMapFusion, Pose2D, Window
from bev_mapper.local_map_fusion import KEPT, MAX_LATENESS_NS
from gridnav.grid import GridGeometry

FREE, WALL, UNSEEN = 0, 100, -1


def make_fusion() -> LocalMapFusion:
    """Return an empty map of 15 x 15 cells."""
    return LocalMapFusion(GridFusion(GridGeometry(15, 15, 1.0)))


def view(row: int, col: int, value: int = WALL) -> Window:
    """Return a window that shows one cell of the map."""
    return Window(np.array([[value]], dtype=np.int8), GridGeometry(1, 1, 1.0, col, row))


def at(row: int, col: int) -> Pose2D:
    """Return the pose of a robot on a cell."""
    return Pose2D(col + 0.5, row + 0.5)


@pytest.mark.parametrize('window_first', [True, False])
def test_a_pair_is_fused_whichever_comes_first(*, window_first: bool) -> None:
    """One alone makes no map."""
    fusion = make_fusion()
    if window_first:
        assert not fusion.add_window(7, view(3, 4))
        assert fusion.add_pose(7, at(2, 2))
    else:
        assert not fusion.add_pose(7, at(2, 2))
        assert fusion.add_window(7, view(3, 4))
    assert fusion.stamp == 7
    assert fusion.grid.occupancy[3, 4] == WALL
    assert fusion.grid.occupancy[2, 2] == FREE
    assert (fusion.grid.occupancy != UNSEEN).sum() == 2


def test_unequal_stamps_do_not_meet() -> None:
    """Not even one nanosecond apart."""
    fusion = make_fusion()
    assert not fusion.add_window(7, view(3, 4))
    assert not fusion.add_pose(8, at(2, 2))
    assert (fusion.grid.occupancy == UNSEEN).all()


def test_a_repeated_pair_makes_no_new_map() -> None:
    """A world repeats its latest observation for those who join late."""
    fusion = make_fusion()
    fusion.add_pose(7, at(2, 2))
    assert fusion.add_window(7, view(3, 4))
    assert not fusion.add_pose(7, at(2, 2))
    assert not fusion.add_window(7, view(3, 4))
    assert not fusion.counts


@settings(deadline=None)
@given(st.permutations([(kind, stamp) for kind in 'wp' for stamp in range(6)]))
def test_the_order_of_arrival_does_not_matter(order: list[tuple[str, int]]) -> None:
    """Every interleaving gives the map of the ordered one; the cell seen last by each wins."""
    values = [WALL, FREE, WALL, WALL, FREE, WALL]
    fusion = make_fusion()
    maps = 0
    for kind, stamp in order:
        if kind == 'w':
            maps += fusion.add_window(stamp, view(3, 3 + stamp // 4, values[stamp]))
        else:
            maps += fusion.add_pose(stamp, at(5, 2 + stamp))
    assert maps == 6
    assert fusion.stamp == 5
    assert fusion.grid.occupancy[3, 3:5].tolist() == [WALL, WALL]
    assert (fusion.grid.occupancy[5, 2:8] == FREE).all()


def test_what_never_meets_is_dropped_and_counted() -> None:
    """The buffers are bounded, the oldest goes."""
    fusion = make_fusion()
    for stamp in range(KEPT + 3):
        assert not fusion.add_pose(stamp, at(2, 2))
    assert fusion.counts == {'dropped: odom without local_map': 3}
    assert not fusion.add_window(2, view(3, 4))
    assert fusion.add_window(3, view(3, 4))
    for stamp in range(1000, 1000 + KEPT + 2):
        fusion.add_window(stamp, view(3, 4))
    assert fusion.counts['dropped: local_map without odom'] == 3


def test_a_window_on_the_robot_is_placed_by_its_pose() -> None:
    """Its frame is that of the robot."""
    fusion = make_fusion()
    ahead = Window(
        np.array([[WALL]], dtype=np.int8), GridGeometry(1, 1, 1.0, 0.5, -0.5), on_robot=True
    )
    fusion.add_window(1, ahead)
    fusion.add_pose(1, at(6, 7))
    assert fusion.grid.occupancy[6, 7:9].tolist() == [FREE, WALL]


def test_a_new_episode_clears_the_map() -> None:
    """And what comes late from the old one is dropped."""
    fusion = make_fusion()
    fusion.add_pose(5, at(2, 2))
    fusion.add_window(5, view(3, 4))
    assert not fusion.begin_episode(10)
    assert (fusion.grid.occupancy == UNSEEN).all()
    fusion.add_pose(9, at(2, 2))
    fusion.add_window(9, view(3, 4))
    assert (fusion.grid.occupancy == UNSEEN).all()
    assert fusion.counts['dropped: older than the episode'] == 2
    fusion.add_pose(10, at(7, 7))
    assert fusion.add_window(10, view(8, 8))
    assert (fusion.grid.occupancy != UNSEEN).sum() == 2


def test_observations_that_were_faster_than_the_episode_are_fused_again() -> None:
    """Topics are not ordered among each other."""
    fusion = make_fusion()
    for stamp, row in ((5, 2), (10, 6), (11, 7)):
        fusion.add_pose(stamp, at(row, 2))
        fusion.add_window(stamp, view(row, 4))
    fusion.add_window(12, view(8, 4))
    assert fusion.begin_episode(10)
    assert fusion.stamp == 11
    assert np.argwhere(fusion.grid.occupancy != UNSEEN).tolist() == [
        [6, 2],
        [6, 4],
        [7, 2],
        [7, 4],
    ]
    assert fusion.add_pose(12, at(8, 2))


def test_an_episode_that_is_known_changes_nothing() -> None:
    """It is said again at its end, and to late joiners."""
    fusion = make_fusion()
    fusion.begin_episode(5)
    fusion.add_pose(5, at(2, 2))
    fusion.add_window(5, view(3, 4))
    assert not fusion.begin_episode(5)
    assert (fusion.grid.occupancy != UNSEEN).sum() == 2


def test_an_earlier_episode_begins_from_nothing() -> None:
    """A bag that starts again: what lies in the future is of no use."""
    fusion = make_fusion()
    fusion.begin_episode(50)
    fusion.add_pose(60, at(2, 2))
    fusion.add_window(60, view(3, 4))
    assert not fusion.begin_episode(20)
    assert fusion.stamp == -1
    fusion.add_pose(20, at(7, 7))
    assert fusion.add_window(20, view(8, 8))
    assert (fusion.grid.occupancy != UNSEEN).sum() == 2


def test_when_time_goes_back_the_map_starts_again() -> None:
    """A bag that loops without episodes; a little late is still late."""
    fusion = make_fusion()
    newest = 2 * MAX_LATENESS_NS
    for stamp in (newest, newest - MAX_LATENESS_NS):
        fusion.add_pose(stamp, at(2, 2))
        assert fusion.add_window(stamp, view(3, 4))
    assert fusion.stamp == newest
    fusion.add_pose(1, at(7, 7))
    assert fusion.add_window(1, view(8, 8))
    assert fusion.counts == {'time went back': 1}
    assert fusion.stamp == 1
    assert (fusion.grid.occupancy != UNSEEN).sum() == 2


def test_after_a_reset_the_repeated_observation_counts_again() -> None:
    """The map comes back without waiting for the next step."""
    fusion = make_fusion()
    fusion.begin_episode(5)
    for _ in range(2):
        fusion.add_pose(5, at(2, 2))
        assert fusion.add_window(5, view(3, 4))
        fusion.clear()
    fusion.add_pose(4, at(2, 2))
    assert fusion.counts['dropped: older than the episode'] == 1


def test_a_window_that_does_not_fit_is_refused_at_once() -> None:
    """Before its pose comes; and one that is too far when its pose is there."""
    fusion = make_fusion()
    small = Window(np.array([[WALL]], dtype=np.int8), GridGeometry(1, 1, 0.5))
    with pytest.raises(ValueError, match='resolution'):
        fusion.add_window(1, small)
    fusion.add_pose(2, at(2, 2))
    with pytest.raises(ValueError, match='limit'):
        fusion.add_window(2, view(999_999, 0))
    fusion.add_pose(3, at(2, 2))
    assert fusion.add_window(3, view(3, 4))
