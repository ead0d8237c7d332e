"""Generators that nothing is trained on: what they draw, and that nothing is trained on them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import label

from maze_sim import WORLD_KINDS
from vgdp_experiments.held_out import (
    HELD_OUT_KINDS,
    binary_tree,
    division,
    growing_tree,
    held_out_maze,
    kruskal,
    sidewinder,
)
from vgdp_experiments.settings import Setting
from vgdp_experiments.suites import generators
from vgdp_experiments.train_value import WORLDS
from vgdp_experiments.worlds import SHARES

TREES = {
    'prim': lambda shape, rng: growing_tree(shape, rng, newest=False),
    'depth_first': lambda shape, rng: growing_tree(shape, rng, newest=True),
    'kruskal': kruskal,
    'sidewinder': sidewinder,
    'binary_tree': binary_tree,
    'division': division,
}


@pytest.mark.parametrize('shape', [(15, 15), (12, 21)])
@pytest.mark.parametrize('kind', TREES)
def test_mazes_are_trees(kind: str, shape: tuple[int, int]) -> None:
    """One way leads from each cell to each other: joined, and with one passage less than cells."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        blocked = TREES[kind](shape, rng)
        rows, cols = (shape[0] - 1) // 2, (shape[1] - 1) // 2
        assert blocked.shape == shape
        assert not blocked[1 : 2 * rows : 2, 1 : 2 * cols : 2].any()
        assert (~blocked).sum() == 2 * rows * cols - 1
        assert label(~blocked)[1] == 1
        assert blocked[0].all()
        assert blocked[:, 0].all()
        assert blocked[-1].all()
        assert blocked[:, -1].all()


def dead_ends(blocked: np.ndarray) -> float:
    """Return the share of the lattice cells with a single way out."""
    free = ~np.pad(blocked, 1, constant_values=True)
    exits = free[:-2, 1:-1] + 0 + free[2:, 1:-1] + free[1:-1, :-2] + free[1:-1, 2:]
    return float((exits[1::2, 1::2] == 1).mean())


def test_what_grows_at_its_newest_cell_has_fewer_dead_ends() -> None:
    """That is what tells the two growing mazes apart."""
    rng = np.random.default_rng(0)
    shares = {
        newest: np.mean([dead_ends(growing_tree((31, 31), rng, newest=newest)) for _ in range(20)])
        for newest in (False, True)
    }
    assert shares[True] < 0.15
    assert shares[False] > 0.25


@pytest.mark.parametrize('kind', HELD_OUT_KINDS)
def test_starts_and_goals_are_apart_and_come_again(kind: str) -> None:
    """A world depends on the seed and its number alone."""
    first = Setting(21, kind=kind).mazes(range(3), 5)
    for number, maze in enumerate(first):
        same = held_out_maze(kind, 21, np.random.default_rng([5, number]))
        assert maze.expert_steps >= 15
        assert (maze.start, maze.goal) == (same.start, same.goal)
        assert np.array_equal(maze.blocked, same.blocked)
    other = held_out_maze(kind, 21, np.random.default_rng(1))
    assert not np.array_equal(other.blocked, first[0].blocked)


def test_worlds_that_are_too_small_are_refused() -> None:
    """With one sentence, not with a search that never ends."""
    with pytest.raises(ValueError, match="kind 'prim' and the size 5 has 15 steps"):
        held_out_maze('prim', 5, np.random.default_rng(0))


def test_nothing_is_trained_on_them() -> None:
    """Else they would show nothing."""
    trained = {*WORLD_KINDS, *SHARES, *(world.kind for world in WORLDS)}
    assert not trained & {*HELD_OUT_KINDS}
    assert {*generators.SUITE.settings} == {*HELD_OUT_KINDS}
