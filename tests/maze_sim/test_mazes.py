"""Wilson mazes: their shape, their distribution, their starts and goals."""

from __future__ import annotations

import hashlib
from collections import Counter

import networkx as nx
import numpy as np
import pytest
from scipy.stats import chisquare
from tests.maze_sim.drawing import walls

from maze_sim import Maze, make_mazes, sample_maze, shortest_actions, wilson_maze


def grid_graph(free: np.ndarray) -> nx.Graph:
    """Return the graph of the free cells, joined orthogonally."""
    graph = nx.grid_2d_graph(*free.shape)
    graph.remove_nodes_from([cell for cell in graph if not free[cell]])
    return graph


@pytest.mark.parametrize('size', [5, 6, 7, 14, 15, 30, 61])
def test_maze_is_a_tree_over_all_lattice_cells(size: int) -> None:
    """Every lattice cell is free, and one way leads from each to each other."""
    blocked = wilson_maze(size, np.random.default_rng(size))
    side = (size - 1) // 2
    assert blocked.shape == (size, size)
    assert blocked.dtype == np.bool_
    assert not blocked[1 : 2 * side : 2, 1 : 2 * side : 2].any()
    assert nx.is_tree(grid_graph(~blocked))
    assert (~blocked).sum() == 2 * side**2 - 1


@pytest.mark.parametrize('shape', [(5, 20), (9, 8), (14, 31)])
def test_maze_need_not_be_square(shape: tuple[int, int]) -> None:
    """It is a tree over all cells of its lattice whatever its sides are."""
    blocked = wilson_maze(shape, np.random.default_rng(2))
    rows, cols = ((side - 1) // 2 for side in shape)
    assert blocked.shape == shape
    assert not blocked[1 : 2 * rows : 2, 1 : 2 * cols : 2].any()
    assert nx.is_tree(grid_graph(~blocked))
    assert (~blocked).sum() == 2 * rows * cols - 1


@pytest.mark.parametrize('size', [5, 15, 200])
def test_maze_is_closed_and_pillars_stand(size: int) -> None:
    """The outer cells and the cells at even rows and columns are walls."""
    blocked = wilson_maze(size, np.random.default_rng(0))
    assert blocked[[0, -1]].all()
    assert blocked[:, [0, -1]].all()
    assert blocked[::2, ::2].all()


def test_even_size_keeps_spare_row_and_column_as_wall() -> None:
    """A maze of an even size is one of the odd size below with one more row and column."""
    odd = wilson_maze(15, np.random.default_rng(3))
    even = wilson_maze(16, np.random.default_rng(3))
    assert (even[:15, :15] == odd).all()
    assert even[15].all()
    assert even[:, 15].all()


@pytest.mark.parametrize('size', [-1, 0, 4])
def test_too_small_size_is_refused(size: int) -> None:
    """A size below 5 is named in the error."""
    with pytest.raises(ValueError, match=f'at least 5, got {size}'):
        wilson_maze(size, np.random.default_rng(0))
    with pytest.raises(ValueError, match=f'at least 5 cells, got {size} x {size}'):
        sample_maze(size, np.random.default_rng(0), min_expert_steps=0)


@pytest.mark.parametrize(('size', 'draws'), [(5, 4_000), (7, 20_000)])
def test_mazes_are_uniform_over_all_spanning_trees(size: int, draws: int) -> None:
    """All spanning trees of the lattice are drawn, equally often."""
    side = (size - 1) // 2
    trees = round(nx.number_of_spanning_trees(nx.grid_2d_graph(side, side)))
    rng = np.random.default_rng(1)
    counts = Counter(wilson_maze(size, rng).tobytes() for _ in range(draws))
    assert len(counts) == trees
    assert chisquare(list(counts.values())).pvalue > 0.01


def test_starts_and_goals_are_uniform_over_all_distant_pairs() -> None:
    """Given the maze, all pairs that are far enough apart are drawn equally often."""
    rng = np.random.default_rng(5)
    draws = 3_000
    counts: Counter[tuple[bytes, tuple[int, int], tuple[int, int]]] = Counter()
    for _ in range(draws):
        maze = sample_maze(5, rng, min_expert_steps=3)
        counts[maze.blocked.tobytes(), maze.start, maze.goal] += 1

    possible = set()
    for drawn in {key[0] for key in counts}:
        blocked = np.frombuffer(drawn, dtype=np.bool_).reshape(5, 5)
        free = [(row, col) for row, col in np.argwhere(~blocked).tolist()]
        possible |= {
            (drawn, start, goal)
            for start in free
            for goal in free
            if len(shortest_actions(blocked, start, goal)) >= 3
        }
    assert set(counts) == possible
    assert chisquare(list(counts.values())).pvalue > 0.01


@pytest.mark.parametrize('size', [13, 15, 20])
def test_sampled_maze_keeps_start_and_goal_apart(size: int) -> None:
    """The expert needs the promised number of steps, and as many as the maze says."""
    for maze in make_mazes(20, size, seed=4, min_expert_steps=15):
        actions = shortest_actions(maze.blocked, maze.start, maze.goal)
        assert maze.expert_steps == len(actions) >= 15
        assert maze.expert_steps <= maze.expert_cost <= maze.expert_steps * np.sqrt(2)


@pytest.mark.parametrize(('size', 'steps'), [(5, 15), (7, 13), (15, 1000)])
def test_impossible_distance_is_refused(size: int, steps: int) -> None:
    """A distance that no maze of the size has is named in the error."""
    with pytest.raises(ValueError, match=f'{size} x {size} was found with {steps} expert steps'):
        sample_maze(size, np.random.default_rng(0), min_expert_steps=steps)


def test_maze_depends_on_seed_and_number_alone() -> None:
    """The same seed gives the same mazes, however many; another seed gives others."""
    few, many = make_mazes(3, 15, seed=7), make_mazes(6, 15, seed=7)
    for one, other in zip(few, many, strict=False):
        assert (one.blocked == other.blocked).all()
        assert (one.start, one.goal) == (other.start, other.goal)
    assert len({maze.blocked.tobytes() for maze in many}) == 6
    assert (make_mazes(1, 15, seed=8)[0].blocked != many[0].blocked).any()


def test_generator_version_0_draws_this_maze() -> None:
    """A change that gives other mazes for a seed needs a new version of the environment."""
    assert (wilson_maze(9, np.random.default_rng(0)) == walls(FROZEN_MAZE)).all()


@pytest.mark.parametrize(
    ('count', 'size', 'seed', 'digest'),
    [
        (5, 15, 0, 'c86239d97449fe3d'),
        (5, 20, 1, '677eab376fdbf358'),
        (3, 30, 2, '6be47f7e98c3eba4'),
    ],
)
def test_mazes_of_evaluations_stay_what_they_are(
    count: int, size: int, seed: int, digest: str
) -> None:
    """Results are compared over versions, so a seed gives the same mazes, starts and goals."""
    found = hashlib.sha256()
    for maze in make_mazes(count, size, seed):
        found.update(maze.blocked.tobytes())
        told = (maze.start, maze.goal, maze.expert_steps, round(maze.expert_cost, 9))
        found.update(repr(told).encode())
    assert found.hexdigest()[:16] == digest


def test_solved_maze_knows_the_expert() -> None:
    """A hand-made maze is solved with the diagonal rule."""
    maze = Maze.solved(walls('.#. ... ..#'), (0, 0), (0, 2))
    assert maze.expert_steps == 2
    assert maze.expert_cost == pytest.approx(2 * np.sqrt(2))


@pytest.mark.parametrize(
    ('start', 'goal', 'message'),
    [
        ((0, 1), (0, 0), r'start \(0, 1\) is not a free cell'),
        ((0, 0), (0, 3), r'goal \(0, 3\) is off the map of 1 x 3 cells'),
        ((0, 0), (-1, 0), r'goal \(-1, 0\) is off the map'),
        ((0, 0), (0, 2), r'No way leads from the start \(0, 0\)'),
    ],
)
def test_senseless_maze_is_refused(
    start: tuple[int, int], goal: tuple[int, int], message: str
) -> None:
    """Start and goal must be free cells with a way between them."""
    with pytest.raises(ValueError, match=message):
        Maze.solved(walls('.#.'), start, goal)


FROZEN_MAZE = """
#########
#.......#
#.#######
#.#...#.#
#.#.###.#
#.#.#.#.#
#.#.#.#.#
#.......#
#########
"""
