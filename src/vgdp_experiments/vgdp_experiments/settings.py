"""Where robots are tried: the worlds, what is seen of them and what goes wrong."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from maze_sim import Worlds
from vgdp_experiments.held_out import HELD_OUT_KINDS, held_out_maze

if TYPE_CHECKING:
    from collections.abc import Iterable

    from maze_sim import Maze

MAPS = Path(__file__).parent / 'maps'
"""Where the maps are that come with the package."""

KEPT = 5000
"""So many worlds are kept for the next method."""


@dataclass(frozen=True)
class Setting:
    """A kind of worlds and the conditions in them.

    Attributes:
        size: Side of the worlds in cells, or (rows, cols).
        view_range: Cells that a view reaches to each side.
        budget: Actions after which an episode ends.
        kind: What the worlds look like, one of `maze_sim.WORLD_KINDS` or of `HELD_OUT_KINDS`.
        map: A map of the map server to draw starts and goals in, instead of `size` and `kind`:
            a YAML file, or the name of one that comes with the package. None if empty.
        slip: Share of the steps that lead elsewhere, or nowhere.
        pose_noise: Standard deviation of the reported pose in cells.
    """

    size: int | tuple[int, int] = 15
    view_range: int = 2
    budget: int = 500
    kind: str = 'maze'
    map: str = ''
    slip: float = 0.0
    pose_noise: float = 0.0

    unit: ClassVar[str] = 'mazes'

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Build it from `to_dict`'s output, JSON's lists included."""
        plain: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()
        }
        return cls(**plain)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, ready for JSON."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    def mazes(self, numbers: Iterable[int], seed: int) -> list[Maze]:
        """Draw worlds, of which each depends on the seed and its number alone.

        Raises:
            ValueError: If there are none of that kind and size, or the map can't be used.
        """
        return [_draw(self.size, self.kind, self.map, seed, number) for number in numbers]

    @property
    def seen(self) -> str:
        """What the worlds are, and how far the robot sees in them, in a few words."""
        rows, cols = self.size if isinstance(self.size, tuple) else (self.size, self.size)
        kind = '' if self.kind == 'maze' else f'{self.kind} of '
        return f'{self.map or f"{kind}{rows}×{cols}"}, view range {self.view_range}'

    def describe(self) -> str:
        """Say it in a few words."""
        parts = [self.seen, f'budget {self.budget}']
        if self.slip:
            parts.append(f'slip {self.slip:g}')
        if self.pose_noise:
            parts.append(f'pose noise {self.pose_noise:g} cells')
        return ', '.join(parts)


@cache
def _worlds(size: int | tuple[int, int], kind: str, name: str) -> Worlds:
    bundled = MAPS / f'{name}.yaml'
    return Worlds(size, kind, map_file=str(bundled) if bundled.is_file() else name)


@lru_cache(maxsize=KEPT)
def _draw(size: int | tuple[int, int], kind: str, name: str, seed: int, number: int) -> Maze:
    rng = np.random.default_rng([seed, number])
    if kind in HELD_OUT_KINDS:
        return held_out_maze(kind, size, rng)
    return _worlds(size, kind, name).sample(rng)
