# ruff: noqa: PLR2004 - sizes of things
"""Tables, and the legs that things stand on."""

from __future__ import annotations

from avd_player.homes.furniture.style import TABLE, Item, Style, Top
from avd_player.homes.mesh import Mesh, box, cylinder, join, rod


def four_legs(
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
        parts += four_legs(
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
