"""Jobs of an evaluation: a method on some mazes of a trial, and the file that keeps it."""

from __future__ import annotations

import argparse
import hashlib
import json
import re
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Self

from gridnav import EpisodeResult, Outcome
from vgdp_experiments import calvin
from vgdp_experiments.evaluate import evaluate
from vgdp_experiments.files import write_whole
from vgdp_experiments.methods.registry import PLANNERS, REFERENCES, VARIANTS
from vgdp_experiments.planner_options import load_planner
from vgdp_experiments.report import current_versions
from vgdp_experiments.scores import Trial
from vgdp_experiments.search.home_setting import HomeSetting
from vgdp_experiments.settings import Setting
from vgdp_planner.weights import MODEL_FILE, SHIPPED, WeightsError, read_record

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

SCHEMA_VERSION = 1
"""Rises with any change after which older readers would misread a part."""

DECIMALS = 3
"""Costs are kept in thousandths of a cell."""

HASH_LENGTH = 16
"""Digits of a hash that are kept."""


AnySetting = Setting | HomeSetting


class PartError(ValueError):
    """A file does not hold a part of an evaluation, or one that does not fit."""


@dataclass(frozen=True)
class Variant:
    """A method, and how it is used.

    Attributes:
        method: Its name among the methods.
        planner: Settings of the planner in which it differs, by name.
        filtered: Whether it gets the belief of the filter instead of the cell that is reported.
    """

    method: str
    planner: dict[str, Any] = field(default_factory=dict)
    filtered: bool = False


@dataclass(frozen=True)
class Job:
    """One method on some mazes of a trial, or on some searches of a scene.

    Attributes:
        suite: The evaluation that it is a part of.
        place: Name of the setting there.
        setting: Where the robots are tried.
        name: Name of the method there.
        variant: What it is.
        trial: Number of the trial, which is the seed of the mazes and of the method, too.
        first: Number of its first maze in the trial.
        episodes: So many mazes from there.
    """

    suite: str
    place: str
    setting: AnySetting
    name: str
    variant: Variant
    trial: int
    first: int
    episodes: int

    @property
    def title(self) -> str:
        """What it is in a few words."""
        last, unit = self.first + self.episodes - 1, self.setting.unit
        return f'{self.name}, {self.place}, trial {self.trial}, {unit} {self.first} to {last}'

    @property
    def file_name(self) -> str:
        """Name of the file that keeps what came out."""
        words = re.sub(r'[^a-z0-9.]+', '_', f'{self.place} {self.name}'.lower())
        return f'{words}_{self.trial}_{self.first}.json'

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, ready for JSON."""
        return asdict(self) | {'setting': self.setting.to_dict()}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Build it from `to_dict`'s output."""
        return cls(
            **values
            | {
                'setting': setting_from_dict(values['setting']),
                'variant': Variant(**values['variant']),
            }
        )


def setting_from_dict(values: dict[str, Any]) -> AnySetting:
    """Build a setting from its `to_dict`'s output."""
    kind: type[AnySetting] = HomeSetting if 'scene' in values else Setting
    return kind.from_dict(values)


@dataclass(frozen=True)
class Part:
    """What came out of a job.

    Attributes:
        job: The job.
        weights: Hashes of the weights that the method used, by what they belong to.
        settings: What shaped the method's decisions.
        trial: The episodes.
        versions: Of Python and of the packages that the results depend on.
    """

    job: Job
    weights: dict[str, str]
    settings: dict[str, Any]
    trial: Trial
    versions: dict[str, str] = field(default_factory=current_versions)

    def save(self, folder: Path) -> None:
        """Write it into a folder; the file is there as a whole or not at all."""
        values = {
            'schema_version': SCHEMA_VERSION,
            'job': self.job.to_dict(),
            'weights': self.weights,
            'settings': self.settings,
            'versions': self.versions,
            'experts': experts_to_dict(self.trial),
            'trial': trial_to_dict(self.trial),
        }
        write_whole(folder / self.job.file_name, json.dumps(values) + '\n')

    @classmethod
    def load(cls, path: Path) -> Part:
        """Read a part.

        Raises:
            PartError: If the file does not hold one, with one sentence that says why.
        """
        try:
            values = json.loads(path.read_text(encoding='utf-8'))
            if values['schema_version'] != SCHEMA_VERSION:
                msg = f'schema version {SCHEMA_VERSION} is needed'
                raise ValueError(msg)  # noqa: TRY301 - all that can be wrong is said below
            return cls(
                job=Job.from_dict(values['job']),
                weights=values['weights'],
                settings=values['settings'],
                trial=trial_from_dict(values['trial'], values['experts']),
                versions=values['versions'],
            )
        except (OSError, KeyError, TypeError, ValueError) as error:
            msg = f'{path} holds no part of an evaluation: {error}.'
            raise PartError(msg) from error


def experts_to_dict(trial: Trial) -> dict[str, Any]:
    """Return what the expert needs in each maze of a trial, as plain values."""
    return {
        'steps': [result.expert_steps for result in trial.results],
        'costs': [round(result.expert_cost, DECIMALS) for result in trial.results],
    }


def trial_to_dict(trial: Trial) -> dict[str, Any]:
    """Return the rest of a trial as plain values: what differs from method to method."""
    failures: dict[str, list[int]] = {}
    for index, result in enumerate(trial.results):
        if not result.success:
            failures.setdefault(str(result.outcome), []).append(index)
    return {
        'seed': trial.seed,
        'decisions': trial.decisions,
        'seconds': round(trial.seconds, DECIMALS),
        'failures': failures,
        'steps': [result.steps for result in trial.results],
        'path_costs': [round(result.path_cost, DECIMALS) for result in trial.results],
    }


def trial_from_dict(values: dict[str, Any], experts: dict[str, Any]) -> Trial:
    """Build a trial from what `trial_to_dict` and `experts_to_dict` return."""
    outcomes = [Outcome.SUCCESS] * len(values['steps'])
    for outcome, indices in values['failures'].items():
        for index in indices:
            outcomes[index] = Outcome(outcome)
    columns: Sequence[Sequence[Any]] = (
        outcomes,
        values['steps'],
        values['path_costs'],
        experts['steps'],
        experts['costs'],
    )
    results = [EpisodeResult(*episode) for episode in zip(*columns, strict=True)]
    return Trial(values['seed'], results, values['decisions'], values['seconds'])


@dataclass(frozen=True)
class Machinery:
    """How jobs are run, which changes nothing about what comes out but the time it takes.

    Attributes:
        weights: Folder of the planner's weights; those shipped if None.
        calvin_weights: Folder of CALVIN's weights; those shipped if None.
        device: Where the networks run.
        threads: CPU threads of the networks; PyTorch's choice if None.
        batch: Episodes run at once.
        data: Folder of the scenes, for evaluations in these.
        learned_weights: Folder with those of the methods that are learned for searches, in a
            folder for each; those shipped if None.
    """

    weights: Path | None = None
    calvin_weights: Path | None = None
    device: str = 'cpu'
    threads: int | None = None
    batch: int = 100
    data: Path | None = None
    learned_weights: Path | None = None


def weights_of(variant: Variant, machinery: Machinery) -> dict[str, str]:
    """Return the hashes of the weights that a method uses, by what they belong to.

    Raises:
        WeightsError: If there are no such weights.
    """
    if variant.method in VARIANTS:
        return {'planner': hash_of(machinery.weights or SHIPPED)}
    if variant.method == 'calvin':
        return {'calvin': hash_of(machinery.calvin_weights or calvin.SHIPPED)}
    if machinery.data is not None:
        # Loaded late: mazes need no reader of images.
        from vgdp_experiments.search.learned import used_weights  # noqa: PLC0415

        folders = used_weights(variant.method, machinery.learned_weights)
        return {owner: hash_of(folder) for owner, folder in folders.items()}
    return {}


def hash_of(folder: Path) -> str:
    """Return a hash of what decides how a network behaves: its weights and their configuration.

    Raises:
        WeightsError: If the folder holds no weights.
    """
    config = json.dumps(read_record(folder)['config'], sort_keys=True).encode()
    try:
        tensors = (folder / MODEL_FILE).read_bytes()
    except OSError as error:
        msg = f'There are no weights in {folder}: {MODEL_FILE} can not be read.'
        raise WeightsError(msg) from error
    return hashlib.sha256(config + tensors).hexdigest()[:HASH_LENGTH]


def run_job(job: Job, machinery: Machinery, on_finished: Callable[[int], object]) -> Part:
    """Run a job.

    Args:
        job: What to run.
        machinery: How.
        on_finished: Is told how many episodes have ended since the last time.

    Raises:
        ValueError: If the mazes can't be drawn or the weights can't be used.
    """
    setting, variant = job.setting, job.variant
    end = job.first + job.episodes
    args = argparse.Namespace(
        weights=machinery.weights,
        calvin_weights=machinery.calvin_weights,
        device=machinery.device,
        threads=machinery.threads,
        settings=list(variant.planner.items()),
        learned_weights=machinery.learned_weights,
    )
    if isinstance(setting, HomeSetting):
        trial, settings = _search(job, setting, machinery, args, on_finished)
        return Part(job, weights_of(variant, machinery), settings, trial)
    method = (
        REFERENCES[variant.method](setting.mazes(range(end), job.trial))
        if variant.method in REFERENCES
        else PLANNERS[variant.method](args)
    )
    trial = evaluate(
        method,
        setting.mazes(range(job.first, end), job.trial),
        setting.view_range,
        setting.budget,
        job.trial,
        slip=setting.slip,
        pose_noise=setting.pose_noise,
        belief_filter=load_planner(args).belief_filter.cpu() if variant.filtered else None,
        first=job.first,
        batch=machinery.batch,
        on_finished=on_finished,
    )
    return Part(job, weights_of(variant, machinery), method.settings, trial)


def _search(
    job: Job,
    setting: HomeSetting,
    machinery: Machinery,
    args: argparse.Namespace,
    on_finished: Callable[[int], object],
) -> tuple[Trial, dict[str, Any]]:
    """Return what comes out of a job in a scene, and what shaped the decisions."""
    # Loaded late: mazes need no reader of images.
    from vgdp_experiments.search.evaluate import open_home, run_searches  # noqa: PLC0415

    if machinery.data is None:
        msg = f'{job.title} needs the folder of the scenes.'
        raise ValueError(msg)
    home = open_home(machinery.data, setting, job.trial)
    numbers = range(job.first, job.first + job.episodes)
    return run_searches(home, job.variant.method, args, job.trial, numbers, on_finished)
