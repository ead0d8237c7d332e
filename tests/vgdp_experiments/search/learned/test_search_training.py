"""Training the learned methods of the search, and searching with what comes of it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file
from tests.vgdp_experiments.test_commands import vgdp

from avd_player.scene import Scene
from avd_player.simulation import ActiveVisionSimulation, SearchRules
from gridnav import DONE, FREE, NUM_ACTIONS, NUM_MOVES, OBSTACLE, STEPS, GridGeometry
from vgdp_experiments.search.learned import LEARNED
from vgdp_experiments.search.learned.calvin_3d import Calvin3D, Calvin3DConfig
from vgdp_experiments.search.learned.searchers import safe_step
from vgdp_experiments.search.loop import SearchStep, search
from vgdp_experiments.search.searchers import Sight
from vgdp_experiments.search.views import SmallViews
from vgdp_planner.planning_grid import PlanningGrid

if TYPE_CHECKING:
    from pathlib import Path

    from vgdp_experiments.search.learned.demonstrations import HomeDemonstrations

COMMANDS = {name: f'search-{name.removeprefix("vgdp_").replace("_", "-")}' for name in LEARNED}


@pytest.fixture(scope='module')
def trained(data: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the folders of weights that were trained for two steps, by method."""
    folder = tmp_path_factory.mktemp('trained')
    for name in ('calvin_2d', 'vgdp_object', 'vgdp_rgbd', 'calvin_3d', 'no_projector'):
        initial = ['--initial', str(folder / 'calvin_2d')] if name == 'no_projector' else []
        options = ['--steps', '2', '--batch', '2', '--leave-out', 'Home_102_1', '--threads', '1']
        out = str(folder / name)
        assert (
            vgdp('train', COMMANDS[name], '--data', str(data), '--out', out, *options, *initial)
            == 0
        )
    return {name: folder / name for name in LEARNED}


def test_the_record_says_how_weights_came_about(trained: dict[str, Path]) -> None:
    """Homes that were left out were not trained on, and the budget is stated."""
    for folder in trained.values():
        training = json.loads((folder / 'config.json').read_text())['training']
        assert training['leave_out'] == 'Home_102_1'
        assert training['homes'] == ['Home_101_1']
        assert training['cpu_minutes'] >= 0
        assert all(np.isfinite(loss) for loss in training['losses'].values())
        assert not any('/' in str(value) for value in training.values())


def test_a_run_goes_on_from_its_checkpoint(data: Path, tmp_path: Path) -> None:
    """Stopped and gone on with, or in one go: the weights are the same."""
    options = f'--data {data} --batch 2 --threads 1 --checkpoint-every 2 --steps'.split()
    whole, parts = tmp_path / 'whole', tmp_path / 'parts'
    assert vgdp('train', 'search-rgbd', '--out', str(whole), *options, '3') == 0
    assert vgdp('train', 'search-rgbd', '--out', str(parts), *options, '3') == 0
    (parts / 'model.safetensors').unlink()
    assert vgdp('train', 'search-rgbd', '--out', str(parts), *options, '3') == 0
    first, second = (load_file(folder / 'model.safetensors') for folder in (whole, parts))
    for name, tensor in first.items():
        assert np.allclose(tensor, second[name], atol=1e-6), name
    assert vgdp('train', 'search-rgbd', '--out', str(parts), *options, '4') == 2


@pytest.mark.parametrize('name', LEARNED)
def test_each_method_searches_and_never_runs_into_what_it_knows(
    name: str, trained: dict[str, Path], home: Path
) -> None:
    """Whatever two steps of training made of it."""
    rules = SearchRules(min_expert_steps=3, max_steps=6)
    simulation = ActiveVisionSimulation(Scene.open(home, 96), rules)
    searcher = LEARNED[name](trained[name])
    decided: list[list[int]] = []

    def check(step: SearchStep) -> None:
        grid = step.observation.grid
        cell = np.array(grid.start)
        for action in step.committed:
            if action != DONE:
                cell = cell + STEPS[action]
                assert not grid.partial_map[OBSTACLE, cell[0], cell[1]]
        decided.append(step.committed)

    first = search(simulation, searcher, 1, on_step=check)
    assert first.steps > 0
    count = len(decided)
    assert search(simulation, searcher, 1, on_step=check) == first
    assert decided[:count] == decided[count:]


def test_safe_steps() -> None:
    """The best action that the map allows; none where nothing is left to see."""
    partial_map = np.zeros((3, 3, 3), dtype=np.float32)
    partial_map[FREE, 1, :2] = 1.0
    partial_map[OBSTACLE, 1, 2] = 1.0
    grid = PlanningGrid(partial_map, GridGeometry(3, 3, 0.3), (1, 1))
    q_values = np.zeros(9, dtype=np.float32)
    q_values[[DONE, 2, 6]] = 3.0, 2.0, 1.0
    assert safe_step(q_values, grid) == [6]
    partial_map[:2] = [np.ones((3, 3)), np.zeros((3, 3))]
    partial_map[:2, 1, 1] = 0.0, 1.0
    assert safe_step(q_values, grid) == []


@torch.no_grad()
def test_calvin_3d_is_told_what_was_refused(made: HomeDemonstrations, tmp_path: Path) -> None:
    """It wants to say Done everywhere, and as it may not it goes on instead of to and fro."""
    model = Calvin3D(Calvin3DConfig(channels=4))
    moves = model.log_kernels().new_full((NUM_MOVES, 9), -1.0)
    moves[torch.arange(NUM_MOVES), torch.from_numpy((STEPS + 1) @ [3, 1])] = 1.0
    model.motion_logits.copy_(moves)
    model.done_reward.fill_(10.0)
    for parameter in model.availability.parameters():
        parameter.fill_(0.0)
    # The last of them are the biases of the logits, and of their threshold.
    parameter.copy_(torch.tensor([9.0] * NUM_ACTIONS + [0.0]))
    model.save(tmp_path, {})
    searcher = LEARNED['calvin_3d'](tmp_path)
    searcher.reset(0)
    views = SmallViews(made.color[0], made.depth[0], made.points[0], made.bearings[0])
    corridor = np.zeros((3, 3, 9), dtype=np.float32)
    corridor[OBSTACLE] = 1.0
    corridor[OBSTACLE, 1, :8] = 0.0
    corridor[FREE, 1, 1:8] = 1.0
    cell = (1, 7)
    been = [cell]
    for _ in range(5):
        grid = PlanningGrid(corridor, GridGeometry(3, 9, 0.3), cell)
        (action,) = searcher.decide(Sight(grid, lambda: views))
        cell = (int(cell[0] + STEPS[action, 0]), int(cell[1] + STEPS[action, 1]))
        been.append(cell)
    assert been == [(1, col) for col in range(7, 1, -1)]


def test_looks_are_compared(
    data: Path, trained: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same choices for all, none of which is better than the best one."""
    file = tmp_path / 'looks.json'
    options = f'--data {data} --homes Home_102_1 --weights {trained["vgdp_object"]} --threads 1'
    ending = ['--decisions', '5', '--json', str(file)]
    assert vgdp('eval', 'looks', *options.split(), *ending) == 0
    assert 'object-search value' in capsys.readouterr().out
    scores = json.loads(file.read_text())['scores']
    assert len(scores) == 3
    for found in scores.values():
        assert found['mean'] >= 0
        assert 0 <= found['far'] <= 1
    assert vgdp('eval', 'looks', '--data', str(data), '--homes', 'Home_9_1') == 2
