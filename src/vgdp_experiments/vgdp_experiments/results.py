"""All parts of an evaluation, joined, in one file."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from gridnav import Outcome
from vgdp_experiments.files import write_whole
from vgdp_experiments.jobs import (
    Part,
    experts_to_dict,
    setting_from_dict,
    trial_from_dict,
    trial_to_dict,
)
from vgdp_experiments.scores import REFERENCE, MethodResults, Scores, Trial, score_methods

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from vgdp_experiments.jobs import AnySetting, Job

SCHEMA_VERSION = 1
"""Rises with any change after which older readers would misread the results."""

MOST_NAMED = 8
"""So many of the missing parts are named."""


class ResultsError(ValueError):
    """Parts do not make a whole, or a file does not hold one."""


@dataclass(frozen=True)
class PlaceResults:
    """All methods in one setting, each on the same mazes.

    Attributes:
        setting: Where the robots were tried.
        methods: Results by the method's name.
    """

    setting: AnySetting
    methods: dict[str, MethodResults]

    def scores(self, reference: str = REFERENCE) -> dict[str, Scores]:
        """Score every method; ratios of SPL are over that of the reference."""
        return score_methods(self.methods, reference)

    def cut(self, budget: int) -> PlaceResults:
        """Return what would have come out with a smaller budget.

        Nobody is told the budget, so all goes the same way until it is spent.
        """
        methods = {
            name: replace(of_method, trials=[_cut(trial, budget) for trial in of_method.trials])
            for name, of_method in self.methods.items()
        }
        return PlaceResults(replace(self.setting, budget=budget), methods)

    @property
    def trials(self) -> int:
        """Number of trials."""
        return len(next(iter(self.methods.values())).trials)

    @property
    def episodes(self) -> int:
        """Mazes in a trial."""
        return len(next(iter(self.methods.values())).trials[0].results)


@dataclass(frozen=True)
class Results:
    """What an evaluation found.

    Attributes:
        suite: Its name.
        places: Results by the setting's name.
        weights: Hashes of the weights, by what they belong to.
        versions: Of Python and of the packages that the results depend on, all that took part.
    """

    suite: str
    places: dict[str, PlaceResults]
    weights: dict[str, str]
    versions: dict[str, list[str]]

    @classmethod
    def join(cls, parts: Sequence[Part], jobs: Sequence[Job]) -> Results:
        """Put the parts of some jobs together; other parts are left out.

        Raises:
            ResultsError: If a part is missing or parts do not belong together, with one sentence
                that names them.
        """
        found: dict[str, Part] = {}
        for part in parts:
            other = found.setdefault(part.job.title, part)
            if other.trial.results != part.trial.results:
                msg = f'There are two parts for {part.job.title!r}, with other episodes.'
                raise ResultsError(msg)
        missing = [job for job in jobs if job.title not in found]
        if missing:
            named = '; '.join(job.title for job in missing[:MOST_NAMED])
            more = f'; and {len(missing) - MOST_NAMED} more' if missing[MOST_NAMED:] else ''
            msg = f'{len(missing)} of {len(jobs)} parts are missing: {named}{more}.'
            raise ResultsError(msg)
        chosen = [found[job.title] for job in jobs]
        for part, job in zip(chosen, jobs, strict=True):
            if part.job.setting != job.setting:
                msg = (
                    f'The part for {job.title!r} is of {part.job.setting}; wanted is '
                    f'{job.setting}.'
                )
                raise ResultsError(msg)
        _check_mazes(chosen)
        weights = _check_weights(chosen)
        places = {
            place: PlaceResults(setting, _methods([p for p in chosen if p.job.place == place]))
            for place, setting in {job.place: job.setting for job in jobs}.items()
        }
        return cls(chosen[0].job.suite, places, weights, _versions(chosen))

    def save(self, path: Path) -> None:
        """Write the results as JSON. The file is there as a whole or not at all."""
        write_whole(path, json.dumps(self.to_dict(), separators=(',', ':')) + '\n')

    @classmethod
    def load(cls, path: Path) -> Results:
        """Read results.

        Raises:
            ResultsError: If the file does not hold any, with one sentence that says why.
        """
        try:
            values = json.loads(path.read_text(encoding='utf-8'))
            if values['schema_version'] != SCHEMA_VERSION:
                msg = f'schema version {SCHEMA_VERSION} is needed'
                raise ValueError(msg)  # noqa: TRY301 - all that can be wrong is said below
            return cls(
                values['suite'],
                {name: _place_from_dict(place) for name, place in values['places'].items()},
                values['weights'],
                values['versions'],
            )
        except (OSError, AttributeError, LookupError, TypeError, ValueError) as error:
            msg = f'{path} holds no results of an evaluation: {error!r}.'
            raise ResultsError(msg) from error

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, ready for JSON."""
        return {
            'schema_version': SCHEMA_VERSION,
            'suite': self.suite,
            'weights': self.weights,
            'versions': self.versions,
            'places': {name: _place_to_dict(place) for name, place in self.places.items()},
        }


def _cut(trial: Trial, budget: int) -> Trial:
    """Let the episodes of a trial that took longer than a budget end there.

    What their ways had cost by then is not known; it counts nowhere, as they have failed.
    """
    results = [
        result
        if result.steps <= budget
        else replace(result, outcome=Outcome.TIMEOUT, steps=budget, path_cost=float(budget))
        for result in trial.results
    ]
    return replace(trial, results=results)


def load_parts(folders: Sequence[Path]) -> list[Part]:
    """Read all parts in some folders.

    Raises:
        ResultsError: If there are none, or of several evaluations.
        PartError: If a file holds none.
    """
    parts = [Part.load(path) for folder in folders for path in sorted(folder.glob('*.json'))]
    suites = {part.job.suite for part in parts}
    if len(suites) != 1:
        named = ', '.join(map(str, folders))
        what = f'parts of {", ".join(sorted(suites))}' if suites else 'no parts'
        msg = f'Parts of one evaluation are needed; {named} holds {what}.'
        raise ResultsError(msg)
    return parts


def _methods(parts: Sequence[Part]) -> dict[str, MethodResults]:
    """Put the parts of one setting together, by method and trial."""
    methods: dict[str, MethodResults] = {}
    for part in parts:
        results = methods.setdefault(part.job.name, MethodResults(part.settings, []))
        if not results.trials or results.trials[-1].seed != part.trial.seed:
            results.trials.append(Trial(part.trial.seed))
        results.trials[-1].extend(part.trial)
    return methods


def _check_mazes(parts: Sequence[Part]) -> None:
    """Make sure that the methods were on the same mazes, as far as the expert's ways tell.

    Raises:
        ResultsError: If not.
    """
    known: dict[tuple[str, int, int], Part] = {}
    for part in parts:
        other = known.setdefault((part.job.place, part.job.trial, part.job.first), part)
        if experts_to_dict(other.trial) != experts_to_dict(part.trial):
            msg = f'{part.job.title!r} was on other mazes than {other.job.title!r}.'
            raise ResultsError(msg)


def _check_weights(parts: Sequence[Part]) -> dict[str, str]:
    """Return the hashes of the weights.

    Raises:
        ResultsError: If a method was evaluated with several weights or settings.
    """
    weights: dict[str, tuple[str, Part]] = {}
    settings: dict[str, Part] = {}
    for part in parts:
        for owner, value in part.weights.items():
            known, other = weights.setdefault(owner, (value, part))
            if known != value:
                msg = (
                    f'{part.job.title!r} and {other.job.title!r} were made with different '
                    f'weights: {value} and {known}.'
                )
                raise ResultsError(msg)
        same = settings.setdefault(part.job.name, part)
        if same.settings != part.settings:
            msg = f'{part.job.title!r} and {same.job.title!r} were made with different settings.'
            raise ResultsError(msg)
    return {owner: value for owner, (value, _) in weights.items()}


def _versions(parts: Sequence[Part]) -> dict[str, list[str]]:
    names = dict.fromkeys(name for part in parts for name in part.versions)
    return {
        name: sorted({part.versions[name] for part in parts if name in part.versions})
        for name in names
    }


def _place_to_dict(place: PlaceResults) -> dict[str, Any]:
    first = next(iter(place.methods.values()))
    return {
        'setting': place.setting.to_dict(),
        'experts': [experts_to_dict(trial) for trial in first.trials],
        'methods': {
            name: {
                'settings': results.settings,
                'trials': [trial_to_dict(trial) for trial in results.trials],
            }
            for name, results in place.methods.items()
        },
    }


def _place_from_dict(values: dict[str, Any]) -> PlaceResults:
    return PlaceResults(
        setting_from_dict(values['setting']),
        {
            name: MethodResults(
                results['settings'],
                [
                    trial_from_dict(trial, experts)
                    for trial, experts in zip(results['trials'], values['experts'], strict=True)
                ],
            )
            for name, results in values['methods'].items()
        },
    )
