# ruff: noqa: PLR2004 - sizes of things
"""Cupboards and bookcases."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from avd_player.homes.furniture.small_things import small_thing
from avd_player.homes.furniture.style import BOOKCASE, CLUTTER, Item, Style, Top
from avd_player.homes.mesh import box, cushion, join, rod


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
