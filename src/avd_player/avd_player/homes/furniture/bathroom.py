"""What stands in bathrooms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from avd_player.homes import textures
from avd_player.homes.furniture.storage import cupboard
from avd_player.homes.furniture.style import CLUTTER, Item, Style, Top
from avd_player.homes.mesh import Mesh, box, join, lathe, rod


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
