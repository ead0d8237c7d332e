"""What an evaluation is made of: settings, methods and the page that shows the results."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from vgdp_experiments.jobs import Job, Variant
from vgdp_experiments.results import Results

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from vgdp_experiments.jobs import AnySetting

BLOCK = 100
"""Mazes of a job: what is lost, at most, when a run is stopped."""


@dataclass(frozen=True)
class Page:
    """How results are shown.

    Attributes:
        text: Markdown.
        pictures: By the name of the file beside the page that the text shows.
    """

    text: str
    pictures: dict[str, Figure] = field(default_factory=dict)


@dataclass(frozen=True)
class Suite:
    """All methods in all settings.

    Attributes:
        name: Names the command and the files.
        settings: By name.
        variants: The methods by name.
        page: Shows the results.
        trials: So many, with the seeds 0, 1, and so on.
        episodes: Mazes in a trial.
    """

    name: str
    settings: Mapping[str, AnySetting]
    variants: dict[str, Variant]
    page: Callable[[Results], Page]
    trials: int = 5
    episodes: int = 500

    def show(self, path: Path) -> Page:
        """Make the page of results in a file.

        Raises:
            ResultsError: If the file does not hold any.
        """
        return self.page(Results.load(path))

    def jobs(
        self, places: Sequence[str], names: Sequence[str], trials: int, episodes: int
    ) -> list[Job]:
        """Return the jobs of some settings and methods, in the suite's order.

        Raises:
            ValueError: If there is no setting or method of a name.
        """
        for wanted, known, what in (
            (places, self.settings, 'setting'),
            (names, self.variants, 'method'),
        ):
            for name in wanted:
                if name not in known:
                    msg = f'{self.name} has no {what} {name!r}; there are {", ".join(known)}.'
                    raise ValueError(msg)
        return [
            Job(
                self.name,
                place,
                setting,
                name,
                variant,
                trial,
                first,
                min(BLOCK, episodes - first),
            )
            for place, setting in self.settings.items()
            if place in places
            for name, variant in self.variants.items()
            if name in names
            for trial in range(trials)
            for first in range(0, episodes, BLOCK)
        ]
