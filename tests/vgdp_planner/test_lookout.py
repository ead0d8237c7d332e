"""When a robot had better look before it decides on its next step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gridnav import DONE, FREE, OBSTACLE
from vgdp_planner.lookout import Lookout

if TYPE_CHECKING:
    from numpy.typing import NDArray

EAST = 2


def drawn(drawing: str) -> NDArray[np.float32]:
    """Return the partial map (3, H, W) of a drawing: wall ``#``, free ``.``, unseen ``?``."""
    characters = np.array([list(line) for line in drawing.split()])
    partial_map = np.zeros((3, *characters.shape), dtype=np.float32)
    partial_map[OBSTACLE] = characters == '#'
    partial_map[FREE] = characters == '.'
    return partial_map


def looked_out(drawing: str, cell: tuple[int, int], actions: list[int]) -> list[int]:
    """Return the steps before looking of a robot that sees two cells far."""
    lookout = Lookout()
    lookout._view_range = 2
    return lookout.before_looking(drawn(drawing), cell, actions)


def test_known_ways_are_walked_without_looking() -> None:
    """In a corridor that is known nothing new comes into view, whatever lies behind its walls."""
    assert looked_out('??????? ####### ....... ####### ???????', (2, 0), [EAST] * 6) == [EAST] * 6


def test_the_last_step_before_the_unseen_is_looked_from() -> None:
    """The second step ends two cells before the unseen, in view of it."""
    assert looked_out('####### ......? #######', (1, 1), [EAST] * 5) == [EAST] * 3


def test_corners_can_be_looked_around() -> None:
    """A branch that opens beside the way is looked into."""
    assert looked_out('###.### ......# ###?###', (1, 0), [EAST] * 4) == [EAST]
    assert looked_out('####### ......# ###?###', (1, 0), [EAST] * 4) == [EAST]
    assert looked_out('####### ......# ####### ???????', (1, 0), [EAST] * 4) == [EAST] * 4


def test_done_need_not_wait() -> None:
    """What says Done says it at once."""
    assert looked_out('????? ..... ?????', (1, 1), [EAST, DONE]) == [EAST, DONE]


def test_how_far_the_robot_sees_is_learnt() -> None:
    """The farthest cell that was new from the way tells it, an extended map tells nothing."""
    lookout = Lookout()
    assert lookout._view_range == 1
    lookout.look(drawn('??..#?????'), (0, 2))
    assert lookout._view_range == 2
    lookout.before_looking(drawn('??..??????'), (0, 2), [EAST])
    lookout.look(drawn('??.....???'), (0, 3))
    assert lookout._view_range == 3
    lookout.look(drawn('??.........'), (0, 3))
    assert lookout._view_range == 3
