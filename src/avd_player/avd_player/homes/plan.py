"""Homes: floor plans, furnished, with the positions where a robot can stand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avd_player.homes.free_space import find_free_space
from avd_player.homes.home import Home
from avd_player.homes.layout import KINDS, draw_layout
from avd_player.homes.mesh import join
from avd_player.homes.rays import Caster
from avd_player.homes.rooms import furnish
from avd_player.homes.shell import build_openings, build_shell, build_structure
from avd_player.homes.site import Site, UnusableError
from avd_player.homes.things import put_things

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

POSITIONS = 200
"""A home has at most so many positions unless told otherwise."""

LEAST_POSITIONS = 120
"""Smaller homes can't be furnished."""

FEWEST_POSITIONS = 50
"""A home with fewer positions is drawn anew."""

ATTEMPTS = 100
"""A home is drawn anew so often at most."""

PATIENCE = 20
"""After so many attempts a home gets a room less."""

AREAS = (0.17, 0.26)
"""Square metres of a home for each of the positions that it may have, from and to."""

LARGEST = 110.0
"""Square metres of the largest homes."""

ROOM_SHARES = (0.2, 0.35, 0.3, 0.15)
"""So many of the homes have 3, 4, 5 and 6 rooms."""


def draw_home(seed: int | Sequence[int], *, positions: int = POSITIONS) -> Home:
    """Draw a home.

    Args:
        seed: All follows from it.
        positions: At most so many positions, which is what the size of the home follows from.

    Raises:
        ValueError: If it has too few positions for a home or none was found, or open3d is missing.
    """
    if positions < LEAST_POSITIONS:
        msg = f'A home has room for {LEAST_POSITIONS} positions or more, not for {positions}.'
        raise ValueError(msg)
    seeds = [seed] if isinstance(seed, int) else list(seed)
    rng = np.random.default_rng(seeds)
    low, high = (min(area * positions, LARGEST) for area in AREAS)
    size = float(rng.uniform(low, high))
    rooms = int(rng.choice(list(KINDS), p=ROOM_SHARES))
    for attempt in range(ATTEMPTS):
        try:
            # What proves hard to furnish gets fewer rooms.
            count = max(min(KINDS), rooms - attempt // PATIENCE)
            home = _draw(np.random.default_rng([*seeds, attempt]), size, count)
        except UnusableError:
            continue
        if len(home.positions) <= positions:
            return home
        size = max(low, size * max(0.7, positions / len(home.positions)))
    msg = f'No home with at most {positions} positions was found for the seed {seed}.'
    raise ValueError(msg)


def _draw(rng: np.random.Generator, area: float, rooms: int) -> Home:
    layout = draw_layout(rng, area, rooms)
    if layout is None:
        raise UnusableError
    site = Site(rng, layout)
    build_openings(site)
    if not site.lattice_joined(site.solid):
        raise UnusableError
    build_structure(site)
    furnish(site)
    build_shell(site)
    caster = Caster(join(site.parts))
    outer = layout.outer_wall
    west, south = (site.shift - outer).tolist()
    east, north = west + layout.width + 2 * outer, south + layout.depth + 2 * outer
    x, y = site.origin.tolist()
    outline = (west, south, east, north)
    space = find_free_space(caster, (x, y), site.solid.shape, outline)
    if len(space.positions) < FEWEST_POSITIONS or not _all_entered(site, space.positions):
        raise UnusableError
    height, pitch = site.style.between(1.1, 1.35), site.style.between(0.0, 10.0)
    things = put_things(site, caster, space.positions, height)
    return Home(
        layout._replace(rooms=tuple(site.rooms), openings=tuple(site.openings)),
        join(site.parts),
        site.style.materials.draw(),
        tuple(site.lights),
        things,
        space.positions,
        space.moves,
        space.plan,
        height,
        float(np.radians(pitch)),
    )


def _all_entered(site: Site, positions: NDArray[np.float64]) -> bool:
    """Tell whether each room has a position."""
    x, y = positions.T
    return all(
        ((x > room.x0) & (x < room.x1) & (y > room.y0) & (y < room.y1)).any()
        for room in site.rooms
    )
