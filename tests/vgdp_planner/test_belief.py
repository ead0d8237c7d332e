"""The belief filter."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gridnav import DONE, FREE, OBSTACLE, STEPS
from maze_sim import Maze, MazeSimulation, wilson_maze
from vgdp_planner import ValueGuidedPlanner


@pytest.fixture(scope='module')
def planner() -> ValueGuidedPlanner:
    """Return the shipped planner."""
    return ValueGuidedPlanner.from_pretrained()


def known(blocked: np.ndarray) -> torch.Tensor:
    """Return the partial map of a known world, (1, 3, H, W)."""
    partial_map = np.zeros((1, 3, *blocked.shape), dtype=np.float32)
    partial_map[0, OBSTACLE], partial_map[0, FREE] = blocked, ~blocked
    return torch.from_numpy(partial_map)


@torch.no_grad()
def test_prediction_moves_the_belief(planner: ValueGuidedPlanner) -> None:
    """A valid step carries the belief along, an invalid one and Done leave it."""
    blocked = np.zeros((5, 5), dtype=bool)
    blocked[2, 3] = True
    maps = known(blocked).expand(9, -1, -1, -1)
    mask = planner.value_network.action_mask(maps)[:, :8]
    belief = torch.zeros(9, 5, 5)
    belief[:, 2, 2] = 1
    after = planner.belief_filter.predict(belief, torch.arange(9), mask)
    torch.testing.assert_close(after.sum(dim=(1, 2)), torch.ones(9), atol=0.01, rtol=0)
    for action in range(9):
        row, col = (2, 2) if action in (DONE, 2) else 2 + STEPS[action]
        assert after[action, row, col] > 0.98


@torch.no_grad()
def test_localises_from_nowhere(planner: ValueGuidedPlanner) -> None:
    """From a uniform belief in a known maze the filter finds the robot within ten steps."""
    found = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        blocked = wilson_maze(15, rng)
        start, goal = (tuple(cell) for cell in rng.permutation(np.argwhere(~blocked))[:2])
        simulation = MazeSimulation([Maze.solved(blocked, start, goal)], view_range=2)
        maps = known(blocked)
        mask = planner.value_network.action_mask(maps)[:, :8]
        belief = maps[:, FREE] / maps[:, FREE].sum()
        for _ in range(10):
            views = torch.from_numpy(simulation.windows())
            belief = planner.belief_filter.correct(belief, maps, views)
            row, col = simulation.cells[0]
            valid = np.flatnonzero(mask[0, :, row, col].numpy() > 0.5)
            action = int(rng.choice(valid))
            simulation.step(np.array([action]))
            belief = planner.belief_filter.predict(belief, torch.tensor([action]), mask)
        row, col = simulation.cells[0]
        found += int(belief[0, row, col] > 0.5)
    assert found >= 18


@torch.no_grad()
def test_a_contradicted_belief_recovers(planner: ValueGuidedPlanner) -> None:
    """A belief that the view rules out everywhere gives way to the view."""
    blocked = wilson_maze(15, np.random.default_rng(0))
    maps = known(blocked)
    wall = torch.zeros(1, 15, 15)
    wall[0, 0, 0] = 1
    view = torch.full((1, 5, 5), -1, dtype=torch.int8)
    view[0, 2, 2] = 0
    corrected = planner.belief_filter.correct(wall, maps, view)
    assert torch.isfinite(corrected).all()
    torch.testing.assert_close(corrected.sum(), torch.tensor(1.0))
    assert corrected[0, 0, 0] == 0
