# ruff: noqa: PLR2004 - sizes of things
"""Walls, floors, ceilings, doors, windows, beams and columns."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from avd_player.homes import furniture, textures
from avd_player.homes.furniture import (
    BEAM,
    CEILING,
    CLUTTER,
    COLUMN,
    DOOR,
    FLOOR,
    WALL,
    WINDOW,
    Item,
)
from avd_player.homes.layout import EAST, NORTH, SOUTH, WEST, Opening, Room
from avd_player.homes.light import Light
from avd_player.homes.mesh import Mesh, box, cylinder, join, rectangle
from avd_player.homes.site import Hung, Site
from avd_player.homes.textures import hsv

BASE = 0.001
"""Where columns begin, in metres: where the floor is, rays would meet either of them."""

CELL = 0.25
"""Light on walls, floors and ceilings is computed at points so far apart, metres."""

_WALLS = (*[textures.plaster] * 5, textures.wallpaper, textures.concrete, textures.bricks)
_ACCENTS = (
    textures.plaster,
    textures.wallpaper,
    textures.concrete,
    textures.bricks,
    textures.wood,
)
_FLOORS = (
    *[textures.planks] * 3,
    textures.herringbone,
    textures.carpet,
    textures.tiles,
    textures.concrete,
)


def build_openings(site: Site) -> None:
    """Make doors and windows."""
    style = site.style
    leaf = style.front()
    frame = style.front()
    glass_frame = style.white if style.chance(0.6) else style.wood()
    daylight = style.between(0.25, 1.6) if style.chance(0.85) else 0.03
    sky = style.materials.add(textures.outside, (0.5, 0.7, 0.9), glow=0.25 + 1.1 * daylight)
    for opening in site.openings:
        along = (opening.start + opening.end) / 2
        x, y, yaw = site.at_wall(opening.room, opening.side, along)
        width = opening.end - opening.start
        if opening.kind == 'window':
            _window(site, opening, width, glass_frame, sky)
            _daylight(site, opening, width, daylight)
        elif opening.kind == 'entrance':
            depth = 0.1
            mesh = _niche(width, 0.0, opening.high, depth, frame, DOOR)
            mesh.append(
                box(
                    (-width / 2, -depth - 0.04, 0),
                    (width / 2, -depth + 0.02, opening.high),
                    leaf,
                    DOOR,
                    cell=0.4,
                )
            )
            mesh.append(
                box(
                    (width / 2 - 0.12, -depth + 0.02, 1.0),
                    (width / 2 - 0.04, -depth + 0.07, 1.03),
                    style.steel,
                    DOOR,
                )
            )
            site.parts.append(join(mesh).moved(x, y, 0, yaw))
            site.keep_free(opening, opening.room, opening.side, 0.7)
        else:
            _doorway(site, opening, width, frame, leaf)


def _niche(
    width: float, low: float, high: float, depth: float, material: int, label: int
) -> list[Mesh]:
    """Return the four sides of a hole in a wall, from its face at y = 0 into it."""
    half, up, back = width / 2, (0, 0, high - low), (0, depth, 0)
    return [
        rectangle((-half, -depth, low), back, up, material, label, cell=CELL),
        rectangle((half, 0, low), (0, -depth, 0), up, material, label, cell=CELL),
        rectangle((-half, -depth, low), (width, 0, 0), back, material, label, cell=CELL),
        rectangle((-half, -depth, high), back, (width, 0, 0), material, label, cell=CELL),
    ]


def _window(site: Site, opening: Opening, width: float, frame: int, sky: int) -> None:
    style = site.style
    low, high, depth = opening.low, opening.high, 0.14
    half = width / 2
    parts = _niche(width, low, high, depth, style.white, WALL)
    pane = (half, -depth, low), (-width, 0, 0), (0, 0, high - low)
    parts.append(rectangle(*pane, sky, WINDOW, fit=True))
    edge = 0.055
    bars = [
        (-half, low, half, low + edge),
        (-half, high - edge, half, high),
        (-half, low, -half + edge, high),
        (half - edge, low, half, high),
    ]
    for index in range(1, max(1, round(width / style.between(0.55, 0.9)))):
        x = -half + width * index / max(1, round(width / 0.7))
        if x < half - 0.15:
            bars.append((x - edge / 2, low, x + edge / 2, high))
    if style.chance(0.3):
        z = high - 0.35 * (high - low)
        bars.append((-half, z - edge / 2, half, z + edge / 2))
    parts += [
        box((a, -depth + 0.005, b), (c, -depth + 0.05, d), frame, WINDOW) for a, b, c, d in bars
    ]
    if low > 0.3:
        parts.append(
            box(
                (-half - 0.04, -depth, low),
                (half + 0.04, 0.06, low + 0.025),
                style.white,
                WINDOW,
            )
        )
    along = (opening.start + opening.end) / 2
    x, y, yaw = site.at_wall(opening.room, opening.side, along)
    site.parts.append(join(parts).moved(x, y, 0, yaw))
    room = site.rooms[opening.room]
    start, end = room.side(opening.side)
    if style.chance(0.55):
        below = 0.04 if style.chance(0.6) and low < 0.3 else max(0.1, low - 0.15)
        above = min(high + 0.15, site.layout.height - 0.03)
        wide, cloth = style.between(0.2, 0.35), style.cloth()
        rail = [
            box(
                (-half - wide, 0.06, above),
                (half + wide, 0.1, above + 0.02),
                style.leg(),
                CLUTTER,
            )
        ]
        for side in (-1.0, 1.0):
            middle = along + side * (half + wide / 2 - 0.06)
            if start + 0.15 < middle - wide / 2 and middle + wide / 2 < end - 0.15:
                cx, cy, _ = site.at_wall(opening.room, opening.side, middle)
                site.parts.append(
                    furniture.curtain(cloth, wide, below, above).moved(cx, cy, 0, yaw)
                )
        if start < along - half - wide and along + half + wide < end:
            site.parts.append(join(rail).moved(x, y, 0, yaw))
        site.hung.append(
            Hung(
                opening.room,
                opening.side,
                along - half - wide,
                along + half + wide,
                below,
                above,
            )
        )
    if low > 0.7 and style.chance(0.6):
        heater = furniture.radiator(style, min(width, style.between(0.6, 1.4)))
        cells = site.cells(*site.rect((-heater.width / 2, 0, heater.width / 2, 0.13), x, y, yaw))
        site.footprints[cells] = True
        site.parts.append(heater.mesh.moved(x, y, 0, yaw))


def _daylight(site: Site, opening: Opening, width: float, strength: float) -> None:
    along = (opening.start + opening.end) / 2
    high = opening.high - opening.low
    tint = site.style.between(0.9, 1.1)
    power = 1.6 * strength * width * high / 6
    for across in (-0.33, 0.0, 0.33):
        for up in (0.3, 0.75):
            x, y, yaw = site.at_wall(opening.room, opening.side, along + across * width)
            facing = (-float(np.sin(yaw)), float(np.cos(yaw)))
            site.lights.append(
                Light(
                    float(x - 0.05 * facing[0]),
                    float(y - 0.05 * facing[1]),
                    opening.low + up * high,
                    (power * tint, power, power / tint),
                    facing,
                )
            )


def _doorway(site: Site, opening: Opening, width: float, frame: int, leaf: int) -> None:
    style, wall = site.style, site.layout.inner_wall
    along = (opening.start + opening.end) / 2
    x, y, yaw = site.at_wall(opening.room, opening.side, along)
    half, high = width / 2, opening.high
    wide = opening.kind == 'wide'
    material, label, thick = (style.white, WALL, 0.01) if wide else (frame, DOOR, 0.035)
    lip = 0.0 if wide else 0.015
    parts = [
        box((-half, -wall - lip, 0), (-half + thick, lip, high), material, label, cell=CELL),
        box((half - thick, -wall - lip, 0), (half, lip, high), material, label, cell=CELL),
        box(
            (-half + thick, -wall - lip, high - thick),
            (half - thick, lip, high),
            material,
            label,
            cell=CELL,
        ),
    ]
    if not wide:
        # A band around the frame, on both faces of the wall.
        for face in (0.0, -wall - 0.014):
            parts += [
                box(
                    (-half - 0.05, face, 0),
                    (-half, face + 0.014, high + 0.05),
                    material,
                    label,
                    cell=0.4,
                ),
                box(
                    (half, face, 0),
                    (half + 0.05, face + 0.014, high + 0.05),
                    material,
                    label,
                    cell=0.4,
                ),
                box((-half, face, high), (half, face + 0.014, high + 0.05), material, label),
            ]
    parts.append(
        rectangle((-half, -wall, 0), (width, 0, 0), (0, wall, 0), style.wood(), FLOOR, cell=CELL)
    )
    site.parts.append(join(parts).moved(x, y, 0, yaw))
    site.solid[
        site.cells(*site.rect((-half + thick, -wall - 0.03, half - thick, 0.03), x, y, yaw))
    ] = False
    site.keep_free(opening, opening.room, opening.side, 0.75)
    site.keep_free(opening, opening.other, (opening.side + 2) % 4, 0.75)
    if opening.kind == 'leaf':
        _leaf(site, opening, width, leaf)


def _leaf(site: Site, opening: Opening, width: float, material: int) -> None:
    """Hang the leaf of a door, standing open into one of its rooms."""
    style = site.style
    turn_in = site.rooms[opening.room].kind != 'hall'
    room = opening.room if turn_in else opening.other
    side = opening.side if turn_in else (opening.side + 2) % 4
    # Hinged where the nearer corner is, as doors are.
    start, end = site.rooms[room].side(side)
    near_start = opening.start - start < end - opening.end
    hinge = opening.start + 0.04 if near_start else opening.end - 0.04
    x, y, yaw = site.at_wall(room, side, hinge)
    angle = np.radians(style.between(82.0, 100.0))
    wide, high = width - 0.08, opening.high - 0.045
    parts = [
        box((0, 0, 0.01), (wide, 0.04, high), material, DOOR, cell=0.4),
        box((wide - 0.14, -0.05, 1.0), (wide - 0.04, 0.09, 1.025), style.steel, DOOR),
    ]
    if style.chance(0.5):
        for low, top in ((0.15, 0.85), (1.05, high - 0.15)):
            parts += [
                box((0.12, face, low), (wide - 0.12, face + 0.005, top), material, DOOR)
                for face in (-0.005, 0.04)
            ]
    mesh = join(parts)
    # In the frame of furniture at this wall, does the opening lie at positive x?
    along_x = np.cos(yaw) if side in {SOUTH, NORTH} else np.sin(yaw)
    to_opening = (1.0 if near_start else -1.0) * along_x
    if to_opening > 0:
        mesh = mesh.moved(0, 0, 0, angle)
        tip = np.array([np.cos(angle), np.sin(angle)]) * wide
    else:
        mesh = mesh.mirrored().moved(0, 0, 0, -angle)
        tip = np.array([-np.cos(angle), np.sin(angle)]) * wide
    site.parts.append(mesh.moved(x, y, 0, yaw))
    low, right = sorted([0.0, float(tip[0])])
    rect = site.rect((low - 0.05, 0.0, right + 0.05, wide), x, y, yaw)
    site.solid[site.cells(*rect)] = True
    # Not the opening itself: there the leaf is thin.
    inner = site.layout.inner_wall
    ox, oy, oyaw = site.at_wall(room, side, (opening.start + opening.end) / 2)
    half = width / 2 - 0.06
    clear = site.rect((-half + 0.05, -inner - 0.03, half - 0.05, 0.05), ox, oy, oyaw)
    site.solid[site.cells(*clear)] = False
    site.hung.append(Hung(room, side, hinge - 0.1, hinge + 0.1, 0.0, high))


def build_shell(site: Site) -> None:
    """Make floors, ceilings and walls."""
    style, rng = site.style, site.rng
    add = style.materials.add
    height = site.layout.height
    ceiling = add(
        textures.plaster,
        hsv(rng.uniform(0.08, 0.16), rng.uniform(0, 0.06), rng.uniform(0.85, 0.97)),
        1.5,
    )
    dry = _dry_floor(site)
    skirting = style.white if style.chance(0.6) else style.wood()
    base_hue, base_sat = rng.random(), rng.uniform(0.0, 0.2)
    for index, room in enumerate(site.rooms):
        floor = dry if style.chance(0.65) else _dry_floor(site)
        hue, sat = base_hue, base_sat
        if style.chance(0.5):
            hue, sat = rng.random(), 0.5 * rng.beta(1.0, 2.5)
        kind = _WALLS[int(rng.integers(len(_WALLS)))]
        wall = add(kind, hsv(hue, sat, rng.uniform(0.6, 0.97)), rng.uniform(0.8, 1.3))
        if room.kind in {'bath', 'kitchen'} and style.chance(0.85 if room.kind == 'bath' else 0.6):
            floor = add(
                textures.tiles,
                hsv(rng.random(), rng.uniform(0, 0.35), rng.uniform(0.3, 0.9)),
                rng.uniform(0.8, 1.6),
                gloss=0.1,
            )
            if room.kind == 'bath':
                wall = add(
                    textures.tiles,
                    hsv(rng.random(), rng.uniform(0, 0.35), rng.uniform(0.6, 0.95)),
                    rng.uniform(0.6, 1.2),
                    gloss=0.1,
                )
        wide, deep = room.x1 - room.x0, room.y1 - room.y0
        site.parts += [
            rectangle((room.x0, room.y0, 0), (wide, 0, 0), (0, deep, 0), floor, FLOOR, cell=CELL),
            rectangle(
                (room.x0, room.y0, height),
                (0, deep, 0),
                (wide, 0, 0),
                ceiling,
                CEILING,
                cell=CELL,
            ),
        ]
        accent = int(rng.integers(4)) if style.chance(0.35) else -1
        for side in range(4):
            material = wall
            if side == accent:
                material = add(
                    _ACCENTS[int(rng.integers(len(_ACCENTS)))],
                    hsv(rng.random(), rng.uniform(0.1, 0.6), rng.uniform(0.35, 0.85)),
                    rng.uniform(0.8, 1.6),
                )
            _wall(site, index, side, material, skirting)


def _dry_floor(site: Site) -> int:
    rng = site.rng
    kind = _FLOORS[int(rng.integers(len(_FLOORS)))]
    if kind is textures.carpet:
        colour = hsv(rng.random(), rng.uniform(0.0, 0.5), rng.uniform(0.25, 0.75))
    elif kind in {textures.tiles, textures.concrete}:
        colour = hsv(rng.uniform(0.03, 0.15), rng.uniform(0.0, 0.4), rng.uniform(0.35, 0.85))
    else:
        colour = hsv(rng.uniform(0.04, 0.11), rng.uniform(0.2, 0.65), rng.uniform(0.28, 0.85))
    return site.style.materials.add(
        kind, colour, rng.uniform(0.9, 1.8), gloss=rng.uniform(0, 0.12)
    )


def _wall(site: Site, index: int, side: int, material: int, skirting: int) -> None:
    room, height = site.rooms[index], site.layout.height
    start, end = room.side(side)
    holes = [
        (o.start, o.end, o.low, o.high)
        for o in site.openings
        if (o.room == index and o.side == side) or (o.other == index and (o.side + 2) % 4 == side)
    ]
    edges = sorted({start, end, *(edge for hole in holes for edge in hole[:2])})
    for low, high in pairwise(edges):
        middle = (low + high) / 2
        hole = next((h for h in holes if h[0] < middle < h[1]), None)
        pieces = [(0.0, height)] if hole is None else [(0.0, hole[2]), (hole[3], height)]
        for bottom, top in pieces:
            if top - bottom > 1e-6:
                site.parts.append(_face(room, side, low, high, bottom, top, material))
        if (hole is None or hole[2] > 0.2) and high - low > 0.02:
            x, y, yaw = site.at_wall(index, side, middle)
            half = (high - low) / 2
            site.parts.append(
                box((-half, 0, 0), (half, 0.012, 0.07), skirting, WALL, cell=0.5).moved(
                    x, y, 0, yaw
                )
            )


def _face(
    room: Room, side: int, start: float, end: float, low: float, high: float, material: int
) -> Mesh:
    corners = {
        SOUTH: ((end, room.y0), (start - end, 0.0)),
        EAST: ((room.x1, end), (0.0, start - end)),
        NORTH: ((start, room.y1), (end - start, 0.0)),
        WEST: ((room.x0, start), (0.0, end - start)),
    }
    (x, y), (right_x, right_y) = corners[side]
    return rectangle(
        (x, y, low), (right_x, right_y, 0.0), (0.0, 0.0, high - low), material, WALL, cell=CELL
    )


def build_structure(site: Site) -> None:
    """Put up beams and columns."""
    style, rng = site.style, site.rng
    height = site.layout.height
    material = style.materials.add(
        _ACCENTS[int(rng.integers(len(_ACCENTS)))],
        hsv(rng.uniform(0.05, 0.12), rng.uniform(0, 0.3), rng.uniform(0.45, 0.95)),
        1.0,
    )
    if style.chance(0.92):
        for _ in range(int(rng.integers(1, 3))):
            room = site.rooms[int(rng.integers(len(site.rooms)))]
            thick, drop = style.between(0.12, 0.3), style.between(0.14, 0.32)
            count = 3 if style.chance(0.2) else 1
            for index in range(count):
                share = style.between(0.2, 0.8) if count == 1 else (index + 0.5) / count
                if room.x1 - room.x0 < room.y1 - room.y0:
                    at = room.y0 + share * (room.y1 - room.y0)
                    ends = (room.x0, at - thick / 2), (room.x1, at + thick / 2)
                else:
                    at = room.x0 + share * (room.x1 - room.x0)
                    ends = (at - thick / 2, room.y0), (at + thick / 2, room.y1)
                site.parts.append(
                    box(
                        (*ends[0], height - drop),
                        (*ends[1], height),
                        material,
                        BEAM,
                        cell=CELL,
                    )
                )
    if style.chance(0.85):
        for _ in range(int(rng.integers(1, 3))):
            size = style.between(0.22, 0.4)
            if style.chance(0.4):
                mesh = cylinder(0, size / 2, BASE, height, size / 2, material, COLUMN, segments=24)
            else:
                mesh = box(
                    (-size / 2, 0, BASE), (size / 2, size, height), material, COLUMN, cell=CELL
                )
            big = max(range(len(site.rooms)), key=lambda i: site.rooms[i].area)
            room_index = big if style.chance(0.6) else int(rng.integers(len(site.rooms)))
            site.stand(
                Item(mesh, size, size, height),
                room_index,
                free=style.chance(0.3),
                corner=style.chance(0.5),
            )
