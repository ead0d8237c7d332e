# ruff: noqa: PLR2004 - sizes of things
"""What stands and hangs in the rooms of a home."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avd_player.homes import furniture
from avd_player.homes.furniture import BOOKCASE, CHAIR, TABLE
from avd_player.homes.site import Hung, Site, UnusableError

if TYPE_CHECKING:
    from collections.abc import Callable

    from avd_player.homes.furniture import Item, Style


def furnish(site: Site) -> None:
    """Furnish the rooms of a flat, large ones first.

    Raises:
        UnusableError: If something has no place that a home can't be without.
    """
    for index in sorted(range(len(site.rooms)), key=lambda i: -site.rooms[i].area):
        _FURNISH[site.rooms[index].kind](site, index)
    _complete(site)
    for index in range(len(site.rooms)):
        _hang(site, index)
    _ceiling_lamps(site)


def _living(site: Site, room: int) -> None:
    """Furnish a living room."""
    style, size = site.style, site.rooms[room].area
    _must(site, room, lambda: furniture.sofa_group(style))
    if style.chance(0.8):
        site.stand(furniture.tv_bench(style), room)
    alone = 'kitchen' not in {r.kind for r in site.rooms}
    if alone or (size > 11 and style.chance(0.7)):
        site.stand(furniture.dining_set(style), room, free=style.chance(0.5), tries=20)
    _several(site, room, furniture.bookcase, 1, 3)
    if size > 10 and style.chance(0.7):
        site.stand(furniture.sofa(style, style.between(0.8, 0.95)), room)
    if size > 12 and style.chance(0.6):
        site.stand(furniture.desk_set(style), room)
    if style.chance(0.5):
        site.stand(_sideboard(site), room)
    _extras(site, room, 1.0)


def _kitchen(site: Site, room: int) -> None:
    """Furnish a kitchen."""
    style, r = site.style, site.rooms[room]
    long = max(r.x1 - r.x0, r.y1 - r.y0) - 0.06
    high = [True, False, style.chance(0.5)]

    def row() -> Item:
        # Without cupboards above it fits below windows.
        high.append(high.pop(0))
        return furniture.kitchen_row(
            style, min(long, style.between(1.5, 3.2)), cupboards_above=high[-1]
        )

    _must(site, room, row, corner=True)
    if r.area > 5:
        placed = style.chance(0.85) and site.stand(
            furniture.dining_set(style), room, free=style.chance(0.4), tries=16
        )
        if not placed:
            site.stand(furniture.kitchen_island(style), room, free=style.chance(0.4))
    if style.chance(0.4):
        site.stand(furniture.bookcase(style), room)
    if style.chance(0.5):
        site.stand(furniture.stool(style), room)
    site.stand(furniture.bin_(style), room)
    _extras(site, room, 0.5)


def _bed(site: Site, room: int) -> None:
    """Furnish a bedroom."""
    style = site.style
    _must(site, room, lambda: furniture.bed_set(style))
    width, depth = style.between(0.9, 2.0), style.between(0.55, 0.62)
    tall = furniture.cupboard(style, width, depth, style.between(1.9, 2.2))
    site.stand(tall, room, tries=20, front=0.3)
    if style.chance(0.45):
        site.stand(furniture.desk_set(style), room)
    if style.chance(0.6):
        site.stand(_sideboard(site), room)
    if style.chance(0.35):
        site.stand(furniture.bookcase(style), room)
    if style.chance(0.6):
        site.stand(furniture.chair(style), room)
    _extras(site, room, 0.8)


def _office(site: Site, room: int) -> None:
    """Furnish a study."""
    style = site.style
    _must(site, room, lambda: furniture.desk_set(style))
    _several(site, room, furniture.bookcase, 1, 3)
    if style.chance(0.5):
        site.stand(furniture.sofa(style, style.between(0.8, 1.4)), room)
    if style.chance(0.5):
        site.stand(furniture.chair(style), room)
    if style.chance(0.5):
        site.stand(_sideboard(site), room)
    _extras(site, room, 0.8)


def _bath(site: Site, room: int) -> None:
    """Furnish a bathroom."""
    style = site.style
    if site.rooms[room].area > 3.6 and style.chance(0.75):
        site.stand(furniture.bathtub(style), room, corner=True, tries=20)
    _must(site, room, lambda: furniture.washbasin(style))
    site.stand(furniture.toilet(style), room, tries=25)
    if style.chance(0.6):
        site.stand(furniture.washing_machine(style), room, corner=True)
    if style.chance(0.6):
        site.stand(furniture.bin_(style), room)
    if style.chance(0.3):
        site.stand(furniture.stool(style), room)


def _hall(site: Site, room: int) -> None:
    """Furnish a hall."""
    style = site.style
    if style.chance(0.75):
        site.stand(furniture.coat_rack(style), room)
    if style.chance(0.6):
        site.stand(_sideboard(site, style.between(0.22, 0.35)), room)
    if site.rooms[room].area > 6:
        _several(site, room, furniture.bookcase, 0, 2)
    _extras(site, room, 0.6)


def _must(site: Site, room: int, make: Callable[[], Item], **how: bool) -> None:
    """Place what a room can't be without, in one of several versions of it."""
    if not any(site.stand(make(), room, tries=12, **how) for _ in range(6)):
        raise UnusableError


def _sideboard(site: Site, depth: float = 0.42) -> Item:
    style = site.style
    return furniture.cupboard(style, style.between(0.5, 1.2), depth, style.between(0.7, 1.1))


def _complete(site: Site) -> None:
    """Add a table, a chair and a bookcase where a home has none yet."""
    style = site.style
    makers: dict[int, Callable[[], Item]] = {
        TABLE: lambda: furniture.table(style, style.between(0.5, 0.9), 0.45, 0.7),
        CHAIR: lambda: furniture.chair(style),
        BOOKCASE: lambda: furniture.bookcase(style),
    }
    for label, make in makers.items():
        if not any((part.labels == label).any() for part in site.parts):
            rooms = site.rng.permutation(len(site.rooms)).tolist()
            if not any(site.stand(make(), room) for room in rooms * 2):
                raise UnusableError


def _several(site: Site, room: int, make: Callable[[Style], Item], low: int, high: int) -> None:
    for _ in range(int(site.rng.integers(low, high + 1))):
        site.stand(make(site.style), room)


def _extras(site: Site, room: int, share: float) -> None:
    """Add plants, lamps, boxes and the like."""
    style = site.style
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
            site.stand(make(style), room, corner=style.chance(0.6))


def _hang(site: Site, index: int) -> None:
    style = site.style
    kind = site.rooms[index].kind
    many = {'living': 4, 'bed': 3, 'office': 3, 'hall': 2, 'kitchen': 2, 'bath': 0}[kind]
    wanted: list[Item] = []
    if style.chance(
        {
            'office': 0.95,
            'living': 0.35,
            'kitchen': 0.3,
            'bed': 0.25,
            'hall': 0.3,
            'bath': 0.0,
        }[kind]
    ):
        wanted.append(furniture.picture(style, board=True))
    wanted += [furniture.picture(style) for _ in range(int(site.rng.integers(0, many + 1)))]
    if style.chance(0.35) and many:
        wanted.append(furniture.wall_shelf(style))
    for item in wanted:
        for _ in range(10):
            side = int(site.rng.integers(4))
            start, end = site.rooms[index].side(side)
            if end - start < item.width + 0.2:
                continue
            along = style.between(start + item.width / 2 + 0.1, end - item.width / 2 - 0.1)
            low = style.between(1.05, 1.55) if item.depth < 0.15 else 1.5
            low = min(low, site.layout.height - item.height - 0.3)
            span = (
                along - item.width / 2,
                along + item.width / 2,
                low - 0.03,
                low + item.height,
            )
            if site.wall_free(index, side, *span):
                x, y, yaw = site.at_wall(index, side, along)
                site.parts.append(item.mesh.moved(x, y, low, yaw))
                site.hung.append(Hung(index, side, *span))
                break


def _ceiling_lamps(site: Site) -> None:
    night = not any(light.facing != (0.0, 0.0) and light.colour[0] > 0.05 for light in site.lights)
    for room in site.rooms:
        long = max(room.x1 - room.x0, room.y1 - room.y0)
        for share in (0.3, 0.7) if long > 4.5 else (0.5,):
            x = room.x0 + (room.x1 - room.x0) * (share if long == room.x1 - room.x0 else 0.5)
            y = room.y0 + (room.y1 - room.y0) * (share if long == room.y1 - room.y0 else 0.5)
            on = night or site.style.chance(0.7)
            site.place(furniture.ceiling_lamp(site.style, site.layout.height, on=on), x, y, 0.0)


_FURNISH = {
    'living': _living,
    'kitchen': _kitchen,
    'bed': _bed,
    'office': _office,
    'bath': _bath,
    'hall': _hall,
}
