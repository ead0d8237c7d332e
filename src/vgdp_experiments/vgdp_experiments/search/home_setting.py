"""Where a thing is searched: a scene, and what is wrong with what is sensed there."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar, Self

from vgdp_experiments.search.noise import Noise


@dataclass(frozen=True)
class HomeSetting:
    """A scene to search, and the conditions there.

    Attributes:
        scene: Its name.
        budget: Actions after which a search ends.
        noise: What is wrong with what the robot senses.
    """

    scene: str
    budget: int = 500
    noise: Noise = field(default_factory=Noise)

    unit: ClassVar[str] = 'searches'

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Build it from `to_dict`'s output."""
        return cls(**values | {'noise': Noise(**values['noise'])})

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, ready for JSON."""
        return asdict(self)

    @property
    def place(self) -> str:
        """Its name among settings."""
        return f'{self.scene} {self.noise.describe()}'.strip()

    def describe(self) -> str:
        """Say it in a few words."""
        noise = f', {self.noise.describe()}' if self.noise else ''
        return f'{self.scene}, budget {self.budget}{noise}'
