"""The episode topic."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from hypothesis import given
from hypothesis import strategies as st

from gridnav.metrics import Outcome
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.validation import InvalidMessage


@given(start=st.integers(0, 2**31 * 10**9 - 1), outcome=st.sampled_from(Outcome))
def test_a_status_comes_back(start: int, outcome: Outcome) -> None:
    """Start, text and values survive the message."""
    status = EpisodeStatus('maze_sim', outcome, start, {'steps': '3', 'seed': '7'})
    assert EpisodeStatus.from_message(status.to_message()) == status
    assert status.begins == (outcome is Outcome.RUNNING)


def test_the_start_is_written_with_nine_digits() -> None:
    """As the documentation of the topic says."""
    message = EpisodeStatus('maze_sim', 'running', 5_000_000_042).to_message()
    assert [(item.key, item.value) for item in message.values] == [('start', '5.000000042')]


@pytest.mark.parametrize(
    ('text', 'level'),
    [
        ('running', DiagnosticStatus.OK),
        ('success', DiagnosticStatus.OK),
        ('collision', DiagnosticStatus.WARN),
        ('exhausted', DiagnosticStatus.WARN),
    ],
)
def test_the_level_tells_good_from_bad(text: str, level: bytes) -> None:
    """OK while running and after success."""
    assert EpisodeStatus('maze_sim', text, 0).to_message().level == level


@pytest.mark.parametrize('start', [None, '', '12', '1.5', '-1.000000000', 'nan', '1.0000000001'])
def test_a_status_without_a_start_is_refused(start: str | None) -> None:
    """The start is what names the episode."""
    values = [] if start is None else [KeyValue(key='start', value=start)]
    message = DiagnosticStatus(name='maze_sim', message='running', values=values)
    with pytest.raises(InvalidMessage, match='start'):
        EpisodeStatus.from_message(message)


def test_a_status_without_a_speaker_or_text_is_refused() -> None:
    """Nobody says nothing."""
    for name, text in (('', 'running'), ('maze_sim', '')):
        values = [KeyValue(key='start', value='1.000000000')]
        with pytest.raises(InvalidMessage, match='lacks'):
            EpisodeStatus.from_message(DiagnosticStatus(name=name, message=text, values=values))
