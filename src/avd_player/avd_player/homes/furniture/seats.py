# ruff: noqa: PLR2004 - sizes of things
"""Chairs, stools and sofas."""

from __future__ import annotations

import numpy as np

from avd_player.homes.furniture.style import CHAIR, SOFA, Item, Style
from avd_player.homes.furniture.tables import four_legs
from avd_player.homes.mesh import box, cushion, cylinder, join, rod


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
    parts = four_legs(
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
