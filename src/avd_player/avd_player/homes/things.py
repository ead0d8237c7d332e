# ruff: noqa: PLR2004 - sizes of things
"""Small things on tables and shelves, those that are looked for among them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avd_player.avd_format import INSTANCES
from avd_player.homes import furniture
from avd_player.homes.home import Thing
from avd_player.homes.instances import BOTTLE_ID, instance_size, make_instance
from avd_player.homes.site import Site, UnusableError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avd_player.homes.rays import Caster

NEAR_BOTTLE = 0.8
"""The bottle is this close to a position, metres in the plane."""

SIGHT = 2.5
"""From so far away the bottle must be seen from some positions."""

WATCHERS = 4
"""From so many."""


def put_things(
    site: Site, caster: Caster, positions: NDArray[np.float64], camera_height: float
) -> tuple[Thing, ...]:
    """Put small things on tables and shelves, the bottle first."""
    style, rng = site.style, site.rng
    taken: list[tuple[float, float, float, float]] = []
    things = [_bottle(site, caster, positions, camera_height, taken)]
    others = [number for number in range(1, len(INSTANCES)) if number != BOTTLE_ID]
    chosen = rng.choice(others, int(rng.integers(5, 11)), replace=False).tolist()
    if style.chance(0.2):
        chosen.append(chosen[0])
    for number in chosen:
        size = instance_size(number)
        spot = _spot(site, max(size[0], size[1]) / 2 + 0.02, taken)
        if spot is not None:
            things.append(_put(site, len(things) + 1, number, *spot))
    for _ in range(int(rng.integers(8, 30))):
        item = furniture.small_thing(style)
        spot = _spot(site, max(item.width, item.depth) / 2 + 0.01, taken)
        if spot is not None:
            site.parts.append(item.mesh.moved(*spot, style.between(0, 6.28)))
    return tuple(things)


def _spot(
    site: Site, radius: float, taken: list[tuple[float, float, float, float]], tries: int = 12
) -> tuple[float, float, float] | None:
    """Find room for a small thing."""
    for _ in range(tries if site.tops else 0):
        top = site.tops[int(site.rng.integers(len(site.tops)))]
        if min(top.x1 - top.x0, top.y1 - top.y0) < 2 * radius - 0.04:
            continue
        x = _within(site, top.x0 + radius, top.x1 - radius)
        y = _within(site, top.y0 + radius, top.y1 - radius)
        if any(
            np.hypot(x - tx, y - ty) < radius + r and abs(top.z - tz) < 0.3
            for tx, ty, tz, r in taken
        ):
            continue
        taken.append((x, y, top.z, radius))
        return x, y, top.z
    return None


def _within(site: Site, low: float, high: float) -> float:
    return site.style.between(low, high) if low < high else (low + high) / 2


def _put(site: Site, index: int, number: int, x: float, y: float, z: float) -> Thing:
    mesh = make_instance(site.style, number).moved(x, y, z + 0.001, site.style.between(0, 6.28))
    mesh = mesh.marked(index)
    site.parts.append(mesh)
    centers = mesh.vertices[mesh.faces].mean(1)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    every = max(1, len(centers) // 60)
    points = np.concatenate([centers, normals], 1)[::every].astype(np.float32)
    height = float(mesh.vertices[:, 2].max() - z)
    return Thing(number, (x, y, z + height / 2), points)


def _bottle(
    site: Site,
    caster: Caster,
    positions: NDArray[np.float64],
    camera_height: float,
    taken: list[tuple[float, float, float, float]],
) -> Thing:
    """Put the bottle where it can be reached and seen."""
    usable = [top for top in site.tops if 0.4 <= top.z <= 1.2]
    all_tops, site.tops = site.tops, usable
    try:
        for _ in range(60):
            spot = _spot(site, 0.04, taken, tries=1)
            if spot is None:
                continue
            x, y, z = spot
            apart = np.hypot(positions[:, 0] - x, positions[:, 1] - y)
            near = (apart < SIGHT) & (apart > 0.6)
            eyes = np.full((int(near.sum()), 3), camera_height, np.float32)
            eyes[:, :2] = positions[near]
            seen = np.ones(len(eyes), np.bool_)
            for up in (0.03, 0.19):
                target = np.array([x, y, z + up], np.float32)
                seen &= ~caster.blocked(eyes, np.broadcast_to(target, eyes.shape), 0.01)
            if apart.min() < NEAR_BOTTLE and seen.sum() >= WATCHERS:
                return _put(site, 1, BOTTLE_ID, x, y, z)
            taken.pop()
    finally:
        site.tops = all_tops
    raise UnusableError
