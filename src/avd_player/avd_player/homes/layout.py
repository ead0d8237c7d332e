# ruff: noqa: PLR2004 - sizes of things
"""Floor plans: rooms, the openings between them, and windows."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

SOUTH, EAST, NORTH, WEST = range(4)
"""Sides of a room."""

MIN_SHARED = 1.35
"""Metres of wall that two rooms must share for a door."""

MIN_SIDE = 1.75
"""No room has a shorter side, in metres between the middles of its walls."""

KINDS = {
    3: ('living', 'bed', 'kitchen'),
    4: ('hall', 'living', 'bed', 'kitchen'),
    5: ('hall', 'living', 'bed', 'kitchen', 'bath'),
    6: ('hall', 'living', 'bed', 'office', 'kitchen', 'bath'),
}
"""What the rooms of a home of so many rooms are; but for the hall, from large to small."""


class Room(NamedTuple):
    """A room between its walls, in metres."""

    kind: str
    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def area(self) -> float:
        """Square metres."""
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    def side(self, side: int) -> tuple[float, float]:
        """Return where a side begins and ends along its wall."""
        return (self.x0, self.x1) if side in {SOUTH, NORTH} else (self.y0, self.y1)


class Opening(NamedTuple):
    """A hole in a wall.

    Attributes:
        kind: 'leaf' (a door that stands open), 'frame' (without its leaf), 'wide' (a passage),
            'entrance' (a closed door to outside) or 'window'.
        room: Its room, or the first of the two that it joins.
        side: Of that room.
        other: The second room, or -1.
        start: Where it begins along the wall, metres.
        end: Where it ends.
        low: Height of its lower edge.
        high: Height of its upper edge.
    """

    kind: str
    room: int
    side: int
    other: int
    start: float
    end: float
    low: float
    high: float


class Layout(NamedTuple):
    """A floor plan.

    Attributes:
        width: Metres along x, between the faces of the outer walls.
        depth: Metres along y.
        height: Of the ceiling.
        inner_wall: Thickness of the walls between rooms, metres.
        outer_wall: Thickness of the outer walls.
        rooms: The rooms.
        openings: The openings.
    """

    width: float
    depth: float
    height: float
    inner_wall: float
    outer_wall: float
    rooms: tuple[Room, ...]
    openings: tuple[Opening, ...]


def draw_layout(rng: np.random.Generator, area: float, count: int) -> Layout | None:
    """Draw a flat.

    Args:
        rng: Source of the draws.
        area: Square metres.
        count: Number of rooms, as in `KINDS`.

    Returns:
        The flat, or None if what was drawn is of no use.
    """
    aspect = rng.uniform(1.0, 1.65)
    width, depth = float(np.sqrt(area * aspect)), float(np.sqrt(area / aspect))
    corridor = count >= 5 and rng.random() < 0.6
    gross = _corridor(rng, width, depth, count) if corridor else _split(rng, width, depth, count)
    if gross is None:
        return None
    if rng.random() < 0.5:
        gross = gross[:, [1, 0, 3, 2]]
        width, depth = depth, width
    if rng.random() < 0.5:
        gross = np.stack([width - gross[:, 2], gross[:, 1], width - gross[:, 0], gross[:, 3]], 1)
    if rng.random() < 0.5:
        gross = np.stack([gross[:, 0], depth - gross[:, 3], gross[:, 2], depth - gross[:, 1]], 1)
    inner, outer = float(rng.uniform(0.1, 0.16)), float(rng.uniform(0.2, 0.35))
    rooms = _name(rng, gross, inner, width, depth, corridor=corridor)
    doors = _doors(rng, rooms, inner)
    if doors is None:
        return None
    height = float(rng.uniform(2.4, 2.8))
    openings = doors + _windows(rng, rooms, width, depth, height)
    return Layout(width, depth, height, inner, outer, tuple(rooms), tuple(openings))


def _cuts(rng: np.random.Generator, length: float, count: int) -> NDArray[np.float64] | None:
    """Cut a length into parts none of which is too short."""
    if length < count * MIN_SIDE:
        return None
    shares = rng.dirichlet(np.full(count, 6.0)) * (length - count * MIN_SIDE) + MIN_SIDE
    return np.concatenate([[0.0], np.cumsum(shares)])


def _corridor(
    rng: np.random.Generator, width: float, depth: float, count: int
) -> NDArray[np.float64] | None:
    """Put a corridor between two rows of rooms; it is the first of the rooms."""
    hall = rng.uniform(1.25, 1.7)
    below = rng.uniform(0.4, 0.6) * (depth - hall)
    if min(below, depth - hall - below) < MIN_SIDE:
        return None
    lower = (count - 1) // 2
    upper = count - 1 - lower
    first, second = _cuts(rng, width, lower), _cuts(rng, width, upper)
    if first is None or second is None:
        return None
    end, extra = width, []
    # The corridor may end before the last room of a row, which then is deeper.
    deep = int(rng.integers(3))
    rooms = [[first[i], 0.0, first[i + 1], below] for i in range(lower)]
    rooms += [[second[i], below + hall, second[i + 1], depth] for i in range(upper)]
    if deep == 1 and lower > 1:
        end = float(first[-2])
        rooms[lower - 1][3] = below + hall
    elif deep == 2 and upper > 1:
        end = float(second[-2])
        rooms[-1][1] = below
    extra.append([0.0, below, end, below + hall])
    return np.array(extra + rooms)


def _split(
    rng: np.random.Generator, width: float, depth: float, count: int
) -> NDArray[np.float64] | None:
    """Split the flat, and always the largest part again."""
    parts = [[0.0, 0.0, width, depth]]
    while len(parts) < count:
        parts.sort(key=lambda part: (part[2] - part[0]) * (part[3] - part[1]))
        x0, y0, x1, y1 = parts.pop()
        share = rng.uniform(0.34, 0.66)
        if x1 - x0 > y1 - y0:
            cut = x0 + share * (x1 - x0)
            parts += [[x0, y0, cut, y1], [cut, y0, x1, y1]]
        else:
            cut = y0 + share * (y1 - y0)
            parts += [[x0, y0, x1, cut], [x0, cut, x1, y1]]
    rooms = np.array(parts)
    if min((rooms[:, 2] - rooms[:, 0]).min(), (rooms[:, 3] - rooms[:, 1]).min()) < MIN_SIDE:
        return None
    return rooms


def _name(
    rng: np.random.Generator,
    gross: NDArray[np.float64],
    inner: float,
    width: float,
    depth: float,
    *,
    corridor: bool,
) -> list[Room]:
    """Say what the rooms are, by their sizes, and take their halves of the walls from them."""
    half = inner / 2
    net = gross + np.array([half, half, -half, -half])
    net[:, :2] = np.where(gross[:, :2] < 1e-6, 0.0, net[:, :2])
    limit = np.array([width, depth])
    net[:, 2:] = np.where(gross[:, 2:] > limit - 1e-6, limit, net[:, 2:])
    areas = (gross[:, 2] - gross[:, 0]) * (gross[:, 3] - gross[:, 1])
    kinds = list(KINDS[len(gross)])
    names = [''] * len(gross)
    left = list(range(len(gross)))
    if kinds[0] == 'hall':
        kinds.pop(0)
        if corridor:
            hall = 0
        else:
            # The hall is not large, and in the middle of things.
            touching = [sum(_shared(a, b)[0] > MIN_SHARED for b in gross) for a in gross]
            hall = int(np.argmax(np.array(touching) - areas / areas.mean()))
        names[hall] = 'hall'
        left.remove(hall)
    left.sort(key=lambda room: -float(areas[room]))
    if len(kinds) > 3 and rng.random() < 0.4:
        kinds[1], kinds[2] = kinds[2], kinds[1]
    for room, kind in zip(left, kinds, strict=True):
        names[room] = kind
    return [Room(name, *row) for name, row in zip(names, net.tolist(), strict=True)]


def _shared(
    a: NDArray[np.float64], b: NDArray[np.float64], gap: float = 1e-6
) -> tuple[float, int, float, float]:
    """Return how much wall two rooms share, on which side of the first, from where to where."""
    for side, (edge, facing) in enumerate(((1, 3), (2, 0), (3, 1), (0, 2))):
        if abs(a[edge] - b[facing]) <= gap:
            low, high = (0, 2) if side in {SOUTH, NORTH} else (1, 3)
            start, end = max(a[low], b[low]), min(a[high], b[high])
            if end > start:
                return float(end - start), side, float(start), float(end)
    return 0.0, SOUTH, 0.0, 0.0


_COSTS = {
    frozenset({'living', 'kitchen'}): 0.6,
    frozenset({'bath', 'kitchen'}): 3.0,
    frozenset({'bath', 'living'}): 2.5,
    frozenset({'bed', 'kitchen'}): 2.8,
    frozenset({'bed', 'bath'}): 1.6,
}


def _doors(rng: np.random.Generator, rooms: list[Room], inner: float) -> list[Opening] | None:
    """Join the rooms by doors, from the hall where there is one; none if it can't be done."""
    edges = []
    for first in range(len(rooms)):
        for second in range(first + 1, len(rooms)):
            a, b = np.array(rooms[first][1:]), np.array(rooms[second][1:])
            length, side, start, end = _shared(a, b, inner + 1e-6)
            if length > MIN_SHARED:
                kinds = frozenset({rooms[first].kind, rooms[second].kind})
                cost = 0.3 if 'hall' in kinds else _COSTS.get(kinds, 1.5)
                edges.append((cost + rng.uniform(0, 0.3), first, second, side, start, end))
    group = list(range(len(rooms)))
    doors = []
    for cost, first, second, side, start, end in sorted(edges):
        joined = group[first] == group[second]
        extra = cost < 1.0 and rng.random() < 0.3
        if joined and not extra:
            continue
        group = [group[first] if g == group[second] else g for g in group]
        kinds = frozenset({rooms[first].kind, rooms[second].kind})
        open_plan = kinds <= {'living', 'kitchen', 'hall'} and end - start > 2.0
        if open_plan and rng.random() < 0.5:
            kind, width, high = 'wide', rng.uniform(1.1, min(2.2, end - start - 0.5)), 2.2
        else:
            kind = 'leaf' if rng.random() < 0.55 else 'frame'
            width, high = rng.uniform(0.9, 1.0), rng.uniform(2.0, 2.1)
        # Doors are rather near a corner, which leaves room for furniture.
        slack = end - start - width - 0.3
        at = start + 0.15 + slack * float(rng.beta(0.5, 0.5))
        doors.append(Opening(kind, first, side, second, at, at + width, 0.0, float(high)))
    return doors if len(set(group)) == 1 else None


def _windows(
    rng: np.random.Generator,
    rooms: list[Room],
    width: float,
    depth: float,
    height: float,
) -> list[Opening]:
    """Put the entrance and windows into the outer walls."""
    openings = []
    outer: list[tuple[int, int]] = []
    for index, room in enumerate(rooms):
        sides = (room.y0 <= 0, room.x1 >= width, room.y1 >= depth, room.x0 <= 0)
        outer += [(index, side) for side, is_outer in enumerate(sides) if is_outer]
    # The entrance is where people would have it.
    wanted = ('hall', 'living', 'kitchen', 'bed', 'office', 'bath')
    entry = min(outer, key=lambda place: wanted.index(rooms[place[0]].kind))
    start, end = rooms[entry[0]].side(entry[1])
    at = start + 0.1 + float(rng.uniform(0, max(0.0, end - start - 1.15)))
    openings.append(Opening('entrance', *entry, -1, at, at + 0.93, 0.0, 2.05))
    sill, top = float(rng.uniform(0.75, 1.0)), float(min(rng.uniform(2.0, 2.3), height - 0.15))
    for index, side in outer:
        room = rooms[index]
        start, end = room.side(side)
        if (index, side) == entry or end - start < 1.2 or rng.random() < 0.15:
            continue
        small = room.kind in {'bath', 'hall'}
        wide = float(rng.uniform(0.5, 0.8) if small else rng.uniform(0.9, 1.9))
        wide = min(wide, end - start - 0.5)
        low = sill
        if small:
            low = max(sill, top - 0.8)
        elif room.kind == 'living' and rng.random() < 0.35:
            low = 0.06
        at = start + 0.25 + float(rng.uniform(0.2, 0.8)) * (end - start - wide - 0.5)
        openings.append(Opening('window', index, side, -1, at, at + wide, low, top))
        if end - at - wide > 1.6 and not small:
            more = min(wide, end - at - wide - 0.6)
            begin = at + wide + 0.35
            openings.append(Opening('window', index, side, -1, begin, begin + more, low, top))
    return openings
