"""CALVIN: its network, its training and the method that steps on it."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from torch.nn import functional

from gridnav import DONE, FREE, GOAL, NUM_ACTIONS, NUM_MOVES, OBSTACLE, STEPS, Outcome
from maze_sim import make_mazes
from vgdp_experiments import train_calvin
from vgdp_experiments.calvin import Calvin, CalvinConfig, load_calvin, save_calvin
from vgdp_experiments.commands import register
from vgdp_experiments.data import Demonstrations, walk_expert
from vgdp_experiments.evaluate import evaluate
from vgdp_experiments.methods.calvin import AutoregressiveCalvin
from vgdp_experiments.parallel import Team
from vgdp_experiments.train_calvin import CalvinTraining, ImitationLoss, passes, steps_before
from vgdp_planner.weights import WeightsError

if TYPE_CHECKING:
    from pathlib import Path

ALONE = Team(0, 1, torch.device('cpu'))

SMALL = CalvinTraining(steps=4, batch=8, checkpoint_every=2, device='cpu', threads=1)


@pytest.fixture(scope='module')
def made() -> Demonstrations:
    """Return the expert's ways through a few mazes."""
    return walk_expert(make_mazes(5, 15, 1), 2, 4)


def fresh(rounds: int = 1) -> Calvin:
    """Return a small network that nobody has trained, but which has opinions."""
    torch.manual_seed(0)
    model = Calvin(CalvinConfig(channels=8, rounds=rounds))
    for parameter in model.parameters():
        torch.nn.init.normal_(parameter, std=0.5)
    return model


def random_maps(*shape: int) -> torch.Tensor:
    """Return partial maps of noise, (B, 3, H, W)."""
    kinds = torch.from_numpy(np.random.default_rng(0).integers(3, size=shape))
    maps = torch.zeros((shape[0], 3, *shape[1:]))
    maps[:, OBSTACLE], maps[:, FREE] = (kinds == 0).float(), (kinds == 1).float()
    maps[:, GOAL, 2, 2] = 1.0
    return maps


def test_size_of_the_network() -> None:
    """One 3 x 3 convolution of 150 channels and a 1 x 1; kernels and costs of eight steps."""
    counts = {name: value.numel() for name, value in Calvin(CalvinConfig()).named_parameters()}
    assert counts == {
        'motion_logits': 8 * 9,
        'step_cost': 8 * 9,
        'done_reward': 1,
        'failure_cost': 1,
        'availability.0.weight': 150 * 4 * 9,
        'availability.0.bias': 150,
        'availability.2.weight': 10 * 150,
        'availability.2.bias': 10,
    }


@torch.no_grad()
def test_q_values_obey_the_bellman_equation() -> None:
    """Q is R̂ + γ Â Σ T̂ max Q, on maps that are not square; nothing comes after Done."""
    model = fresh(rounds=100)
    maps = random_maps(2, 6, 9)
    found = model(maps)
    assert found.q_values.shape == found.logits.shape == (2, NUM_ACTIONS, 6, 9)
    kernels = model.log_kernels().exp().view(NUM_MOVES, 1, 3, 3)
    torch.testing.assert_close(kernels.sum(dim=(1, 2, 3)), torch.ones(NUM_MOVES))
    values = found.q_values.amax(dim=1, keepdim=True)
    ahead = functional.conv2d(values, kernels, padding=1)
    ahead = torch.cat([ahead, torch.zeros_like(values)], dim=1)
    costs = (kernels.flatten(1) * functional.softplus(model.step_cost)).sum(dim=1)
    rewards = torch.cat([-costs, model.done_reward])[:, None, None]
    failed = -functional.softplus(model.failure_cost)
    expected = found.available * (rewards + 0.99 * ahead) + (1 - found.available) * failed
    torch.testing.assert_close(found.q_values, expected, rtol=1e-4, atol=1e-4)
    assert (costs > 0).all()


@torch.no_grad()
def test_rounds_grow_with_the_map() -> None:
    """With one round for each cell of a side, news travels that far and no further."""
    model = fresh()
    model.motion_logits.copy_(-100.0 * torch.ones(NUM_MOVES, 9))
    model.motion_logits[torch.arange(8), torch.from_numpy((STEPS + 1) @ [3, 1])] = 0.0
    maps = torch.zeros(1, 3, 3, 12)
    q_values = model(maps).q_values
    maps[0, GOAL, 1, 0] = 1.0
    changed = (model(maps).q_values != q_values).any(dim=1)[0, 1]
    assert changed[:2].all()
    tall = torch.zeros(1, 3, 12, 3)
    tall[0, GOAL, 0, 1] = 1.0
    assert not torch.equal(model(tall).q_values, model(torch.zeros(1, 3, 12, 3)).q_values)


def test_weights_come_back(tmp_path: Path) -> None:
    """What is saved is loaded; a folder without weights, or with damaged ones, is named."""
    with pytest.raises(WeightsError, match=r'no weights of CALVIN in .*vgdp train calvin'):
        load_calvin(tmp_path)
    model = fresh()
    save_calvin(tmp_path, model, {'seed': 7})
    loaded = load_calvin(tmp_path)
    assert loaded.config == model.config
    for name, value in model.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], value), name
    assert json.loads((tmp_path / 'config.json').read_text())['training'] == {'seed': 7}
    whole = (tmp_path / 'model.safetensors').read_bytes()
    (tmp_path / 'model.safetensors').write_bytes(whole[:-9])
    with pytest.raises(WeightsError, match='does not hold undamaged weights of CALVIN'):
        load_calvin(tmp_path)


def test_steps_before(made: Demonstrations) -> None:
    """Followed back from its Done, each of the expert's ways is found whole."""
    before = steps_before(made)
    lengths = []
    for end in np.flatnonzero(made.actions[:, 0] == DONE):
        index, steps = end, 1
        while before[index] >= 0:
            earlier = before[index]
            step = STEPS[made.actions[earlier, 0]]
            assert np.array_equal(made.cells[earlier] + step, made.cells[index])
            index, steps = earlier, steps + 1
        lengths.append(steps)
    assert sorted(lengths) == sorted(maze.expert_steps + 1 for maze in make_mazes(5, 15, 1))


def test_maps_come_with_the_steps_that_led_there(made: Demonstrations) -> None:
    """Each map is used for the last steps of its way, the longer ago the less they count."""
    settings = replace(SMALL, batch=64, past=3, past_weight=0.5)
    ((maps, cells, actions, weights),) = passes(made, steps_before(made), settings, ALONE, 0)
    assert maps.shape == (64, 3, 15, 15)
    assert cells.shape == (64, 4, 2)
    assert (weights == 1.0 * (weights > 0) * torch.tensor([1.0, 0.5, 0.25, 0.125])).all()
    assert (weights > 0).sum(dim=0).tolist() == sorted((weights > 0).sum(dim=0).tolist())[::-1]
    followed = cells[:, 1:] + torch.from_numpy(np.vstack([STEPS, [0, 0]]))[actions[:, 1:]]
    there = weights[:, 1:] > 0
    assert there.sum() > 64
    assert torch.equal(followed[there], cells[:, :-1][there])
    # The steps of long ago lie on the map of now.
    index = torch.arange(64)[:, None].expand(-1, 4)
    seen = maps[index, FREE, cells[..., 0], cells[..., 1]]
    assert (seen[weights > 0] == 1).all()


def test_losses_fall(made: Demonstrations, tmp_path: Path) -> None:
    """A few steps of training lower all three losses."""
    model = Calvin(CalvinConfig(channels=16, rounds=1))
    settings = replace(SMALL, out=str(tmp_path), steps=20, batch=16, ema=0.5)
    loss = ImitationLoss(model)
    (batch,) = passes(made, steps_before(made), replace(settings, batch=128), ALONE, 0)
    before = {name: float(value.detach()) for name, value in loss(*batch).items()}
    train_calvin.train(model, made, settings, ALONE)
    after = {name: float(value.detach()) for name, value in loss(*batch).items()}
    assert all(after[name] < before[name] for name in before), (before, after)
    assert (tmp_path / 'log.csv').read_text().startswith('step,action,available,motion')


def test_an_interrupted_training_goes_on(
    made: Demonstrations, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped after its checkpoint and started again, a run ends with the very same weights."""
    whole, resumed = fresh(), fresh()
    train_calvin.train(whole, made, replace(SMALL, out=str(tmp_path / 'whole')), ALONE)
    settings = replace(SMALL, out=str(tmp_path / 'stopped'))

    class StopError(Exception):
        """Ends a run in the middle."""

    def stop(*arguments: object) -> object:
        if arguments[-1] == 3:
            raise StopError
        return passes(*arguments)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(train_calvin, 'passes', stop)
        with pytest.raises(StopError):
            train_calvin.train(fresh(), made, settings, ALONE)
    train_calvin.train(resumed, made, settings, ALONE)
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name


def vgdp(command: str) -> int:
    """Run a command and return its exit status."""
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers(required=True))
    args = parser.parse_args(command.split())
    status: int = args.run(args)
    return status


def test_missing_weights_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Evaluating CALVIN without weights says how to make them, in one sentence."""
    assert vgdp(f'eval gridmaze --episodes 1 --method calvin --calvin-weights {tmp_path}') == 2
    said = capsys.readouterr().err
    assert said == (
        f'error: There are no weights of CALVIN in {tmp_path}; make them with '
        '`vgdp train calvin`.\n'
    )


def test_the_command_trains(made: Demonstrations, tmp_path: Path) -> None:
    """`vgdp train calvin` writes weights that load, with the record of how they came about."""
    data = tmp_path / 'd.npz'
    np.savez(
        data, codes=made.codes, cells=made.cells, actions=made.actions, settings='{"mazes": 5}'
    )
    options = f'--data {data} --out {tmp_path} --steps 2 --batch 4 --device cpu --threads 1'
    assert vgdp(f'train calvin {options}') == 0
    assert load_calvin(tmp_path).config == CalvinConfig()
    record = json.loads((tmp_path / 'config.json').read_text())['training']
    assert record['steps'] == 2
    assert record['demonstrations'] == {'mazes': 5}
    assert set(record['losses']) == {'action', 'available', 'motion'}


@torch.no_grad()
def test_the_method_takes_the_best_action_where_the_robot_is() -> None:
    """It is argmax Q at the robot's cell, planned anew when the map has changed."""
    model = fresh()
    method = AutoregressiveCalvin(model)
    maps = random_maps(4, 7, 7).numpy()
    cells = np.array([[1, 1], [2, 3], [5, 5], [0, 6]])
    active = np.array([True, True, False, True])
    method.reset(range(4), seed=0)
    for _ in range(3):
        before = maps.copy()
        q_values = model(torch.from_numpy(maps)).q_values.numpy()
        best = q_values[np.arange(4), :, cells[:, 0], cells[:, 1]].argmax(axis=1)
        expected = [[action] for action in best]
        expected[2] = []
        assert method.act(maps, cells, active) == expected
        assert np.array_equal(maps, before)
        maps[:2] = 1 - maps[:2]
        cells = cells[::-1].copy()


@pytest.mark.timeout(120)
def test_the_shipped_weights_find_goals() -> None:
    """In mazes that nobody trained on, most goals are found, in larger ones, too."""
    method = AutoregressiveCalvin(load_calvin())
    for size, count, least in ((15, 25, 0.8), (20, 10, 0.7)):
        trial = evaluate(method, make_mazes(count, size, 4321), 2, 200, 0)
        outcomes = [result.outcome for result in trial.results]
        assert outcomes.count(Outcome.SUCCESS) >= least * len(outcomes)


def test_it_may_fail() -> None:
    """Nothing keeps it from walls: untrained, its first steps run into them."""
    method = AutoregressiveCalvin(fresh())
    trial = evaluate(method, make_mazes(5, 15, 0), 2, 30, 0)
    assert {result.outcome for result in trial.results} <= {
        Outcome.COLLISION,
        Outcome.FALSE_DONE,
        Outcome.TIMEOUT,
    }
