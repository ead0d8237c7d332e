"""Episodes of the array simulation: what is seen, how they end, and what they come to."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chisquare
from tests.maze_sim.drawing import find, walls

from gridnav import (
    DONE,
    FREE,
    GOAL,
    NUM_ACTIONS,
    OBSTACLE,
    STEP_LENGTHS,
    Outcome,
    summarize,
    valid_moves,
)
from maze_sim import Maze, MazeSimulation, make_mazes, shortest_actions, visible_cells

NORTH, EAST, SOUTH, WEST = 0, 2, 4, 6
NORTH_EAST = 1


def maze_of(drawing: str) -> Maze:
    """Return the maze of a drawing with its start ``s`` and goal ``g``."""
    return Maze.solved(walls(drawing), find(drawing, 's'), find(drawing, 'g'))


def run(drawing: str, actions: list[int], **kwargs: int) -> MazeSimulation:
    """Take the actions in the maze of a drawing."""
    simulation = MazeSimulation([maze_of(drawing)], **cast('dict[str, Any]', kwargs))
    for action in actions:
        simulation.step(np.array([action]))
    return simulation


def expert_actions(mazes: list[Maze]) -> np.ndarray:
    """Return the expert's actions of all mazes, filled up with Done, (T, B)."""
    ways = [shortest_actions(maze.blocked, maze.start, maze.goal) for maze in mazes]
    length = max(map(len, ways)) + 1
    return np.array([way + [DONE] * (length - len(way)) for way in ways]).T


@pytest.mark.parametrize(
    ('drawing', 'actions', 'outcome', 'steps', 'path_cost'),
    [
        ('s.g', [EAST, EAST, DONE], Outcome.SUCCESS, 3, 2.0),
        ('s.g', [EAST, DONE], Outcome.FALSE_DONE, 2, 1.0),
        ('s.g', [DONE], Outcome.FALSE_DONE, 1, 0.0),
        ('s.g', [EAST, EAST], Outcome.RUNNING, 2, 2.0),
        ('s.g', [EAST, NORTH], Outcome.COLLISION, 2, 1.0),
        ('s.g', [WEST], Outcome.COLLISION, 1, 0.0),
        ('s#. ..g', [EAST], Outcome.COLLISION, 1, 0.0),
        # A diagonal step passes one wall, not two.
        ('s# .g', [NORTH_EAST, DONE], Outcome.SUCCESS, 2, np.sqrt(2)),
        ('s. #g', [NORTH_EAST, DONE], Outcome.SUCCESS, 2, np.sqrt(2)),
        ('s. .# g.', [NORTH_EAST], Outcome.COLLISION, 1, 0.0),
        ('s.g', [EAST, WEST, EAST, WEST], Outcome.TIMEOUT, 4, 4.0),
        ('s.g', [EAST, EAST, WEST, WEST, EAST], Outcome.TIMEOUT, 4, 4.0),
        # The last action may still end the episode in another way.
        ('s.g', [EAST, WEST, EAST, DONE], Outcome.FALSE_DONE, 4, 3.0),
        ('s...g', [EAST, EAST, EAST, DONE], Outcome.FALSE_DONE, 4, 3.0),
        ('s.g', [EAST, WEST, EAST, NORTH], Outcome.COLLISION, 4, 3.0),
    ],
)
def test_episode_ends_as_it_should(
    drawing: str, actions: list[int], outcome: Outcome, steps: int, path_cost: float
) -> None:
    """Each way to end has its outcome; nothing happens after the end."""
    simulation = run(drawing, actions, max_steps=4)
    result = simulation.result(0)
    assert result.outcome is outcome
    assert result.steps == steps
    assert result.path_cost == pytest.approx(path_cost)
    assert simulation.active[0] == (outcome is Outcome.RUNNING)


def test_no_step_passes_between_two_diagonal_walls() -> None:
    """A diagonal step between two walls is a collision, whatever is behind them."""
    blocked = walls('.# #.')
    maze = Maze(blocked, (0, 0), (1, 1), expert_steps=1, expert_cost=1.0)
    simulation = MazeSimulation([maze])
    simulation.step(np.array([NORTH_EAST]))
    assert simulation.outcomes[0] is Outcome.COLLISION
    assert simulation.cells[0].tolist() == [0, 0]


def test_nothing_changes_after_the_end() -> None:
    """Rows that are not active ignore their actions, even senseless ones."""
    simulation = MazeSimulation([maze_of('s.g'), maze_of('s.g')])
    simulation.step(np.array([WEST, EAST]))
    simulation.step(np.array([99, EAST]))
    assert simulation.active.tolist() == [False, True]
    assert simulation.steps.tolist() == [1, 2]
    assert simulation.cells.tolist() == [[0, 0], [0, 2]]
    assert simulation.outcomes.tolist() == [Outcome.COLLISION, Outcome.RUNNING]


@pytest.mark.parametrize(
    ('actions', 'message'),
    [
        ([9], 'from 0 to 8, got 9'),
        ([-1], 'from 0 to 8, got -1'),
        ([0, 0], r'\(1,\), got \(2,\)'),
    ],
)
def test_senseless_actions_are_refused(actions: list[int], message: str) -> None:
    """An action out of range or a wrong number of them is named, and nothing is done."""
    simulation = MazeSimulation([maze_of('s.g')])
    with pytest.raises(ValueError, match=message):
        simulation.step(np.array(actions))
    assert simulation.steps[0] == 0


@pytest.mark.parametrize(
    ('kwargs', 'message'),
    [
        ({'mazes': []}, 'at least one maze'),
        ({'view_range': 0}, 'view range must be at least 1, got 0'),
        ({'max_steps': 0}, 'at least 1, got 0'),
        ({'slip': -0.1}, 'slip must be 0 to 1, got -0.1'),
        ({'slip': 1.5}, 'slip must be 0 to 1, got 1.5'),
        ({'slip': np.nan}, 'slip must be 0 to 1, got nan'),
        ({'pose_noise': -1.0}, '0 cells or more and finite, got -1.0'),
        ({'pose_noise': np.inf}, '0 cells or more and finite, got inf'),
        ({'slip': 0.1, 'stop_on_repeat': True}, 'Exact loops can not be told'),
        ({'seeds': [0, 1]}, 'zip'),
        ({'mazes': [maze_of('s.g'), maze_of('sg')]}, r'shape \(1, 3\), got \(1, 2\)'),
    ],
)
def test_senseless_simulation_is_refused(kwargs: dict[str, Any], message: str) -> None:
    """Each argument out of range is named."""
    with pytest.raises(ValueError, match=message):
        MazeSimulation(**({'mazes': [maze_of('s.g')]} | kwargs))


def test_expert_succeeds_everywhere_with_full_marks() -> None:
    """Following the expert in every maze ends in success with an SPL of 1."""
    mazes = make_mazes(100, 15, seed=0)
    simulation = MazeSimulation(mazes)
    for actions in expert_actions(mazes):
        simulation.step(actions)
    summary = summarize(simulation.results())
    assert summary.success == 1.0
    assert summary.spl == pytest.approx(1.0)
    assert summary.spl_steps == pytest.approx(1.0)
    assert simulation.goal_seen.all()
    assert [result.steps for result in simulation.results()] == [
        maze.expert_steps + 1 for maze in mazes
    ]


def test_first_look_is_merged_at_once() -> None:
    """The map holds the view from the start before any step."""
    simulation = MazeSimulation([maze_of('s.#.g .....')], view_range=2)
    partial_map = simulation.partial_maps[0]
    assert partial_map[FREE].tolist() == [[1, 1, 0, 0, 0], [1, 1, 1, 0, 0]]
    assert partial_map[OBSTACLE].tolist() == [[0, 0, 1, 0, 0], [0, 0, 0, 0, 0]]
    assert not partial_map[GOAL].any()
    assert simulation.windows()[0].tolist() == [
        [-1, -1, -1, -1, -1],
        [-1, -1, -1, -1, -1],
        [-1, -1, 0, 0, 100],
        [-1, -1, 0, 0, 0],
        [-1, -1, -1, -1, -1],
    ]


def test_goal_is_marked_once_it_is_seen() -> None:
    """The goal channel stays empty until the goal is in sight, then the cell is free and goal."""
    simulation = MazeSimulation([maze_of('s...g')], view_range=2)
    simulation.step(np.array([EAST]))
    assert not simulation.goal_seen[0]
    assert not simulation.partial_maps[0, GOAL].any()
    simulation.step(np.array([EAST]))
    assert simulation.goal_seen[0]
    assert simulation.partial_maps[0, :, 0, 4].tolist() == [0, 1, 1]
    assert simulation.partial_maps[0, GOAL].sum() == 1


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 1000), size=st.integers(9, 14), view_range=st.integers(1, 4))
def test_map_is_exactly_what_was_seen(seed: int, size: int, view_range: int) -> None:
    """The map is the true map where some view reached, and 0 everywhere else."""
    rng = np.random.default_rng(seed)
    mazes = make_mazes(4, size, seed, min_expert_steps=5)
    simulation = MazeSimulation(mazes, view_range, max_steps=30)
    blocked = np.stack([maze.blocked for maze in mazes])
    goal = np.zeros_like(blocked)
    for row, maze in enumerate(mazes):
        goal[row][maze.goal] = True
    seen = np.zeros_like(blocked)
    while simulation.active.any():
        views = visible_cells(blocked, simulation.cells, view_range)
        windows = simulation.windows()
        for row, place, col in np.argwhere(views):
            cell = simulation.cells[row] + (place - view_range, col - view_range)
            seen[row, cell[0], cell[1]] = True
            assert windows[row, place, col] == 100 * blocked[row, cell[0], cell[1]]
        assert (windows[~views] == -1).all()
        assert (simulation.partial_maps[:, OBSTACLE] == seen & blocked).all()
        assert (simulation.partial_maps[:, FREE] == seen & ~blocked).all()
        assert (simulation.partial_maps[:, GOAL] == seen & goal).all()
        assert (simulation.goal_seen == (seen & goal).any(axis=(1, 2))).all()
        valid = valid_moves(blocked)[np.arange(4), :, *simulation.cells.T]
        simulation.step((rng.random(valid.shape) * valid).argmax(axis=1))


def test_unseen_cells_have_no_say() -> None:
    """Two worlds that differ only where no view reached give the same observations."""
    here = 's..... .####. .#.... .#.#.. .#..g.'
    there = 's..... .####. .#.##. .#..#. .#.#g.'
    actions = [NORTH, NORTH, NORTH, SOUTH]
    one, other = run(here, actions, view_range=1), run(there, actions, view_range=1)
    assert (one.partial_maps == other.partial_maps).all()
    assert (one.windows() == other.windows()).all()
    assert (one.cells == other.cells).all()


def test_replacing_the_true_map_leaves_the_observations_alone() -> None:
    """What was seen stays as it was seen when the maze's array is overwritten."""
    maze = maze_of('s...g .....')
    simulation = MazeSimulation([maze])
    before = simulation.partial_maps.copy()
    maze.blocked[:] = True
    assert (simulation.partial_maps == before).all()
    simulation.step(np.array([EAST]))
    assert simulation.outcomes[0] is Outcome.RUNNING


@pytest.mark.parametrize(
    ('actions', 'repeat_at'),
    [
        # To and fro in known land: the second step east from the start is the repeat.
        ([EAST, WEST, EAST], 3),
        ([EAST, WEST, NORTH, SOUTH, EAST], 5),
        ([EAST, EAST, WEST, WEST, EAST, EAST], 5),
        # Another action from the same cell is no loop.
        ([EAST, WEST, NORTH, EAST, SOUTH, EAST], None),
    ],
)
def test_exact_loop_ends_in_repeat_where_asked_for(
    actions: list[int], repeat_at: int | None
) -> None:
    """The same action from the same cell on the same map ends the episode, if asked for."""
    drawing = 's.... ..... ....g'
    simulation = MazeSimulation([maze_of(drawing)], view_range=4, stop_on_repeat=True)
    for action in actions:
        simulation.step(np.array([action]))
    if repeat_at is None:
        assert simulation.outcomes[0] is Outcome.RUNNING
    else:
        assert simulation.outcomes[0] is Outcome.REPEAT
        assert simulation.steps[0] == repeat_at
    assert run(drawing, actions, view_range=4).outcomes[0] is Outcome.RUNNING


def test_news_in_between_is_no_repeat() -> None:
    """Going back over a cell after something new was seen is no loop, doing it again is."""
    drawing = 's...... ......g'
    simulation = MazeSimulation([maze_of(drawing)], view_range=2, stop_on_repeat=True)
    for action in [EAST, WEST, EAST, EAST, WEST, WEST]:
        simulation.step(np.array([action]))
        assert simulation.active[0]
    simulation.step(np.array([EAST]))
    assert simulation.active[0]
    simulation.step(np.array([EAST]))
    assert simulation.active[0]
    simulation.step(np.array([WEST]))
    assert simulation.outcomes[0] is Outcome.REPEAT


def test_repeat_counts_before_timeout() -> None:
    """A loop that closes with the last action allowed is still a loop."""
    simulation = MazeSimulation([maze_of('s.g')], max_steps=3, stop_on_repeat=True)
    for action in [EAST, WEST, EAST]:
        simulation.step(np.array([action]))
    assert simulation.outcomes[0] is Outcome.REPEAT


def test_giving_up_ends_running_episodes_alone() -> None:
    """A robot that gives up has not succeeded; an ended episode keeps its outcome."""
    simulation = MazeSimulation([maze_of('s.g')] * 3)
    simulation.step(np.array([WEST, EAST, EAST]))
    simulation.give_up(np.array([0, 1]))
    assert simulation.outcomes.tolist() == [Outcome.COLLISION, Outcome.GAVE_UP, Outcome.RUNNING]
    assert simulation.active.tolist() == [False, False, True]


def test_restarted_rows_are_like_new_and_others_go_on() -> None:
    """A restart leaves nothing of the old episode and touches no other row."""
    mazes = make_mazes(6, 15, seed=1)
    simulation = MazeSimulation(mazes[:4], max_steps=50, stop_on_repeat=True)
    fresh = MazeSimulation(mazes[4:], max_steps=50, stop_on_repeat=True)
    ways = expert_actions(mazes)
    for actions in ways[:-5]:
        simulation.step(actions[:4])
    assert simulation.goal_seen[[1, 3]].any()
    before = simulation.partial_maps.copy()
    simulation.restart(np.array([1, 3]), mazes[4:])
    assert (simulation.partial_maps[[0, 2]] == before[[0, 2]]).all()
    assert not simulation.goal_seen[[1, 3]].any()
    for actions in ways:
        simulation.step(actions[[0, 4, 2, 5]])
        fresh.step(actions[4:])
        assert (simulation.partial_maps[[1, 3]] == fresh.partial_maps).all()
        assert (simulation.cells[[1, 3]] == fresh.cells).all()
    assert [simulation.result(row) for row in (1, 3)] == fresh.results()
    assert all(result.success for result in fresh.results())


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000))
def test_stepping_together_is_stepping_alone(seed: int) -> None:
    """B mazes at once give what each gives alone, and path costs add up."""
    rng = np.random.default_rng(seed)
    mazes = make_mazes(5, 11, seed, min_expert_steps=4)
    kwargs: dict[str, Any] = {'view_range': 2, 'max_steps': 12, 'stop_on_repeat': True}
    together = MazeSimulation(mazes, **kwargs)
    alone = [MazeSimulation([maze], **kwargs) for maze in mazes]
    costs = np.zeros(5)
    for _ in range(14):
        actions = rng.integers(NUM_ACTIONS, size=5)
        before = together.cells.copy()
        together.step(actions)
        for simulation, action in zip(alone, actions, strict=True):
            simulation.step(np.array([action]))
        moved = (together.cells != before).any(axis=1)
        costs += np.where(moved, STEP_LENGTHS[actions], 0.0)
    assert together.results() == [simulation.result(0) for simulation in alone]
    assert (together.partial_maps == np.concatenate([s.partial_maps for s in alone])).all()
    np.testing.assert_allclose(together.path_costs, costs)


def wander(simulation: MazeSimulation, steps: int, seed: int = 0) -> list[np.ndarray]:
    """Take random valid moves everywhere and return the cells after each step, (B, 2)."""
    rng = np.random.default_rng(seed)
    valid = valid_moves(np.stack([maze.blocked for maze in simulation.mazes]))
    rows = np.arange(len(simulation.mazes))
    visited = []
    for _ in range(steps):
        chances = rng.random((len(rows), 8)) * valid[rows, :, *simulation.cells.T]
        simulation.step(chances.argmax(axis=1))
        visited.append(simulation.cells.copy())
    return visited


@pytest.mark.parametrize(
    ('drawing', 'action', 'shares'),
    [
        ('.....  ..s..  ....g', EAST, {(1, 3): 0.4, (1, 2): 0.2, (0, 3): 0.2, (2, 3): 0.2}),
        ('.....  ..s..  ....g', NORTH_EAST, {(2, 3): 0.4, (1, 2): 0.2, (2, 2): 0.2, (1, 3): 0.2}),
        # Where a cell beside the right one is a wall, the others share.
        ('.....  ..s..  ...#g', EAST, {(1, 3): 0.4, (1, 2): 0.3, (0, 3): 0.3}),
        ('...#.  ..s.g  ...#.', EAST, {(1, 3): 0.4, (1, 2): 0.6}),
        ('.....  ..s..  ....g', DONE, {(1, 2): 1.0}),
    ],
)
def test_slips_lead_beside_or_nowhere(
    drawing: str, action: int, shares: dict[tuple[int, int], float]
) -> None:
    """With a probability of 0.6 here, each cell beside the right one as likely as staying."""
    count = 4000
    simulation = MazeSimulation([maze_of(drawing)] * count, slip=0.6)
    simulation.step(np.full(count, action))
    assert Outcome.COLLISION not in set(simulation.outcomes)
    cells, counts = np.unique(simulation.cells, axis=0, return_counts=True)
    found = {tuple(cell): number for cell, number in zip(cells.tolist(), counts, strict=True)}
    assert set(found) == set(shares)
    expected = [shares[cell] * count for cell in found]
    assert len(found) == 1 or chisquare(list(found.values()), expected).pvalue > 0.01
    start = simulation.mazes[0].start
    lengths = np.hypot(*(simulation.cells - start).T)
    np.testing.assert_allclose(simulation.path_costs, lengths)


def test_a_slip_is_no_collision_and_no_excuse_for_one() -> None:
    """Robots that choose valid moves never collide; a move into a wall always does."""
    simulation = MazeSimulation(make_mazes(20, 15, seed=3), max_steps=300, slip=0.5)
    blocked = np.stack([maze.blocked for maze in simulation.mazes])
    for cells in wander(simulation, 100):
        assert not blocked[np.arange(20), *cells.T].any()
    assert simulation.active.all()
    simulation = MazeSimulation([maze_of('s.g')] * 50, slip=1.0)
    simulation.step(np.full(50, NORTH))
    assert set(simulation.outcomes) == {Outcome.COLLISION}
    assert not simulation.cells.any()


def test_reported_cells_are_gaussian_and_on_the_map() -> None:
    """They spread by the noise where there is room, and nothing else is affected."""
    field = np.zeros((41, 41), dtype=np.bool_)
    mazes = [Maze.solved(field, (20, 20), (20, 30))] * 2000
    noisy = MazeSimulation(mazes, pose_noise=1.5)
    clear = MazeSimulation(mazes[:1])
    for simulation in (noisy, clear):
        simulation.step(np.full(len(simulation.mazes), EAST))
    assert (noisy.cells == (20, 21)).all()
    errors = noisy.reported_cells - noisy.cells
    # Rounding to cells adds a variance of 1/12.
    assert errors.std(axis=0) == pytest.approx(np.sqrt(1.5**2 + 1 / 12), rel=0.05)
    assert abs(errors.mean(axis=0)).max() < 0.15
    assert (noisy.partial_maps == clear.partial_maps).all()
    assert (noisy.windows() == clear.windows()).all()
    corner = MazeSimulation([maze_of('s.. ..g')] * 500, pose_noise=5.0)
    assert np.unique(corner.reported_cells, axis=0).tolist() == [
        [row, col] for row in range(2) for col in range(3)
    ]


def test_without_noise_the_reported_cells_are_the_true_ones() -> None:
    """Also after steps and restarts, and the seeds say nothing."""
    mazes = make_mazes(4, 15, seed=1)
    one, other = MazeSimulation(mazes), MazeSimulation(mazes, seeds=[9, 8, 7, 6])
    for simulation in (one, other):
        wander(simulation, 30)
        simulation.restart(np.array([2]), mazes[:1])
        wander(simulation, 5)
        assert (simulation.reported_cells == simulation.cells).all()
    assert (one.cells == other.cells).all()
    assert (one.partial_maps == other.partial_maps).all()


def test_slips_and_noise_follow_the_seed_of_the_episode() -> None:
    """Whatever runs beside it; another seed gives other luck, and a restart begins anew."""
    mazes = make_mazes(3, 15, seed=2)
    kwargs: dict[str, Any] = {'slip': 0.4, 'pose_noise': 1.0}
    ways = np.random.default_rng(0).integers(8, size=(40, 3))

    def follow(simulation: MazeSimulation, columns: list[int]) -> list[list[list[int]]]:
        seen = []
        for actions in ways[:, columns]:
            valid = valid_moves(np.stack([maze.blocked for maze in simulation.mazes]))
            can = valid[np.arange(len(columns)), actions, *simulation.cells.T]
            firsts = valid[np.arange(len(columns)), :, *simulation.cells.T].argmax(axis=1)
            simulation.step(np.where(can, actions, firsts))
            seen.append(np.hstack([simulation.cells, simulation.reported_cells]).tolist())
        return seen

    together = follow(MazeSimulation(mazes, **kwargs, seeds=[5, [6, 1], 7]), [0, 1, 2])
    alone = follow(MazeSimulation(mazes[1:2], **kwargs, seeds=[[6, 1]]), [1])
    assert [rows[1] for rows in together] == [rows[0] for rows in alone]
    simulation = MazeSimulation(mazes, **kwargs)
    others = follow(simulation, [0, 1, 2])
    assert [rows[1] for rows in others] != [rows[0] for rows in alone]
    simulation.restart(np.arange(3), mazes, [5, [6, 1], 7])
    assert follow(simulation, [0, 1, 2]) == together
