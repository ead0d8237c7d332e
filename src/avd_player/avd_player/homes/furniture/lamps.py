"""Lamps that stand and hang."""

from __future__ import annotations

from avd_player.homes.furniture.style import CLUTTER, Item, Style
from avd_player.homes.mesh import cushion, cylinder, join, lathe, rod
from avd_player.homes.textures import hsv


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
