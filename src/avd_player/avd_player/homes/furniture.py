# ruff: noqa: PLR2004 - sizes of things
"""Furniture and other things in homes, each with dimensions, parts and colours of its own.

Things stand in a frame of their own: x to the right along the wall that they stand at, y from
that wall (0) into the room, z up from the floor, the middle of the back at the origin.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from avd_player.homes import textures
from avd_player.homes.mesh import Mesh, box, cushion, cylinder, join, lathe, rectangle, rod
from avd_player.homes.textures import Materials, hsv
from gridnav.rgbd import CLASSES

if TYPE_CHECKING:
    from collections.abc import Callable

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


def _legs(
    style: Style, x: float, y0: float, y1: float, height: float, label: int, thick: float = 0.04
) -> list[Mesh]:
    """Return four legs at x and -x, y0 and y1, square or round, upright or splayed."""
    material = style.leg()
    kind = style.rng.integers(3)
    legs = []
    for side in (-1.0, 1.0):
        for y, out in ((y0, -1.0), (y1, 1.0)):
            if kind == 0:
                half = thick / 2
                low = (side * x - half, y - half, 0.0)
                legs.append(box(low, (side * x + half, y + half, height), material, label))
            elif kind == 1:
                legs.append(
                    cylinder(
                        side * x,
                        y,
                        0.0,
                        height,
                        thick * 0.35,
                        material,
                        label,
                        segments=8,
                        top=thick * 0.6,
                    )
                )
            else:
                foot = (side * (x + 0.03), y + 0.03 * out, 0.0)
                legs.append(
                    rod(foot, (side * x, y, height), thick * 0.5, material, label, segments=8)
                )
    return legs


def table(style: Style, width: float, depth: float, height: float, label: int = TABLE) -> Item:
    """Make a table: with four legs, two trestles, or on one foot, round or with corners."""
    top, thick = style.front(), style.between(0.02, 0.05)
    below = height - thick
    kind = style.rng.integers(4)
    half, back, ahead = width / 2, 0.0, depth
    if kind == 0 and width < 1.4:
        radius = min(width, depth) / 2
        middle = depth / 2
        parts = [
            cylinder(0, middle, below, height, radius, top, label, segments=28),
            cylinder(0, middle, 0.03, below, 0.05, style.leg(), label),
            cylinder(
                0,
                middle,
                0.0,
                0.03,
                radius * 0.6,
                style.leg(),
                label,
                segments=20,
                top=radius * 0.4,
            ),
        ]
        inner = radius * 0.65
        return Item(
            join(parts),
            width,
            depth,
            height,
            (Top(-inner, middle - inner, inner, middle + inner, height),),
        )
    parts = [box((-half, back, below), (half, ahead, height), top, label, cell=0.3)]
    if kind == 1:
        material = style.leg()
        for side in (-1.0, 1.0):
            x = side * (half - 0.18)
            parts += [
                box((x - 0.03, 0.08, 0.0), (x + 0.03, depth - 0.08, 0.05), material, label),
                box(
                    (x - 0.025, depth / 2 - 0.05, 0.05),
                    (x + 0.025, depth / 2 + 0.05, below),
                    material,
                    label,
                ),
                box(
                    (x - 0.03, 0.12, below - 0.05),
                    (x + 0.03, depth - 0.12, below),
                    material,
                    label,
                ),
            ]
        parts.append(
            box(
                (-half + 0.18, depth / 2 - 0.02, below - 0.15),
                (half - 0.18, depth / 2 + 0.02, below - 0.05),
                material,
                label,
            )
        )
    else:
        parts += _legs(
            style, half - 0.06, 0.06, depth - 0.06, below, label, style.between(0.035, 0.07)
        )
        if height > 0.55:
            apron = style.front() if style.chance(0.2) else top
            parts += [
                box(
                    (-half + 0.07, y - 0.01, below - 0.08),
                    (half - 0.07, y + 0.01, below),
                    apron,
                    label,
                )
                for y in (0.07, depth - 0.07)
            ]
        elif style.chance(0.5):
            parts.append(
                box((-half + 0.06, 0.06, 0.12), (half - 0.06, depth - 0.06, 0.14), top, label)
            )
    return Item(
        join(parts),
        width,
        depth,
        height,
        (Top(-half + 0.05, 0.05, half - 0.05, depth - 0.05, height),),
    )


def chair(style: Style) -> Item:
    """Make a chair with four legs: slats, boards or a padded back, some with arms."""
    width, depth = style.between(0.4, 0.5), style.between(0.42, 0.5)
    seat, height = style.between(0.43, 0.48), style.between(0.8, 1.05)
    frame, pad = style.leg(), style.cloth() if style.chance(0.6) else style.front()
    half = width / 2
    parts = []
    legs = style.rng.integers(2)
    for side in (-1.0, 1.0):
        x = side * (half - 0.03)
        if legs:
            parts += [
                rod((x * 1.08, depth - 0.01, 0), (x, depth - 0.06, seat), 0.017, frame, CHAIR),
                rod((x * 1.08, 0.0, 0), (x, 0.06, seat), 0.017, frame, CHAIR),
                rod((x, 0.06, seat), (x, 0.0, height), 0.016, frame, CHAIR),
            ]
        else:
            parts += [
                box((x - 0.02, depth - 0.06, 0), (x + 0.02, depth - 0.02, seat), frame, CHAIR),
                box((x - 0.02, 0.02, 0), (x + 0.02, 0.06, height), frame, CHAIR),
            ]
    if style.chance(0.5):
        parts.append(
            cushion((0, depth / 2, seat), (half, depth / 2, 0.04), pad, CHAIR, roundness=0.35)
        )
    else:
        parts.append(box((-half, 0.02, seat - 0.02), (half, depth, seat + 0.015), pad, CHAIR))
    kind = style.rng.integers(3)
    if kind == 0:
        low = seat + style.between(0.08, 0.2)
        parts.append(
            cushion(
                (0, 0.035, (low + height) / 2),
                (half * 0.95, 0.03, (height - low) / 2),
                pad,
                CHAIR,
                roundness=0.3,
                tilt=0.05,
            )
        )
    elif kind == 1:
        count = int(style.rng.integers(2, 5))
        for level in np.linspace(seat + 0.15, height - 0.05, count).tolist():
            parts.append(
                box(
                    (-half + 0.04, 0.015, level - 0.03),
                    (half - 0.04, 0.04, level + 0.03),
                    frame,
                    CHAIR,
                )
            )
    else:
        parts.append(
            box((-half + 0.02, 0.0, height - 0.08), (half - 0.02, 0.04, height), frame, CHAIR)
        )
        for x in np.linspace(-half + 0.08, half - 0.08, int(style.rng.integers(3, 6))).tolist():
            parts.append(
                box((x - 0.012, 0.02, seat), (x + 0.012, 0.04, height - 0.08), frame, CHAIR)
            )
    if style.chance(0.2):
        for side in (-1.0, 1.0):
            x = side * (half - 0.02)
            parts += [
                box(
                    (x - 0.02, 0.04, seat + 0.2),
                    (x + 0.02, depth - 0.05, seat + 0.225),
                    frame,
                    CHAIR,
                ),
                box(
                    (x - 0.015, depth - 0.1, seat),
                    (x + 0.015, depth - 0.07, seat + 0.2),
                    frame,
                    CHAIR,
                ),
            ]
    return Item(join(parts), width, depth, height)


def office_chair(style: Style) -> Item:
    """Make a swivel chair."""
    seat, height = style.between(0.45, 0.52), style.between(0.9, 1.15)
    pad = style.cloth() if style.chance(0.6) else style.black
    foot = style.black if style.chance(0.6) else style.steel
    parts = [cylinder(0, 0.3, 0.1, seat - 0.04, 0.025, style.steel, CHAIR, segments=10)]
    for angle in (np.arange(5) * 2 * np.pi / 5).tolist():
        x, y = 0.27 * np.cos(angle), 0.3 + 0.27 * np.sin(angle)
        parts += [
            rod((0, 0.3, 0.12), (x, y, 0.07), 0.02, foot, CHAIR),
            cushion(
                (x, y, 0.03),
                (0.025, 0.025, 0.03),
                style.black,
                CHAIR,
                roundness=0.8,
                rings=4,
                segments=8,
            ),
        ]
    parts += [
        cushion((0, 0.3, seat), (0.24, 0.24, 0.05), pad, CHAIR, roundness=0.4),
        cushion(
            (0, 0.07, (seat + height) / 2 + 0.08),
            (0.22, 0.04, (height - seat) / 2 - 0.08),
            pad,
            CHAIR,
            roundness=0.4,
            tilt=0.08,
        ),
        rod((0, 0.1, seat - 0.03), (0, 0.06, seat + 0.25), 0.02, style.black, CHAIR),
    ]
    if style.chance(0.6):
        for side in (-0.27, 0.27):
            parts += [
                box(
                    (side - 0.025, 0.15, seat + 0.2),
                    (side + 0.025, 0.42, seat + 0.23),
                    style.black,
                    CHAIR,
                ),
                rod(
                    (side * 0.9, 0.28, seat - 0.02),
                    (side, 0.28, seat + 0.2),
                    0.015,
                    style.black,
                    CHAIR,
                ),
            ]
    return Item(join(parts), 0.6, 0.6, height)


def stool(style: Style) -> Item:
    """Make a stool."""
    height, radius = style.between(0.43, 0.75), style.between(0.15, 0.2)
    parts = _legs(
        style, radius * 0.7, 0.2 - radius * 0.7, 0.2 + radius * 0.7, height - 0.02, CHAIR, 0.03
    )
    seat = style.front() if style.chance(0.5) else style.cloth()
    parts.append(cylinder(0, 0.2, height - 0.03, height, radius, seat, CHAIR, segments=18))
    return Item(join(parts), 0.4, 0.4, height)


def sofa(style: Style, width: float) -> Item:
    """Make a sofa, or an armchair if it is narrow: base, arms, back, cushions and pillows."""
    depth, height = style.between(0.8, 0.98), style.between(0.7, 0.95)
    seat, arm = style.between(0.38, 0.46), style.between(0.5, 0.66)
    thick, feet = style.between(0.1, 0.24), style.between(0.03, 0.12)
    body = style.cloth()
    pad = style.cloth() if style.chance(0.25) else body
    half = width / 2
    soft = style.between(0.15, 0.4)
    parts = [
        box(
            (-half + 0.03, 0.03, feet),
            (half - 0.03, depth - 0.03, seat - 0.12),
            body,
            SOFA,
            cell=0.4,
        )
    ]
    foot = style.leg()
    for x in (-half + 0.1, half - 0.1):
        parts += [
            cylinder(x, y, 0, feet, 0.025, foot, SOFA, segments=8) for y in (0.1, depth - 0.1)
        ]
    for side in (-1.0, 1.0):
        middle = side * (half - thick / 2)
        parts.append(
            cushion(
                (middle, depth / 2, (arm + feet) / 2),
                (thick / 2, depth / 2, (arm - feet) / 2),
                body,
                SOFA,
                roundness=soft,
            )
        )
    parts.append(
        cushion(
            (0, 0.11, (height + feet) / 2 - 0.02),
            (half - 0.02, 0.11, (height - feet) / 2 - 0.04),
            body,
            SOFA,
            roundness=soft,
        )
    )
    inner = width - 2 * thick
    count = max(1, round(inner / style.between(0.55, 0.85)))
    step = inner / count
    for index in range(count):
        x = -inner / 2 + (index + 0.5) * step
        parts += [
            cushion(
                (x, (depth + 0.2) / 2, seat - 0.06),
                (step / 2, (depth - 0.2) / 2, 0.08),
                pad,
                SOFA,
                roundness=0.25,
            ),
            cushion(
                (x, 0.25, (seat + height) / 2),
                (step / 2 - 0.01, 0.08, (height - seat) / 2),
                pad,
                SOFA,
                roundness=0.3,
                tilt=-0.15,
            ),
        ]
    for _ in range(int(style.rng.integers(0, 4))):
        x = style.between(-inner / 2 + 0.18, inner / 2 - 0.18) if inner > 0.5 else 0.0
        parts.append(
            cushion(
                (x, 0.4, seat + 0.19),
                (0.2, 0.06, 0.18),
                style.cloth(),
                SOFA,
                roundness=0.5,
                tilt=-0.35,
            )
        )
    if width > 1.9 and style.chance(0.4):
        side = style.rng.choice([-1.0, 1.0])
        long = style.between(1.35, 1.6)
        low, high = sorted([side * half, side * (half - 0.75)])
        parts += [
            box(
                (low + 0.02, depth - 0.05, feet),
                (high - 0.02, long - 0.02, seat - 0.12),
                body,
                SOFA,
                cell=0.4,
            ),
            cushion(
                ((low + high) / 2, (depth + long) / 2 - 0.05, seat - 0.06),
                (0.37, (long - depth) / 2 + 0.06, 0.08),
                pad,
                SOFA,
                roundness=0.25,
            ),
        ]
        depth = long
    return Item(join(parts), width, depth, height)


def sofa_group(style: Style) -> Item:
    """Make a sofa with a low table and a rug before it."""
    seat = sofa(style, style.between(1.5, 2.3))
    parts = [seat.mesh]
    depth = seat.depth
    tops: tuple[Top, ...] = ()
    if style.chance(0.75) and depth < 1.1:
        low = table(
            style, style.between(0.6, 1.1), style.between(0.45, 0.6), style.between(0.38, 0.5)
        )
        y = seat.depth + style.between(0.3, 0.4)
        x = style.between(-0.2, 0.2)
        parts.append(low.mesh.moved(x, y))
        tops = tuple(Top(t.x0 + x, t.y0 + y, t.x1 + x, t.y1 + y, t.z) for t in low.tops)
        depth = y + low.depth
    if style.chance(0.6):
        half = min(seat.width / 2, style.between(0.8, 1.1))
        parts.append(_rug(style, -half, seat.depth - 0.3, half, depth - 0.02))
    return Item(join(parts), seat.width, depth, seat.height, tops)


def _rug(style: Style, x0: float, y0: float, x1: float, y1: float) -> Mesh:
    rng = style.rng
    colour = hsv(rng.random(), rng.uniform(0.05, 0.7), rng.uniform(0.25, 0.9))
    material = style.materials.add(textures.rug, colour)
    side = style.materials.colour(colour)
    return join(
        [
            rectangle(
                (x0, y0, 0.012),
                (x1 - x0, 0, 0),
                (0, y1 - y0, 0),
                material,
                FLOOR,
                cell=0.25,
                fit=True,
            ),
            box((x0, y0, 0.0), (x1, y1, 0.0115), side, FLOOR),
        ]
    )


def dining_set(style: Style) -> Item:
    """Make a table with chairs around it."""
    width, depth = style.between(0.8, 1.7), style.between(0.75, 0.95)
    board = table(style, width, depth, style.between(0.71, 0.77))
    seed = style.rng.integers(2**31)
    out = style.between(0.1, 0.3)
    parts = [board.mesh.moved(0, 0.45)]
    places = [
        (x, side) for side in (0, 1) for x in ((0.0,) if width < 1.1 else (-width / 4, width / 4))
    ]
    for x, side in places:
        if style.chance(0.12):
            continue
        # The chairs of a set are alike.
        rng, style.rng = style.rng, np.random.default_rng(seed)
        one = chair(style)
        style.rng = rng
        turn = style.between(-0.25, 0.25) if style.chance(0.4) else 0.0
        y = 0.45 - out if side == 0 else 0.45 + depth + out
        parts.append(one.mesh.moved(x, y, 0, turn + (np.pi if side else 0.0)))
    tops = tuple(Top(t.x0, t.y0 + 0.45, t.x1, t.y1 + 0.45, t.z) for t in board.tops)
    return Item(join(parts), max(width, 1.0), depth + 0.9, board.height, tops)


def desk_set(style: Style) -> Item:
    """Make a desk with drawers, a screen and a chair."""
    width, depth, height = (
        style.between(1.0, 1.5),
        style.between(0.6, 0.75),
        style.between(0.72, 0.76),
    )
    desk = table(style, width, depth, height)
    parts = [desk.mesh]
    half = width / 2
    if style.chance(0.6):
        side = style.rng.choice([-1.0, 1.0])
        low, high = sorted([side * (half - 0.05), side * (half - 0.45)])
        front = style.front()
        parts.append(box((low, 0.05, 0.06), (high, depth - 0.08, height - 0.06), front, TABLE))
        for level in (0.12, 0.33, 0.52):
            parts += [
                box(
                    (low + 0.01, depth - 0.08, level),
                    (high - 0.01, depth - 0.065, level + 0.17),
                    front,
                    TABLE,
                ),
                box(
                    ((low + high) / 2 - 0.06, depth - 0.065, level + 0.1),
                    ((low + high) / 2 + 0.06, depth - 0.05, level + 0.115),
                    style.steel,
                    TABLE,
                ),
            ]
    if style.chance(0.75):
        parts.append(_screen(style).moved(style.between(-0.15, 0.15), 0.12, height))
        parts.append(box((-0.22, 0.35, height), (0.22, 0.47, height + 0.02), style.black, CLUTTER))
    seat = office_chair(style) if style.chance(0.65) else chair(style)
    turn = np.pi + style.between(-0.5, 0.5)
    parts.append(seat.mesh.moved(style.between(-0.1, 0.1), depth + 0.5, 0, turn))
    tops = (
        Top(-half + 0.08, 0.1, -half * 0.45, depth - 0.08, height),
        Top(half * 0.45, 0.1, half - 0.08, depth - 0.08, height),
    )
    return Item(join(parts), width, depth + 0.55, height, tops)


def _screen(style: Style) -> Mesh:
    width, height = style.between(0.45, 0.7), style.between(0.28, 0.4)
    parts = [
        box((-width / 2, 0, 0.1), (width / 2, 0.03, 0.1 + height), style.black, CLUTTER),
        box((-0.02, -0.01, 0.01), (0.02, 0.005, 0.2), style.black, CLUTTER),
        box((-0.12, -0.06, 0), (0.12, 0.1, 0.012), style.black, CLUTTER),
    ]
    if style.chance(0.6):
        parts.append(_shown(style, width, height, 0.1, 0.0315))
    return join(parts)


def _shown(style: Style, width: float, height: float, z: float, y: float) -> Mesh:
    """Return a screen that is on; it is seen from the front."""
    rng = style.rng
    colour = hsv(rng.random(), rng.uniform(0.1, 0.8), rng.uniform(0.3, 0.9))
    material = style.materials.add(textures.painting, colour, glow=rng.uniform(0.6, 1.1))
    return rectangle(
        (width / 2 - 0.015, y, z + 0.015),
        (-width + 0.03, 0, 0),
        (0, 0, height - 0.03),
        material,
        CLUTTER,
        fit=True,
    )


def tv_bench(style: Style) -> Item:
    """Make a low sideboard with a television on it."""
    item = cupboard(
        style, style.between(1.1, 1.8), style.between(0.38, 0.45), style.between(0.4, 0.6)
    )
    width = style.between(0.8, min(1.3, item.width))
    height = width * 0.57
    parts = [
        box((-width / 2, 0.14, 0.06), (width / 2, 0.18, 0.06 + height), style.black, CLUTTER),
        box((-0.25, 0.1, 0.0), (0.25, 0.26, 0.015), style.black, CLUTTER),
        box((-0.04, 0.14, 0.0), (0.04, 0.17, 0.07), style.black, CLUTTER),
    ]
    if style.chance(0.4):
        parts.append(_shown(style, width, height, 0.06, 0.1815))
    edge = item.width / 2
    tops = (
        (Top(width / 2, 0.08, edge - 0.05, 0.33, item.height),) if edge - width / 2 > 0.2 else ()
    )
    return Item(
        join([item.mesh, join(parts).moved(0, 0, item.height)]),
        item.width,
        item.depth,
        item.height + height,
        tops,
    )


def cupboard(style: Style, width: float, depth: float, height: float) -> Item:
    """Make a cupboard, wardrobe or sideboard with doors, drawers and handles."""
    body, front = style.front(), style.front()
    half, plinth = width / 2, style.between(0.03, 0.1)
    cell = 0.4
    parts = [
        box((-half + 0.02, 0.01, 0), (half - 0.02, depth - 0.05, plinth), style.black, CLUTTER),
        box((-half, 0, plinth), (half, depth - 0.02, height), body, CLUTTER, cell=cell),
    ]
    count = max(1, round(width / style.between(0.4, 0.6)))
    step = width / count
    handle = style.rng.integers(3)
    for index in range(count):
        low, high = -half + index * step + 0.004, -half + (index + 1) * step - 0.004
        rows = [plinth + 0.005, height - 0.005]
        if height < 1.2 and style.chance(0.4):
            rows = np.linspace(rows[0], rows[1], int(style.rng.integers(3, 5))).tolist()
        for below, above in pairwise(rows):
            parts.append(
                box(
                    (low, depth - 0.02, below + 0.003),
                    (high, depth, above - 0.003),
                    front,
                    CLUTTER,
                    cell=cell,
                )
            )
            x, z = (low + high) / 2, (below + above) / 2
            if handle == 0:
                parts.append(
                    box(
                        (x - 0.06, depth, above - 0.08),
                        (x + 0.06, depth + 0.02, above - 0.065),
                        style.steel,
                        CLUTTER,
                    )
                )
            elif handle == 1:
                side = high - 0.06 if index % 2 == 0 else low + 0.06
                parts.append(
                    rod(
                        (side, depth + 0.015, z - 0.07),
                        (side, depth + 0.015, z + 0.07),
                        0.008,
                        style.steel,
                        CLUTTER,
                    )
                )
            else:
                parts.append(
                    cushion(
                        (x, depth + 0.01, above - 0.07),
                        (0.014, 0.014, 0.014),
                        style.steel,
                        CLUTTER,
                        roundness=1.0,
                        rings=4,
                        segments=8,
                    )
                )
    tops = (Top(-half + 0.05, 0.05, half - 0.05, depth - 0.05, height),) if height < 1.3 else ()
    return Item(join(parts), width, depth + 0.02, height, tops)


def bookcase(style: Style) -> Item:
    """Make a bookcase with shelves, books and other things in it, some without a back."""
    width, depth = style.between(0.6, 1.2), style.between(0.24, 0.36)
    height = style.between(0.8, 2.1)
    material, half, thick = style.front(), width / 2, style.between(0.018, 0.03)
    rows = max(2, round(height / style.between(0.3, 0.42)))
    levels = np.linspace(0.05, height - thick, rows + 1)
    parts = [
        box(
            (side - thick / 2, 0, 0),
            (side + thick / 2, depth, height),
            material,
            BOOKCASE,
            cell=0.4,
        )
        for side in (-half + thick / 2, half - thick / 2)
    ]
    parts += [
        box(
            (-half + thick, 0.005, z), (half - thick, depth - 0.005, z + thick), material, BOOKCASE
        )
        for z in levels.tolist()
    ]
    if style.chance(0.75):
        parts.append(
            box(
                (-half + thick, 0, 0.05),
                (half - thick, 0.008, height - 0.005),
                material,
                BOOKCASE,
                cell=0.4,
            )
        )
    tops = []
    gap = float(levels[1] - levels[0]) - thick
    for index, z in enumerate((levels[:-1] + thick).tolist()):
        if style.chance(0.15):
            if 0.35 < z < 1.2 and gap > 0.3:
                tops.append(Top(-half + 0.08, 0.08, half - 0.08, depth - 0.02, z))
            continue
        x = -half + thick + 0.005
        end = half - thick - (style.between(0, width * 0.5) if style.chance(0.6) else 0.01)
        while x < end - 0.05:
            wide = style.between(0.015, 0.05)
            tall, deep = gap * style.between(0.55, 0.95), depth * style.between(0.6, 0.9)
            parts.append(
                box((x, 0.02, z), (x + wide, 0.02 + deep, z + tall), style.any_colour(), BOOKCASE)
            )
            x += wide + (style.between(0.05, 0.2) if style.chance(0.05) else 0.001)
        free = half - thick - end
        if free > 0.2:
            if gap > 0.3 and 0.35 < z < 1.2 and index:
                tops.append(Top(end + 0.07, 0.08, half - thick - 0.05, depth - 0.02, z))
            elif style.chance(0.5):
                parts.append(
                    small_thing(style, min(0.2, gap)).mesh.moved(end + free / 2, depth / 2, z)
                )
    if height < 1.25:
        tops.append(Top(-half + 0.06, 0.06, half - 0.06, depth - 0.04, height))
    return Item(join(parts), width, depth, height, tuple(tops))


def bed_set(style: Style) -> Item:
    """Make a bed with a blanket, pillows and small tables with lamps beside it."""
    wide = style.rng.choice([0.9, 1.0, 1.4, 1.6])
    long, height = 2.05, style.between(0.4, 0.55)
    half, frame, sheet, blanket = wide / 2, style.front(), style.white, style.cloth()
    parts = [
        box(
            (-half - 0.03, 0.03, 0.12),
            (half + 0.03, long, height - 0.16),
            frame,
            CLUTTER,
            cell=0.4,
        ),
        cushion(
            (0, long / 2, height - 0.1),
            (half, long / 2 - 0.03, 0.1),
            sheet,
            CLUTTER,
            roundness=0.15,
        ),
        cushion(
            (0, long * 0.62, height - 0.06),
            (half + 0.04, long * 0.37, 0.11),
            blanket,
            CLUTTER,
            roundness=0.2,
            rings=10,
            segments=24,
        ),
        box(
            (-half - 0.05, 0, 0),
            (half + 0.05, 0.05, style.between(0.7, 1.15)),
            frame,
            CLUTTER,
            cell=0.4,
        ),
    ]
    parts += [
        box((x - 0.03, y, 0), (x + 0.03, y + 0.06, 0.12), frame, CLUTTER)
        for x in (-half, half)
        for y in (0.1, long - 0.1)
    ]
    for x in (0.0,) if wide < 1.2 else (-half / 2, half / 2):
        parts.append(
            cushion(
                (x, 0.3, height + 0.05),
                (0.32, 0.2, 0.08),
                style.cloth() if style.chance(0.3) else sheet,
                CLUTTER,
                roundness=0.5,
            )
        )
    width, tops, lamps = wide + 0.1, [], []
    side = 0.5
    beside = [-1.0, 1.0] if wide > 1.2 else [float(style.rng.choice([-1.0, 1.0]))]
    if style.chance(0.85):
        for sign in beside:
            small = (
                table(style, 0.42, 0.38, style.between(0.42, 0.55))
                if style.chance(0.5)
                else cupboard(style, 0.42, 0.38, style.between(0.42, 0.55))
            )
            x = sign * (half + 0.3)
            mesh = small.mesh
            # Beside a bed even a small cupboard is a table.
            parts.append(mesh.moved(x, 0.02))
            if style.chance(0.7):
                lamp = table_lamp(style)
                parts.append(lamp.mesh.moved(x, 0.17, small.height))
                lamps.append((x, 0.17, small.height + 0.45, 0.6))
            else:
                tops.append(Top(x - 0.14, 0.08, x + 0.14, 0.32, small.height))
        width = wide + 0.1 + 2 * side
    return Item(join(parts), width, long, 1.1, tuple(tops), tuple(lamps))


def kitchen_row(style: Style, width: float, *, cupboards_above: bool) -> Item:
    """Make a kitchen: base cupboards, worktop, sink, hob, oven, and more.

    Args:
        style: Of the home.
        width: Metres.
        cupboards_above: Whether there are cupboards or shelves on the wall, and often a fridge.
    """
    depth, height = 0.6, style.between(0.86, 0.93)
    front, handle = style.front(), style.steel
    rng = style.rng
    top = (
        style.materials.add(
            textures.stone,
            hsv(rng.random(), rng.uniform(0, 0.2), rng.uniform(0.15, 0.9)),
            0.8,
            gloss=0.08,
        )
        if style.chance(0.7)
        else style.wood()
    )
    half = width / 2
    parts, tops = [], []
    start = -half
    tall = 0.0
    if cupboards_above and width > 1.9 and style.chance(0.85):
        tall = style.between(1.6, 2.0)
        parts.append(fridge(style, tall).mesh.moved(-half + 0.31, 0))
        start += 0.62
    parts += [
        box((start + 0.01, 0, 0), (half, depth - 0.06, 0.1), style.black, CLUTTER),
        box(
            (start + 0.005, 0, 0.1), (half, depth - 0.02, height - 0.035), front, CLUTTER, cell=0.4
        ),
        box((start, 0, height - 0.035), (half, depth + 0.01, height), top, CLUTTER, cell=0.3),
    ]
    count = max(2, round((half - start) / 0.6))
    step = (half - start) / count
    oven = int(rng.integers(count))
    sink = int((oven + rng.integers(1, count)) % count)
    for index in range(count):
        low, high = start + index * step + 0.004, start + (index + 1) * step - 0.004
        middle = (low + high) / 2
        if index == oven:
            parts += [
                box(
                    (low, depth - 0.02, 0.12),
                    (high, depth + 0.005, height - 0.05),
                    style.black,
                    CLUTTER,
                ),
                box(
                    (low + 0.04, depth + 0.005, height - 0.18),
                    (high - 0.04, depth + 0.03, height - 0.16),
                    handle,
                    CLUTTER,
                ),
                box(
                    (low, depth, height - 0.12),
                    (high, depth + 0.006, height - 0.05),
                    style.steel,
                    CLUTTER,
                ),
                box(
                    (low + 0.02, 0.06, height),
                    (high - 0.02, depth - 0.06, height + 0.006),
                    style.black,
                    CLUTTER,
                ),
            ]
            parts += [
                cylinder(
                    middle + dx,
                    0.3 + dy,
                    height + 0.006,
                    height + 0.01,
                    0.08,
                    style.steel,
                    CLUTTER,
                    segments=14,
                )
                for dx in (-0.13, 0.13)
                for dy in (-0.11, 0.11)
            ]
            if style.chance(0.6):
                parts.append(pot(style).mesh.moved(middle + 0.13, 0.19, height + 0.01))
            continue
        drawers = style.chance(0.35)
        rows = np.linspace(0.11, height - 0.045, 4 if drawers else 2).tolist()
        for below, above in pairwise(rows):
            parts += [
                box(
                    (low, depth - 0.02, below + 0.003),
                    (high, depth, above - 0.003),
                    front,
                    CLUTTER,
                ),
                box(
                    (middle - 0.07, depth, above - 0.06),
                    (middle + 0.07, depth + 0.02, above - 0.045),
                    handle,
                    CLUTTER,
                ),
            ]
        if index == sink:
            parts += [
                box(
                    (low + 0.05, 0.12, height),
                    (high - 0.05, depth - 0.1, height + 0.004),
                    style.steel,
                    CLUTTER,
                ),
                box(
                    (low + 0.09, 0.16, height + 0.004),
                    (high - 0.09, depth - 0.14, height + 0.005),
                    style.black,
                    CLUTTER,
                ),
                rod(
                    (middle, 0.08, height),
                    (middle, 0.08, height + 0.28),
                    0.012,
                    style.steel,
                    CLUTTER,
                ),
                rod(
                    (middle, 0.08, height + 0.28),
                    (middle, 0.25, height + 0.24),
                    0.01,
                    style.steel,
                    CLUTTER,
                ),
            ]
        else:
            tops.append(Top(low + 0.06, 0.12, high - 0.06, depth - 0.08, height))
    above = style.between(1.4, 1.5)
    if cupboards_above and style.chance(0.85):
        upper = start + (step if style.chance(0.3) else 0.0)
        other = style.front() if style.chance(0.3) else front
        high_end = above + style.between(0.5, 0.75)
        boxes = max(1, round((half - upper) / step))
        wide = (half - upper) / boxes
        for index in range(boxes):
            low, high = upper + index * wide, upper + (index + 1) * wide
            parts += [
                box((low, 0, above), (high, 0.32, high_end), other, CLUTTER, cell=0.4),
                box(
                    (low + 0.004, 0.32, above + 0.004),
                    (high - 0.004, 0.338, high_end - 0.004),
                    other,
                    CLUTTER,
                ),
                box(
                    ((low + high) / 2 - 0.06, 0.338, above + 0.03),
                    ((low + high) / 2 + 0.06, 0.355, above + 0.045),
                    handle,
                    CLUTTER,
                ),
            ]
    elif cupboards_above:
        parts.append(
            box((start + 0.2, 0, above), (half - 0.2, 0.24, above + 0.03), style.wood(), CLUTTER)
        )
        parts += [
            small_thing(style, 0.25).mesh.moved(x, 0.13, above + 0.03)
            for x in np.arange(start + 0.35, half - 0.3, 0.22).tolist()
        ]
    return Item(join(parts), width, depth + 0.03, 2.2 if cupboards_above else height, tuple(tops))


def fridge(style: Style, height: float) -> Item:
    """Make a fridge with one or two doors."""
    material = (
        style.steel
        if style.chance(0.4)
        else style.white
        if style.chance(0.7)
        else style.any_colour()
    )
    split = height * style.between(0.35, 0.7)
    parts = [box((-0.3, 0.02, 0.02), (0.3, 0.58, height), material, CLUTTER, cell=0.5)]
    for low, high in ((0.04, split - 0.005), (split + 0.005, height - 0.01)):
        parts += [
            box((-0.3, 0.58, low), (0.3, 0.62, high), material, CLUTTER, cell=0.5),
            box(
                (0.24, 0.62, (low + high) / 2 - 0.12),
                (0.26, 0.655, (low + high) / 2 + 0.12),
                style.steel,
                CLUTTER,
            ),
        ]
    return Item(join(parts), 0.62, 0.65, height)


def kitchen_island(style: Style) -> Item:
    """Make a counter that stands free or at a wall, with cupboards below and stools before it."""
    width, depth, height = (
        style.between(0.9, 1.5),
        style.between(0.45, 0.6),
        style.between(0.88, 1.05),
    )
    low = cupboard(style, width, depth, height - 0.04)
    top = style.wood() if style.chance(0.5) else style.front()
    parts = [
        low.mesh,
        box(
            (-width / 2 - 0.03, 0, height - 0.04),
            (width / 2 + 0.03, depth + 0.04, height),
            top,
            CLUTTER,
            cell=0.3,
        ),
    ]
    return Item(
        join(parts),
        width + 0.06,
        depth + 0.04,
        height,
        (Top(-width / 2, 0.06, width / 2, depth - 0.05, height),),
    )


def toilet(style: Style) -> Item:
    """Make a toilet."""
    bowl = [
        (0.0, 0.0),
        (0.13, 0.0),
        (0.12, 0.1),
        (0.17, 0.3),
        (0.2, 0.38),
        (0.2, 0.41),
        (0.0, 0.42),
    ]
    parts = [
        lathe(bowl, style.white, CLUTTER, center=(0, 0.4), segments=20),
        box((-0.1, 0.1, 0.02), (0.1, 0.35, 0.36), style.white, CLUTTER),
        box((-0.2, 0.0, 0.4), (0.2, 0.18, 0.8), style.white, CLUTTER),
        box((-0.03, 0.07, 0.8), (0.03, 0.11, 0.81), style.steel, CLUTTER),
    ]
    return Item(join(parts), 0.42, 0.62, 0.8)


def washbasin(style: Style) -> Item:
    """Make a washbasin with a cupboard below and a mirror above."""
    width = style.between(0.5, 0.9)
    low = cupboard(style, width, 0.42, 0.72)
    half = width / 2
    glass = style.materials.add(textures.metal, (0.72, 0.78, 0.8), 2.0, gloss=0.4)
    parts = [
        low.mesh,
        box((-half - 0.02, 0, 0.72), (half + 0.02, 0.48, 0.84), style.white, CLUTTER),
        lathe(
            [(0.0, 0.8405), (0.18, 0.841), (0.2, 0.845), (0.0, 0.846)],
            style.steel,
            CLUTTER,
            center=(0, 0.26),
            segments=20,
        ),
        rod((0, 0.06, 0.84), (0, 0.06, 1.0), 0.013, style.steel, CLUTTER),
        rod((0, 0.06, 1.0), (0, 0.18, 0.97), 0.01, style.steel, CLUTTER),
        box((-half * 0.9, 0, 1.1), (half * 0.9, 0.025, style.between(1.6, 1.9)), glass, CLUTTER),
    ]
    return Item(
        join(parts), width + 0.04, 0.48, 1.9, (Top(half - 0.17, 0.1, half - 0.02, 0.4, 0.84),)
    )


def bathtub(style: Style) -> Item:
    """Make a bathtub: an outer wall, a rim and a basin."""
    long, wide, height = (
        style.between(1.5, 1.7),
        style.between(0.7, 0.75),
        style.between(0.52, 0.6),
    )
    half, rim = long / 2, 0.06
    parts = [
        box((-half, 0, 0), (half, rim, height), style.white, CLUTTER, cell=0.4),
        box((-half, wide - rim, 0), (half, wide, height), style.white, CLUTTER, cell=0.4),
        box((-half, rim, 0), (-half + rim, wide - rim, height), style.white, CLUTTER),
        box((half - rim, rim, 0), (half, wide - rim, height), style.white, CLUTTER),
        box((-half + rim, rim, 0), (half - rim, wide - rim, 0.15), style.white, CLUTTER, cell=0.4),
        rod(
            (-half + 0.15, 0.04, height),
            (-half + 0.15, 0.04, height + 0.15),
            0.015,
            style.steel,
            CLUTTER,
        ),
        rod(
            (-half + 0.15, 0.04, height + 0.15),
            (-half + 0.15, 0.18, height + 0.12),
            0.013,
            style.steel,
            CLUTTER,
        ),
    ]
    return Item(join(parts), long, wide, height)


def washing_machine(style: Style) -> Item:
    """Make a washing machine with a round door."""
    parts = [box((-0.3, 0, 0.02), (0.3, 0.57, 0.85), style.white, CLUTTER, cell=0.4)]
    ring = lathe(
        [(0.0, 0.0), (0.19, 0.0), (0.19, 0.02), (0.15, 0.035), (0.0, 0.035)],
        style.steel,
        CLUTTER,
        segments=22,
    )
    glass = lathe(
        [(0.0, 0.036), (0.14, 0.036), (0.1, 0.05), (0.0, 0.055)], style.black, CLUTTER, segments=22
    )
    parts += [_lying(part, 0.57, 0.45) for part in (ring, glass)]
    parts.append(box((-0.28, 0.57, 0.72), (0.0, 0.575, 0.82), style.steel, CLUTTER))
    return Item(join(parts), 0.62, 0.62, 0.85, (Top(-0.22, 0.08, 0.22, 0.5, 0.85),))


def _lying(part: Mesh, y: float, z: float) -> Mesh:
    """Return a mesh whose z axis is turned to y."""
    turn = np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]], np.float32)
    return replace(
        part,
        vertices=part.vertices @ turn + np.array([0, y, z], np.float32),
        normals=part.normals @ turn,
    )


def plant(style: Style, height: float) -> Item:
    """Make a plant in a pot: a bush of leaves on stems, or long blades."""
    radius = style.between(0.3, 0.5) * height * 0.35 + 0.04
    pot_height = min(0.35, 0.3 * height + 0.03)
    clay = style.any_colour()
    parts = [
        lathe(
            [
                (0.0, 0.0),
                (radius * 0.7, 0.0),
                (radius, pot_height),
                (radius * 0.9, pot_height),
                (radius * 0.85, pot_height - 0.02),
            ],
            clay,
            CLUTTER,
            segments=14,
        ),
        lathe(
            [(radius * 0.86, pot_height - 0.02), (0.0, pot_height - 0.02)],
            style.soil,
            CLUTTER,
            segments=14,
        ),
    ]
    spread = 0.0
    blades = style.chance(0.4)
    for _ in range(int(style.rng.integers(12, 26))):
        turn = style.between(0, 2 * np.pi)
        lean = style.between(0.1, 0.9)
        long = (height - pot_height) * style.between(0.4, 1.0)
        if blades:
            leaf = cushion(
                (0, 0, long / 2),
                (0.025, 0.006, long / 2),
                style.leaf,
                CLUTTER,
                roundness=1.0,
                rings=6,
                segments=6,
            )
            leaf = _tilted(leaf, lean * 0.5)
            parts.append(leaf.moved(0, 0, pot_height - 0.03, turn))
            reach = long * np.sin(lean * 0.5)
        else:
            reach = long * 0.45 * np.sin(lean)
            x, y, z = (
                reach * np.cos(turn),
                reach * np.sin(turn),
                pot_height + long * np.cos(lean * 0.6),
            )
            parts.append(
                rod((0, 0, pot_height - 0.03), (x, y, z), 0.005, style.soil, CLUTTER, segments=4)
            )
            big = style.between(0.05, 0.1) * (0.5 + height * 0.6)
            leaf = _tilted(
                cushion(
                    (0, 0, 0),
                    (big * 0.6, 0.006, big),
                    style.leaf,
                    CLUTTER,
                    roundness=1.0,
                    rings=4,
                    segments=8,
                ),
                style.between(0.3, 1.5),
            )
            parts.append(leaf.moved(x, y, z, turn + style.between(-0.6, 0.6)))
            reach += big
        spread = max(spread, reach)
    half = max(radius, min(spread, 0.3))
    return Item(join(parts).moved(0, half), 2 * half, 2 * half, height)


def _tilted(part: Mesh, angle: float) -> Mesh:
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]], np.float32)
    return replace(part, vertices=part.vertices @ turn, normals=part.normals @ turn)


def _shade(style: Style, *, on: bool) -> int:
    rng = style.rng
    colour = hsv(rng.uniform(0.06, 0.15), rng.uniform(0.02, 0.5), rng.uniform(0.75, 1.0))
    return style.materials.colour(colour, glow=1.3 if on else 0.0)


def floor_lamp(style: Style) -> Item:
    """Make a floor lamp with a shade."""
    height, on = style.between(1.35, 1.75), style.chance(0.6)
    radius = style.between(0.13, 0.22)
    parts = [
        cylinder(0, 0.2, 0, 0.025, 0.14, style.leg(), CLUTTER, segments=18),
        rod((0, 0.2, 0.02), (0, 0.2, height - 0.2), 0.013, style.leg(), CLUTTER, segments=8),
        cylinder(
            0,
            0.2,
            height - 0.25,
            height,
            radius,
            _shade(style, on=on),
            CLUTTER,
            segments=18,
            top=radius * style.between(0.5, 1.0),
        ),
    ]
    lamps = ((0.0, 0.2, height + 0.1, 1.2),) if on else ()
    return Item(join(parts), 0.4, 0.4, height, (), lamps)


def table_lamp(style: Style) -> Item:
    """Make a lamp for a table."""
    foot, radius = style.between(0.18, 0.3), style.between(0.08, 0.13)
    base = [
        (0.0, 0.0),
        (0.07, 0.0),
        (0.07, 0.015),
        (0.02, 0.03),
        (style.between(0.015, 0.06), foot * 0.5),
        (0.012, foot),
        (0.0, foot),
    ]
    parts = [
        lathe(base, style.any_colour(), CLUTTER, segments=12),
        cylinder(
            0,
            0,
            foot,
            foot + 0.16,
            radius,
            _shade(style, on=style.chance(0.6)),
            CLUTTER,
            segments=14,
            top=radius * 0.7,
        ),
    ]
    return Item(join(parts), 2 * radius, 2 * radius, foot + 0.16)


def bin_(style: Style) -> Item:
    """Make a waste bin."""
    radius, height = style.between(0.11, 0.17), style.between(0.25, 0.6)
    material = style.steel if style.chance(0.4) else style.any_colour()
    low = radius * style.between(0.75, 1.0)
    profile = [(0.0, 0.0), (low, 0.0), (radius, height)]
    profile += (
        [(radius * 0.9, height), (radius * 0.7, 0.06), (0.0, 0.06)]
        if style.chance(0.6)
        else [(radius * 0.8, height + 0.05), (0.0, height + 0.06)]
    )
    return Item(
        lathe(profile, material, CLUTTER, center=(0, radius), segments=16),
        2 * radius,
        2 * radius,
        height,
    )


def boxes(style: Style) -> Item:
    """Make a stack of cardboard boxes, or a basket."""
    rng = style.rng
    card = style.materials.add(
        textures.package,
        hsv(rng.uniform(0.06, 0.1), rng.uniform(0.3, 0.5), rng.uniform(0.5, 0.75)),
    )
    parts, z = [], 0.0
    width, depth = style.between(0.3, 0.5), style.between(0.28, 0.4)
    for _ in range(int(rng.integers(1, 4))):
        high = style.between(0.18, 0.35)
        part = box((-width / 2, -depth / 2, z), (width / 2, depth / 2, z + high), card, CLUTTER)
        part = part if z == 0 else part.moved(0, 0, 0, style.between(-0.3, 0.3))
        # The print covers each side once.
        parts.append(
            replace(
                part,
                uvs=np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32), (6, 1))
                * 0.999,
            )
        )
        z += high
        width, depth = width * style.between(0.7, 0.95), depth * style.between(0.7, 0.95)
    return Item(join(parts).moved(0, 0.22), 0.5, 0.44, z)


def coat_rack(style: Style) -> Item:
    """Make hooks with coats on them over a bench with shoes."""
    width = style.between(0.6, 1.0)
    parts = [box((-width / 2, 0, 1.65), (width / 2, 0.025, 1.75), style.wood(), CLUTTER)]
    for x in np.linspace(
        -width / 2 + 0.12, width / 2 - 0.12, int(style.rng.integers(2, 5))
    ).tolist():
        parts.append(rod((x, 0.02, 1.68), (x, 0.08, 1.7), 0.008, style.steel, CLUTTER))
        if style.chance(0.75):
            long = style.between(0.3, 0.5)
            parts.append(
                cushion(
                    (x, 0.12, 1.68 - long),
                    (0.1, 0.07, long),
                    style.cloth(),
                    CLUTTER,
                    roundness=0.6,
                )
            )
    bench = table(style, width, 0.32, style.between(0.35, 0.45), CLUTTER)
    parts.append(bench.mesh)
    for x in np.arange(-width / 2 + 0.15, width / 2 - 0.1, 0.24).tolist():
        material = style.any_colour()
        parts += [
            cushion(
                (x + dx, 0.16, 0.05),
                (0.04, 0.13, 0.05),
                material,
                CLUTTER,
                roundness=0.6,
                rings=5,
                segments=10,
            )
            for dx in (-0.05, 0.05)
        ]
    return Item(join(parts), width, 0.34, 1.75, bench.tops)


def pot(style: Style) -> Item:
    """Make a cooking pot."""
    radius, height = style.between(0.08, 0.12), style.between(0.08, 0.16)
    material = style.steel if style.chance(0.6) else style.any_colour()
    profile = [
        (0.0, 0.0),
        (radius, 0.0),
        (radius, height),
        (radius * 0.9, height + 0.01),
        (0.015, height + 0.03),
        (0.015, height + 0.05),
        (0.0, height + 0.05),
    ]
    parts = [lathe(profile, material, CLUTTER, segments=16)]
    parts += [
        rod(
            (side * radius, 0, height * 0.75),
            (side * (radius + 0.05), 0, height * 0.75),
            0.009,
            style.black,
            CLUTTER,
        )
        for side in (-1, 1)
    ]
    return Item(join(parts), 2 * radius + 0.1, 2 * radius, height + 0.05)


def small_thing(style: Style, most: float = 0.4) -> Item:
    """Make something that stands on tables and shelves, at most so high."""
    kinds: list[Callable[[Style], Item]] = [cup, bowl, vase, some_bottle, book_pile, packet]
    if most > 0.3:
        kinds += [some_bottle, kettle, toaster]
    for _ in range(6):
        item = kinds[int(style.rng.integers(len(kinds)))](style)
        if item.height <= most:
            return item
    return cup(style)


def cup(style: Style) -> Item:
    """Make a cup with a handle."""
    radius, height = style.between(0.03, 0.045), style.between(0.07, 0.11)
    material = style.any_colour()
    profile = [
        (0.0, 0.0),
        (radius * 0.8, 0.0),
        (radius, height),
        (radius * 0.9, height),
        (radius * 0.7, 0.012),
        (0.0, 0.012),
    ]
    parts = [lathe(profile, material, CLUTTER, segments=12)]
    points = [
        (radius, height * 0.8),
        (radius + 0.028, height * 0.7),
        (radius + 0.028, height * 0.35),
        (radius * 0.9, height * 0.25),
    ]
    parts += [
        rod((a[0], 0, a[1]), (b[0], 0, b[1]), 0.005, material, CLUTTER, segments=5)
        for a, b in pairwise(points)
    ]
    return Item(join(parts), 0.12, 0.1, height)


def bowl(style: Style) -> Item:
    """Make a bowl, sometimes with fruit."""
    radius, height = style.between(0.08, 0.14), style.between(0.05, 0.09)
    profile = [
        (0.0, 0.0),
        (radius * 0.4, 0.0),
        (radius * 0.8, height * 0.5),
        (radius, height),
        (radius * 0.95, height),
        (radius * 0.7, height * 0.45),
        (0.0, 0.015),
    ]
    parts = [lathe(profile, style.any_colour(), CLUTTER, segments=16)]
    if style.chance(0.5):
        for turn in (np.arange(4) * 1.6).tolist():
            fruit = style.materials.colour(
                hsv(style.between(0.0, 0.3), 0.8, style.between(0.5, 0.9))
            )
            parts.append(
                cushion(
                    (radius * 0.4 * np.cos(turn), radius * 0.4 * np.sin(turn), height),
                    (0.035, 0.035, 0.033),
                    fruit,
                    CLUTTER,
                    roundness=1.0,
                    rings=6,
                    segments=10,
                )
            )
    return Item(join(parts), 2 * radius, 2 * radius, height + 0.03)


def vase(style: Style) -> Item:
    """Make a vase, sometimes a small plant."""
    if style.chance(0.4):
        item = plant(style, style.between(0.2, 0.35))
        return Item(item.mesh.moved(0, -item.depth / 2), 0.2, 0.2, item.height)
    height, radius = style.between(0.12, 0.3), style.between(0.04, 0.08)
    profile = [
        (0.0, 0.0),
        (radius * 0.6, 0.0),
        (radius, height * 0.4),
        (radius * style.between(0.3, 0.7), height * 0.85),
        (radius * 0.6, height),
        (0.0, height * 0.97),
    ]
    return Item(
        lathe(profile, style.any_colour(), CLUTTER, segments=14), 2 * radius, 2 * radius, height
    )


def some_bottle(style: Style) -> Item:
    """Make a bottle, one of any kind but the one that is looked for."""
    height, radius = style.between(0.18, 0.32), style.between(0.03, 0.042)
    hue = style.between(0.2, 0.65)
    glass = style.materials.colour(
        hsv(hue, style.between(0.2, 0.8), style.between(0.2, 0.8)), gloss=0.12
    )
    neck = style.between(0.55, 0.75)
    profile = [
        (0.0, 0.0),
        (radius, 0.0),
        (radius, height * neck),
        (radius * 0.38, height * (neck + 0.14)),
        (radius * 0.36, height),
        (0.0, height),
    ]
    parts = [
        lathe(profile, glass, CLUTTER, segments=12),
        cylinder(
            0,
            0,
            height * 0.15,
            height * 0.45,
            radius * 1.02,
            style.any_colour(),
            CLUTTER,
            segments=12,
        ),
    ]
    return Item(join(parts), 2 * radius, 2 * radius, height)


def book_pile(style: Style) -> Item:
    """Make a pile of books or papers."""
    parts, z = [], 0.0
    for _ in range(int(style.rng.integers(1, 6))):
        half, deep, high = (
            style.between(0.08, 0.15),
            style.between(0.06, 0.11),
            style.between(0.008, 0.035),
        )
        parts.append(
            box((-half, -deep, z), (half, deep, z + high), style.any_colour(), CLUTTER).moved(
                0, 0, 0, style.between(-0.4, 0.4)
            )
        )
        z += high
    return Item(join(parts), 0.3, 0.24, z)


def packet(style: Style) -> Item:
    """Make a packet of food or a box."""
    half, deep, height = (
        style.between(0.03, 0.1),
        style.between(0.02, 0.06),
        style.between(0.08, 0.3),
    )
    return Item(
        box((-half, -deep, 0), (half, deep, height), style.any_colour(), CLUTTER),
        2 * half,
        2 * deep,
        height,
    )


def kettle(style: Style) -> Item:
    """Make a kettle."""
    material = style.steel if style.chance(0.5) else style.any_colour()
    profile = [(0.0, 0.0), (0.085, 0.0), (0.085, 0.04), (0.06, 0.19), (0.02, 0.21), (0.0, 0.225)]
    parts = [
        lathe(profile, material, CLUTTER, segments=16),
        rod((0.075, 0, 0.17), (0.13, 0, 0.18), 0.01, style.black, CLUTTER),
        rod((0.13, 0, 0.18), (0.12, 0, 0.05), 0.01, style.black, CLUTTER),
        rod((-0.06, 0, 0.14), (-0.11, 0, 0.18), 0.012, material, CLUTTER),
    ]
    return Item(join(parts), 0.26, 0.18, 0.23)


def toaster(style: Style) -> Item:
    """Make a toaster, or a microwave oven."""
    if style.chance(0.5):
        parts = [
            box(
                (-0.24, -0.17, 0.01),
                (0.24, 0.16, 0.28),
                style.steel if style.chance(0.5) else style.white,
                CLUTTER,
            ),
            box((-0.23, 0.16, 0.02), (0.12, 0.17, 0.27), style.black, CLUTTER),
        ]
        return Item(join(parts), 0.5, 0.36, 0.28)
    parts = [
        cushion(
            (0, 0, 0.1),
            (0.14, 0.09, 0.1),
            style.steel if style.chance(0.5) else style.any_colour(),
            CLUTTER,
            roundness=0.3,
        ),
        box((-0.1, -0.03, 0.19), (0.1, -0.01, 0.201), style.black, CLUTTER),
        box((-0.1, 0.01, 0.19), (0.1, 0.03, 0.201), style.black, CLUTTER),
    ]
    return Item(join(parts), 0.3, 0.2, 0.2)


def picture(style: Style, *, board: bool = False) -> Item:
    """Make what hangs on walls: a framed picture, or a board to write on or to pin to.

    Its height above the floor is left to whoever hangs it.
    """
    rng = style.rng
    if board:
        width, height = style.between(0.7, 1.6), style.between(0.5, 1.0)
        colour = hsv(
            *[(0.1, 0.02, 0.95), (0.38, 0.5, 0.28), (0.09, 0.5, 0.62), (0.6, 0.1, 0.2)][
                int(rng.integers(4))
            ]
        )
        inside = style.materials.add(textures.writing, colour)
    else:
        width, height = style.between(0.3, 1.1), style.between(0.3, 0.9)
        inside = style.materials.add(
            textures.painting, hsv(rng.random(), rng.uniform(0, 0.8), rng.uniform(0.2, 0.95))
        )
    frame, edge = style.leg(), style.between(0.012, 0.05)
    half = width / 2
    parts = [
        box((-half, 0, 0), (half, 0.02, height), frame, BOARD, cell=0.5),
        rectangle(
            (half - edge, 0.0205, edge),
            (-width + 2 * edge, 0, 0),
            (0, 0, height - 2 * edge),
            inside,
            BOARD,
            cell=0.5,
            fit=True,
        ),
    ]
    if board:
        parts.append(box((-half * 0.6, 0.02, -0.02), (half * 0.6, 0.07, 0.0), frame, BOARD))
    return Item(join(parts), width, 0.07 if board else 0.03, height)


def wall_shelf(style: Style) -> Item:
    """Make a board on the wall with things on it."""
    width = style.between(0.5, 1.2)
    parts = [box((-width / 2, 0, 0), (width / 2, 0.2, 0.025), style.front(), BOOKCASE)]
    parts += [
        small_thing(style, 0.25).mesh.moved(x, 0.1, 0.025)
        for x in np.arange(-width / 2 + 0.12, width / 2 - 0.1, style.between(0.15, 0.35)).tolist()
    ]
    return Item(join(parts), width, 0.2, 0.3)


def radiator(style: Style, width: float) -> Item:
    """Make a radiator of ribs."""
    height = style.between(0.45, 0.6)
    parts = [
        box((x, 0.03, 0.1), (x + 0.06, 0.1, 0.1 + height), style.white, CLUTTER)
        for x in np.arange(-width / 2, width / 2 - 0.05, 0.08).tolist()
    ]
    parts.append(box((-width / 2, 0.05, 0.13), (width / 2, 0.08, 0.18), style.white, CLUTTER))
    return Item(join(parts), width, 0.1, height + 0.1)


def curtain(material: int, width: float, low: float, high: float) -> Mesh:
    """Make a curtain that hangs in folds, from low to high."""
    folds = max(3, int(width / 0.09))
    return join(
        cylinder(
            (index + 0.5) / folds * width - width / 2,
            0.08,
            low,
            high,
            0.045,
            material,
            CLUTTER,
            segments=7,
        )
        for index in range(folds)
    )


def ceiling_lamp(style: Style, height: float, *, on: bool) -> Item:
    """Make a lamp at the ceiling: a disc, a ball or a shade on a wire; y = 0 is its middle."""
    shade = _shade(style, on=on)
    kind = style.rng.integers(3)
    if kind == 0:
        radius, low = style.between(0.12, 0.25), height - 0.09
        part = cylinder(0, 0, low, height - 0.001, radius, shade, CLUTTER, segments=20)
    elif kind == 1:
        drop = style.between(0.2, 0.4)
        low = height - drop - 0.13
        part = join(
            [
                cushion((0, 0, height - drop), (0.13, 0.13, 0.13), shade, CLUTTER, roundness=1.0),
                rod(
                    (0, 0, height - drop), (0, 0, height), 0.005, style.black, CLUTTER, segments=4
                ),
            ]
        )
    else:
        drop = style.between(0.3, 0.5)
        low = height - drop - 0.2
        part = join(
            [
                cylinder(
                    0,
                    0,
                    height - drop - 0.15,
                    height - drop,
                    style.between(0.15, 0.25),
                    shade,
                    CLUTTER,
                    segments=18,
                    top=style.between(0.05, 0.15),
                ),
                rod(
                    (0, 0, height - drop), (0, 0, height), 0.005, style.black, CLUTTER, segments=4
                ),
            ]
        )
    lamps = ((0.0, 0.0, low - 0.12, style.between(1.6, 3.2)),) if on else ()
    return Item(part, 0.5, 0.5, height, (), lamps)
