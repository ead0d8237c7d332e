"""The ``episode`` topic: how an episode begins, ends, and why."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from gridnav.metrics import Outcome
from gridnav.ros.conversions import NANOSECONDS
from gridnav.ros.validation import InvalidMessage

PLANNER_GAVE_UP = ('exhausted', 'unreachable', 'stuck')
"""What a planner says when it stops: nothing reachable is left to see, no way to the goal, or no
plan with a safe first step."""

START_KEY = 'start'
_START = re.compile(r'(\d{1,10})\.(\d{9})')


@dataclass(frozen=True)
class EpisodeStatus:
    """One message on ``episode``.

    Attributes:
        source: Who says it: ``'maze_sim'``, ``'avd_player'``, ``'vgdp_planner'``.
        message: An ``Outcome`` value from a world, one of ``PLANNER_GAVE_UP`` from a planner.
        start: Stamp of the episode's first observation in nanoseconds; it names the episode.
        values: Everything else that is said, as text.
    """

    source: str
    message: str
    start: int
    values: dict[str, str] = field(default_factory=dict)

    @property
    def begins(self) -> bool:
        """Whether a world says that this episode is running."""
        return self.message == Outcome.RUNNING

    def to_message(self) -> DiagnosticStatus:
        """Return it as a message: level OK while running or after success, else WARN."""
        fine = self.message in (Outcome.RUNNING, Outcome.SUCCESS)
        seconds, rest = divmod(self.start, NANOSECONDS)
        values = {START_KEY: f'{seconds}.{rest:09d}', **self.values}
        return DiagnosticStatus(
            level=DiagnosticStatus.OK if fine else DiagnosticStatus.WARN,
            name=self.source,
            message=self.message,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    @classmethod
    def from_message(cls, message: DiagnosticStatus) -> EpisodeStatus:
        """Read a message.

        Raises:
            InvalidMessage: If it has no name, no text or no ``start`` stamp.
        """
        values = {item.key: item.value for item in message.values}
        start = values.pop(START_KEY, '')
        match = _START.fullmatch(start)
        if match is None:
            msg = f"Its value 'start' is {start!r}, expected seconds.nanoseconds (9 digits)."
            raise InvalidMessage(msg)
        if not message.name or not message.message:
            msg = f'It lacks a name or a message ({message.name!r}, {message.message!r}).'
            raise InvalidMessage(msg)
        nanoseconds = int(match[1]) * NANOSECONDS + int(match[2])
        return cls(message.name, message.message, nanoseconds, values)
