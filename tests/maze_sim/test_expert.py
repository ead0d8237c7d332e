"""The expert against networkx."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from tests.maze_sim.drawing import walls

from gridnav import STEP_LENGTHS, STEPS, valid_moves
from maze_sim import cost_to_go, shortest_actions, wilson_maze


def oracle_graph(blocked: np.ndarray) -> nx.DiGraph:
    """Return the graph of all valid steps of a map."""
    graph = nx.DiGraph()
    graph.add_nodes_from((row, col) for row, col in np.argwhere(~blocked).tolist())
    for action, row, col in np.argwhere(valid_moves(blocked)).tolist():
        if not blocked[row, col]:
            target = (row + int(STEPS[action, 0]), col + int(STEPS[action, 1]))
            graph.add_edge((row, col), target, weight=float(STEP_LENGTHS[action]))
    return graph


def maps() -> list[np.ndarray]:
    """Return mazes and random maps of several densities, some of them in pieces."""
    rng = np.random.default_rng(2)
    mazes = [wilson_maze(size, rng) for size in (5, 8, 15)]
    return mazes + [rng.random((9, 12)) < density for density in (0.0, 0.2, 0.4, 0.6)]


@pytest.mark.parametrize('blocked', maps())
def test_costs_and_ways_agree_with_networkx(blocked: np.ndarray) -> None:
    """Costs are those of networkx, and following the actions takes exactly that length."""
    graph = oracle_graph(blocked)
    cells = [(row, col) for row, col in np.argwhere(~blocked).tolist()]
    for goal in cells[:: max(1, len(cells) // 6)]:
        expected = np.full(blocked.shape, np.inf)
        for cell, cost in nx.single_source_dijkstra_path_length(graph.reverse(), goal).items():
            expected[cell] = cost
        costs = cost_to_go(blocked, goal)
        np.testing.assert_allclose(costs, expected)
        for start in cells[:: max(1, len(cells) // 6)]:
            if not np.isfinite(expected[start]):
                with pytest.raises(ValueError, match='No way leads'):
                    shortest_actions(blocked, start, goal)
                continue
            actions = shortest_actions(blocked, start, goal)
            cell = start
            for action in actions:
                following = (cell[0] + int(STEPS[action, 0]), cell[1] + int(STEPS[action, 1]))
                assert graph.has_edge(cell, following)
                cell = following
            assert cell == goal
            assert STEP_LENGTHS[actions].sum() == pytest.approx(expected[start])


def test_step_with_the_lowest_index_wins_a_tie() -> None:
    """Of two ways around a pillar the one that begins with the lower action is taken."""
    blocked = walls('... .#. ...')
    assert shortest_actions(blocked, (0, 1), (2, 1)) == [1, 7]
    assert shortest_actions(blocked, (1, 0), (1, 2)) == [1, 3]
    # However the lengths of equal ways are rounded.
    field = np.zeros((40, 50), dtype=np.bool_)
    assert shortest_actions(field, (0, 0), (31, 49)) == [1] * 31 + [2] * 18


def test_diagonal_step_needs_one_open_cell_beside_it() -> None:
    """A diagonal between two walls is closed; one wall leaves it open."""
    assert shortest_actions(walls('.# ..'), (0, 0), (1, 1)) == [1]
    with pytest.raises(ValueError, match='No way leads'):
        shortest_actions(walls('.# #.'), (0, 0), (1, 1))


def test_way_to_the_own_cell_is_empty() -> None:
    """Nothing is to be done on the goal."""
    assert shortest_actions(walls('..'), (0, 1), (0, 1)) == []


@pytest.mark.parametrize('goal', [(0, 1), (1, 0), (0, -1)])
def test_goal_must_be_a_free_cell(goal: tuple[int, int]) -> None:
    """A goal in a wall or off the map is refused."""
    with pytest.raises(ValueError, match='The goal'):
        cost_to_go(walls('.#.'), goal)
