"""Training the policy: resuming, checkpoints, and several processes that train as one."""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from maze_sim import make_mazes
from vgdp_experiments import train_policy, train_value_paper
from vgdp_experiments.data import Demonstrations, walk_expert
from vgdp_experiments.parallel import Team, training_team
from vgdp_experiments.preset_settings import read_preset_settings
from vgdp_experiments.train_policy import SETTINGS, DenoisingLoss, PolicyTraining
from vgdp_experiments.train_value_paper import PaperValueTraining
from vgdp_experiments.training import ValueParts
from vgdp_planner import preset
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.value import ValueNetwork

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

ALONE = Team(0, 1, torch.device('cpu'))

SMALL = PolicyTraining(
    steps=6, batch=4, accumulation=2, noises=2, checkpoint_every=3, device='cpu', threads=1
)


@pytest.fixture(scope='module')
def made() -> Demonstrations:
    """Return a few demonstrations."""
    return walk_expert(make_mazes(2, 15, 1), 2, 8)


@pytest.fixture
def data(made: Demonstrations, tmp_path: Path) -> str:
    """Return a file with a few demonstrations."""
    path = tmp_path / 'demonstrations.npz'
    np.savez(path, codes=made.codes, cells=made.cells, actions=made.actions, settings='{}')
    return str(path)


def fresh() -> DiffusionPolicy:
    """Return a policy that is always the same."""
    torch.manual_seed(0)
    return DiffusionPolicy(preset('default').policy)


def test_an_interrupted_training_goes_on_as_if_nothing_had_happened(
    made: Demonstrations, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped after its checkpoint and started again, a run ends with the very same weights."""
    whole, resumed = fresh(), fresh()
    losses = train_policy.train(whole, made, replace(SMALL, out=str(tmp_path / 'whole')), ALONE)
    stopped = replace(SMALL, out=str(tmp_path / 'stopped'))

    class StopError(Exception):
        """Ends a run in the middle."""

    draws = 0
    draw = Demonstrations.draw

    def stop(self: Demonstrations, count: int, rng: np.random.Generator) -> object:
        nonlocal draws
        draws += 1
        if draws == 5:
            raise StopError
        return draw(self, count, rng)

    with monkeypatch.context() as patch:
        patch.setattr(Demonstrations, 'draw', stop)
        with pytest.raises(StopError):
            train_policy.train(fresh(), made, stopped, ALONE)
    # Where it runs may change, and so may the folder's place.
    moved = (tmp_path / 'stopped').rename(tmp_path / 'moved')
    settings = replace(stopped, out=str(moved), threads=2, checkpoint_every=2)
    train_policy.train(resumed, made, settings, ALONE)
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name
    assert set(losses) == {'denoising'}
    # The run is at its end: once more changes nothing.
    assert train_policy.train(fresh(), made, settings, ALONE) == {}


def test_a_run_is_not_continued_with_other_settings(made: Demonstrations, tmp_path: Path) -> None:
    """Another learning rate for a run that has begun is refused, naming folder and setting."""
    settings = replace(SMALL, out=str(tmp_path), steps=1, checkpoint_every=1)
    train_policy.train(fresh(), made, settings, ALONE)
    with pytest.raises(ValueError, match=rf'{tmp_path} .*other settings \(learning_rate\)'):
        train_policy.train(fresh(), made, replace(settings, learning_rate=0.5), ALONE)


def test_checkpoints_hold_no_pickle(made: Demonstrations, tmp_path: Path) -> None:
    """A checkpoint is safetensors and JSON, the optimiser's state included."""
    settings = replace(SMALL, out=str(tmp_path), steps=1, checkpoint_every=1)
    train_policy.train(fresh(), made, settings, ALONE)
    checkpoint = {path.name for path in tmp_path.glob('checkpoint*')}
    assert checkpoint == {'checkpoint.safetensors', 'checkpoint.json'}
    tensors = load_file(tmp_path / 'checkpoint.safetensors')
    assert any(name.startswith('optimizer.') for name in tensors)


@pytest.mark.parametrize('passes', [1, 2, 4])
def test_passes_and_processes_see_the_same_samples(made: Demonstrations, passes: int) -> None:
    """However a step is dealt out, its gradients are those of all samples at once."""

    def gradients(settings: PolicyTraining, size: int) -> dict[str, torch.Tensor]:
        policy = fresh()
        loss = DenoisingLoss(policy)
        for rank in range(size):
            team = Team(rank, size, torch.device('cpu'))
            dealt = train_policy.passes(policy, made, settings, team, 7)
            for arguments in dealt:
                (loss(*arguments)['denoising'] / (size * len(dealt))).backward()
        return {
            name: parameter.grad
            for name, parameter in policy.named_parameters()
            if parameter.grad is not None
        }

    whole = gradients(replace(SMALL, batch=8, accumulation=1), 1)
    dealt = gradients(replace(SMALL, batch=8 // passes, accumulation=passes), 2)
    assert whole
    for name, gradient in whole.items():
        torch.testing.assert_close(gradient, dealt[name], rtol=1e-4, atol=1e-6, msg=name)


def train_both(folder: Path, made: Demonstrations, team: Team) -> None:
    """Train policy and value for two steps and write what came out."""
    common = {'steps': 2, 'batch': 4, 'accumulation': 2, 'device': 'cpu'}
    policy = fresh()
    settings = PolicyTraining(out=str(folder / 'policy'), **common)  # type: ignore[arg-type]
    losses = train_policy.train(policy, made, settings, team)
    both = ValueParts(ValueNetwork(preset('paper').value), BeliefFilter())
    value_settings = PaperValueTraining(
        out=str(folder / 'value'),
        **common,  # type: ignore[arg-type]
    )
    losses |= train_value_paper.train(both, made, value_settings, team)
    numbers = {name: torch.tensor(loss) for name, loss in losses.items()}
    save_file({**numbers, **policy.state_dict(), **both.state_dict()}, folder / 'both.safetensors')


ONE_OF_TWO = """
import importlib.util, sys
from pathlib import Path
import torch
from vgdp_experiments.data import load_demonstrations
from vgdp_experiments.parallel import training_team

spec = importlib.util.spec_from_file_location('tests_of_training', sys.argv[1])
tests = importlib.util.module_from_spec(spec)
spec.loader.exec_module(tests)
torch.set_num_threads(1)
with training_team('cpu') as team:
    tests.train_both(Path(sys.argv[2]), load_demonstrations(Path(sys.argv[3])), team)
"""


@pytest.mark.timeout(300)
def test_two_processes_train_as_one(made: Demonstrations, data: str, tmp_path: Path) -> None:
    """Two processes with half of each batch end with the weights and losses of one process."""
    folders = [tmp_path / name for name in ('first', 'second', 'alone')]
    for folder in folders:
        folder.mkdir()
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    # What `torchrun` tells its processes.
    told = {'WORLD_SIZE': '2', 'MASTER_ADDR': '127.0.0.1', 'MASTER_PORT': str(port)}
    processes = [
        subprocess.Popen(
            [sys.executable, '-c', ONE_OF_TWO, __file__, str(folders[rank]), data],
            env={**os.environ, **told, 'RANK': str(rank), 'LOCAL_RANK': str(rank)},
        )
        for rank in range(2)
    ]
    train_both(folders[2], made, ALONE)
    assert [process.wait() for process in processes] == [0, 0]
    first, second, alone = (load_file(folder / 'both.safetensors') for folder in folders)
    for name, tensor in alone.items():
        torch.testing.assert_close(first[name], tensor, rtol=1e-3, atol=1e-5, msg=name)
        assert torch.equal(first[name], second[name]), name
    # The first process alone writes logs and checkpoints.
    assert len((folders[0] / 'policy' / 'log.csv').read_text().splitlines()) == 2
    assert [path.name for path in folders[1].iterdir()] == ['both.safetensors']


def command_line(words: str) -> Callable[[], object]:
    """Return a function that trains as the command line says."""
    parser = argparse.ArgumentParser()
    train_policy.add_arguments(parser)
    return lambda: train_policy.run(parser.parse_args(words.split()))


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        ('--preset nonsense', "no preset named 'nonsense'"),
        ('--precision half', "one of auto, float32, bfloat16, got 'half'"),
        ('--device tpu', "one of auto, cpu, cuda, got 'tpu'"),
        ('--batch 0', '--batch must be at least 1, got 0'),
        ('--checkpoint-every 0', '--checkpoint-every must be at least 1, got 0'),
    ],
)
def test_settings_out_of_range(words: str, reason: str, data: str, tmp_path: Path) -> None:
    """What can not be is refused in one sentence that names it."""
    with pytest.raises(ValueError, match=reason):
        command_line(f'{words} --data {data} --out {tmp_path}')()


def test_plans_that_are_too_short_are_refused(data: str, tmp_path: Path) -> None:
    """Demonstrations of fewer steps than the policy plans are refused, with what to do."""
    with np.load(data) as arrays:
        short = {**arrays, 'actions': arrays['actions'][:, :4]}
    np.savez(data, **short)
    with pytest.raises(ValueError, match='hold plans of 4 steps and the policy needs 8'):
        command_line(f'--data {data} --out {tmp_path}')()


def test_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    """'auto' takes a GPU of its own where there is one; asking for one that is not is refused."""
    monkeypatch.setattr(torch.cuda, 'is_available', lambda: False)
    with training_team('auto') as team:
        assert (team.rank, team.size, team.device.type) == (0, 1, 'cpu')
    with pytest.raises(ValueError, match='no GPU here'), training_team('cuda'):
        pass
    monkeypatch.setattr(torch.cuda, 'is_available', lambda: True)
    monkeypatch.setattr(torch.cuda, 'device_count', lambda: 2)
    with training_team('auto') as team:
        assert team.device == torch.device('cuda', 0)
    monkeypatch.setenv('LOCAL_RANK', '2')
    with (
        pytest.raises(ValueError, match=r'Process 3 of this machine has no GPU.*there are 2'),
        training_team('cuda'),
    ):
        pass
    with pytest.raises(ValueError, match='batch of 5 can not be dealt out evenly to 2'):
        Team(0, 2, torch.device('cpu')).share(0, 5)


def test_the_papers_hyperparameters() -> None:
    """The appendix's table: what `--preset paper` trains with unless the options say otherwise."""
    parser = argparse.ArgumentParser()
    train_policy.add_arguments(parser)
    arguments = parser.parse_args(['--preset', 'paper', '--seed', '3'])
    settings = read_preset_settings(arguments, SETTINGS)
    assert settings == replace(SETTINGS['paper'], seed=3)
    value = PaperValueTraining()
    for run in (settings, value):
        assert (run.batch, run.accumulation, run.ema) == (32, 2, 0.995)
        assert run.steps == 60 * 10_000
    assert settings.learning_rate == 2e-4
    assert value.learning_rate == 0.005
    policy = preset('paper').policy
    assert (policy.diffusion_steps, policy.prediction) == (32, 'epsilon')
