"""What the reference methods do with what they are given."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from gridnav import DONE, FREE, GOAL, OBSTACLE, Outcome, summarize
from maze_sim import make_mazes
from vgdp_experiments.evaluate import evaluate
from vgdp_experiments.methods.clairvoyant import Clairvoyant
from vgdp_experiments.methods.frontier import NearestFrontier

if TYPE_CHECKING:
    from numpy.typing import NDArray

NORTH, NORTH_EAST, EAST, WEST = 0, 1, 2, 6
"""Row 0 is the southernmost row, and the first line of a drawing."""


def observed(drawing: str) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return the partial maps (1, 3, H, W) and the cells (1, 2) of a drawing.

    ``#`` is an observed wall, ``.`` observed free, ``?`` unseen, ``R`` the robot, ``G`` the goal.
    """
    characters = np.array([list(line) for line in drawing.split()])
    maps = np.zeros((1, 3, *characters.shape), dtype=np.float32)
    maps[0, OBSTACLE] = characters == '#'
    maps[0, FREE] = np.isin(characters, ['.', 'R', 'G'])
    maps[0, GOAL] = characters == 'G'
    return maps, np.argwhere(characters == 'R')


def new_method() -> NearestFrontier:
    """Return the frontier method at the beginning of one episode."""
    method = NearestFrontier()
    method.reset(range(1), seed=0)
    return method


def decide(method: NearestFrontier, drawing: str) -> list[int]:
    """Return what a method does in one episode."""
    maps, cells = observed(drawing)
    (actions,) = method.act(maps, cells, np.array([True]))
    return actions


@pytest.mark.parametrize(
    ('drawing', 'actions'),
    [
        pytest.param('?..R...?', [WEST], id='nearest'),
        pytest.param('?..R..?', [WEST], id='first of equally near'),
        pytest.param('?...R....G', [EAST], id='goal before frontier'),
        pytest.param('?....R.?G', [EAST], id='goal out of reach'),
        pytest.param('R## ..?', [NORTH_EAST], id='diagonally beside a wall'),
        pytest.param('#R.#', [], id='nothing left'),
        pytest.param('R# #?', [], id='no step between two walls'),
        pytest.param('R# .. ?.', [NORTH], id='frontier by a straight step'),
    ],
)
def test_frontier_decides(drawing: str, actions: list[int]) -> None:
    """One decision in a drawn map."""
    assert decide(new_method(), drawing) == actions


def test_frontier_says_done_on_the_goal() -> None:
    """On the goal there is nothing left to do but Done."""
    maps, cells = observed('?.R.?')
    maps[0, GOAL, 0, 2] = 1
    assert new_method().act(maps, cells, np.array([True])) == [[DONE]]


def test_frontier_keeps_its_target_while_it_is_one() -> None:
    """A nearer frontier cell does not distract the robot; the loss of its target does."""
    method = new_method()
    assert decide(method, '?..R....?') == [WEST]
    assert decide(method, '?....R..?') == [WEST]
    assert decide(method, '#....R..?') == [EAST]


def test_frontier_forgets_its_target_with_the_episode() -> None:
    """A new episode begins without a target."""
    method = new_method()
    assert decide(method, '?..R....?') == [WEST]
    method.reset(range(1, 2), seed=0)
    assert decide(method, '?....R..?') == [EAST]


def test_frontier_ignores_rows_that_ask_for_nothing() -> None:
    """Rows that are not active get no actions, and don't disturb the others."""
    maps, cells = observed('?..R...?')
    method = NearestFrontier()
    method.reset(range(3), seed=0)
    actions = method.act(
        np.repeat(maps, 3, axis=0), np.repeat(cells, 3, axis=0), np.array([False, True, False])
    )
    assert actions == [[], [WEST], []]


@pytest.mark.parametrize('view_range', [1, 3])
def test_frontier_always_finds_the_goal(view_range: int) -> None:
    """In 100 mazes it succeeds without a collision, by longer ways than the expert's."""
    trial = evaluate(NearestFrontier(), make_mazes(100, 15, seed=1), view_range, 500, seed=0)
    summary = summarize(trial.results)
    assert summary.success == 1.0
    assert 0.25 < summary.spl < 0.7


def test_frontier_does_not_depend_on_the_batch() -> None:
    """The same episodes come out, whichever run beside them, and again the same."""
    mazes = make_mazes(20, 15, seed=2)
    alone, together, again = (
        evaluate(NearestFrontier(), mazes, 2, 500, seed=0, batch=batch).results
        for batch in (1, 7, 7)
    )
    assert alone == together == again


def test_clairvoyant_is_the_expert() -> None:
    """It walks the shortest way of every maze, in batches, too, with one decision for each."""
    mazes = make_mazes(30, 15, seed=3)
    trial = evaluate(Clairvoyant(mazes), mazes, 1, 500, seed=0, batch=8)
    summary = summarize(trial.results)
    assert summary.success == 1.0
    assert summary.spl == pytest.approx(1.0)
    assert summary.spl_steps == 1.0
    assert trial.decisions == len(mazes)
    assert all(result.outcome is Outcome.SUCCESS for result in trial.results)
