"""Reports: what they compute, and that they survive being written."""

from __future__ import annotations

import io
import json
import math
import re
from typing import TYPE_CHECKING

import pytest
from rich.console import Console

from gridnav import EpisodeResult, Outcome
from vgdp_experiments.report import EvalConfig, Report, ReportError
from vgdp_experiments.scores import MethodResults, Trial

if TYPE_CHECKING:
    from pathlib import Path


def success(path_cost: float) -> EpisodeResult:
    """Return a success in a maze whose expert walks 20 cells in 20 steps."""
    return EpisodeResult(Outcome.SUCCESS, 41, path_cost, 20, 20.0)


def failure(outcome: Outcome) -> EpisodeResult:
    """Return an episode that ended otherwise."""
    return EpisodeResult(outcome, 7, 6 + math.sqrt(2), 20, 20.0)


@pytest.fixture
def report() -> Report:
    """Return two methods on two trials of two mazes."""
    return Report(
        config=EvalConfig(episodes=2, trials=2, seed=3),
        methods={
            'vgdp': MethodResults(
                settings={'execute': 2},
                trials=[
                    Trial(3, [success(25.0), success(40.0)], 60, 0.3),
                    Trial(4, [success(20.0), failure(Outcome.TIMEOUT)], 40, 0.2),
                ],
            ),
            'frontier': MethodResults(
                settings={},
                trials=[
                    Trial(3, [success(40.0), success(40.0)], 80, 0.008),
                    Trial(4, [success(40.0), success(40.0)], 80, 0.008),
                ],
            ),
        },
        command=['vgdp', 'eval', 'gridmaze'],
    )


def test_scores_of_a_hand_made_report(report: Report) -> None:
    """The numbers are those that can be worked out by hand."""
    scores = report.scores()
    vgdp = scores['vgdp']
    assert vgdp.summary.episodes == 4
    assert vgdp.summary.success == 0.75
    assert vgdp.summary.spl == pytest.approx((0.8 + 0.5 + 1.0 + 0.0) / 4)
    assert vgdp.summary.spl_steps == pytest.approx(3 * 0.5 / 4)
    assert vgdp.summary.steps == pytest.approx((3 * 41 + 7) / 4)
    assert vgdp.summary.failures == {'timeout': 1}
    assert vgdp.success_sd == pytest.approx(math.sqrt(0.125))
    assert vgdp.ms_per_decision == pytest.approx(5.0)
    assert vgdp.spl_ratio == pytest.approx(0.575 / 0.5)
    assert scores['frontier'].spl_ratio == 1.0


def test_world_of_a_report_survives_the_file(tmp_path: Path) -> None:
    """Both sides of a world and its kind come back as they were."""
    config = EvalConfig(size=(20, 30), kind='rooms', slip=0.1, episodes=1, trials=1)
    report = Report(config, {'vgdp': MethodResults({}, [Trial(0, [success(25.0)], 1, 1.0)])})
    report.save(tmp_path / 'report.json')
    assert Report.load(tmp_path / 'report.json') == report
    assert config.describe() == 'rooms of 20×30, view range 2, budget 500, slip 0.1'


def test_scores_that_need_more_are_missing(report: Report) -> None:
    """One trial has no deviation, and without the reference there is nothing to compare with."""
    alone = MethodResults({}, report.methods['vgdp'].trials[:1])
    (scores,) = Report(EvalConfig(), {'vgdp': alone}).scores().values()
    assert scores.success_sd is None
    assert scores.spl_ratio is None


def test_report_survives_the_file(report: Report, tmp_path: Path) -> None:
    """What is read is what was written, to the last digit, and nothing else is left behind."""
    path = tmp_path / 'report.json'
    path.write_text('an older file')
    report.save(path)
    assert Report.load(path) == report
    assert list(tmp_path.iterdir()) == [path]
    values = json.loads(path.read_text())
    assert values['schema_version'] == 1
    assert values['methods']['vgdp']['scores']['summary']['success'] == 0.75
    assert values['methods']['vgdp']['trials'][1]['episodes'][1][:2] == ['timeout', 7]
    assert 'numpy' in values['versions']


def test_a_failed_write_leaves_the_old_file(report: Report, tmp_path: Path) -> None:
    """A report that can't be written leaves what was there, and no half of itself."""
    path = tmp_path / 'report.json'
    path.write_text('an older file')
    report.methods['vgdp'].settings['broken'] = object()
    with pytest.raises(TypeError):
        report.save(path)
    assert path.read_text() == 'an older file'
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        ('{', 'Expecting'),
        ('[]', 'schema version 1 is needed, got None'),
        ('{"schema_version": 99}', 'schema version 1 is needed, got 99'),
        ('{"schema_version": 1}', 'damaged'),
        ('{"schema_version": 1, "config": {}, "methods": {"a": 3}}', 'damaged'),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: str, reason: str) -> None:
    """A file that holds no report is named, with the reason."""
    path = tmp_path / 'other.json'
    path.write_text(content)
    with pytest.raises(ReportError, match=reason):
        Report.load(path)


def test_table_shows_every_number(report: Report) -> None:
    """The table fits into 80 columns and has a column for each method."""
    console = Console(file=io.StringIO(), width=80)
    console.print(report.table())
    assert isinstance(console.file, io.StringIO)
    lines = [re.split('[│┃]', line)[1:-1] for line in console.file.getvalue().splitlines()]
    rows = {line[0].strip(): [cell.strip() for cell in line[1:]] for line in lines if line}
    assert rows[''] == ['vgdp', 'frontier']
    assert rows['success'] == ['0.750', '1.000']
    assert rows['95 % interval'] == ['0.301 … 0.954', '0.510 … 1.000']
    assert rows['over trials'] == ['0.750 ± 0.354', '1.000 ± 0.000']
    assert rows['SPL (path cost)'] == ['0.575', '0.500']
    assert rows['/ frontier'] == ['1.150', '1.000']
    assert rows['SPL (steps)'] == ['0.375', '0.500']
    assert rows['steps'] == ['32.5', '41.0']
    assert rows['failures'] == ['timeout 1', '–']
    assert rows['ms a decision'] == ['5', '0.1']
