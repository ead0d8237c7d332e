# ruff: noqa: PLR2004 - sizes of things
"""The taste of a home, and what a piece of furniture is."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from avd_player.homes import textures
from avd_player.homes.textures import Materials, hsv
from gridnav.rgbd import CLASSES

if TYPE_CHECKING:
    import numpy as np

    from avd_player.homes.mesh import Mesh

(
    CEILING,
    FLOOR,
    WALL,
    BEAM,
    COLUMN,
    WINDOW,
    DOOR,
    TABLE,
    CHAIR,
    SOFA,
    BOOKCASE,
    BOARD,
    CLUTTER,
) = range(len(CLASSES))


class Top(NamedTuple):
    """A level place where things can stand: left, back, right, front and height in metres."""

    x0: float
    y0: float
    x1: float
    y1: float
    z: float


class Item(NamedTuple):
    """A piece of furniture, or several that stand together.

    Attributes:
        mesh: In its own frame.
        width: Metres along the wall.
        depth: Metres from the wall.
        height: Metres.
        tops: Where things can stand on it.
        lamps: Position and strength of the lamps in it.
    """

    mesh: Mesh
    width: float
    depth: float
    height: float
    tops: tuple[Top, ...] = ()
    lamps: tuple[tuple[float, float, float, float], ...] = ()


class Style:
    """The taste of a home: its materials and the draws of its furniture.

    Attributes:
        rng: Source of the draws.
        materials: What the home is made of.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.materials = Materials(int(rng.integers(2**31)))
        add = self.materials.add
        self._woods = [
            add(
                textures.wood,
                hsv(rng.uniform(0.04, 0.11), rng.uniform(0.25, 0.7), rng.uniform(0.25, 0.85)),
                rng.uniform(0.6, 1.2),
                gloss=rng.uniform(0.0, 0.08),
            )
            for _ in range(4)
        ]
        self._lacquers = [
            self.materials.colour(
                hsv(
                    rng.random(),
                    rng.choice([0.02, 0.04, 0.06, 0.12, 0.3, 0.6]),
                    rng.uniform(0.3, 0.95),
                ),
                gloss=0.06,
            )
            for _ in range(3)
        ]
        self._lacquers.append(self.materials.colour((0.92, 0.92, 0.9), gloss=0.06))
        self._cloths = [
            add(
                textures.fabric if rng.random() < 0.75 else textures.leather,
                hsv(rng.random(), rng.uniform(0.0, 0.75), rng.uniform(0.15, 0.9)),
                rng.uniform(0.3, 0.9),
            )
            for _ in range(6)
        ]
        self.steel = add(textures.metal, hsv(0.6, 0.03, rng.uniform(0.45, 0.8)), 0.7, gloss=0.15)
        self.black = self.materials.colour((0.07, 0.07, 0.08), gloss=0.08)
        self.white = self.materials.colour((0.93, 0.93, 0.92), gloss=0.08)
        self.leaf = add(
            textures.leaves,
            hsv(rng.uniform(0.22, 0.4), rng.uniform(0.4, 0.8), rng.uniform(0.25, 0.6)),
            0.25,
        )
        self.soil = self.materials.colour((0.2, 0.14, 0.1))

    def wood(self) -> int:
        """Choose one of the woods."""
        return int(self.rng.choice(self._woods))

    def cloth(self) -> int:
        """Choose one of the cloths."""
        return int(self.rng.choice(self._cloths))

    def front(self) -> int:
        """Choose what cupboards are made of: wood or lacquer."""
        return int(self.rng.choice(self._woods + self._lacquers))

    def leg(self) -> int:
        """Choose what legs are made of."""
        return int(self.rng.choice([*self._woods, self.steel, self.black, self.white]))

    def any_colour(self) -> int:
        """Choose any colour for a small thing."""
        rng = self.rng
        colour = hsv(rng.random(), rng.uniform(0.0, 0.95), rng.uniform(0.12, 0.95))
        return self.materials.colour(colour, gloss=0.05)

    def chance(self, probability: float) -> bool:
        """Draw yes or no."""
        return bool(self.rng.random() < probability)

    def between(self, low: float, high: float) -> float:
        """Draw a number."""
        return float(self.rng.uniform(low, high))
