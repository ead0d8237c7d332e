"""How far a run is, and how that looks in a terminal. No ROS here."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from rich.columns import Columns
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Protocol, Self

    from numpy.typing import NDArray
    from rich.console import Console, RenderableType

    from gridnav.grid import GridGeometry

    class Display(Protocol):
        """Shows the progress of a run while it is a context."""

        def __enter__(self) -> Self:
            """Begin to show."""

        def __exit__(
            self,
            kind: type[BaseException] | None,
            error: BaseException | None,
            trace: TracebackType | None,
        ) -> None:
            """Show no more."""

        def update(self, progress: Progress) -> None:
            """Show the progress as of now."""


Point = tuple[float, float]

UNSEEN, FREE, WALL, TRACE, PLAN, GOAL, ROBOT = range(7)
COLORS = ('#23263a', '#e9e7e0', '#6f7691', '#b7cdf2', '#f2a541', '#2fb36b', '#e0413e')
NAMES = ('unseen', 'free', 'wall', 'path', 'plan', 'goal', 'robot')

LINES_BESIDE_MAP = 8
"""What a terminal needs in height besides the map."""

PLAIN_EVERY = 10
"""Where lines are printed instead of a live picture: one for each so many steps."""


@dataclass
class Progress:
    """What is known about a run so far, all of it from messages.

    Attributes:
        occupancy: The latest map, int8 (H, W), or None before the first one.
        geometry: Where it lies.
        path: Positions (x, y) in metres, one for each observation.
        goal: The goal in metres once it was seen.
        plan: The latest plan, positions in metres.
        outcome: What ``episode`` says; empty before it says anything.
        episode: The values that came with it, as text.
        latencies: From each map's arrival to that of its plan, in seconds.
        value: The chosen plan's score, or None while nobody says one.
    """

    occupancy: NDArray[np.int8] | None = None
    geometry: GridGeometry | None = None
    path: list[Point] = field(default_factory=list)
    goal: Point | None = None
    plan: list[Point] = field(default_factory=list)
    outcome: str = ''
    episode: dict[str, str] = field(default_factory=dict)
    latencies: list[float] = field(default_factory=list)
    value: float | None = None

    @property
    def steps(self) -> int:
        """Steps that were made so far."""
        return max(len(self.path) - 1, 0)

    @property
    def seen(self) -> float:
        """Share of the map's cells that have been seen."""
        if self.occupancy is None:
            return 0.0
        return float(np.mean(self.occupancy != UNKNOWN_VALUE))

    def cells(self) -> NDArray[np.int64]:
        """Return what to show in each cell, an index into ``COLORS``, (H, W)."""
        if self.occupancy is None or self.geometry is None:
            return np.zeros((0, 0), dtype=np.int64)
        shown = np.full(self.occupancy.shape, UNSEEN, dtype=np.int64)
        shown[self.occupancy == FREE_VALUE] = FREE
        shown[self.occupancy == OCCUPIED_VALUE] = WALL
        for points, what in (
            (self.path, TRACE),
            (self.plan, PLAN),
            ([self.goal] if self.goal else [], GOAL),
            (self.path[-1:], ROBOT),
        ):
            for x, y in points:
                row, col = self.geometry.cell_at(x, y)
                if self.geometry.contains(row, col):
                    shown[row, col] = what
        return shown

    def rows(self) -> list[tuple[str, str]]:
        """Return what to print beside the map: names and values."""
        rows = [
            ('episode', self.outcome or 'not begun'),
            ('step', str(self.steps)),
            ('seen', f'{self.seen:.0%} of the map'),
            ('goal', 'seen' if self.goal else 'not seen yet'),
            ('value', '-' if self.value is None else f'{self.value:.2f}'),
            ('planning', '-' if not self.latencies else f'{self.latencies[-1] * 1000:.0f} ms'),
        ]
        if len(self.latencies) > 1:
            rows.append(('median', f'{np.median(self.latencies) * 1000:.0f} ms'))
        return rows


def draw_map(progress: Progress, lines: int) -> Text:
    """Draw the map in coloured blocks, north up, in at most so many lines if it can be.

    A cell is two characters wide, or half a character high where lines are short.
    """
    cells = np.flipud(progress.cells())
    text = Text()
    if len(cells) <= lines:
        for row in cells:
            for cell in row:
                text.append('  ', style=f'on {COLORS[cell]}')
            text.append('\n')
        return text
    if len(cells) % 2:
        cells = np.vstack([cells, np.full_like(cells[:1], UNSEEN)])
    for upper, lower in zip(cells[::2], cells[1::2], strict=True):
        for above, below in zip(upper, lower, strict=True):
            text.append('▀', style=f'{COLORS[above]} on {COLORS[below]}')
        text.append('\n')
    return text


class LiveDisplay:
    """A picture in the terminal that is drawn anew all the time."""

    def __init__(self, console: Console) -> None:
        """Prepare to draw on a console that is a terminal."""
        self._console = console
        self._live = Live(console=console, auto_refresh=False)

    def __enter__(self) -> Self:
        """Take over the lower part of the terminal."""
        self._live.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the last picture where it is."""
        self._live.__exit__(kind, error, trace)

    def update(self, progress: Progress) -> None:
        """Draw the progress as of now."""
        self._live.update(self._picture(progress), refresh=True)

    def _picture(self, progress: Progress) -> RenderableType:
        facts = Table.grid(padding=(0, 2))
        for name, value in progress.rows():
            facts.add_row(Text(name, style='dim'), value)
        legend = Text()
        for name, color in zip(NAMES, COLORS, strict=True):
            legend.append('  ', style=f'on {color}').append(f' {name}  ')
        picture = draw_map(progress, self._console.height - LINES_BESIDE_MAP)
        return Group('', Columns([picture, facts], padding=(0, 3)), legend)


class PlainDisplay:
    """A line now and then, for logs."""

    def __init__(self, console: Console) -> None:
        """Prepare to print on a console."""
        self._console = console
        self._printed = -PLAIN_EVERY

    def __enter__(self) -> Self:
        """Do nothing."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Do nothing."""

    def update(self, progress: Progress) -> None:
        """Print a line if enough steps were made since the last one."""
        known = progress.path and progress.occupancy is not None
        if known and progress.steps >= self._printed + PLAIN_EVERY:
            self._printed = progress.steps
            line = ', '.join(f'{name} {value}' for name, value in progress.rows())
            self._console.print(line, highlight=False, soft_wrap=True)
