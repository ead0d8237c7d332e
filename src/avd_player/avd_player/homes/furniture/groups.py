# ruff: noqa: PLR2004 - sizes of things
"""Furniture that stands together: desks, sofas, beds and tables with what belongs to them."""

from __future__ import annotations

import numpy as np

from avd_player.homes import textures
from avd_player.homes.furniture.lamps import table_lamp
from avd_player.homes.furniture.seats import chair, office_chair, sofa
from avd_player.homes.furniture.storage import cupboard
from avd_player.homes.furniture.style import CLUTTER, FLOOR, TABLE, Item, Style, Top
from avd_player.homes.furniture.tables import table
from avd_player.homes.mesh import Mesh, box, cushion, join, rectangle
from avd_player.homes.textures import hsv


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
