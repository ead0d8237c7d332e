"""What hangs on walls."""

from __future__ import annotations

import numpy as np

from avd_player.homes import textures
from avd_player.homes.furniture.small_things import small_thing
from avd_player.homes.furniture.style import BOARD, BOOKCASE, CLUTTER, Item, Style
from avd_player.homes.mesh import Mesh, box, cylinder, join, rectangle
from avd_player.homes.textures import hsv


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
