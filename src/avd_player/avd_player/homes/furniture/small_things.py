# ruff: noqa: PLR2004 - sizes of things
"""Small things that stand on tables and shelves."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from avd_player.homes.furniture.loose import plant
from avd_player.homes.furniture.style import CLUTTER, Item, Style
from avd_player.homes.mesh import box, cushion, cylinder, join, lathe, rod
from avd_player.homes.textures import hsv

if TYPE_CHECKING:
    from collections.abc import Callable


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
