"""Worlds of all kinds, and starts and goals in them."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.stats import chisquare
from tests.maze_sim.drawing import find, walls
from tests.maze_sim.test_map_file import write_map

from gridnav import DONE, FREE, Outcome
from maze_sim import (
    WORLD_KINDS,
    Maze,
    MazeSimulation,
    Worlds,
    cost_to_go,
    draw_world,
    make_mazes,
    open_walls,
    sample_episode,
    shortest_actions,
    wall_off,
    wilson_maze,
)
from vgdp_experiments.methods.frontier import NearestFrontier

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SHAPES = [(8, 8), (15, 15), (9, 40), (40, 21), (100, 100)]


def joined_parts(blocked: NDArray[np.bool_]) -> list[int]:
    """Return how many cells are joined by ways, largest part first."""
    left = ~blocked
    sizes = []
    while left.any():
        row, col = np.argwhere(left)[0].tolist()
        part = np.isfinite(cost_to_go(blocked, (row, col))) & ~blocked
        sizes.append(int(part.sum()))
        left &= ~part
    return sorted(sizes, reverse=True)


@pytest.mark.parametrize('kind', WORLD_KINDS)
@pytest.mark.parametrize('shape', SHAPES)
def test_worlds_have_their_shape_and_room_to_move(kind: str, shape: tuple[int, int]) -> None:
    """Each draw is another world with some of it free; a seed gives the same one again."""
    drawn = [draw_world(kind, shape, np.random.default_rng(seed)) for seed in range(3)]
    for seed, blocked in enumerate(drawn):
        assert blocked.shape == shape
        assert blocked.dtype == np.bool_
        assert (~blocked).sum() >= 4
        assert (draw_world(kind, shape, np.random.default_rng(seed)) == blocked).all()
    assert len({blocked.tobytes() for blocked in drawn}) == 3


@pytest.mark.parametrize('kind', ['maze', 'loops', 'rooms'])
def test_all_of_a_building_can_be_reached(kind: str) -> None:
    """Mazes and rooms are closed and in one part, whatever stands in them."""
    for seed in range(15):
        blocked = draw_world(kind, (25, 32), np.random.default_rng(seed))
        assert blocked[[0, -1]].all()
        assert blocked[:, [0, -1]].all()
        assert len(joined_parts(blocked)) == 1


@pytest.mark.parametrize('kind', ['caves', 'obstacles'])
def test_open_country_is_mostly_joined(kind: str) -> None:
    """A quarter of the map at least is free and in one part; some have other parts, too."""
    parts = [
        joined_parts(draw_world(kind, (30, 30), np.random.default_rng(seed))) for seed in range(30)
    ]
    assert min(sizes[0] for sizes in parts) >= 0.25 * 30 * 30
    assert any(len(sizes) > 1 for sizes in parts)
    free = [sum(sizes) / 900 for sizes in parts]
    assert max(free) - min(free) > 0.15


def test_rooms_have_thin_walls_and_narrow_doors() -> None:
    """Where rooms are split by walls, few squares of 2 x 2 are walls; dug rooms have rock."""
    solid = []
    for seed in range(30):
        blocked = draw_world('rooms', (40, 40), np.random.default_rng(seed))
        square = blocked[1:, 1:] & blocked[:-1, 1:] & blocked[1:, :-1] & blocked[:-1, :-1]
        solid.append(square.mean())
    assert min(solid) < 0.03
    assert max(solid) > 0.3


def test_opened_walls_make_loops_and_cut_off_nothing() -> None:
    """Only walls between two free cells go, and all of them where the share is 1."""
    blocked = wilson_maze(15, np.random.default_rng(0))
    opened = open_walls(blocked, 1.0, np.random.default_rng(0))
    assert not opened[1:-1:2, 1:-1].any()
    assert not opened[1:-1, 1:-1:2].any()
    for row, col in np.argwhere(blocked & ~opened).tolist():
        across = blocked[row, [col - 1, col + 1]], blocked[[row - 1, row + 1], col]
        assert any(not pair.any() for pair in across)
    assert (open_walls(blocked, 0.0, np.random.default_rng(0)) == blocked).all()


@pytest.mark.parametrize(
    ('kind', 'shape', 'message'),
    [
        ('swamp', (15, 15), "maze, loops, rooms, caves, obstacles, got 'swamp'"),
        ('caves', (4, 15), 'at least 5 cells, got 4 x 15'),
    ],
)
def test_senseless_worlds_are_refused(kind: str, shape: tuple[int, int], message: str) -> None:
    """The kind and the shape are named in the error."""
    with pytest.raises(ValueError, match=message):
        draw_world(kind, shape, np.random.default_rng(0))
    with pytest.raises(ValueError, match=message):
        make_mazes(1, shape, 0, kind=kind)


def test_pairs_are_uniform_over_all_that_a_way_joins() -> None:
    """On a map in two parts, all pairs far enough apart in one part are equally likely."""
    blocked = walls('...#... ...#...')
    free = [(row, col) for row, col in np.argwhere(~blocked).tolist()]
    possible = {
        (start, goal)
        for goal in free
        for start in free
        if np.isfinite(cost_to_go(blocked, goal)[start])
        and len(shortest_actions(blocked, start, goal)) >= 2
    }
    assert len(possible) == 16
    rng = np.random.default_rng(0)
    counts: Counter[tuple[tuple[int, int], tuple[int, int]]] = Counter()
    for _ in range(600):
        maze = sample_episode(blocked, rng, min_expert_steps=2)
        assert maze is not None
        assert maze.expert_steps == len(shortest_actions(blocked, maze.start, maze.goal))
        counts[maze.start, maze.goal] += 1
    assert set(counts) == possible
    assert chisquare(list(counts.values())).pvalue > 0.01


@pytest.mark.parametrize('drawing', ['###', '..#', '.....', '.#.#.#.#.#.'])
def test_a_map_without_such_a_pair_gives_none(drawing: str) -> None:
    """Walls alone, and parts that are too small."""
    assert sample_episode(walls(drawing), np.random.default_rng(0), min_expert_steps=5) is None


@pytest.mark.parametrize('kind', WORLD_KINDS)
def test_number_i_depends_on_the_seed_and_i_alone(kind: str) -> None:
    """All of one shape, each solved, however many are drawn."""
    few, many = (make_mazes(count, (20, 24), 3, 12, kind=kind) for count in (2, 4))
    for one, other in zip(few, many, strict=False):
        assert (one.blocked == other.blocked).all()
        assert (one.start, one.goal) == (other.start, other.goal)
    assert {maze.blocked.shape for maze in many} == {(20, 24)}
    for maze in many:
        assert maze.reachable
        assert maze.expert_steps >= 12
        assert Maze.solved(maze.blocked, maze.start, maze.goal).expert_cost == maze.expert_cost


def test_worlds_from_a_map_file_are_that_map(tmp_path: Path) -> None:
    """Starts and goals differ, the walls don't; size and kind say nothing."""
    blocked = draw_world('rooms', (16, 24), np.random.default_rng(0))
    path = write_map(tmp_path, blocked)
    worlds = Worlds(9, 'maze', map_file=str(path), min_expert_steps=5)
    assert worlds.shape == (16, 24)
    assert worlds.geometry.resolution == 0.05
    mazes = make_mazes(5, 9, 0, 5, map_file=str(path))
    assert all((maze.blocked == blocked).all() for maze in mazes)
    assert len({(maze.start, maze.goal) for maze in mazes}) > 1
    with pytest.raises(ValueError, match=r'map .*map\.yaml was found with 999 expert steps'):
        make_mazes(1, 9, 0, 999, map_file=str(path))


@pytest.mark.parametrize('kind', WORLD_KINDS)
def test_unreachable_goals_lie_behind_a_wall(kind: str) -> None:
    """The same worlds with a wall more; start and goal stay free, and no way is left."""
    open_ones, closed = (
        make_mazes(6, (20, 24), 5, kind=kind, reachable=reachable) for reachable in (True, False)
    )
    for before, maze in zip(open_ones, closed, strict=True):
        assert (maze.start, maze.goal) == (before.start, before.goal)
        assert (maze.blocked >= before.blocked).all()
        assert not maze.reachable
        assert (maze.expert_steps, maze.expert_cost) == (0, math.inf)
        assert np.isinf(cost_to_go(maze.blocked, maze.goal)[maze.start])


def test_no_wall_fits_between_neighbours() -> None:
    """Where start and goal are too close for a wall, that is said."""
    maze = Maze.solved(walls('...'), (0, 0), (0, 2))
    with pytest.raises(ValueError, match=r'between the start \(0, 0\) and the goal \(0, 2\)'):
        wall_off(maze, np.random.default_rng(0))


def explore(mazes: list[Maze]) -> MazeSimulation:
    """Let nearest-frontier exploration run until all episodes have ended."""
    simulation = MazeSimulation(mazes, max_steps=2000)
    method = NearestFrontier()
    method.reset(range(len(mazes)), 0)
    while simulation.active.any():
        answers = method.act(simulation.partial_maps, simulation.cells, simulation.active)
        simulation.give_up(np.flatnonzero([not answer for answer in answers]))
        simulation.step(np.array([answer[0] if answer else DONE for answer in answers]))
    return simulation


@pytest.mark.parametrize('kind', ['maze', 'rooms'])
def test_explorer_gives_up_once_it_has_seen_all_it_can_reach(kind: str) -> None:
    """It stops with that verdict where no way leads to the goal, and earns nothing."""
    simulation = explore(make_mazes(4, (15, 18), 2, kind=kind, reachable=False))
    assert set(simulation.outcomes) == {Outcome.GAVE_UP}
    for row, maze in enumerate(simulation.mazes):
        reached = np.isfinite(cost_to_go(maze.blocked, maze.start)) & ~maze.blocked
        assert (simulation.partial_maps[row, FREE] >= reached).all()
        result = simulation.result(row)
        assert result.expert_cost == math.inf
        assert (result.spl, result.spl_steps) == (0.0, 0.0)


def test_explorer_gives_up_before_a_goal_that_it_sees_behind_walls() -> None:
    """One can look between two diagonal walls, but no step passes there."""
    drawing = 's.... ..... ..#.. .#g#. ..#..'
    maze = Maze(walls(drawing), find(drawing, 's'), find(drawing, 'g'), 0, math.inf)
    simulation = explore([maze])
    assert simulation.goal_seen[0]
    assert simulation.outcomes[0] is Outcome.GAVE_UP
