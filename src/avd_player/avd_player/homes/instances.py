# ruff: noqa: PLR2004 - sizes of things
"""The things of AVD that are looked for, as small shapes with colours like theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avd_player.avd_format import INSTANCES
from avd_player.homes import textures
from avd_player.homes.furniture import CLUTTER
from avd_player.homes.mesh import Mesh, box, join, lathe

if TYPE_CHECKING:
    from avd_player.homes.furniture import Style
    from avd_player.homes.textures import Colour

BOTTLE = 'coca_cola_glass_bottle'
"""What is searched for."""

_RED, _BROWN, _GREEN = (0.78, 0.1, 0.1), (0.32, 0.18, 0.1), (0.2, 0.5, 0.25)
_YELLOW, _BLUE, _WHITE = (0.9, 0.75, 0.15), (0.15, 0.3, 0.65), (0.92, 0.92, 0.9)
_PINK, _CREAM, _BLACK = (0.95, 0.5, 0.65), (0.85, 0.75, 0.5), (0.12, 0.12, 0.12)

_SHAPES: dict[str, tuple[str, tuple[float, float, float], Colour]] = {
    # shape; width, depth and height in metres; colour
    'advil_liqui_gels': ('box', (0.06, 0.05, 0.11), _BLUE),
    'aunt_jemima_original_syrup': ('bottle', (0.08, 0.08, 0.25), _BROWN),
    'bumblebee_albacore': ('can', (0.085, 0.085, 0.04), _YELLOW),
    'cholula_chipotle_hot_sauce': ('bottle', (0.045, 0.045, 0.18), (0.6, 0.2, 0.1)),
    BOTTLE: ('cola', (0.06, 0.06, 0.21), (0.1, 0.035, 0.02)),
    'crest_complete_minty_fresh': ('box', (0.2, 0.045, 0.05), _BLUE),
    'crystal_hot_sauce': ('bottle', (0.05, 0.05, 0.19), (0.75, 0.15, 0.1)),
    'expo_marker_red': ('can', (0.02, 0.02, 0.13), _RED),
    'hersheys_bar': ('box', (0.14, 0.06, 0.012), _BROWN),
    'honey_bunches_of_oats_honey_roasted': ('box', (0.19, 0.06, 0.3), (0.85, 0.55, 0.15)),
    'honey_bunches_of_oats_with_almonds': ('box', (0.19, 0.06, 0.3), (0.2, 0.35, 0.75)),
    'hunts_sauce': ('can', (0.075, 0.075, 0.11), _RED),
    'listerine_green': ('bottle', (0.09, 0.06, 0.22), _GREEN),
    'mahatma_rice': ('box', (0.14, 0.06, 0.2), _YELLOW),
    'nature_valley_granola_thins_dark_chocolate': ('box', (0.14, 0.06, 0.17), _BROWN),
    'nutrigrain_harvest_blueberry_bliss': ('box', (0.15, 0.06, 0.16), (0.3, 0.3, 0.7)),
    'pepto_bismol': ('bottle', (0.07, 0.05, 0.17), _PINK),
    'pringles_bbq': ('can', (0.075, 0.075, 0.25), (0.5, 0.15, 0.12)),
    'progresso_new_england_clam_chowder': ('can', (0.085, 0.085, 0.115), _BLUE),
    'quaker_chewy_low_fat_chocolate_chunk': ('box', (0.16, 0.06, 0.14), _RED),
    'red_bull': ('can', (0.053, 0.053, 0.135), (0.3, 0.45, 0.75)),
    'softsoap_clear': ('bottle', (0.08, 0.05, 0.19), (0.7, 0.85, 0.85)),
    'softsoap_gold': ('bottle', (0.08, 0.05, 0.19), (0.85, 0.65, 0.2)),
    'softsoap_white': ('bottle', (0.08, 0.05, 0.19), _WHITE),
    'spongebob_squarepants_fruit_snaks': ('box', (0.14, 0.06, 0.19), _YELLOW),
    'tapatio_hot_sauce': ('bottle', (0.055, 0.055, 0.21), (0.7, 0.2, 0.08)),
    'vo5_tea_therapy_healthful_green_tea_smoothing_shampoo': (
        'bottle',
        (0.07, 0.05, 0.22),
        _GREEN,
    ),
    'nature_valley_sweet_and_salty_nut_almond': ('box', (0.15, 0.06, 0.15), _BLUE),
    'nature_valley_sweet_and_salty_nut_cashew': ('box', (0.15, 0.06, 0.15), (0.8, 0.5, 0.1)),
    'nature_valley_sweet_and_salty_nut_peanut': ('box', (0.15, 0.06, 0.15), _BROWN),
    'nature_valley_sweet_and_salty_nut_roasted_mix_nut': (
        'box',
        (0.15, 0.06, 0.15),
        (0.55, 0.15, 0.2),
    ),
    'paper_plate': ('plate', (0.22, 0.22, 0.025), _WHITE),
    'red_cup': ('cup', (0.095, 0.095, 0.12), _RED),
}

BOTTLE_ID = INSTANCES.index(BOTTLE)
"""The number of what is searched for."""


def instance_size(number: int) -> tuple[float, float, float]:
    """Return width, depth and height of a thing in metres."""
    return _SHAPES[INSTANCES[number]][1]


def make_instance(style: Style, number: int) -> Mesh:
    """Make one of the things; it stands in the origin.

    Args:
        style: Gets its materials.
        number: As in `INSTANCES`, from 1.
    """
    shape, size, colour = _SHAPES[INSTANCES[number]]
    return _MAKE[shape](style, size, colour)


def _cola(style: Style, size: tuple[float, float, float], colour: Colour) -> Mesh:
    radius, height = size[0] / 2, size[2]
    glass = style.materials.colour(colour, gloss=0.12)
    label = style.materials.add(textures.cola, (0.8, 0.05, 0.07), gloss=0.05)
    cap = style.materials.colour((0.75, 0.08, 0.08), gloss=0.1)
    below = [(0.0, 0.0), (0.8, 0.0), (0.92, 0.03), (0.95, 0.12), (0.86, 0.27), (0.88, 0.3)]
    above = [
        (0.99, 0.52),
        (0.97, 0.58),
        (0.8, 0.66),
        (0.52, 0.76),
        (0.4, 0.86),
        (0.42, 0.93),
        (0.0, 0.93),
    ]

    def turned(points: list[tuple[float, float]], material: int, *, fit: bool = False) -> Mesh:
        profile = [(r * radius, z * height) for r, z in points]
        return lathe(profile, material, CLUTTER, segments=20, fit=fit)

    return join(
        [
            turned(below, glass),
            turned([(0.88, 0.3), (0.99, 0.4), (0.99, 0.52)], label, fit=True),
            turned(above, glass),
            turned([(0.0, 0.92), (0.46, 0.92), (0.48, 0.99), (0.0, 1.0)], cap),
        ]
    )


def _bottle(style: Style, size: tuple[float, float, float], colour: Colour) -> Mesh:
    width, depth, height = size
    body = style.materials.colour(colour, gloss=0.06)
    label = style.materials.add(textures.package, _CREAM)
    cap = style.materials.colour(_WHITE if sum(colour) < 1.5 else _BLACK)
    radius = width / 2

    def turned(points: list[tuple[float, float]], material: int, *, fit: bool = False) -> Mesh:
        profile = [(r * radius, z * height) for r, z in points]
        part = lathe(profile, material, CLUTTER, segments=16, fit=fit)
        part.vertices[:, 1] *= depth / width
        return part

    return join(
        [
            turned([(0.0, 0.0), (0.95, 0.0), (1.0, 0.2)], body),
            turned([(1.0, 0.2), (1.0, 0.55)], label, fit=True),
            turned([(1.0, 0.55), (0.9, 0.65), (0.4, 0.8), (0.38, 0.86), (0.0, 0.86)], body),
            turned([(0.0, 0.86), (0.45, 0.86), (0.45, 1.0), (0.0, 1.0)], cap),
        ]
    )


def _can(style: Style, size: tuple[float, float, float], colour: Colour) -> Mesh:
    radius, height = size[0] / 2, size[2]
    label = style.materials.add(textures.package, colour)
    return join(
        [
            lathe([(radius, 0.0), (radius, height)], label, CLUTTER, segments=18, fit=True),
            lathe([(0.0, 0.0), (radius, 0.0)], style.steel, CLUTTER, segments=18),
            lathe([(radius, height), (0.0, height)], style.steel, CLUTTER, segments=18),
        ]
    )


def _box(style: Style, size: tuple[float, float, float], colour: Colour) -> Mesh:
    width, depth, height = size
    printed = style.materials.add(textures.package, colour)
    part = box((-width / 2, -depth / 2, 0), (width / 2, depth / 2, height), printed, CLUTTER)
    part.uvs[:] = np.tile(np.array([[0, 0], [0.999, 0], [0.999, 0.999], [0, 0.999]]), (6, 1))
    return part


def _plate(style: Style, size: tuple[float, float, float], colour: Colour) -> Mesh:
    radius, height = size[0] / 2, size[2]
    profile = [
        (0.0, 0.0),
        (radius * 0.65, 0.0),
        (radius, height),
        (radius * 0.6, 0.006),
        (0.0, 0.006),
    ]
    return lathe(profile, style.materials.colour(colour), CLUTTER, segments=24)


def _cup(style: Style, size: tuple[float, float, float], colour: Colour) -> Mesh:
    radius, height = size[0] / 2, size[2]
    profile = [
        (0.0, 0.0),
        (radius * 0.68, 0.0),
        (radius, height),
        (radius * 0.94, height),
        (radius * 0.64, 0.01),
        (0.0, 0.01),
    ]
    return lathe(profile, style.materials.colour(colour, gloss=0.1), CLUTTER, segments=18)


_MAKE = {'box': _box, 'bottle': _bottle, 'can': _can, 'cola': _cola, 'cup': _cup, 'plate': _plate}
