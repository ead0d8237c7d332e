"""Any map as the planner needs it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from gridnav import FREE, GOAL, OBSTACLE, STEPS, GridGeometry, valid_moves
from gridnav.partial_map import from_occupancy
from vgdp_planner.coarsening import make_planning_grid
from vgdp_planner.planning_grid import (
    GridSettings,
    OccupiedError,
    OutsideMapError,
    PlanningGrid,
)
from vgdp_planner.safety import SafetyCheck
from vgdp_planner.ways import inflate

if TYPE_CHECKING:
    from numpy.typing import NDArray

RESOLUTION = 0.05

RIM = 32
"""Cells around a map that a way may lead through."""


def too_near(obstacle: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Inflate by looking at each pair of a cell and an obstacle's square."""
    cells, squares = np.argwhere(np.ones_like(obstacle)), np.argwhere(obstacle)
    nearest = np.full(len(cells), np.inf)
    for square in squares:
        np.minimum(nearest, np.hypot(*np.maximum(abs(cells - square) - 0.5, 0).T), out=nearest)
    return (nearest < radius - 1e-6).reshape(obstacle.shape) | obstacle


def map_of(occupancy: NDArray[np.int8], origin: tuple[float, float] = (0.0, 0.0)) -> GridGeometry:
    """Place a map of small cells."""
    rows, cols = occupancy.shape
    return GridGeometry(rows, cols, RESOLUTION, *origin)


def in_reach(grid: PlanningGrid) -> NDArray[np.bool_]:
    """Return the blocks that the planner's steps lead to, found step by step, (H, W)."""
    valid = valid_moves(grid.partial_map[OBSTACLE] > 0)
    reached = np.zeros(grid.geometry.shape, dtype=np.bool_)
    reached[grid.start] = True
    waiting = [grid.start]
    while waiting:
        row, col = waiting.pop()
        for action in np.flatnonzero(valid[:, row, col]):
            cell = row + int(STEPS[action, 0]), col + int(STEPS[action, 1])
            if not reached[cell]:
                reached[cell] = True
                waiting.append(cell)
    return reached


def assert_way(grid: PlanningGrid, way: NDArray[np.float64], blocked: NDArray[np.bool_]) -> None:
    """Check that a way keeps off what is blocked on a map at the origin, and does not jump."""
    cells = np.floor(way / RESOLUTION + 1e-6).astype(int) + RIM
    padded = np.pad(blocked, RIM)
    cols, rows = cells.T
    assert not padded[rows, cols].any()
    steps = np.abs(np.diff(cells, axis=0))
    assert (steps.max(axis=1, initial=0) == 1).all()
    # No corners are cut: both cells beside a diagonal step are clear.
    assert not padded[rows[:-1], cols[1:]].any()
    assert not padded[rows[1:], cols[:-1]].any()
    assert grid.is_clear(way)


@st.composite
def maps(draw: st.DrawFn) -> NDArray[np.int8]:
    """Draw rooms with doors, clutter, and parts that were not seen."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rows, cols = draw(st.integers(12, 32)), draw(st.integers(12, 32))
    occupancy = rng.integers(0, 20, (rows, cols)).astype(np.int8)
    for _ in range(draw(st.integers(0, 4))):
        axis, door = rng.integers(2), rng.integers(1, 12)
        wall = occupancy if axis else occupancy.T
        line = wall[rng.integers(wall.shape[0])]
        begin = rng.integers(len(line))
        line[:begin] = 100
        line[begin + door :] = 90
    occupancy[rng.random((rows, cols)) < draw(st.sampled_from([0.0, 0.01, 0.05, 0.2]))] = 100
    for _ in range(draw(st.integers(0, 3))):
        row, col = rng.integers(rows), rng.integers(cols)
        occupancy[row : row + 12, col : col + 12] = -1
    return occupancy


@given(maps(), st.floats(0, 8))
@settings(max_examples=40, deadline=None)
def test_inflation(occupancy: NDArray[np.int8], radius: float) -> None:
    """It marks what is nearer to an obstacle's square than the radius, no more and no less."""
    obstacle = occupancy >= 50
    assert np.array_equal(inflate(obstacle, radius), too_near(obstacle, radius))


@given(maps(), st.integers(1, 9), st.sampled_from([0.0, 0.03, 0.07, 0.12, 0.2]), st.data())
@settings(max_examples=40, deadline=None)
def test_every_step_has_a_way_and_nothing_is_lost(
    occupancy: NDArray[np.int8], factor: int, radius: float, data: st.DataObject
) -> None:
    """On random maps: each step leads along a clear way into its block; doors stay as they are.

    What is connected on the inflated map stays so, and what is not is not joined.
    """
    geometry = map_of(occupancy)
    obstacle = np.pad(occupancy >= 50, RIM)
    clear = ~too_near(obstacle, radius / RESOLUTION)
    free = np.argwhere(clear[RIM:-RIM, RIM:-RIM])
    if not len(free) or (factor == 1 and radius == 0):
        return
    start, goal = (
        tuple(free[data.draw(st.integers(0, len(free) - 1))].tolist()) for _ in range(2)
    )
    grid = make_planning_grid(
        occupancy,
        geometry,
        geometry.center_of(*start),
        geometry.center_of(*goal),
        GridSettings(radius, factor * RESOLUTION),
    )
    assert not grid.lost
    blocked = ~clear[RIM:-RIM, RIM:-RIM]
    reached = in_reach(grid)
    valid = valid_moves(grid.partial_map[OBSTACLE] > 0)
    steps = np.argwhere(valid & reached)
    for action, row, col in steps[:: max(1, len(steps) // 12)].tolist():
        here, there = (row, col), (row + int(STEPS[action, 0]), col + int(STEPS[action, 1]))
        assert grid.ground is not None
        begin, end = grid.ground.stand(here), grid.ground.stand(there)
        leg = grid.ground.leg(begin, end, [here, there])
        way = np.array([grid.ground.geometry.center_of(*cell) for cell in leg])
        assert_way(grid, way, blocked)
        assert grid.geometry.cell_at(*way[-1]) == there

    # Everything off the map is unseen, so ways may lead around it.
    labels, _ = ndimage.label(clear)
    connected = len({labels[row + RIM, col + RIM] for row, col in (start, goal)}) == 1
    assert grid.goal == ('ok' if connected else 'unreachable')
    shown = np.argwhere(grid.partial_map[GOAL])
    assert (len(shown) == 1 and bool(reached[tuple(shown[0])])) == connected


@given(
    st.integers(0, 7),
    st.integers(0, 7),
    st.integers(1, 16),
    st.sampled_from([0.1, 0.17, 0.25]),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_doors(row: int, col: int, width: int, radius: float, across: bool) -> None:  # noqa: FBT001
    """A door a cell wider than the robot is open wherever it is, one narrower than it closed."""
    occupancy = np.full((60, 60), 100, dtype=np.int8)
    occupancy[1:-1, 1:-1] = 0
    occupancy[28 + row : 30 + row] = 100
    occupancy[28 + row : 30 + row, 20 + col : 20 + col + width] = 0
    start, goal = (0.6, 0.5), (2.3, 2.5)
    if across:
        occupancy, start, goal = occupancy.T.copy(), start[::-1], goal[::-1]
    grid = make_planning_grid(occupancy, map_of(occupancy), start, goal, GridSettings(radius, 0.4))
    door = width * RESOLUTION
    if door >= 2 * radius + RESOLUTION:
        assert grid.goal == 'ok'
    if door < 2 * radius - 1e-6:
        assert grid.goal == 'unreachable'
        belief = np.zeros(grid.geometry.shape, dtype=np.float32)
        belief[grid.start] = 1
        assert SafetyCheck(grid.partial_map, belief, 0.1).status == 'unreachable'


def test_the_map_of_a_maze_is_taken_as_it_is() -> None:
    """Where blocks are the cells of the map and the robot has no radius nothing changes."""
    occupancy = np.random.default_rng(0).choice([-1, 0, 30, 60, 100], (9, 7)).astype(np.int8)
    geometry = GridGeometry(9, 7, 0.5, -1.0, 2.0)
    for resolution in (0.0, 0.5):
        grid = make_planning_grid(
            occupancy, geometry, (0.1, 3.2), (1.4, 2.2), GridSettings(resolution=resolution)
        )
        assert np.array_equal(grid.partial_map, from_occupancy(occupancy, (0, 4)))
        assert (grid.geometry, grid.start, grid.goal) == (geometry, (2, 2), 'ok')
        way = grid.way([(2, 2), (3, 3)])
        assert way.tolist() == [[0.25, 3.25], [0.75, 3.75]]


def test_blocks_stay_where_they_are_as_the_map_grows() -> None:
    """Their corners are multiples of their side in the map's frame, wherever the origin is."""
    occupancy = np.zeros((40, 50), dtype=np.int8)
    for rows, cols in ((0, 0), (3, 7), (8, 16), (21, 1)):
        geometry = map_of(occupancy, (-cols * RESOLUTION, -rows * RESOLUTION))
        grid = make_planning_grid(occupancy, geometry, (0.5, 0.5), settings=GridSettings(0.1, 0.4))
        assert grid.geometry.resolution == pytest.approx(0.4)
        for corner in (grid.geometry.origin_x, grid.geometry.origin_y):
            assert corner / 0.4 == pytest.approx(round(corner / 0.4))


def test_what_is_unknown_on_a_map_is_unseen() -> None:
    """Also beyond its edge; a block is free once half of it was seen, or the robot was there."""
    occupancy = np.full((24, 24), -1, dtype=np.int8)
    occupancy[:, :8] = 0
    occupancy[:, 8:11] = 24
    occupancy[:, 11:14] = 40
    grid = make_planning_grid(
        occupancy, map_of(occupancy), (0.1, 0.1), settings=GridSettings(0.0, 0.2)
    )
    free = grid.partial_map[FREE]
    assert free.shape == (8, 6)
    assert free[1:-1, 1:4].all()
    assert not free[[0, -1]].any()
    assert not free[:, [0, 4, 5]].any()
    assert not grid.partial_map[OBSTACLE].any()
    again = make_planning_grid(
        occupancy,
        map_of(occupancy),
        (0.1, 0.1),
        None,
        GridSettings(0.0, 0.2),
        visited=[(0.7, 0.5)],
    )
    assert np.argwhere(again.partial_map[FREE] != free).tolist() == [[3, 4]]


def test_a_robot_close_to_a_wall_starts_beside_it() -> None:
    """On its own side; far from any clear place, or off the map, there is no plan."""
    occupancy = np.zeros((40, 60), dtype=np.int8)
    occupancy[:, 30] = 100
    geometry = map_of(occupancy)
    near = make_planning_grid(occupancy, geometry, (1.41, 1.0), settings=GridSettings(0.2, 0.4))
    assert near.ground is not None
    # Four cells and a half from the wall, and not on its other side.
    x, y = near.ground.geometry.center_of(*near.ground.start)
    assert (x, y) == pytest.approx((1.275, 1.025))
    with pytest.raises(OutsideMapError, match='9'):
        make_planning_grid(occupancy, geometry, (9.0, 1.0), settings=GridSettings(0.2, 0.4))
    occupancy[:] = 100
    with pytest.raises(OccupiedError, match='no clear place'):
        make_planning_grid(occupancy, geometry, (1.0, 1.0), settings=GridSettings(0.2, 0.4))


@pytest.mark.parametrize(
    ('goal', 'state'),
    [
        ((2.6, 1.0), 'ok'),
        ((1.52, 1.0), 'ok'),  # Too near to a wall: beside it.
        ((2.15, 1.0), 'occupied'),
        ((60.0, 1.0), 'outside'),
        ((4.0, 1.0), 'ok'),  # Beyond the map: unseen.
    ],
)
def test_goals(goal: tuple[float, float], state: str) -> None:
    """A way ends at the goal, or near by where it is too close to an obstacle."""
    occupancy = np.zeros((40, 60), dtype=np.int8)
    occupancy[:30, 30] = 100
    occupancy[4:36, 36:50] = 100
    geometry = map_of(occupancy)
    grid = make_planning_grid(occupancy, geometry, (0.5, 1.0), goal, GridSettings(0.2, 0.2))
    if goal == (2.6, 1.0):
        occupancy[4:36, 36:50] = 0
        grid = make_planning_grid(occupancy, geometry, (0.5, 1.0), goal, GridSettings(0.2, 0.2))
        assert grid.ground is not None
        assert grid.ground.goal is not None
        target = grid.ground.geometry.center_of(*grid.ground.goal)
        assert target == pytest.approx(goal, abs=RESOLUTION)
    assert grid.goal == state
    assert bool(grid.partial_map[GOAL].any()) == (state == 'ok')


def test_a_way_goes_through_the_block_it_has_to() -> None:
    """Even where that is a detour."""
    occupancy = np.zeros((40, 40), dtype=np.int8)
    grid = make_planning_grid(
        occupancy, map_of(occupancy), (0.5, 0.5), settings=GridSettings(0.1, 0.2)
    )
    row, col = grid.start
    blocks = [(row, col), (row, col + 1), (row + 1, col + 1), (row + 1, col), (row + 2, col)]
    way = grid.way(blocks, via=2)
    assert (row + 1, col + 1) in {grid.geometry.cell_at(*point) for point in way}
    assert grid.geometry.cell_at(*way[-1]) == (row + 2, col)
    assert_way(grid, way, occupancy >= 50)


def test_too_many_cells_make_larger_blocks() -> None:
    """And no smaller ones, even where something is lost by it: then the grid says so."""
    occupancy = np.zeros((100, 100), dtype=np.int8)
    occupancy[:, 50] = 100
    occupancy[40:45, 50] = 0
    settings = GridSettings(0.0, 0.1, max_cells=150)
    grid = make_planning_grid(occupancy, map_of(occupancy), (0.5, 0.5), (4.5, 0.5), settings)
    assert grid.partial_map[0].size <= 150
    assert grid.geometry.resolution >= 0.5


def test_beliefs() -> None:
    """A pose's covariance becomes a belief over the blocks where the robot may be."""
    occupancy = np.zeros((60, 60), dtype=np.int8)
    occupancy[:, 30] = 100
    grid = make_planning_grid(
        occupancy, map_of(occupancy), (1.3, 1.5), settings=GridSettings(0.1, 0.2)
    )
    assert grid.belief((1.3, 1.5), np.zeros((2, 2))) is None
    wide = grid.belief((1.3, 1.5), np.diag([0.3, 0.01]))
    assert wide is not None
    assert wide.sum() == pytest.approx(1)
    assert wide[grid.start] == wide.max()
    assert not wide[grid.partial_map[OBSTACLE] > 0].any()
    rows, cols = np.nonzero(wide)
    assert np.ptp(cols) > np.ptp(rows) > 0
    # All of it on the robot's side of the wall, or on the other: the ground is connected.
    x = grid.geometry.origin_x + (cols + 0.5) * grid.geometry.resolution
    mean = float((wide[rows, cols] * x).sum())
    assert mean == pytest.approx(1.3, abs=0.4)


def test_a_large_map_is_prepared_in_well_under_a_second() -> None:
    """4000 x 4000 cells; processor time, as other programs take theirs."""
    occupancy = np.full((4000, 4000), -1, dtype=np.int8)
    occupancy[:3000, 200:3900] = 0
    occupancy[:3000:200, 200:3900] = 100
    occupancy[:3000, 200:3900:300] = 100
    occupancy[100:3000:200, 200:3900] = 0
    began = time.process_time()
    grid = make_planning_grid(
        occupancy,
        map_of(occupancy, (-73.33, -20.1)),
        (-60.0, -15.0),
        settings=GridSettings(0.25, 0.4, max_cells=300_000),
    )
    assert time.process_time() - began < 2.0
    assert grid.factor == 8


def test_a_goal_on_something_is_stopped_beside() -> None:
    """The nearest place to stand is taken, as far from the goal as is tolerated."""
    occupancy = np.zeros((20, 30), dtype=np.int8)
    occupancy[5:15, 15:25] = 100
    geometry, goal = GridGeometry(20, 30, 0.1), (2.05, 1.05)
    chosen = GridSettings(0.1, 0.3)
    grid = make_planning_grid(occupancy, geometry, (0.5, 1.0), goal, chosen)
    assert grid.goal == 'occupied'
    assert not grid.partial_map[GOAL].any()
    chosen = GridSettings(0.1, 0.3, goal_tolerance=1.0)
    grid = make_planning_grid(occupancy, geometry, (0.5, 1.0), goal, chosen)
    assert grid.goal == 'ok'
    (cell,) = np.argwhere(grid.partial_map[GOAL])
    x, y = grid.geometry.center_of(*cell.tolist())
    assert np.hypot(x - goal[0], y - goal[1]) < 1.0
    assert not grid.partial_map[OBSTACLE][tuple(cell)]


def test_any_place_in_reach_of_the_goal_will_do() -> None:
    """Of those that were seen to be free and that the robot gets to, with the nearest of all."""
    occupancy = np.zeros((20, 30), dtype=np.int8)
    occupancy[5:15, 15:25] = 100
    occupancy[15:] = -1
    geometry, goal = GridGeometry(20, 30, 0.1), (2.05, 1.05)
    chosen = GridSettings(0.1, 0.3, goal_tolerance=1.0, goal_reach=0.95)
    grid = make_planning_grid(occupancy, geometry, (0.5, 1.0), goal, chosen)
    cells = np.argwhere(grid.partial_map[GOAL])
    assert len(cells) > 3
    for cell in cells.tolist():
        x, y = grid.geometry.center_of(*cell)
        assert np.hypot(x - goal[0], y - goal[1]) < 0.95
        assert y < 1.5
        assert grid.partial_map[(FREE, *cell)]


@pytest.mark.parametrize(('reach', 'behind'), [(0.0, True), (0.6, True), (0.9, False)])
def test_a_place_that_was_seen_is_better_than_one_behind_a_wall(
    *, reach: float, behind: bool
) -> None:
    """Where it is in reach; what was not seen may be anything."""
    occupancy = np.zeros((30, 30), dtype=np.int8)
    occupancy[8:16] = 100
    occupancy[16:] = -1
    occupancy[:, 28:] = 0
    geometry, goal = GridGeometry(30, 30, 0.1), (1.45, 1.45)
    chosen = GridSettings(0.1, 0.3, goal_tolerance=1.5, goal_reach=reach)
    grid = make_planning_grid(occupancy, geometry, (0.5, 0.5), goal, chosen)
    rows = np.argwhere(grid.partial_map[GOAL])[:, 0]
    y = [grid.geometry.center_of(row, 0)[1] for row in rows.tolist()]
    assert (max(y) > 1.45) == behind


@pytest.mark.parametrize('center', [(0.0, 0.0), (0.1, -0.2), (7.3, 4.1)])
def test_blocks_lie_around_a_place(center: tuple[float, float]) -> None:
    """The place is in the middle of a block, wherever the map begins."""
    chosen = GridSettings(0.1, 0.3, center=center)
    for corner in (-2.25, -3.75):
        geometry = GridGeometry(60, 60, 0.1, corner, corner)
        occupancy = np.zeros((60, 60), dtype=np.int8)
        grid = make_planning_grid(occupancy, geometry, (0.4, 0.4), settings=chosen)
        offset = (np.array(center) - grid.geometry.center_of(0, 0)) / 0.3
        assert np.abs(offset - np.rint(offset)).max() < 0.2
