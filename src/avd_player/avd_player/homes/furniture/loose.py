"""What stands about: plants, bins, boxes and coat racks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from avd_player.homes import textures
from avd_player.homes.furniture.style import CLUTTER, Item, Style
from avd_player.homes.furniture.tables import table
from avd_player.homes.mesh import Mesh, box, cushion, join, lathe, rod
from avd_player.homes.textures import hsv


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
