"""What an evaluation found: results of every episode, as JSON and as a table."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict, dataclass, field
from importlib import metadata
from typing import TYPE_CHECKING, Any

from rich.table import Table

from gridnav import EpisodeResult, Outcome, Summary, summarize
from vgdp_experiments.files import write_whole
from vgdp_experiments.scores import REFERENCE, MethodResults, Scores, Trial, score_methods
from vgdp_experiments.settings import Setting

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

SCHEMA_VERSION = 1
"""Rises with any change after which older readers would misread a report."""

EPISODE_FIELDS = ('outcome', 'steps', 'path_cost', 'expert_steps', 'expert_cost')

PACKAGES = ('vgdp_experiments', 'vgdp_planner', 'maze_sim', 'numpy', 'scipy', 'torch')


class ReportError(ValueError):
    """A file does not hold a report."""


@dataclass(frozen=True)
class EvalConfig(Setting):
    """What was evaluated.

    Attributes:
        episodes: Mazes in a trial.
        trials: Number of trials; trial k has the mazes `Setting.mazes(range(episodes), seed + k)`.
        seed: Of the first trial.
        batch: Episodes run at once.
    """

    episodes: int = 500
    trials: int = 5
    seed: int = 0
    batch: int = 100


def current_versions() -> dict[str, str]:
    """Return the versions of Python and of what the results depend on, where installed."""
    versions = {'python': platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return versions


@dataclass(frozen=True)
class Report:
    """All methods of an evaluation, each on the same mazes.

    Attributes:
        config: What was evaluated.
        methods: Results by the method's name.
        command: The command line that made the report.
        versions: Of Python and of the packages that the results depend on.
    """

    config: EvalConfig
    methods: dict[str, MethodResults]
    command: list[str] = field(default_factory=list)
    versions: dict[str, str] = field(default_factory=current_versions)

    def scores(self) -> dict[str, Scores]:
        """Score every method."""
        return score_methods(self.methods)

    def save(self, path: Path) -> None:
        """Write the report as JSON. The file is there as a whole or, if that fails, not at all."""
        write_whole(path, json.dumps(self.to_dict()) + '\n')

    @classmethod
    def load(cls, path: Path) -> Report:
        """Read a report.

        Raises:
            ReportError: If the file does not hold one, with one sentence that says why.
        """
        try:
            return cls.from_dict(json.loads(path.read_text(encoding='utf-8')))
        except (OSError, ValueError) as error:
            msg = f'{path} holds no report: {error}'
            raise ReportError(msg) from error

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain values, ready for JSON, with the scores of each method."""
        scores = self.scores()
        return {
            'schema_version': SCHEMA_VERSION,
            'command': self.command,
            'versions': self.versions,
            'config': self.config.to_dict(),
            'episode_fields': list(EPISODE_FIELDS),
            'methods': {
                name: {
                    'scores': asdict(scores[name]),
                    'settings': results.settings,
                    'trials': [_trial_to_dict(trial) for trial in results.trials],
                }
                for name, results in self.methods.items()
            },
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Report:
        """Build a report from `to_dict`'s output; the scores are computed anew.

        Raises:
            ReportError: If the values are no report of this schema, with a sentence that says so.
        """
        version = values.get('schema_version') if isinstance(values, dict) else None
        if version != SCHEMA_VERSION:
            msg = f'A report of schema version {SCHEMA_VERSION} is needed, got {version}.'
            raise ReportError(msg)
        try:
            return cls(
                config=EvalConfig.from_dict(values['config']),
                methods={
                    name: MethodResults(
                        settings=results['settings'],
                        trials=[_trial_from_dict(trial) for trial in results['trials']],
                    )
                    for name, results in values['methods'].items()
                },
                command=values['command'],
                versions=values['versions'],
            )
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            msg = f'The report is damaged: {error!r}.'
            raise ReportError(msg) from error

    def table(self) -> Table:
        """Return a table with a column for each method."""
        config = self.config
        table = Table(title=(f'{config.trials} x {config.episodes} mazes of {config.describe()}'))
        scores = self.scores()
        table.add_column('')
        for name in scores:
            table.add_column(name, justify='right')
        for label, cells in _table_rows(list(scores.values())):
            table.add_row(label, *cells)
        return table


def markdown(report: Report) -> str:
    """Return what was evaluated, by which command, and a table with a row for each method."""
    config = report.config
    what = (
        f'{config.describe()}, {config.trials} × {config.episodes} mazes '
        f'(`{" ".join(report.command)}`):'
    )
    columns = (
        'method',
        'success (95 % interval)',
        'SPL by path cost',
        'ratio to frontier',
        'steps',
        'failures',
        'ms a decision',
    )
    lines = [what, '', f'| {" | ".join(columns)} |', '|' + ' --- |' * len(columns)]
    for name, score in report.scores().items():
        summary = score.summary
        cells = (
            name,
            f'{summary.success:.4f} ({summary.success_low:.4f} to {summary.success_high:.4f})',
            f'{summary.spl:.3f}',
            '–' if score.spl_ratio is None else f'{score.spl_ratio:.3f}',
            f'{summary.steps:.1f}',
            ', '.join(f'{number} {why}' for why, number in summary.failures.items()) or 'none',
            f'{score.ms_per_decision:.2g}',
        )
        lines.append(f'| {" | ".join(cells)} |')
    return '\n'.join(lines)


def _trial_to_dict(trial: Trial) -> dict[str, Any]:
    return {
        'seed': trial.seed,
        'success': summarize(trial.results).success,
        'decisions': trial.decisions,
        'seconds': trial.seconds,
        'episodes': [
            [getattr(result, name) for name in EPISODE_FIELDS] for result in trial.results
        ],
    }


def _trial_from_dict(values: dict[str, Any]) -> Trial:
    results = []
    for episode in values['episodes']:
        fields = dict(zip(EPISODE_FIELDS, episode, strict=True))
        results.append(EpisodeResult(**fields | {'outcome': Outcome(fields['outcome'])}))
    return Trial(values['seed'], results, values['decisions'], values['seconds'])


def _table_rows(scores: Sequence[Scores]) -> list[tuple[str, list[str]]]:
    summaries = [score.summary for score in scores]
    return [
        ('success', [f'{s.success:.3f}' for s in summaries]),
        ('  95 % interval', [f'{s.success_low:.3f} … {s.success_high:.3f}' for s in summaries]),
        (
            '  over trials',
            [f'{s.summary.success:.3f} ± {_or_dash(s.success_sd)}' for s in scores],
        ),
        ('SPL (path cost)', [f'{s.spl:.3f}' for s in summaries]),
        (f'  / {REFERENCE}', [_or_dash(score.spl_ratio) for score in scores]),
        ('SPL (steps)', [f'{s.spl_steps:.3f}' for s in summaries]),
        ('steps', [f'{s.steps:.1f}' for s in summaries]),
        ('failures', [_failures(s) for s in summaries]),
        ('ms a decision', [f'{score.ms_per_decision:.3g}' for score in scores]),
    ]


def _or_dash(value: float | None) -> str:
    return '–' if value is None else f'{value:.3f}'


def _failures(summary: Summary) -> str:
    return '\n'.join(f'{reason} {count}' for reason, count in summary.failures.items()) or '–'
