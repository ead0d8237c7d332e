"""The experiments' part of the ``vgdp`` command, from the command line to its exit status."""

from __future__ import annotations

import argparse
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
import torch

from vgdp_experiments import commands
from vgdp_experiments.report import Report
from vgdp_planner import Config, PlannerConfig, ValueGuidedPlanner
from vgdp_planner.weights import save_weights

if TYPE_CHECKING:
    from pathlib import Path


def vgdp(*arguments: str) -> int:
    """Run a command and return its exit status."""
    parser = argparse.ArgumentParser(prog='vgdp')
    commands.register(parser.add_subparsers(required=True))
    args = parser.parse_args(arguments)
    status: int = args.run(args)
    return status


@pytest.fixture(scope='module')
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a folder with weights that nobody has trained."""
    torch.manual_seed(0)
    planner = ValueGuidedPlanner(Config())
    tensors = {
        f'{part}.{name}': tensor
        for part, module in planner.modules().items()
        for name, tensor in module.state_dict().items()
    }
    folder = tmp_path_factory.mktemp('weights')
    save_weights(folder, planner.config, tensors, {})
    return str(folder)


def test_eval_runs_all_methods_on_the_same_mazes(
    tmp_path: Path, weights: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without --method all of them are evaluated; the report and the table come out."""
    path = tmp_path / 'new' / 'report.json'
    options = '--episodes 2 --trials 2 --seed 4 --budget 40 --batch 1 --view-range 1 --size 16'
    status = vgdp('eval', 'gridmaze', *options.split(), '--weights', weights, '--json', str(path))
    assert status == 0
    report = Report.load(path)
    assert list(report.methods) == ['vgdp', 'frontier', 'clairvoyant']
    assert report.methods['vgdp'].settings['planner']['candidates'] == PlannerConfig().candidates
    assert [trial.seed for trial in report.methods['frontier'].trials] == [4, 5]
    mazes = [
        [
            (result.expert_steps, result.expert_cost)
            for trial in method.trials
            for result in trial.results
        ]
        for method in report.methods.values()
    ]
    assert mazes[0] == mazes[1] == mazes[2]
    assert len(set(mazes[0])) > 1
    assert report.scores()['clairvoyant'].summary.success == 1.0
    output = capsys.readouterr().out
    assert '2 x 2 mazes of 16×16, view range 1, budget 40' in output
    assert 'clairvoyant' in output


def test_eval_runs_only_the_methods_asked_for(tmp_path: Path) -> None:
    """--method names them, each once, and the same seed gives the same results."""
    reports = []
    for name in ('one.json', 'two.json'):
        options = '--episodes 2 --trials 1 --method frontier frontier --json'
        assert vgdp('eval', 'gridmaze', *options.split(), str(tmp_path / name)) == 0
        reports.append(Report.load(tmp_path / name))
    assert list(reports[0].methods) == ['frontier']
    first, second = (report.methods['frontier'].trials[0].results for report in reports)
    assert first == second


@pytest.mark.parametrize(
    ('options', 'shown'),
    [
        ('--size 20x30 --kind rooms', 'rooms of 20×30, view range 2, budget 500'),
        ('--map office --budget 2000', 'office, view range 2, budget 2000'),
        ('--slip 0.2 --budget 1000', '15×15, view range 2, budget 1000, slip 0.2'),
    ],
)
def test_eval_in_other_worlds(
    options: str, shown: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exploration arrives in every kind of world, and where steps slip."""
    quick = '--episodes 2 --trials 1 --method frontier'
    assert vgdp('eval', 'gridmaze', *quick.split(), *options.split()) == 0
    output = capsys.readouterr().out
    assert shown in ' '.join(output.split())
    assert '1.000' in output


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        (['--size', '4'], "'4' is not a whole number from 5"),
        (['--size', '20x4'], "'4' is not a whole number from 5"),
        (['--size', '20x20x20'], "'20x20x20' is no size like 15 or 20x30"),
        (['--kind', 'forest'], "invalid choice: 'forest'"),
        (['--map', 'nowhere.yaml', '--method', 'frontier'], 'nowhere.yaml'),
        (['--slip', '2', '--method', 'frontier'], 'slip must be 0 to 1, got 2.0'),
        (['--slip', '0.1', '--method', 'clairvoyant'], 'clairvoyant needs exact steps and poses'),
        (['--episodes', '0'], "'0' is not a whole number from 1"),
        (['--budget', 'many'], "'many' is not a whole number from 1"),
        (['--seed', '-1'], "'-1' is not a whole number from 0"),
        (['--method', 'oracle'], "invalid choice: 'oracle'"),
        (['--device', 'abacus'], "there is no device 'abacus' here"),
        (['--size', '6', '--method', 'frontier'], 'size 6 x 6 was found'),
        (['--json', '.', '--method', 'frontier'], '. is a folder; --json needs a file.'),
        (['--weights', 'nowhere', '--method', 'vgdp'], 'There are no weights in nowhere'),
    ],
)
def test_wrong_options_are_named(
    options: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A value that can't be used ends the command with status 2 and says why."""
    with pytest.raises(SystemExit) as stop:
        sys.exit(vgdp('eval', 'gridmaze', '--episodes', '1', '--trials', '1', *options))
    assert stop.value.code == 2
    assert reason in capsys.readouterr().err


def test_bench_sim_hands_its_options_on(capsys: pytest.CaptureFixture[str]) -> None:
    """The simulator's own program gets the rest of the command line."""
    assert vgdp('bench', 'sim', '--seconds', '0.01', '--num-envs', '3') == 0
    assert '3 environments at once' in capsys.readouterr().out


def test_a_command_is_imported_when_it_is_used() -> None:
    """Registering the commands loads neither PyTorch nor NumPy."""
    program = (
        'import argparse, sys\n'
        'from vgdp_experiments import commands\n'
        'commands.register(argparse.ArgumentParser().add_subparsers())\n'
        "sys.exit('torch' in sys.modules or 'numpy' in sys.modules)"
    )
    subprocess.run([sys.executable, '-c', program], check=True)


@pytest.mark.parametrize('group', commands.GROUPS)
def test_every_command_explains_its_options(
    group: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """--help of each command lists options of its module."""
    for name in commands.GROUPS[group][1]:
        with pytest.raises(SystemExit) as stop:
            vgdp(group, name, '--help')
        assert stop.value.code == 0
        assert '--' in capsys.readouterr().out.replace('--help', '')
