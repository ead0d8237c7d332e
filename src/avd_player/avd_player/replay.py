"""Where a replay is in its frames: what comes next, with pause, step, loop and seek."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


class Replay:
    """A cursor on the frames of a source.

    Attributes:
        names: The frames, in order.
        loop: Whether the first follows on the last.
        paused: Whether it waits.
        next_index: The frame that comes next; the number of frames at the end.
    """

    def __init__(self, names: Sequence[str], start: int = 0, *, loop: bool = False) -> None:
        """Stand before a frame.

        Raises:
            ValueError: If there is none.
        """
        self.names = names
        self.loop = loop
        self.paused = False
        self.seek(start)

    def seek(self, index: int) -> None:
        """Go on with a frame.

        Raises:
            ValueError: If there is none of this number.
        """
        if not 0 <= index < len(self.names):
            msg = f'A frame is a number from 0 to {len(self.names) - 1}, got {index}.'
            raise ValueError(msg)
        self.next_index = index

    @property
    def next_name(self) -> str | None:
        """The frame that comes next; None at the end."""
        if self.next_index < len(self.names):
            return self.names[self.next_index]
        return self.names[0] if self.loop else None

    def take(self) -> str | None:
        """Return the next frame and go one on; None at the end."""
        name = self.next_name
        if name is not None:
            self.next_index = self.next_index % len(self.names) + 1
        return name
