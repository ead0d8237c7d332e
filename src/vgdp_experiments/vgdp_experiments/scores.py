"""Episodes of several methods on the same mazes, and what they say together."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from gridnav import EpisodeResult, Summary, summarize

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

REFERENCE = 'frontier'
"""The method that the others' SPL is compared with, unless another is named."""

RESAMPLES = 2000
"""So many times the mazes are drawn anew for a bootstrap interval."""

INTERVAL = (2.5, 97.5)
"""Percentiles between which 95 % lie."""


@dataclass
class Trial:
    """One method on the mazes of one trial.

    Attributes:
        seed: Of the mazes and of the method.
        results: Of each episode.
        decisions: How often the method was asked what a robot does next.
        seconds: Time it took to answer, all decisions together.
    """

    seed: int
    results: list[EpisodeResult] = field(default_factory=list)
    decisions: int = 0
    seconds: float = 0.0

    def extend(self, more: Trial) -> None:
        """Add episodes of the same trial."""
        self.results.extend(more.results)
        self.decisions += more.decisions
        self.seconds += more.seconds


@dataclass(frozen=True)
class MethodResults:
    """One method on the mazes of all trials.

    Attributes:
        settings: What shaped its decisions.
        trials: One for each seed.
    """

    settings: dict[str, Any]
    trials: list[Trial]

    def summary(self) -> Summary:
        """Sum up the episodes of all trials."""
        return summarize([result for trial in self.trials for result in trial.results])


@dataclass(frozen=True)
class Scores:
    """What all trials of a method say together.

    Attributes:
        summary: Of the episodes of all trials.
        success_sd: Standard deviation of the trials' success rates; None for a single trial.
        spl_sd: Standard deviation of the trials' SPL by path cost; None for a single trial.
        spl_interval: 95 % bootstrap interval of the SPL by path cost, over the mazes.
        ms_per_decision: Time for one decision in milliseconds, of many made at once.
        spl_ratio: SPL by path cost over that of the reference on the same mazes; None where the
            reference was not evaluated or never succeeded.
        ratio_interval: Its 95 % bootstrap interval, each resample with the same mazes for both.
    """

    summary: Summary
    success_sd: float | None
    spl_sd: float | None
    spl_interval: tuple[float, float]
    ms_per_decision: float
    spl_ratio: float | None
    ratio_interval: tuple[float, float] | None

    @property
    def decisions_per_second(self) -> float:
        """How many decisions were made in a second."""
        return 1e3 / self.ms_per_decision if self.ms_per_decision else 0.0


def score_methods(
    methods: Mapping[str, MethodResults], reference: str = REFERENCE
) -> dict[str, Scores]:
    """Score methods that were evaluated on the same mazes.

    Args:
        methods: Results by the method's name.
        reference: The method that the others' SPL is compared with.
    """
    spl = {
        name: np.array([result.spl for trial in results.trials for result in trial.results])
        for name, results in methods.items()
    }
    resampled = {name: _resamples(len(values)) @ values for name, values in spl.items()}
    scores = {}
    for name, results in methods.items():
        trials = [summarize(trial.results) for trial in results.trials]
        several = len(trials) > 1
        compared = reference in spl and spl[reference].any()
        comparable = compared and resampled[reference].all()
        decisions = sum(trial.decisions for trial in results.trials)
        seconds = sum(trial.seconds for trial in results.trials)
        scores[name] = Scores(
            summary=results.summary(),
            success_sd=statistics.stdev(trial.success for trial in trials) if several else None,
            spl_sd=statistics.stdev(trial.spl for trial in trials) if several else None,
            spl_interval=_interval(resampled[name]),
            ms_per_decision=1e3 * seconds / max(decisions, 1),
            spl_ratio=float(spl[name].mean() / spl[reference].mean()) if compared else None,
            ratio_interval=(
                _interval(resampled[name] / resampled[reference]) if comparable else None
            ),
        )
    return scores


def ratio(
    values: NDArray[np.float64], reference: NDArray[np.float64]
) -> tuple[float, tuple[float, float]]:
    """Return the ratio of the means of two columns over the same mazes, and its 95 % interval."""
    resamples = _resamples(len(values))
    interval = _interval((resamples @ values) / (resamples @ reference))
    return float(values.mean() / reference.mean()), interval


@lru_cache(maxsize=1)
def _resamples(count: int) -> NDArray[np.float64]:
    """Return how much each of so many episodes weighs in each resample, (R, count)."""
    rng = np.random.default_rng(0)
    return np.stack(
        [
            np.bincount(rng.integers(count, size=count), minlength=count) / count
            for _ in range(RESAMPLES)
        ]
    )


def _interval(resampled: NDArray[np.float64]) -> tuple[float, float]:
    low, high = np.percentile(resampled, INTERVAL)
    return float(low), float(high)
