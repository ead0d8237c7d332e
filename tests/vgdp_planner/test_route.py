"""Whole ways on a map that stands still."""

from __future__ import annotations

import numpy as np
import pytest

from gridnav import FREE, GridGeometry
from maze_sim import make_mazes
from vgdp_planner import ValueGuidedPlanner
from vgdp_planner.coarsening import make_planning_grid
from vgdp_planner.planning_grid import GridSettings
from vgdp_planner.route import (
    NoRouteError,
    RouteTimeoutError,
    find_route,
    known_way,
    onward_way,
    seen_way,
)


@pytest.fixture(scope='module')
def planner() -> ValueGuidedPlanner:
    """Return the shipped planner."""
    return ValueGuidedPlanner.from_pretrained()


def test_a_way_through_a_maze(planner: ValueGuidedPlanner) -> None:
    """From start to goal, never near a wall, and the planner's own episode goes on as before."""
    [maze] = make_mazes(1, 11, 5)
    occupancy = (100 * maze.blocked).astype(np.int8).repeat(10, axis=0).repeat(10, axis=1)
    geometry = GridGeometry(110, 110, 0.1)
    cells = GridGeometry(11, 11, 1.0)
    start, goal = cells.center_of(*maze.start), cells.center_of(*maze.goal)
    grid = make_planning_grid(occupancy, geometry, start, goal, GridSettings(0.2, 0.5))
    planner.reset(seed=4)
    planner.plan(grid.partial_map, grid.start)
    expected = planner.plan(grid.partial_map, grid.start)
    planner.reset(seed=4)
    planner.plan(grid.partial_map, grid.start)
    way = find_route(planner, grid, seed=0, time_limit=100.0)
    assert way[0] == pytest.approx(start, abs=0.1)
    assert way[-1] == pytest.approx(goal, abs=0.1)
    assert grid.is_clear(way)
    assert np.hypot(*np.diff(way, axis=0).T).max() < 0.15
    again = planner.plan(grid.partial_map, grid.start)
    assert np.array_equal(again.candidates, expected.candidates)


def test_no_way_and_no_time(planner: ValueGuidedPlanner) -> None:
    """Each is an error of its own."""
    occupancy = np.zeros((12, 12), dtype=np.int8)
    geometry = GridGeometry(12, 12, 1.0)
    grid = make_planning_grid(occupancy, geometry, (1.5, 1.5), (10.5, 10.5))
    with pytest.raises(RouteTimeoutError, match=r'0\.0 s'):
        find_route(planner, grid, 0, 0.0)
    occupancy[:, 6] = 100
    grid = make_planning_grid(occupancy, geometry, (1.5, 1.5), (10.5, 10.5))
    with pytest.raises(NoRouteError):
        find_route(planner, grid, 0, 100.0)


def test_ways_end_at_obstacles_and_at_the_unseen() -> None:
    """A step into an obstacle is none; what comes after something unseen is left out."""
    partial_map = np.zeros((3, 3, 6), dtype=np.float32)
    partial_map[FREE, :, :3] = 1
    partial_map[0, 0, 2] = 1
    partial_map[FREE, 0, 2] = 0
    assert known_way(partial_map, (0, 0), [2, 2, 2]) == [(0, 0), (0, 1)]
    way = known_way(partial_map, (1, 1), [2, 2, 2, 8, 2])
    assert way == [(1, 1), (1, 2), (1, 3), (1, 4)]
    assert seen_way(partial_map, way) == [(1, 1), (1, 2), (1, 3)]
    assert seen_way(partial_map, way[:2]) == way[:2]


def test_a_plan_that_comes_back_ends_before_it() -> None:
    """Committed steps are all there; what leads back beside them is not."""
    out = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 4)]
    assert onward_way(out, 2) == out
    assert onward_way([*out[:4], (1, 2), (1, 1), (1, 0)], 2) == out[:4]
    assert onward_way([(0, 0)], 0) == [(0, 0)]
