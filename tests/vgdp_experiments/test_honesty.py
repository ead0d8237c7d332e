"""Decisions see nothing but what was observed: not the true map, nor the goal before its time."""

from __future__ import annotations

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
from vgdp_experiments.methods.frontier import NearestFrontier
from vgdp_experiments.methods.vgdp import ValueGuidedDiffusion
from vgdp_planner import Config, ValueGuidedPlanner

if TYPE_CHECKING:
    from collections.abc import Callable

    from vgdp_experiments.methods import Method

COUNT, SIZE, SEED, VIEW_RANGE = 4, 15, 0, 2


def untrained() -> Method:
    """Return the planner with random weights: what it may look at does not depend on them."""
    torch.manual_seed(0)
    return ValueGuidedDiffusion(ValueGuidedPlanner(Config()))


METHODS: dict[str, Callable[[], Method]] = {'vgdp': untrained, 'frontier': NearestFrontier}


def run(method: Method, simulation: MazeSimulation, decisions: int) -> list[list[list[int]]]:
    """Let a method decide so many times and return what it committed to."""
    log = []
    for _ in range(decisions):
        committed = method.act(simulation.partial_maps, simulation.cells, simulation.active)
        log.append(committed)
        # All carry out the first step alone, so that they stay in step.
        assert all(committed)
        simulation.step(np.array([actions[0] for actions in committed]))
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


@pytest.mark.parametrize('name', METHODS)
@pytest.mark.parametrize('decisions', [0, 1, 6])
def test_replacing_the_world_does_not_change_the_plan(name: str, decisions: int) -> None:
    """With the true map and goal replaced after the observations, the same plan comes out."""
    plans = []
    for replaced in (False, True):
        simulation = MazeSimulation(make_mazes(COUNT, SIZE, SEED), VIEW_RANGE)
        method = METHODS[name]()
        method.reset(range(COUNT), seed=0)
        run(method, simulation, decisions)
        assert not simulation.goal_seen.any()
        if replaced:
            replace_world(simulation, elsewhere(simulation))
        plans.append(method.act(simulation.partial_maps, simulation.cells, simulation.active))
    assert plans[0] == plans[1]


@pytest.mark.parametrize('name', METHODS)
def test_worlds_that_look_alike_are_treated_alike(name: str) -> None:
    """In worlds that differ only where nobody looked, everything is the same until one looks."""
    simulation = MazeSimulation(make_mazes(COUNT, SIZE, SEED), VIEW_RANGE)
    method = METHODS[name]()
    method.reset(range(COUNT), seed=0)
    log = run(method, simulation, 6)
    maps = simulation.partial_maps.copy()
    assert not simulation.goal_seen.any()

    other = MazeSimulation(elsewhere(simulation), VIEW_RANGE)
    method.reset(range(COUNT), seed=0)
    assert run(method, other, 6) == log
    np.testing.assert_array_equal(other.partial_maps, maps)


def test_decisions_follow_what_is_observed() -> None:
    """The same method does decide otherwise once the goal has been observed."""
    simulation = MazeSimulation(make_mazes(COUNT, SIZE, SEED), VIEW_RANGE)
    method = untrained()
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
