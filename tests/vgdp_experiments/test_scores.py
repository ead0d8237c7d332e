"""Scores: what their intervals are, and that both methods of a ratio get the same mazes."""

from __future__ import annotations

import numpy as np
import pytest

from gridnav import EpisodeResult, Outcome
from vgdp_experiments.scores import MethodResults, Scores, Trial, score_methods

EPISODES = 200


def of_spl(values: list[float], trials: int = 1) -> MethodResults:
    """Return episodes with such SPL, dealt out to some trials; 0 is a failure."""
    results = [
        EpisodeResult(Outcome.SUCCESS, 30, 20.0 / value, 20, 20.0)
        if value
        else EpisodeResult(Outcome.TIMEOUT, 500, 100.0, 20, 20.0)
        for value in values
    ]
    each = len(results) // trials
    return MethodResults(
        {}, [Trial(k, results[k * each : (k + 1) * each], 10, 0.1) for k in range(trials)]
    )


@pytest.fixture(scope='module')
def spl() -> list[float]:
    """Return widely spread SPL."""
    return list(np.random.default_rng(1).uniform(0.2, 0.6, size=EPISODES))


@pytest.fixture(scope='module')
def scores(spl: list[float]) -> dict[str, Scores]:
    """Return a method that is 1.25 times the reference in each maze."""
    better = [1.25 * value for value in spl]
    return score_methods({'vgdp': of_spl(better, trials=4), 'frontier': of_spl(spl, trials=4)})


def test_interval_of_the_mean(scores: dict[str, Scores], spl: list[float]) -> None:
    """A bootstrap interval of a mean is about ±1.96 standard errors wide."""
    low, high = scores['frontier'].spl_interval
    error = np.std(spl) / EPISODES**0.5
    assert low < np.mean(spl) < high
    assert high - low == pytest.approx(2 * 1.96 * error, rel=0.1)


def test_interval_of_the_ratio_is_paired(scores: dict[str, Scores]) -> None:
    """The mazes vary, the ratio does not: its interval has no width."""
    assert scores['vgdp'].spl_ratio == pytest.approx(1.25)
    assert scores['vgdp'].ratio_interval == pytest.approx((1.25, 1.25))


def test_any_method_can_be_the_reference(spl: list[float]) -> None:
    """Ratios are then over its SPL, the intervals' resamples too."""
    half = [value / 2 for value in spl]
    scores = score_methods({'vgdp': of_spl(half), 'greedy': of_spl(spl)}, reference='greedy')
    assert scores['vgdp'].spl_ratio == pytest.approx(0.5)
    assert scores['vgdp'].ratio_interval == pytest.approx((0.5, 0.5))


def test_deviation_over_trials(scores: dict[str, Scores], spl: list[float]) -> None:
    """It is the one of the trials' means."""
    means = np.reshape(spl, (4, -1)).mean(axis=1)
    assert scores['frontier'].spl_sd == pytest.approx(np.std(means, ddof=1))
    assert scores['frontier'].success_sd == 0.0
    assert scores['frontier'].decisions_per_second == pytest.approx(100.0)


def test_a_reference_that_never_succeeds_gives_no_ratio(spl: list[float]) -> None:
    """There is nothing to divide by."""
    scores = score_methods({'vgdp': of_spl(spl), 'frontier': of_spl([0.0] * EPISODES)})
    assert scores['vgdp'].spl_ratio is None
    assert scores['vgdp'].ratio_interval is None
