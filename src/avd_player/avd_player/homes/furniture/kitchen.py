# ruff: noqa: PLR2004 - sizes of things
"""What stands in kitchens."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from avd_player.homes import textures
from avd_player.homes.furniture.small_things import pot, small_thing
from avd_player.homes.furniture.storage import cupboard
from avd_player.homes.furniture.style import CLUTTER, Item, Style, Top
from avd_player.homes.mesh import box, cylinder, join, rod
from avd_player.homes.textures import hsv


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
