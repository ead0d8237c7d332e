"""Homes: floor plans, furnished, with the positions where a robot can stand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage

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
    Style,
    Top,
)
from avd_player.homes.instances import (
    BOTTLE_ID,
    INSTANCE_NAMES,
    instance_size,
    make_instance,
)
from avd_player.homes.layout import EAST, NORTH, SOUTH, WEST, Layout, Opening, Room, draw_layout
from avd_player.homes.light import Light
from avd_player.homes.mesh import Mesh, box, cylinder, join, rectangle
from avd_player.homes.rays import NOTHING, Caster
from avd_player.homes.textures import hsv
from gridnav.actions import STEPS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from avd_player.homes.textures import Material

STEP = 0.30
"""Positions lie at multiples of this, in metres."""

ROBOT_RADIUS = 0.20
"""Metres."""

ROBOT_HEIGHT = 1.5
"""What is higher is not in the robot's way, metres."""

LOWEST = 0.05
"""What is lower is not in the robot's way, metres."""

RESOLUTION = 0.05
"""Side of the cells of the true plan, metres."""

FINE = 3
"""Free space is looked at in cells this much smaller."""

FREE, OCCUPIED, OUTSIDE = 0, 1, 2
"""Cells of the true plan."""

ROUGH_CLEARANCE = 0.25
"""Metres to what is around that furniture must leave to positions."""

POSITIONS = 200
"""A home has at most so many positions unless told otherwise."""

FEWEST_POSITIONS = 40
"""A home with fewer of them is drawn anew."""

ATTEMPTS = 60

CELL = 0.25
"""Light on walls, floors and ceilings is computed at points so far apart, metres."""

NEAR_BOTTLE = 0.8
"""The bottle is this close to a position, metres in the plane."""

SIGHT = 2.5
"""From so far away the bottle must be seen from some positions."""

WATCHERS = 4
"""From so many."""


class Thing(NamedTuple):
    """Something that is looked for.

    Attributes:
        number: Its instance, as in `INSTANCE_NAMES`.
        center: Its middle in metres.
        points: Places on its surface and the normals there, (N, 6).
    """

    number: int
    center: tuple[float, float, float]
    points: NDArray[np.float32]


class TruePlan(NamedTuple):
    """What is where between `LOWEST` and `ROBOT_HEIGHT`.

    Attributes:
        cells: `FREE`, `OCCUPIED` or `OUTSIDE`; row 0 is the southern edge, uint8 (H, W).
        x: Western edge in metres.
        y: Southern edge in metres.
        resolution: Side of the cells in metres.
    """

    cells: NDArray[np.uint8]
    x: float
    y: float
    resolution: float


@dataclass(frozen=True)
class Home:
    """A furnished flat; z is up, 0 the floor, lengths in metres.

    Attributes:
        layout: Rooms and openings.
        mesh: All of its surfaces.
        materials: What they look like.
        lights: Lamps that are on, and windows.
        things: What can be looked for; the bottle is the first of them.
        positions: Where the robot can stand, in the order of y, then x, (P, 2).
        moves: Position that each of the eight steps of `gridnav.actions` leads to, or -1 where
            the way isn't free, (P, 8).
        plan: What is where.
        camera_height: Metres.
        camera_pitch: How far the camera looks down, radians.
    """

    layout: Layout
    mesh: Mesh
    materials: tuple[Material, ...]
    lights: tuple[Light, ...]
    things: tuple[Thing, ...]
    positions: NDArray[np.float64]
    moves: NDArray[np.int64]
    plan: TruePlan
    camera_height: float
    camera_pitch: float


class _Unusable(Exception):
    """What was drawn can't be used."""


def draw_home(
    seed: int | Sequence[int],
    *,
    positions: int = POSITIONS,
    area: tuple[float, float] = (34.0, 110.0),
) -> Home:
    """Draw a home.

    Args:
        seed: All follows from it.
        positions: At most so many positions; homes with more are drawn anew, smaller.
        area: Smallest and largest size in square metres.

    Raises:
        ValueError: If the size is none or no such home turned up, or open3d is missing.
    """
    low, high = area
    if not 20.0 <= low <= high:  # noqa: PLR2004
        msg = f'A home has 20 square metres or more, the least first, not {low:g} to {high:g}.'
        raise ValueError(msg)
    seeds = [seed] if isinstance(seed, int) else list(seed)
    rng = np.random.default_rng(seeds)
    size = float(rng.uniform(low, min(high, max(low, positions * AREA_OF_POSITION))))
    for attempt in range(ATTEMPTS):
        try:
            home = _draw(np.random.default_rng([*seeds, attempt]), size)
        except _Unusable:
            continue
        if len(home.positions) <= positions:
            return home
        size = max(low, size * max(0.7, positions / len(home.positions)))
    msg = f'No home of {low:g} to {high:g} square metres with at most {positions} positions was found.'
    raise ValueError(msg)


AREA_OF_POSITION = 0.24
"""A home has about one position for so many square metres."""


def _draw(rng: np.random.Generator, area: float) -> Home:
    layout = draw_layout(rng, area)
    if layout is None:
        raise _Unusable
    return _Builder(rng, layout).home()


class _Hung(NamedTuple):
    """A part of a wall that is taken: side, from and to along it, and heights."""

    room: int
    side: int
    start: float
    end: float
    low: float
    high: float


class _Builder:
    """Furnishes a flat."""

    def __init__(self, rng: np.random.Generator, layout: Layout) -> None:
        self.rng, self.layout = rng, layout
        self.style = Style(rng)
        self.parts: list[Mesh] = []
        self.lights: list[Light] = []
        self.tops: list[Top] = []
        self.hung: list[_Hung] = []
        # The flat is not in line with the positions.
        self.shift = rng.uniform(0.0, STEP, 2)
        margin = layout.outer_wall + 0.1
        self.origin = np.floor((self.shift - margin) / STEP) * STEP
        extent = np.array([layout.width, layout.depth]) + self.shift + margin - self.origin
        columns, rows = np.ceil(extent / RESOLUTION).astype(int).tolist()
        self.x = self.origin[0] + (np.arange(columns) + 0.5) * RESOLUTION
        self.y = self.origin[1] + (np.arange(rows) + 0.5) * RESOLUTION
        self.solid = np.ones((rows, columns), np.bool_)
        self.kept_free = np.zeros((rows, columns), np.bool_)
        self.footprints = np.zeros((rows, columns), np.bool_)
        self.rooms = [
            room._replace(
                x0=room.x0 + self.shift[0],
                x1=room.x1 + self.shift[0],
                y0=room.y0 + self.shift[1],
                y1=room.y1 + self.shift[1],
            )
            for room in layout.rooms
        ]
        along = [self.shift[0] if o.side in {SOUTH, NORTH} else self.shift[1] for o in layout.openings]
        self.openings = [
            opening._replace(start=opening.start + by, end=opening.end + by)
            for opening, by in zip(layout.openings, along, strict=True)
        ]
        for room in self.rooms:
            self.solid[self._cells(room.x0, room.y0, room.x1, room.y1)] = False

    def home(self) -> Home:
        """Build the home."""
        self._openings()
        if not self._lattice_joined(self.solid):
            raise _Unusable
        self._structure()
        for index in sorted(range(len(self.rooms)), key=lambda i: -self.rooms[i].area):
            _FURNISH[self.rooms[index].kind](self, index)
        for index in range(len(self.rooms)):
            self._hang(index)
        self._ceiling_lamps()
        self._shells()
        bare = join(self.parts)
        plan, positions, moves, room_of = self._positions(bare)
        if len(positions) < FEWEST_POSITIONS or len(set(room_of)) < len(self.rooms):
            raise _Unusable
        height = self.style.between(1.1, 1.35)
        pitch = np.radians(self.style.between(0.0, 10.0))
        things = self._things(bare, positions, height)
        return Home(
            self.layout._replace(rooms=tuple(self.rooms), openings=tuple(self.openings)),
            join(self.parts),
            tuple(self.style.materials.all),
            tuple(self.lights),
            things,
            positions,
            moves,
            plan,
            height,
            float(pitch),
        )

    # Places

    def _cells(self, x0: float, y0: float, x1: float, y1: float) -> tuple[slice, slice]:
        """Return the cells whose middles are in a rectangle."""
        columns = np.searchsorted(self.x, [x0, x1])
        rows = np.searchsorted(self.y, [y0, y1])
        return slice(*rows.tolist()), slice(*columns.tolist())

    def _at_wall(self, room: int, side: int, along: float) -> tuple[float, float, float]:
        """Return x, y and yaw of a thing at a wall."""
        r = self.rooms[room]
        if side == SOUTH:
            return along, r.y0, 0.0
        if side == EAST:
            return r.x1, along, np.pi / 2
        if side == NORTH:
            return along, r.y1, np.pi
        return r.x0, along, -np.pi / 2

    @staticmethod
    def _rect(
        item: tuple[float, float, float, float], x: float, y: float, yaw: float
    ) -> tuple[float, float, float, float]:
        """Return the rectangle around one that is turned by quarters, and shifted."""
        cos, sin = round(np.cos(yaw)), round(np.sin(yaw))
        xs = [item[0] * cos - item[1] * sin, item[2] * cos - item[3] * sin]
        ys = [item[0] * sin + item[1] * cos, item[2] * sin + item[3] * cos]
        return x + min(xs), y + min(ys), x + max(xs), y + max(ys)

    def _lattice_joined(self, solid: NDArray[np.bool_]) -> bool:
        """Tell whether nearly all positions and all rooms are joined."""
        clear = ndimage.distance_transform_edt(~solid) * RESOLUTION
        points = self._lattice(clear) >= ROUGH_CLEARANCE
        groups, count = ndimage.label(points)
        if not count:
            return False
        sizes = np.bincount(groups.ravel())[1:]
        if sizes.max() < 0.93 * sizes.sum():
            return False
        main = groups == 1 + int(sizes.argmax())
        rows, columns = np.nonzero(main)
        x, y = self.origin[0] + columns * STEP, self.origin[1] + rows * STEP
        return all(
            ((x > r.x0) & (x < r.x1) & (y > r.y0) & (y < r.y1)).sum() >= 2  # noqa: PLR2004
            for r in self.rooms
        )

    def _lattice(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values at the positions; they lie on corners of cells."""
        step = round(STEP / RESOLUTION)
        padded = np.pad(values, ((1, 0), (1, 0)))
        corners = np.minimum.reduce(
            [padded[:-1, :-1], padded[1:, :-1], padded[:-1, 1:], padded[1:, 1:]]
        )
        return corners[::step, ::step]

    def _place(self, item: Item, room: int, x: float, y: float, yaw: float, z: float = 0.0) -> None:
        """Put a thing where it is known to fit."""
        self.parts.append(item.mesh.moved(x, y, z, yaw))
        cos, sin = np.cos(yaw), np.sin(yaw)
        for top in item.tops:
            rect = self._rect((top.x0, top.y0, top.x1, top.y1), x, y, yaw)
            self.tops.append(Top(*rect, top.z + z))
        warm = self.style.between(0.75, 0.95)
        for lx, ly, lz, strength in item.lamps:
            self.lights.append(
                Light(
                    float(x + lx * cos - ly * sin),
                    float(y + lx * sin + ly * cos),
                    float(lz + z),
                    (strength, strength * (0.5 + 0.5 * warm), strength * warm * warm),
                )
            )
        del room

    def _stand(
        self,
        item: Item,
        room: int,
        *,
        tries: int = 14,
        free: bool = False,
        corner: bool = False,
        front: float = 0.0,
    ) -> bool:
        """Find a place for a piece of furniture.

        Args:
            item: The furniture.
            room: Number of the room.
            tries: So many places are tried.
            free: Whether it stands in the room, not at a wall.
            corner: Whether it stands in a corner rather than elsewhere.
            front: Metres that are kept free of other furniture in front of it.

        Returns:
            Whether it was placed.
        """
        r = self.rooms[room]
        for _ in range(tries):
            side = int(self.rng.integers(4))
            start, end = r.side(side)
            slack = end - start - item.width
            deep = (r.y1 - r.y0 if side in {SOUTH, NORTH} else r.x1 - r.x0) - item.depth
            if slack < 0.02 or deep < 0.1:  # noqa: PLR2004
                continue
            share = float(self.rng.random())
            if corner or self.style.chance(0.4):
                share = float(self.rng.integers(2))
            along = start + item.width / 2 + 0.01 + share * (slack - 0.02)
            x, y, yaw = self._at_wall(room, side, along)
            out = self.style.between(0.2, 0.8) * deep if free else self.style.between(0.005, 0.03)
            x, y = x - out * np.sin(yaw), y + out * np.cos(yaw)
            half = item.width / 2
            rect = self._rect((-half, 0.0, half, item.depth), x, y, yaw)
            cells = self._cells(*rect)
            keep = self._cells(*self._rect((-half, 0.0, half, item.depth + front), x, y, yaw))
            taken = self.footprints | self.solid
            if (taken | self.kept_free)[cells].any() or self.footprints[keep].any():
                continue
            if not free and not self._wall_free(
                room, side, along - half, along + half, 0.0, item.height
            ):
                continue
            trial = self.solid.copy()
            trial[cells] = True
            if not self._lattice_joined(trial | self.footprints):
                continue
            self.footprints[cells] = True
            if not free:
                self.hung.append(
                    _Hung(room, side, along - half, along + half, 0.0, item.height)
                )
            self._place(item, room, x, y, yaw)
            return True
        return False

    def _wall_free(
        self, room: int, side: int, start: float, end: float, low: float, high: float
    ) -> bool:
        """Tell whether a part of a wall has no opening and nothing on it."""
        for opening in self.openings:
            if opening.room == room and opening.side == side:
                at = opening.start, opening.end
            elif opening.other == room and (opening.side + 2) % 4 == side:
                at = opening.start, opening.end
            else:
                continue
            overlaps = at[0] - 0.05 < end and start < at[1] + 0.05
            if overlaps and low < opening.high and opening.low < high - 0.02:
                return False
        return not any(
            other.room == room
            and other.side == side
            and other.start < end
            and start < other.end
            and other.low < high
            and low < other.high
            for other in self.hung
        )

    # Walls, doors, windows

    def _openings(self) -> None:
        style = self.style
        leaf = style.front()
        frame = style.front()
        glass_frame = style.white if style.chance(0.6) else style.wood()
        daylight = style.between(0.25, 1.6) if style.chance(0.85) else 0.03
        sky = style.materials.add(
            textures.outside, (0.5, 0.7, 0.9), glow=0.25 + 1.1 * daylight
        )
        for opening in self.openings:
            along = (opening.start + opening.end) / 2
            x, y, yaw = self._at_wall(opening.room, opening.side, along)
            width = opening.end - opening.start
            if opening.kind == 'window':
                self._window(opening, width, glass_frame, sky)
                self._daylight(opening, width, daylight)
            elif opening.kind == 'entrance':
                depth = 0.1
                mesh = self._niche(width, 0.0, opening.high, depth, frame, DOOR)
                mesh.append(box((-width / 2, -depth - 0.04, 0), (width / 2, -depth + 0.02, opening.high), leaf, DOOR, cell=0.4))
                mesh.append(box((width / 2 - 0.12, -depth + 0.02, 1.0), (width / 2 - 0.04, -depth + 0.07, 1.03), style.steel, DOOR))
                self.parts.append(join(mesh).moved(x, y, 0, yaw))
                self._keep_free(opening, opening.room, opening.side, 0.7)
            else:
                self._doorway(opening, width, frame, leaf)

    def _keep_free(self, opening: Opening, room: int, side: int, depth: float) -> None:
        along = (opening.start + opening.end) / 2
        half = (opening.end - opening.start) / 2 + 0.08
        x, y, yaw = self._at_wall(room, side, along)
        cells = self._cells(*self._rect((-half, -0.05, half, depth), x, y, yaw))
        self.kept_free[cells] = True

    @staticmethod
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

    def _window(self, opening: Opening, width: float, frame: int, sky: int) -> None:
        style = self.style
        low, high, depth = opening.low, opening.high, 0.14
        half = width / 2
        parts = self._niche(width, low, high, depth, style.white, WALL)
        parts.append(rectangle((half, -depth, low), (-width, 0, 0), (0, 0, high - low), sky, WINDOW, fit=True))
        # As seen from inside, right is at negative x of furniture; the pane faces the room.
        parts[-1] = rectangle((-half, -depth, low), (width, 0, 0), (0, 0, high - low), sky, WINDOW, fit=True)
        parts[-1] = _turned_to_room(parts[-1])
        edge = 0.055
        bars = [(-half, low, half, low + edge), (-half, high - edge, half, high), (-half, low, -half + edge, high), (half - edge, low, half, high)]
        for index in range(1, max(1, round(width / style.between(0.55, 0.9)))):
            x = -half + width * index / max(1, round(width / 0.7))
            if x < half - 0.15:
                bars.append((x - edge / 2, low, x + edge / 2, high))
        if style.chance(0.3):
            z = high - 0.35 * (high - low)
            bars.append((-half, z - edge / 2, half, z + edge / 2))
        parts += [box((a, -depth + 0.005, b), (c, -depth + 0.05, d), frame, WINDOW) for a, b, c, d in bars]
        if low > 0.3:  # noqa: PLR2004
            parts.append(box((-half - 0.04, -depth, low), (half + 0.04, 0.06, low + 0.025), style.white, WINDOW))
        along = (opening.start + opening.end) / 2
        x, y, yaw = self._at_wall(opening.room, opening.side, along)
        self.parts.append(join(parts).moved(x, y, 0, yaw))
        room = self.rooms[opening.room]
        start, end = room.side(opening.side)
        if style.chance(0.55):
            below = 0.04 if style.chance(0.6) and low < 0.3 else max(0.1, low - 0.15)  # noqa: PLR2004
            above = min(high + 0.15, self.layout.height - 0.03)
            wide = style.between(0.2, 0.35)
            rail = [box((-half - wide, 0.06, above), (half + wide, 0.1, above + 0.02), style.leg(), CLUTTER)]
            for side in (-1.0, 1.0):
                middle = along + side * (half + wide / 2 - 0.06)
                if start + 0.15 < middle - wide / 2 and middle + wide / 2 < end - 0.15:
                    cx, cy, _ = self._at_wall(opening.room, opening.side, middle)
                    self.parts.append(furniture.curtain(style, wide, below, above).moved(cx, cy, 0, yaw))
            if start < along - half - wide and along + half + wide < end:
                self.parts.append(join(rail).moved(x, y, 0, yaw))
            self.hung.append(_Hung(opening.room, opening.side, along - half - wide, along + half + wide, below, above))
        if low > 0.7 and style.chance(0.6):  # noqa: PLR2004
            heater = furniture.radiator(style, min(width, style.between(0.6, 1.4)))
            cells = self._cells(*self._rect((-heater.width / 2, 0, heater.width / 2, 0.13), x, y, yaw))
            self.footprints[cells] = True
            self.parts.append(heater.mesh.moved(x, y, 0, yaw))

    def _daylight(self, opening: Opening, width: float, strength: float) -> None:
        along = (opening.start + opening.end) / 2
        high = opening.high - opening.low
        tint = self.style.between(0.9, 1.1)
        power = 1.6 * strength * width * high / 6
        for across in (-0.33, 0.0, 0.33):
            for up in (0.3, 0.75):
                x, y, yaw = self._at_wall(opening.room, opening.side, along + across * width)
                facing = (-float(np.sin(yaw)), float(np.cos(yaw)))
                self.lights.append(
                    Light(
                        float(x - 0.05 * facing[0]),
                        float(y - 0.05 * facing[1]),
                        opening.low + up * high,
                        (power * tint, power, power / tint),
                        facing,
                    )
                )

    def _doorway(self, opening: Opening, width: float, frame: int, leaf: int) -> None:
        style, wall = self.style, self.layout.inner_wall
        along = (opening.start + opening.end) / 2
        x, y, yaw = self._at_wall(opening.room, opening.side, along)
        half, high = width / 2, opening.high
        wide = opening.kind == 'wide'
        material, label, thick = (style.white, WALL, 0.01) if wide else (frame, DOOR, 0.035)
        lip = 0.0 if wide else 0.015
        parts = [
            box((-half, -wall - lip, 0), (-half + thick, lip, high), material, label, cell=CELL),
            box((half - thick, -wall - lip, 0), (half, lip, high), material, label, cell=CELL),
            box((-half + thick, -wall - lip, high - thick), (half - thick, lip, high), material, label, cell=CELL),
        ]
        if not wide:
            # A band around the frame, on both faces of the wall.
            for face in (0.0, -wall - 0.014):
                parts += [
                    box((-half - 0.05, face, 0), (-half, face + 0.014, high + 0.05), material, label, cell=0.4),
                    box((half, face, 0), (half + 0.05, face + 0.014, high + 0.05), material, label, cell=0.4),
                    box((-half, face, high), (half, face + 0.014, high + 0.05), material, label),
                ]
        parts.append(rectangle((-half, -wall, 0), (width, 0, 0), (0, wall, 0), style.wood(), FLOOR, cell=CELL))
        self.parts.append(join(parts).moved(x, y, 0, yaw))
        self.solid[self._cells(*self._rect((-half + thick, -wall - 0.03, half - thick, 0.03), x, y, yaw))] = False
        self._keep_free(opening, opening.room, opening.side, 0.75)
        self._keep_free(opening, opening.other, (opening.side + 2) % 4, 0.75)
        if opening.kind == 'leaf':
            self._leaf(opening, width, leaf)

    def _leaf(self, opening: Opening, width: float, material: int) -> None:
        """Hang the leaf of a door, standing open into one of its rooms."""
        style = self.style
        turn_in = self.rooms[opening.room].kind != 'hall'
        room = opening.room if turn_in else opening.other
        side = opening.side if turn_in else (opening.side + 2) % 4
        # Hinged where the nearer corner is, as doors are.
        start, end = self.rooms[room].side(side)
        near_start = opening.start - start < end - opening.end
        hinge = opening.start + 0.04 if near_start else opening.end - 0.04
        x, y, yaw = self._at_wall(room, side, hinge)
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
            mesh = mesh.moved(0, -0.04).moved(0, 0.0, 0, angle) if False else mesh.moved(0, 0, 0, angle)
            tip = np.array([np.cos(angle), np.sin(angle)]) * wide
        else:
            mesh = mesh.mirrored().moved(0, 0, 0, -angle)
            tip = np.array([-np.cos(angle), np.sin(angle)]) * wide
        self.parts.append(mesh.moved(x, y, 0, yaw))
        low, right = sorted([0.0, float(tip[0])])
        rect = self._rect((low - 0.05, 0.0, right + 0.05, wide), x, y, yaw)
        self.solid[self._cells(*rect)] = True
        # Not the opening itself: there the leaf is thin.
        inner = self.layout.inner_wall
        ox, oy, oyaw = self._at_wall(room, side, (opening.start + opening.end) / 2)
        half = width / 2 - 0.06
        clear = self._rect((-half + 0.05, -inner - 0.03, half - 0.05, 0.05), ox, oy, oyaw)
        self.solid[self._cells(*clear)] = False
        self.hung.append(_Hung(room, side, hinge - 0.1, hinge + 0.1, 0.0, high))

    def _shells(self) -> None:
        """Make floors, ceilings and walls."""
        style, rng = self.style, self.rng
        add = style.materials.add
        height = self.layout.height
        ceiling = add(textures.plaster, hsv(rng.uniform(0.08, 0.16), rng.uniform(0, 0.06), rng.uniform(0.85, 0.97)), 1.5)
        dry = self._dry_floor()
        skirting = style.white if style.chance(0.6) else style.wood()
        base_hue, base_sat = rng.random(), rng.uniform(0.0, 0.25)
        for index, room in enumerate(self.rooms):
            floor = dry if style.chance(0.65) else self._dry_floor()
            hue, sat = (base_hue, base_sat) if style.chance(0.5) else (rng.random(), rng.uniform(0.0, 0.45))
            kind = [textures.plaster, textures.plaster, textures.plaster, textures.wallpaper, textures.concrete][int(rng.integers(5))]
            wall = add(kind, hsv(hue, sat, rng.uniform(0.55, 0.95)), rng.uniform(0.8, 2.0))
            if room.kind in {'bath', 'kitchen'} and style.chance(0.85 if room.kind == 'bath' else 0.6):
                floor = add(textures.tiles, hsv(rng.random(), rng.uniform(0, 0.35), rng.uniform(0.3, 0.9)), rng.uniform(0.8, 1.6), gloss=0.1)
                if room.kind == 'bath':
                    wall = add(textures.tiles, hsv(rng.random(), rng.uniform(0, 0.35), rng.uniform(0.6, 0.95)), rng.uniform(0.6, 1.2), gloss=0.1)
            wide, deep = room.x1 - room.x0, room.y1 - room.y0
            self.parts += [
                rectangle((room.x0, room.y0, 0), (wide, 0, 0), (0, deep, 0), floor, FLOOR, cell=CELL),
                rectangle((room.x0, room.y0, height), (0, deep, 0), (wide, 0, 0), ceiling, CEILING, cell=CELL),
            ]
            accent = int(rng.integers(4)) if style.chance(0.35) else -1
            for side in range(4):
                material = wall
                if side == accent:
                    material = add(
                        [textures.plaster, textures.wallpaper, textures.concrete, textures.wood][int(rng.integers(4))],
                        hsv(rng.random(), rng.uniform(0.1, 0.6), rng.uniform(0.35, 0.85)), rng.uniform(0.8, 1.6),
                    )
                self._wall(index, side, material, skirting)

    def _dry_floor(self) -> int:
        rng = self.rng
        kind = [textures.planks, textures.planks, textures.herringbone, textures.carpet, textures.tiles, textures.concrete][int(rng.integers(6))]
        if kind is textures.carpet:
            colour = hsv(rng.random(), rng.uniform(0.0, 0.5), rng.uniform(0.25, 0.75))
        elif kind in {textures.tiles, textures.concrete}:
            colour = hsv(rng.uniform(0.03, 0.15), rng.uniform(0.0, 0.4), rng.uniform(0.35, 0.85))
        else:
            colour = hsv(rng.uniform(0.04, 0.11), rng.uniform(0.2, 0.65), rng.uniform(0.28, 0.85))
        return self.style.materials.add(kind, colour, rng.uniform(0.9, 1.8), gloss=rng.uniform(0, 0.12))

    def _wall(self, index: int, side: int, material: int, skirting: int) -> None:
        room, height = self.rooms[index], self.layout.height
        start, end = room.side(side)
        holes = [
            (o.start, o.end, o.low, o.high)
            for o in self.openings
            if (o.room == index and o.side == side)
            or (o.other == index and (o.side + 2) % 4 == side)
        ]
        edges = sorted({start, end, *(edge for hole in holes for edge in hole[:2])})
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            middle = (low + high) / 2
            hole = next((h for h in holes if h[0] < middle < h[1]), None)
            pieces = [(0.0, height)] if hole is None else [(0.0, hole[2]), (hole[3], height)]
            for bottom, top in pieces:
                if top - bottom > 1e-6:  # noqa: PLR2004
                    self.parts.append(self._face(room, side, low, high, bottom, top, material))
            if (hole is None or hole[2] > 0.2) and high - low > 0.02:  # noqa: PLR2004
                x, y, yaw = self._at_wall(index, side, middle)
                half = (high - low) / 2
                self.parts.append(
                    box((-half, 0, 0), (half, 0.012, 0.07), skirting, WALL, cell=0.5).moved(x, y, 0, yaw)
                )

    @staticmethod
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
        return rectangle((x, y, low), (right_x, right_y, 0.0), (0.0, 0.0, high - low), material, WALL, cell=CELL)

    def _structure(self) -> None:
        """Put up beams and columns."""
        style, rng = self.style, self.rng
        height = self.layout.height
        material = style.materials.add(
            [textures.plaster, textures.concrete, textures.wood][int(rng.integers(3))],
            hsv(rng.uniform(0.05, 0.12), rng.uniform(0, 0.3), rng.uniform(0.45, 0.95)), 1.0,
        )
        if style.chance(0.85):
            for _ in range(int(rng.integers(1, 3))):
                room = self.rooms[int(rng.integers(len(self.rooms)))]
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
                    self.parts.append(box((*ends[0], height - drop), (*ends[1], height), material, BEAM, cell=CELL))
        if style.chance(0.85):
            for _ in range(int(rng.integers(1, 3))):
                size = style.between(0.22, 0.4)
                if style.chance(0.4):
                    mesh = cylinder(0, size / 2, 0, height, size / 2, material, COLUMN, segments=24)
                else:
                    mesh = box((-size / 2, 0, 0), (size / 2, size, height), material, COLUMN, cell=CELL)
                big = max(range(len(self.rooms)), key=lambda i: self.rooms[i].area)
                room_index = big if style.chance(0.6) else int(rng.integers(len(self.rooms)))
                self._stand(Item(mesh, size, size, height), room_index, free=style.chance(0.3), corner=style.chance(0.5))

    # What hangs

    def _hang(self, index: int) -> None:
        style = self.style
        kind = self.rooms[index].kind
        many = {'living': 4, 'bed': 3, 'office': 3, 'hall': 2, 'kitchen': 2, 'bath': 0}[kind]
        wanted: list[Item] = []
        if style.chance({'office': 0.95, 'living': 0.35, 'kitchen': 0.3, 'bed': 0.25, 'hall': 0.3, 'bath': 0.0}[kind]):
            wanted.append(furniture.picture(style, board=True))
        wanted += [furniture.picture(style) for _ in range(int(self.rng.integers(0, many + 1)))]
        if style.chance(0.35) and many:
            wanted.append(furniture.wall_shelf(style))
        for item in wanted:
            for _ in range(10):
                side = int(self.rng.integers(4))
                start, end = self.rooms[index].side(side)
                if end - start < item.width + 0.2:
                    continue
                along = style.between(start + item.width / 2 + 0.1, end - item.width / 2 - 0.1)
                low = style.between(1.05, 1.55) if item.depth < 0.15 else 1.5  # noqa: PLR2004
                low = min(low, self.layout.height - item.height - 0.3)
                span = along - item.width / 2, along + item.width / 2, low - 0.03, low + item.height
                if self._wall_free(index, side, *span):
                    x, y, yaw = self._at_wall(index, side, along)
                    self.parts.append(item.mesh.moved(x, y, low, yaw))
                    self.hung.append(_Hung(index, side, *span))
                    break

    def _ceiling_lamps(self) -> None:
        night = not any(light.facing != (0.0, 0.0) and light.colour[0] > 0.05 for light in self.lights)  # noqa: PLR2004
        for index, room in enumerate(self.rooms):
            long = max(room.x1 - room.x0, room.y1 - room.y0)
            for share in (0.3, 0.7) if long > 4.5 else (0.5,):  # noqa: PLR2004
                x = room.x0 + (room.x1 - room.x0) * (share if long == room.x1 - room.x0 else 0.5)
                y = room.y0 + (room.y1 - room.y0) * (share if long == room.y1 - room.y0 else 0.5)
                on = night or self.style.chance(0.7)
                self._place(furniture.ceiling_lamp(self.style, self.layout.height, on=on), index, x, y, 0.0)

    # Positions

    def _positions(
        self, mesh: Mesh
    ) -> tuple[TruePlan, NDArray[np.float64], NDArray[np.int64], list[int]]:
        """Find where the robot can stand, from the triangles."""
        caster = Caster(mesh)
        rows, columns = self.solid.shape
        step = RESOLUTION / FINE
        x = self.origin[0] + (np.arange(columns * FINE) + 0.5) * step
        y = self.origin[1] + (np.arange(rows * FINE) + 0.5) * step
        rays = np.zeros((len(y), len(x), 6), np.float32)
        rays[..., 0], rays[..., 1] = x[None], y[:, None]
        rays[..., 2], rays[..., 5] = ROBOT_HEIGHT, -1.0
        hit = caster.cast(rays)
        # From below, a surface is the inside of something; nothing at all is inside of a wall.
        inside = (hit['primitive_ids'] == NOTHING) | (hit['primitive_normals'][..., 2] <= 0)
        taken = inside | (hit['t_hit'] < ROBOT_HEIGHT - LOWEST)
        outer = self.layout.outer_wall
        west, south = self.shift - outer
        east, north = self.shift + (self.layout.width + outer, self.layout.depth + outer)
        within = ((x > west) & (x < east))[None] & ((y > south) & (y < north))[:, None]
        cells = np.full(self.solid.shape, OUTSIDE, np.uint8)
        share = taken.reshape(rows, FINE, columns, FINE).mean((1, 3))
        is_in = within.reshape(rows, FINE, columns, FINE).mean((1, 3)) > 0.5  # noqa: PLR2004
        # A cell is occupied when a third of it is.
        cells[is_in] = np.where(share[is_in] > 0.3, OCCUPIED, FREE)  # noqa: PLR2004
        plan = TruePlan(cells, float(self.origin[0]), float(self.origin[1]), RESOLUTION)

        clear = ndimage.distance_transform_edt(~taken) * step
        spacing = round(STEP / step)

        def clearance(px: NDArray[np.float64], py: NDArray[np.float64]) -> NDArray[np.float64]:
            """Return the distance to the nearest taken cell's edge, from corners of cells."""
            column = np.clip(((px - self.origin[0]) / step).round().astype(int), 1, len(x) - 1)
            row = np.clip(((py - self.origin[1]) / step).round().astype(int), 1, len(y) - 1)
            near = [clear[row - a, column - b] for a in (0, 1) for b in (0, 1)]
            return np.minimum.reduce(near)

        columns_at = np.arange(0, len(x), spacing)
        rows_at = np.arange(0, len(y), spacing)
        px, py = np.meshgrid(self.origin[0] + columns_at * step, self.origin[1] + rows_at * step)
        free = clearance(px, py) >= ROBOT_RADIUS
        ways = np.zeros((*free.shape, 8), np.bool_)
        padded = np.pad(free, 1)
        height, width = free.shape
        for action, (up, right) in enumerate(STEPS.tolist()):
            def shifted(dr: int, dc: int) -> NDArray[np.bool_]:
                return padded[1 + dr : 1 + dr + height, 1 + dc : 1 + dc + width]

            way = free & shifted(up, right)
            if up and right:
                way &= shifted(up, 0) | shifted(0, right)
            for share_of_way in (0.25, 0.5, 0.75):
                way &= (
                    clearance(px + right * STEP * share_of_way, py + up * STEP * share_of_way)
                    >= ROBOT_RADIUS - step
                )
            ways[..., action] = way
        return plan, *self._component(px, py, free, ways)

    def _component(
        self,
        px: NDArray[np.float64],
        py: NDArray[np.float64],
        free: NDArray[np.bool_],
        ways: NDArray[np.bool_],
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], list[int]]:
        """Keep the largest set of positions that moves join."""
        from scipy.sparse import coo_array  # noqa: PLC0415
        from scipy.sparse.csgraph import connected_components  # noqa: PLC0415

        width = free.shape[1]
        start, action = np.nonzero(ways.reshape(-1, 8))
        end = start + STEPS[action, 0] * width + STEPS[action, 1]
        size = free.size
        graph = coo_array((np.ones(len(start)), (start, end)), shape=(size, size))
        _, group = connected_components(graph, directed=False)
        counts = np.bincount(group[free.ravel()], minlength=1)
        kept = np.flatnonzero(free.ravel() & (group == counts.argmax()))
        number = np.full(size, -1)
        number[kept] = np.arange(len(kept))
        moves = np.full((size, 8), -1)
        moves[start, action] = number[end]
        positions = np.stack([px.ravel()[kept], py.ravel()[kept]], 1).round(6)
        rooms = [
            next((i for i, r in enumerate(self.rooms) if r.x0 < x < r.x1 and r.y0 < y < r.y1), -1)
            for x, y in positions.tolist()
        ]
        return positions, moves[kept], [room for room in rooms if room >= 0]

    # Things

    def _things(
        self, mesh: Mesh, positions: NDArray[np.float64], camera_height: float
    ) -> tuple[Thing, ...]:
        """Put small things on tables and shelves, the bottle first."""
        style, rng = self.style, self.rng
        taken: list[tuple[float, float, float, float]] = []
        caster = Caster(mesh)
        things = [self._bottle(caster, positions, camera_height, taken)]
        others = [number for number in range(1, len(INSTANCE_NAMES)) if number != BOTTLE_ID]
        chosen = rng.choice(others, int(rng.integers(5, 11)), replace=False).tolist()
        if style.chance(0.2):
            chosen.append(chosen[0])
        for number in chosen:
            size = instance_size(number)
            spot = self._spot(max(size[0], size[1]) / 2 + 0.02, taken)
            if spot is not None:
                things.append(self._put(len(things) + 1, number, *spot))
        for _ in range(int(rng.integers(8, 30))):
            item = furniture.small_thing(style)
            spot = self._spot(max(item.width, item.depth) / 2 + 0.01, taken)
            if spot is not None:
                self.parts.append(item.mesh.moved(*spot, style.between(0, 6.28)))
        return tuple(things)

    def _spot(
        self, radius: float, taken: list[tuple[float, float, float, float]], tries: int = 12
    ) -> tuple[float, float, float] | None:
        """Find room for a small thing."""
        for _ in range(tries if self.tops else 0):
            top = self.tops[int(self.rng.integers(len(self.tops)))]
            if min(top.x1 - top.x0, top.y1 - top.y0) < 2 * radius - 0.04:
                continue
            x = self._within(top.x0 + radius, top.x1 - radius)
            y = self._within(top.y0 + radius, top.y1 - radius)
            if any(
                np.hypot(x - tx, y - ty) < radius + r and abs(top.z - tz) < 0.3  # noqa: PLR2004
                for tx, ty, tz, r in taken
            ):
                continue
            taken.append((x, y, top.z, radius))
            return x, y, top.z
        return None

    def _within(self, low: float, high: float) -> float:
        return self.style.between(low, high) if low < high else (low + high) / 2

    def _put(self, index: int, number: int, x: float, y: float, z: float) -> Thing:
        mesh = make_instance(self.style, number).moved(x, y, z + 0.001, self.style.between(0, 6.28))
        mesh = mesh.marked(index)
        self.parts.append(mesh)
        centers = mesh.vertices[mesh.faces].mean(1)
        corners = mesh.vertices[mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        every = max(1, len(centers) // 60)
        points = np.concatenate([centers, normals], 1)[::every].astype(np.float32)
        height = float(mesh.vertices[:, 2].max() - z)
        return Thing(number, (x, y, z + height / 2), points)

    def _bottle(
        self,
        caster: Caster,
        positions: NDArray[np.float64],
        camera_height: float,
        taken: list[tuple[float, float, float, float]],
    ) -> Thing:
        """Put the bottle where it can be reached and seen."""
        usable = [top for top in self.tops if 0.4 <= top.z <= 1.2]  # noqa: PLR2004
        all_tops, self.tops = self.tops, usable
        try:
            for _ in range(60):
                spot = self._spot(0.04, taken, tries=1)
                if spot is None:
                    continue
                x, y, z = spot
                apart = np.hypot(positions[:, 0] - x, positions[:, 1] - y)
                near = (apart < SIGHT) & (apart > 0.6)  # noqa: PLR2004
                eyes = np.full((int(near.sum()), 3), camera_height, np.float32)
                eyes[:, :2] = positions[near]
                seen = np.ones(len(eyes), np.bool_)
                for up in (0.03, 0.19):
                    target = np.array([x, y, z + up], np.float32)
                    seen &= ~caster.blocked(eyes, np.broadcast_to(target, eyes.shape), 0.01)
                if apart.min() < NEAR_BOTTLE and seen.sum() >= WATCHERS:
                    return self._put(1, BOTTLE_ID, x, y, z)
                taken.pop()
        finally:
            self.tops = all_tops
        raise _Unusable

    # Rooms

    def living(self, room: int) -> None:
        """Furnish a living room."""
        style, size = self.style, self.rooms[room].area
        self._stand(furniture.sofa_group(style), room, tries=30)
        if style.chance(0.8):
            self._stand(furniture.tv_bench(style), room)
        if 'kitchen' not in {r.kind for r in self.rooms} or (size > 11 and style.chance(0.7)):  # noqa: PLR2004
            self._stand(furniture.dining_set(style), room, free=style.chance(0.5), tries=20)
        self._several(room, furniture.bookcase, 1, 2 if size > 12 else 1)  # noqa: PLR2004
        if size > 13 and style.chance(0.6):  # noqa: PLR2004
            self._stand(furniture.sofa(style, style.between(0.8, 0.95)), room, corner=style.chance(0.5))
        self._extras(room, 0.8)

    def kitchen(self, room: int) -> None:
        """Furnish a kitchen."""
        style, r = self.style, self.rooms[room]
        long = max(r.x1 - r.x0, r.y1 - r.y0)
        for _ in range(4):
            if self._stand(furniture.kitchen_row(style, min(long - 0.06, style.between(1.5, 3.4))), room, tries=16, corner=True):
                break
        if r.area > 6 and not (style.chance(0.85) and self._stand(furniture.dining_set(style), room, free=style.chance(0.4), tries=16)):  # noqa: PLR2004
            self._stand(furniture.kitchen_island(style), room, free=style.chance(0.4))
        if style.chance(0.5):
            self._stand(furniture.stool(style), room)
        self._stand(furniture.bin_(style), room)
        self._extras(room, 0.3)

    def bed(self, room: int) -> None:
        """Furnish a bedroom."""
        style = self.style
        self._stand(furniture.bed_set(style), room, tries=30)
        tall = furniture.cupboard(style, style.between(0.9, 2.0), style.between(0.55, 0.62), style.between(1.9, 2.2))
        self._stand(tall, room, tries=20, front=0.3)
        if style.chance(0.35):
            self._stand(furniture.desk_set(style), room)
        if style.chance(0.5):
            self._stand(furniture.cupboard(style, style.between(0.6, 1.1), 0.42, style.between(0.7, 1.1)), room)
        if style.chance(0.5):
            self._stand(furniture.chair(style), room)
        self._extras(room, 0.5)

    def office(self, room: int) -> None:
        """Furnish a study."""
        style = self.style
        self._stand(furniture.desk_set(style), room, tries=25)
        self._several(room, furniture.bookcase, 1, 3)
        if style.chance(0.4):
            self._stand(furniture.sofa(style, style.between(0.8, 1.4)), room)
        if style.chance(0.4):
            self._stand(furniture.chair(style), room)
        self._extras(room, 0.6)

    def bath(self, room: int) -> None:
        """Furnish a bathroom."""
        style = self.style
        if self.rooms[room].area > 3.6 and style.chance(0.75):  # noqa: PLR2004
            self._stand(furniture.bathtub(style), room, corner=True, tries=20)
        self._stand(furniture.washbasin(style), room, tries=25)
        self._stand(furniture.toilet(style), room, tries=25)
        if style.chance(0.6):
            self._stand(furniture.washing_machine(style), room, corner=True)
        if style.chance(0.6):
            self._stand(furniture.bin_(style), room)

    def hall(self, room: int) -> None:
        """Furnish a hall."""
        style = self.style
        if style.chance(0.75):
            self._stand(furniture.coat_rack(style), room)
        if style.chance(0.6):
            self._stand(furniture.cupboard(style, style.between(0.5, 0.9), style.between(0.22, 0.35), style.between(0.8, 1.1)), room)
        self._extras(room, 0.3)

    def _several(self, room: int, make: Callable[[Style], Item], low: int, high: int) -> None:
        for _ in range(int(self.rng.integers(low, high + 1))):
            self._stand(make(self.style), room)

    def _extras(self, room: int, share: float) -> None:
        """Add plants, lamps, boxes and the like."""
        style = self.style
        makers: list[tuple[float, Callable[[Style], Item]]] = [
            (0.8, lambda style: furniture.plant(style, style.between(0.5, 1.5))),
            (0.7, furniture.floor_lamp),
            (0.5, furniture.boxes),
            (0.4, furniture.bin_),
            (0.35, furniture.stool),
            (0.4, furniture.chair),
        ]
        for weight, make in makers:
            if style.chance(weight * share):
                self._stand(make(style), room, corner=style.chance(0.6))


def _turned_to_room(part: Mesh) -> Mesh:
    """Return a pane that is seen from the other side."""
    from dataclasses import replace  # noqa: PLC0415

    return replace(
        part, normals=-part.normals, faces=np.ascontiguousarray(part.faces[:, ::-1])
    )


_FURNISH = {
    'living': _Builder.living,
    'kitchen': _Builder.kitchen,
    'bed': _Builder.bed,
    'office': _Builder.office,
    'bath': _Builder.bath,
    'hall': _Builder.hall,
}
