"""Decisions see nothing but what was observed: not the true map, nor the goal before its time."""

from __future__ import annotations

import argparse
import ast
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch

import vgdp_planner
from gridnav import FREE, GOAL, OBSTACLE
from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE
from maze_sim import Maze, MazeSimulation, make_mazes
from vgdp_experiments.calvin import Calvin, CalvinConfig, save_calvin
from vgdp_experiments.methods.frontier import NearestFrontier
from vgdp_experiments.methods.registry import PLANNERS

if TYPE_CHECKING:
    from vgdp_experiments.methods import Method

COUNT, SIZE, SEED, VIEW_RANGE = 4, 15, 0, 2


@pytest.fixture(scope='module')
def options(tmp_path_factory: pytest.TempPathFactory) -> argparse.Namespace:
    """Return the options for the shipped weights, and for random ones of CALVIN."""
    torch.manual_seed(0)
    calvin = tmp_path_factory.mktemp('calvin')
    save_calvin(calvin, Calvin(CalvinConfig()), {})
    return argparse.Namespace(
        weights=None, calvin_weights=calvin, device='cpu', threads=None, settings=[]
    )


def run(method: Method, simulation: MazeSimulation, decisions: int) -> list[list[list[int]]]:
    """Let a method decide so many times and return what it committed to.

    The robots go where exploration takes them, as not all methods get far by themselves.
    """
    walker = NearestFrontier()
    walker.reset(range(COUNT), seed=0)
    log = []
    for _ in range(decisions):
        seen = simulation.partial_maps, simulation.cells, simulation.active
        log.append(method.act(*seen))
        simulation.step(np.concatenate(walker.act(*seen)))
        assert simulation.active.all()
    return log


def elsewhere(simulation: MazeSimulation) -> list[Maze]:
    """Return mazes that look the same so far: what is unseen turned over, the goal elsewhere."""
    mazes = []
    for maze, partial_map in zip(simulation.mazes, simulation.partial_maps, strict=True):
        seen = (partial_map[OBSTACLE] > 0) | (partial_map[FREE] > 0)
        blocked = np.where(seen, maze.blocked, ~maze.blocked)
        places = np.argwhere(~seen & ~blocked).tolist()
        goal = next((row, col) for row, col in places if (row, col) != maze.goal)
        mazes.append(Maze(blocked, maze.start, goal, maze.expert_steps, maze.expert_cost))
    return mazes


def replace_world(simulation: MazeSimulation, mazes: list[Maze]) -> None:
    """Put other mazes behind the robots, in every place that holds the true ones."""
    for row, (old, new) in enumerate(zip(simulation.mazes, mazes, strict=True)):
        old.blocked[:] = new.blocked
        object.__setattr__(old, 'goal', new.goal)
        simulation._goals[row] = new.goal
        simulation._truth[row][simulation._inside] = np.where(
            new.blocked, OCCUPIED_VALUE, FREE_VALUE
        )


@pytest.mark.parametrize('name', PLANNERS)
@pytest.mark.parametrize('decisions', [0, 6])
def test_replacing_the_world_does_not_change_the_plan(
    name: str, decisions: int, options: argparse.Namespace
) -> None:
    """With the true map and goal replaced after the observations, the same plan comes out."""
    plans = []
    for replaced in (False, True):
        simulation = MazeSimulation(make_mazes(COUNT, SIZE, SEED), VIEW_RANGE)
        method = PLANNERS[name](options)
        method.reset(range(COUNT), seed=0)
        run(method, simulation, decisions)
        assert not simulation.goal_seen.any()
        if replaced:
            replace_world(simulation, elsewhere(simulation))
        plans.append(method.act(simulation.partial_maps, simulation.cells, simulation.active))
    assert plans[0] == plans[1]
    assert any(plans[0])


@pytest.mark.parametrize('name', PLANNERS)
def test_worlds_that_look_alike_are_treated_alike(name: str, options: argparse.Namespace) -> None:
    """In worlds that differ only where nobody looked, everything is the same until one looks."""
    simulation = MazeSimulation(make_mazes(COUNT, SIZE, SEED), VIEW_RANGE)
    method = PLANNERS[name](options)
    method.reset(range(COUNT), seed=0)
    log = run(method, simulation, 6)
    maps = simulation.partial_maps.copy()
    assert not simulation.goal_seen.any()

    other = MazeSimulation(elsewhere(simulation), VIEW_RANGE)
    method.reset(range(COUNT), seed=0)
    assert run(method, other, 6) == log
    np.testing.assert_array_equal(other.partial_maps, maps)


def test_decisions_follow_what_is_observed(options: argparse.Namespace) -> None:
    """The same method does decide otherwise once the goal has been observed."""
    simulation = MazeSimulation(make_mazes(COUNT, SIZE, SEED), VIEW_RANGE)
    method = PLANNERS['vgdp'](options)
    method.reset(range(COUNT), seed=0)
    before = method.act(simulation.partial_maps, simulation.cells, simulation.active)
    for partial_map, (row, col) in zip(simulation.partial_maps, simulation.cells, strict=True):
        partial_map[GOAL, row, col] = 1.0
    method.reset(range(COUNT), seed=0)
    after = method.act(simulation.partial_maps, simulation.cells, simulation.active)
    assert all(one != two for one, two in zip(before, after, strict=True))


def test_the_planner_can_not_know_a_simulation() -> None:
    """No file of the planner's package imports the mazes or the experiments."""
    files = sorted(Path(vgdp_planner.__file__).parent.rglob('*.py'))
    assert len(files) > 5
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
            names = (
                [alias.name for alias in node.names]
                if isinstance(node, ast.Import)
                else [str(node.module)]
                if isinstance(node, ast.ImportFrom)
                else []
            )
            assert not {'maze_sim', 'vgdp_experiments'} & {name.split('.')[0] for name in names}
