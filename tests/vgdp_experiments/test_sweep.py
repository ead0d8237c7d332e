"""Evaluations in parts: run, stopped and gone on with, dealt out, joined and shown."""

from __future__ import annotations

import argparse
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import torch

from vgdp_experiments import suite as suite_module
from vgdp_experiments import sweep
from vgdp_experiments.commands import register
from vgdp_experiments.jobs import Job, Machinery, Part, PartError, Variant, run_job
from vgdp_experiments.merge import SUITES as ALL_SUITES
from vgdp_experiments.merge import page_of
from vgdp_experiments.methods.registry import METHODS
from vgdp_experiments.results import Results, ResultsError, load_parts
from vgdp_experiments.settings import Setting
from vgdp_planner import Config, ValueGuidedPlanner
from vgdp_planner.weights import save_weights

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from vgdp_experiments.suite import Suite

SUITES = {
    name: suite
    for name, suite in ALL_SUITES.items()
    if all(isinstance(setting, Setting) for setting in suite.settings.values())
}
"""The evaluations in mazes."""

QUICK = '--method frontier clairvoyant --setting 15-view2 20-view2 --trials 2 --episodes 5'


def vgdp(*arguments: str) -> int:
    """Run a command and return its exit status."""
    parser = argparse.ArgumentParser(prog='vgdp')
    register(parser.add_subparsers(required=True))
    args = parser.parse_args(arguments)
    status: int = args.run(args)
    return status


def table(folder: Path, *options: str) -> int:
    """Run a small part of the table."""
    return vgdp('eval', 'table', *QUICK.split(), '--out', str(folder), *options)


def merge(out: Path, *arguments: str) -> int:
    """Join what `table` leaves."""
    return vgdp('eval', 'merge', *arguments, '-o', str(out), *QUICK.split())


@pytest.fixture(scope='module', autouse=True)
def small_blocks() -> Iterator[None]:
    """Let a trial of five mazes be two jobs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suite_module, 'BLOCK', 3)
        yield


@pytest.fixture(scope='module')
def whole_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with all parts of `QUICK`, to be left as it is."""
    folder = tmp_path_factory.mktemp('parts')
    assert table(folder) == 0
    return folder


@pytest.fixture
def complete(whole_run: Path, tmp_path: Path) -> Path:
    """Return a folder with all parts of `QUICK`."""
    return Path(shutil.copytree(whole_run, tmp_path / 'complete'))


def times(folder: Path) -> dict[str, int]:
    """Return when each part was written."""
    return {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}


def test_table_with_the_papers_columns(complete: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The paper's numbers stand beside ours where they are asked for, and only there."""
    assert table(complete) == 0
    assert '0.906' not in capsys.readouterr().out
    assert table(complete, '--paper') == 0
    output = capsys.readouterr().out
    line = next(line for line in output.splitlines() if line.startswith('| 15×15, view range 2'))
    cells = [cell.strip() for cell in line.strip('|').split('|')]
    assert cells[1:4] == ['0.855 ± 0.030', '0.060 ± 0.022', '0.906 ± 0.010']
    assert cells[4:] == ['1.000 ± 0.000', '1.000 ± 0.000']


def test_a_stopped_run_goes_on_where_it_was(
    complete: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only the part that is not there is run, and comes out as before."""
    path = complete / '20_view2_frontier_1_3.json'
    before, episodes = times(complete), Part.load(path).trial.results
    path.unlink()
    assert table(complete) == 0
    assert '15 parts are there already.' in capsys.readouterr().err
    after = times(complete)
    assert before.keys() == after.keys()
    assert [name for name in before if after[name] != before[name]] == [path.name]
    assert Part.load(path).trial.results == episodes


def test_shards_and_processes_make_the_same_whole(tmp_path: Path, complete: Path) -> None:
    """Two shares, one of them run by two processes, join to what one run finds."""
    one, two = tmp_path / 'one', tmp_path / 'two'
    assert table(one, '--shard', '1/2') == 0
    assert table(two, '--shard', '2/2', '--workers', '2') == 0
    assert not times(one).keys() & times(two).keys()
    assert merge(tmp_path / 'a.json', str(one), str(two)) == 0
    assert merge(tmp_path / 'b.json', str(complete)) == 0
    joined, whole = (Results.load(tmp_path / name) for name in ('a.json', 'b.json'))
    for place, results in whole.places.items():
        assert (results.trials, results.episodes) == (2, 5)
        for name, method in results.methods.items():
            assert [trial.results for trial in joined.places[place].methods[name].trials] == [
                trial.results for trial in method.trials
            ]


def test_merge_names_what_is_missing(
    tmp_path: Path, complete: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A hole is refused with its name; nothing is written."""
    (complete / '15_view2_frontier_1_3.json').unlink()
    assert merge(tmp_path / 'a.json', str(complete)) == 2
    error = capsys.readouterr().err
    assert '1 of 16 parts are missing: frontier, 15-view2, trial 1, mazes 3 to 4.' in error
    assert not (tmp_path / 'a.json').exists()
    assert merge(tmp_path / 'a.json', str(complete), '--scenes', 'Home_113_1') == 2
    assert 'these are parts of table' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (lambda v: v['weights'].update(planner='other'), 'were made with different weights'),
        (lambda v: v['settings'].update(execute=3), 'were made with different settings'),
        (lambda v: v['experts']['steps'].reverse(), 'was on other mazes than'),
        (lambda v: v['job']['setting'].update(budget=7), 'budget=7'),
        (lambda v: v['job'].update(suite='ablation'), 'holds parts of ablation, table'),
        (lambda v: v.update(schema_version=99), 'schema version 1 is needed'),
        (lambda v: v.pop('trial'), 'holds no part of an evaluation'),
    ],
)
def test_merge_refuses_what_does_not_belong_together(
    tmp_path: Path,
    complete: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[dict[str, dict[str, object]]], object],
    reason: str,
) -> None:
    """One part that differs is refused with the reason."""
    for path in complete.glob('*_1_0.json'):
        values = json.loads(path.read_text())
        values['weights'] = {'planner': 'same'}
        path.write_text(json.dumps(values))
    path = complete / '15_view2_frontier_1_0.json'
    values = json.loads(path.read_text())
    change(values)
    path.write_text(json.dumps(values))
    assert merge(tmp_path / 'a.json', str(complete)) == 2
    assert reason in capsys.readouterr().err


def test_the_same_part_twice_must_be_the_same(complete: Path) -> None:
    """A part of two folders is taken once; with other episodes it is refused."""
    jobs = SUITES['table'].jobs(['15-view2'], ['frontier'], 1, 3)
    parts = [part for part in load_parts([complete]) if part.job in jobs]
    twice = [*parts, *parts]
    assert len(Results.join(twice, jobs).places['15-view2'].methods) == 1
    twice[1] = replace(parts[0], trial=replace(parts[0].trial, results=[]))
    with pytest.raises(ResultsError, match='There are two parts for'):
        Results.join(twice, jobs)


def test_a_run_refuses_a_folder_of_another_job(
    complete: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Parts with other mazes than those asked for are not taken for done."""
    assert table(complete, '--episodes', '2') == 2
    assert 'take another folder' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        (['--shard', '0/3'], "'0/3' is no share like 3/8"),
        (['--shard', '4/3'], "'4/3' is no share like 3/8"),
        (['--shard', 'half'], "'half' is no share like 3/8"),
        (['--workers', '0'], "'0' is not a whole number from 1"),
        (['--method', 'oracle'], "invalid choice: 'oracle'"),
        (['--setting', 'nowhere'], "invalid choice: 'nowhere'"),
    ],
)
def test_wrong_options_are_named(
    tmp_path: Path, options: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A value that can't be used ends the command with status 2 and says why."""
    with pytest.raises(SystemExit) as stop:
        table(tmp_path, *options)
    assert stop.value.code == 2
    assert reason in capsys.readouterr().err


@pytest.fixture(scope='module')
def weights(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], Path]:
    """Return a function that writes weights that nobody has trained."""

    def write(seed: int) -> Path:
        torch.manual_seed(seed)
        planner = ValueGuidedPlanner(Config())
        tensors = {
            f'{part}.{name}': tensor
            for part, module in planner.modules().items()
            for name, tensor in module.state_dict().items()
        }
        folder = tmp_path_factory.mktemp('weights')
        save_weights(folder, planner.config, tensors, {'seed': seed})
        return folder

    return write


def test_a_part_remembers_its_weights(
    tmp_path: Path, weights: Callable[[int], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """The same weights are known again in another folder; others are refused."""
    ablation = replace(SUITES['ablation'], settings={'15-view2': Setting(15, budget=4)})
    parser = argparse.ArgumentParser()
    sweep.add_arguments(ablation, parser)
    options = ['--method', 'vgdp', '--episodes', '1', '--trials', '1', '--out', str(tmp_path)]
    one, same, other = weights(0), weights(0), weights(1)
    for folder in (one, same):
        assert sweep.run(ablation, parser.parse_args([*options, '--weights', str(folder)])) == 0
    assert '1 parts are there already.' in capsys.readouterr().err
    with pytest.raises(PartError, match='is of weights'):
        sweep.run(ablation, parser.parse_args([*options, '--weights', str(other)]))


def test_settings_of_a_variant_reach_the_planner(weights: Callable[[int], Path]) -> None:
    """Each point of a curve is made with its own setting, on the mazes of its block."""
    variant = Variant('vgdp', {'candidates': 3})
    job = Job('curves', 'here', Setting(15, budget=4), 'candidates-3', variant, 0, 3, 2)
    part = run_job(job, Machinery(weights(0), batch=1), print)
    assert part.settings['planner']['candidates'] == 3
    mazes = Setting(15).mazes(range(3, 5), 0)
    assert [r.expert_cost for r in part.trial.results] == [m.expert_cost for m in mazes]


def test_blocks_change_nothing(weights: Callable[[int], Path]) -> None:
    """An episode comes out the same in whichever block it is run."""
    machinery = Machinery(weights(0))
    job = Job('table', 'here', Setting(15, budget=12), 'vgdp', Variant('vgdp'), 1, 0, 4)
    whole, tail = (
        run_job(replace(job, first=first, episodes=4 - first), machinery, print).trial.results
        for first in (0, 2)
    )
    assert whole[2:] == tail


def _of_command(text: str, suite: Suite) -> list[Job]:
    """Return the jobs of the command on a page, which would run for hours if it named too few."""
    (words,) = re.findall(rf'`vgdp eval {suite.name} (.*)`', text)
    parser = argparse.ArgumentParser()
    sweep.add_arguments(suite, parser)
    return sweep.selected(suite, parser.parse_args(words.removeprefix('--paper ').split()))


@pytest.mark.parametrize('name', SUITES)
def test_every_evaluation_has_its_page(
    tmp_path: Path, weights: Callable[[int], Path], name: str
) -> None:
    """With some settings and methods of each, the page shows them and its pictures."""
    suite = SUITES[name]
    # The fourth method of the table has weights of its own.
    names = [key for key in [*suite.variants][:4] if key != 'calvin']
    jobs = [
        replace(job, setting=replace(job.setting, size=15, map='', budget=3))
        for job in suite.jobs([*suite.settings][:2], names, trials=2, episodes=2)
        if isinstance(job.setting, Setting)
    ]
    parts = [run_job(job, Machinery(weights(0)), print) for job in jobs]
    path = tmp_path / 'results.json'
    Results.join(parts, jobs).save(path)
    page = page_of(path)
    assert page.text.startswith('# ')
    assert {job.title for job in _of_command(page.text, suite)} == {job.title for job in jobs}
    for picture, figure in page.pictures.items():
        assert f']({picture})' in page.text
        figure.savefig(tmp_path / picture)
    assert page.text.count('](') == len(page.pictures)
    for place in dict.fromkeys(job.setting.describe() for job in jobs):
        assert place in page.text
    for method in names:
        assert f'| `{method}` |' in page.text


def test_all_methods_of_the_evaluations_exist() -> None:
    """What a suite names is a method, and every suite can list its jobs."""
    for suite in SUITES.values():
        jobs = suite.jobs(list(suite.settings), list(suite.variants), 1, 4)
        assert len({job.file_name for job in jobs}) == len(jobs)
        assert {job.variant.method for job in jobs} <= set(METHODS)
