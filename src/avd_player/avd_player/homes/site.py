# ruff: noqa: PLR2004 - sizes of things
"""A flat that is being furnished: what is where so far, and room for more."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage

from avd_player.homes.free_space import RESOLUTION, STEP
from avd_player.homes.furniture import Item, Style, Top
from avd_player.homes.layout import EAST, NORTH, SOUTH, Layout, Opening
from avd_player.homes.light import Light

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avd_player.homes.mesh import Mesh

ROUGH_CLEARANCE = 0.25
"""Metres to what is around that furniture must leave to positions."""

MOST_LOST = 0.07
"""Share of the positions that furniture may cut off from the others."""


class UnusableError(Exception):
    """What was drawn can't be used."""


class Hung(NamedTuple):
    """A part of a wall that is taken: of a room's side, from and to along it, and heights."""

    room: int
    side: int
    start: float
    end: float
    low: float
    high: float


class Site:
    """A flat that is being furnished.

    Attributes:
        rng: Source of the draws.
        layout: Its plan.
        style: Its taste.
        rooms: As in the plan, but shifted: walls are not in line with positions.
        openings: Likewise.
        parts: What stands in it.
        lights: Lamps that are on, and windows.
        tops: Where small things can stand.
        hung: Parts of the walls that are taken.
        origin: South-western corner of the cells below.
        solid: Cells of walls, (H, W).
        kept_free: Cells in front of doors, (H, W).
        footprints: Cells of furniture, (H, W).
    """

    def __init__(self, rng: np.random.Generator, layout: Layout) -> None:
        self.rng, self.layout = rng, layout
        self.style = Style(rng)
        self.parts: list[Mesh] = []
        self.lights: list[Light] = []
        self.tops: list[Top] = []
        self.hung: list[Hung] = []
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
        along = [
            self.shift[0] if o.side in {SOUTH, NORTH} else self.shift[1] for o in layout.openings
        ]
        self.openings = [
            opening._replace(start=opening.start + by, end=opening.end + by)
            for opening, by in zip(layout.openings, along, strict=True)
        ]
        for room in self.rooms:
            self.solid[self.cells(room.x0, room.y0, room.x1, room.y1)] = False

    def cells(self, x0: float, y0: float, x1: float, y1: float) -> tuple[slice, slice]:
        """Return the cells whose middles are in a rectangle."""
        columns = np.searchsorted(self.x, [x0, x1])
        rows = np.searchsorted(self.y, [y0, y1])
        return slice(*rows.tolist()), slice(*columns.tolist())

    def at_wall(self, room: int, side: int, along: float) -> tuple[float, float, float]:
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
    def rect(
        item: tuple[float, float, float, float], x: float, y: float, yaw: float
    ) -> tuple[float, float, float, float]:
        """Return the rectangle around one that is turned by quarters, and shifted."""
        cos, sin = round(np.cos(yaw)), round(np.sin(yaw))
        xs = [item[0] * cos - item[1] * sin, item[2] * cos - item[3] * sin]
        ys = [item[0] * sin + item[1] * cos, item[2] * sin + item[3] * cos]
        return x + min(xs), y + min(ys), x + max(xs), y + max(ys)

    def lattice_joined(self, solid: NDArray[np.bool_]) -> bool:
        """Tell whether nearly all positions and all rooms are joined."""
        clear = ndimage.distance_transform_edt(~solid) * RESOLUTION
        points = self._lattice(clear) >= ROUGH_CLEARANCE
        groups, count = ndimage.label(points)
        if not count:
            return False
        sizes = np.bincount(groups.ravel())[1:]
        if sizes.max() < (1 - MOST_LOST) * sizes.sum():
            return False
        main = groups == 1 + int(sizes.argmax())
        rows, columns = np.nonzero(main)
        x, y = self.origin[0] + columns * STEP, self.origin[1] + rows * STEP
        return all(
            ((x > r.x0) & (x < r.x1) & (y > r.y0) & (y < r.y1)).sum() >= 2 for r in self.rooms
        )

    def _lattice(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values at the positions; they lie on corners of cells."""
        step = round(STEP / RESOLUTION)
        padded = np.pad(values, ((1, 0), (1, 0)))
        corners: NDArray[np.float64] = np.minimum.reduce(
            [padded[:-1, :-1], padded[1:, :-1], padded[:-1, 1:], padded[1:, 1:]]
        )
        return corners[::step, ::step]

    def place(self, item: Item, x: float, y: float, yaw: float) -> None:
        """Put a thing where it is known to fit."""
        self.parts.append(item.mesh.moved(x, y, 0, yaw))
        cos, sin = np.cos(yaw), np.sin(yaw)
        for top in item.tops:
            rect = self.rect((top.x0, top.y0, top.x1, top.y1), x, y, yaw)
            self.tops.append(Top(*rect, top.z))
        warm = self.style.between(0.75, 0.95)
        for lx, ly, lz, strength in item.lamps:
            self.lights.append(
                Light(
                    float(x + lx * cos - ly * sin),
                    float(y + lx * sin + ly * cos),
                    lz,
                    (strength, strength * (0.5 + 0.5 * warm), strength * warm * warm),
                )
            )

    def stand(
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
            if slack < 0.02 or deep < 0.1:
                continue
            share = float(self.rng.random())
            if corner or self.style.chance(0.4):
                share = float(self.rng.integers(2))
            along = start + item.width / 2 + 0.01 + share * (slack - 0.02)
            x, y, yaw = self.at_wall(room, side, along)
            out = self.style.between(0.2, 0.8) * deep if free else self.style.between(0.005, 0.03)
            x, y = x - out * np.sin(yaw), y + out * np.cos(yaw)
            half = item.width / 2
            rect = self.rect((-half, 0.0, half, item.depth), x, y, yaw)
            cells = self.cells(*rect)
            keep = self.cells(*self.rect((-half, 0.0, half, item.depth + front), x, y, yaw))
            taken = self.footprints | self.solid
            if (taken | self.kept_free)[cells].any() or self.footprints[keep].any():
                continue
            if not free and not self.wall_free(
                room, side, along - half, along + half, 0.0, item.height
            ):
                continue
            trial = self.solid.copy()
            trial[cells] = True
            if not self.lattice_joined(trial | self.footprints):
                continue
            self.footprints[cells] = True
            if not free:
                self.hung.append(Hung(room, side, along - half, along + half, 0.0, item.height))
            self.place(item, x, y, yaw)
            return True
        return False

    def wall_free(
        self, room: int, side: int, start: float, end: float, low: float, high: float
    ) -> bool:
        """Tell whether a part of a wall has no opening and nothing on it."""
        for opening in self.openings:
            if (opening.room == room and opening.side == side) or (
                opening.other == room and (opening.side + 2) % 4 == side
            ):
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

    def keep_free(self, opening: Opening, room: int, side: int, depth: float) -> None:
        """Let no furniture stand in front of an opening."""
        along = (opening.start + opening.end) / 2
        half = (opening.end - opening.start) / 2 + 0.08
        x, y, yaw = self.at_wall(room, side, along)
        cells = self.cells(*self.rect((-half, -0.05, half, depth), x, y, yaw))
        self.kept_free[cells] = True
