"""Demonstrations of searching homes, and the batches that are drawn from them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from tests.vgdp_experiments.search.learned.conftest import TINY

from avd_player.avd_format import GRID_M
from avd_player.scene import Scene
from avd_player.simulation import ActiveVisionSimulation, SearchRules
from gridnav import DONE, FREE, GOAL, OBSTACLE, STEP_LENGTHS, STEPS, Outcome
from vgdp_experiments.map_codes import unpack
from vgdp_experiments.search.learned.batches import TURNS, Decision, HomeBatches, Turn, cell_of
from vgdp_experiments.search.learned.demonstrations import (
    HomeDemonstrations,
    demonstrate,
    load_homes,
)

if TYPE_CHECKING:
    from pathlib import Path


def test_same_seed_same_demonstrations(home: Path, made: HomeDemonstrations) -> None:
    """All follows from the settings."""
    again = demonstrate(home, replace(TINY, episodes=1))
    count = len(again)
    assert np.array_equal(again.at, made.at[:count])
    rows, cols = again.codes.shape[1:]
    assert np.array_equal(again.codes, made.codes[:count, :rows, :cols])
    assert np.array_equal(again.color, made.color)


def test_the_expert_gets_there(home: Path, made: HomeDemonstrations) -> None:
    """Its steps succeed, from wherever a decision was noted, and cost what they say."""
    simulation = ActiveVisionSimulation(Scene.open(home, 96), SearchRules(min_expert_steps=3))
    assert np.allclose(made.first[0], simulation.expert.costs)
    for index in range(0, len(made), 3):
        start = int(made.at[index])
        simulation.restart(0, start)
        for action in made.plan(0, start, 60, seen=False):
            simulation.step(action)
        assert simulation.outcome is Outcome.SUCCESS
        assert math.isclose(simulation.path_cost, made.first[0, start])


def test_maps_are_what_was_seen_by_then(made: HomeDemonstrations) -> None:
    """The robot stands on a free cell, has been where it is, and its maps grow in a search."""
    for index in range(len(made)):
        rows, cols = made.sizes[index]
        partial_map = unpack(made.codes[index : index + 1])[0]
        assert not partial_map[:, rows:].any()
        assert not partial_map[:, :, cols:].any()
        row, col = cell_of(made.positions[made.at[index]], made.origins[index])
        assert partial_map[FREE, row, col]
        assert made.visited[index, made.at[index]]
        seen = (made.sees[0] & made.visited[index]).any()
        assert partial_map[GOAL].any() == seen
        if index and made.episodes[index] == made.episodes[index - 1]:
            assert (made.visited[index] >= made.visited[index - 1]).all()


def test_files_come_back(data: Path, made: HomeDemonstrations, tmp_path: Path) -> None:
    """What is saved is loaded; homes are left out or missed by name."""
    (one,) = load_homes(data, leave_out=['Home_102_1'])
    assert np.array_equal(one.points, made.points, equal_nan=True)
    assert one.settings == made.settings
    assert one.name == 'Home_101_1'
    with pytest.raises(ValueError, match=r'no demonstrations of Home_103_1 in'):
        load_homes(data, leave_out=['Home_103_1'])
    with pytest.raises(ValueError, match=r'make them with `vgdp data homes-expert`'):
        load_homes(tmp_path)
    (tmp_path / 'Home_101_1.npz').write_bytes(b'no')
    with pytest.raises(ValueError, match=r'Home_101_1.npz does not hold demonstrations'):
        load_homes(tmp_path)


@pytest.mark.parametrize('number', range(TURNS))
def test_turns_agree_on_maps_cells_actions_and_directions(number: int) -> None:
    """A step on a turned map leads to where the turned step leads, and so looks its direction."""
    turn = Turn(number)
    shape = (4, 7)
    grid = torch.arange(28).view(4, 7)
    cell = torch.tensor([2, 3])
    turned = turn.maps(grid)
    at = turn.cells(cell, shape)
    assert turned[tuple(at)] == grid[tuple(cell)]
    for action, step in enumerate(STEPS):
        now = int(turn.actions(torch.tensor(action)))
        there = at + torch.from_numpy(STEPS[now])
        assert turned[tuple(there)] == grid[tuple(cell + torch.from_numpy(step))]
        bearing = turn.bearings(torch.tensor(math.atan2(step[0], step[1])))
        expected = math.atan2(STEPS[now, 0], STEPS[now, 1])
        assert math.isclose(math.cos(float(bearing) - expected), 1.0, abs_tol=1e-6)
    assert int(turn.actions(torch.tensor(DONE))) == DONE


def test_batches_hold_the_way_and_the_plans(made: HomeDemonstrations) -> None:
    """Earlier cells lie on the map of now, one step apart where one step was committed."""
    batches = HomeBatches([made])
    index = int(np.flatnonzero(made.episodes == 1)[3])
    batch = batches.take([Decision(0, index, 0), Decision(0, 0, 0)], horizon=5, past=6)
    assert batch.maps.shape[:2] == (2, 3)
    assert batch.weights.tolist() == [[1.0] * 4 + [0.0] * 3, [1.0] + [0.0] * 6]
    assert np.abs(np.diff(batch.cells[0, :4], axis=0)).max() == 1
    assert batch.actions[0, 0] == batch.plans[0, 0]
    assert batch.maps[np.arange(2), FREE, batch.cells[:, 0, 0], batch.cells[:, 0, 1]].all()


def test_other_things_are_looked_for_only_while_they_are_hidden(
    data: Path, made: HomeDemonstrations
) -> None:
    """Where all is seen from the start there is nothing to draw."""
    rng = np.random.default_rng(0)
    batches = HomeBatches(load_homes(data))
    for decision in batches.draw(20, rng, unseen_only=True):
        assert not batches.is_seen(decision)
    assert any(batches.is_seen(decision) for decision in batches.draw(20, rng))
    with pytest.raises(ValueError, match='the thing is seen from the start'):
        HomeBatches([made]).draw(1, rng, unseen_only=True)


def test_looks_are_unseen_cells_in_reach(made: HomeDemonstrations) -> None:
    """Each is one step from a free cell, as far as a walk there, and no nearer than the expert."""
    made = replace(made, sees=np.zeros_like(made.sees))
    batches = HomeBatches([made])
    decision = Decision(0, 0, 0)
    batch = batches.take([decision])
    looks = batches.looks([decision], batch)
    partial_map, start = batch.maps[0], batch.cells[0, 0]
    assert len(looks.cells[0]) > 3
    for cell, distance, cost in zip(
        looks.cells[0], looks.distances[0], looks.costs[0, 0], strict=True
    ):
        assert not partial_map[[OBSTACLE, FREE], cell[0], cell[1]].any()
        apart = np.sort(np.abs(cell - start))
        shortest = apart[0] * STEP_LENGTHS[1] + apart[1] - apart[0]
        assert distance >= shortest - 1e-4
        middle = batch.origins[0] + (cell[::-1] + 0.5) * GRID_M
        off = np.hypot(*(made.positions - middle).T) / GRID_M
        assert math.isclose(cost, made.first[0, off.argmin()] + 2 * off.min(), rel_tol=1e-5)
