"""Episode metrics."""

from __future__ import annotations

import pytest

from gridnav.metrics import EpisodeResult, Outcome, summarize


def test_spl_weighs_success_by_the_way() -> None:
    """The expert's way over the robot's, never above 1, and 0 without success."""
    slow = EpisodeResult(Outcome.SUCCESS, 41, 50.0, 20, 25.0)
    assert (slow.spl, slow.spl_steps) == (0.5, 0.5)
    perfect = EpisodeResult(Outcome.SUCCESS, 21, 24.0, 20, 25.0)
    assert (perfect.spl, perfect.spl_steps) == (1.0, 1.0)
    failed = EpisodeResult(Outcome.COLLISION, 21, 25.0, 20, 25.0)
    assert (failed.spl, failed.spl_steps) == (0.0, 0.0)


def test_a_summary_holds_means_interval_and_reasons() -> None:
    """9 of 10: the Wilson interval is the one of the textbook."""
    good = [EpisodeResult(Outcome.SUCCESS, 21, 25.0, 20, 25.0)] * 9
    summary = summarize([*good, EpisodeResult(Outcome.TIMEOUT, 500, 0.0, 20, 25.0)])
    assert summary.episodes == 10
    assert summary.success == pytest.approx(0.9)
    assert summary.success_low == pytest.approx(0.5958, abs=1e-4)
    assert summary.success_high == pytest.approx(0.9821, abs=1e-4)
    assert summary.spl == pytest.approx(0.9)
    assert summary.steps == pytest.approx((9 * 21 + 500) / 10)
    assert summary.failures == {'timeout': 1}


def test_no_episodes_have_no_summary() -> None:
    """A mean of nothing is refused."""
    with pytest.raises(ValueError, match='no episodes'):
        summarize([])
