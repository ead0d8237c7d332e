"""Light in homes: lamps and windows with shadows, and what surfaces throw back to each other.

It is computed once for the vertices of a home; pictures take it from there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from avd_player.homes.mesh import Mesh
    from avd_player.homes.rays import Caster
    from avd_player.homes.textures import Material

REBOUNDS = 3
"""So many times light is thrown back by surfaces."""

BOUNCE_RAYS = 20
"""Rays from each vertex that find the surfaces around it."""

AMBIENT = 0.04
"""Light that is everywhere."""

REACH = 7.0
"""Metres beyond which a light is not looked at."""

CHUNK = 400_000
"""Shadow rays that are cast at once."""

GAMMA = 2.2


class Light(NamedTuple):
    """A small light.

    Attributes:
        x: Metres.
        y: Metres.
        z: Metres.
        colour: Strength of red, green and blue.
        facing: Unit vector in the plane that a window faces, (0, 0) for lamps.
    """

    x: float
    y: float
    z: float
    colour: tuple[float, float, float]
    facing: tuple[float, float] = (0.0, 0.0)


def mean_colours(materials: Sequence[Material]) -> NDArray[np.float32]:
    """Return the share of light that materials throw back, red, green and blue, (M, 3)."""
    means = [material.texture[::8, ::8].reshape(-1, 3) for material in materials]
    return np.stack([((mean / 255.0) ** GAMMA).mean(0) for mean in means]).astype(np.float32)


def bake(
    mesh: Mesh,
    materials: Sequence[Material],
    lights: Sequence[Light],
    caster: Caster,
    seed: int = 0,
) -> NDArray[np.float32]:
    """Return the light on each vertex, red, green and blue, (V, 3)."""
    rng = np.random.default_rng(seed)
    points = _lifted(mesh)
    direct = np.zeros((len(points), 3), np.float32)
    for light in lights:
        _add_light(direct, points, mesh.normals, light, caster)
    around = _surroundings(points, mesh.normals, caster, rng)
    albedo = mean_colours(materials)[mesh.materials]
    glow = np.array([material.glow for material in materials], np.float32)[mesh.materials]
    own = albedo * np.minimum(glow, 1.0)[:, None]
    total = direct
    for _ in range(REBOUNDS):
        # A ray's end is as bright as its triangle in the mean.
        face = total[mesh.faces].mean(1) * albedo * 0.8 + own
        face = np.concatenate([face, np.zeros((1, 3), np.float32)])
        total = direct + face[around].mean(1) + AMBIENT
    return total


def _lifted(mesh: Mesh) -> NDArray[np.float32]:
    """Return the vertices a little off their surface and away from its edges, (V, 3)."""
    middles = np.zeros_like(mesh.vertices)
    counts = np.zeros(len(mesh.vertices), np.float32)
    centers = mesh.vertices[mesh.faces].mean(1)
    for corner in range(3):
        np.add.at(middles, mesh.faces[:, corner], centers)
        np.add.at(counts, mesh.faces[:, corner], 1.0)
    inward = middles / np.maximum(counts, 1.0)[:, None] - mesh.vertices
    length = np.sqrt((inward**2).sum(1, keepdims=True))
    step = np.minimum(0.25 * length, 0.03)
    lifted: NDArray[np.float32] = (
        mesh.vertices + mesh.normals * np.float32(0.008) + inward / np.maximum(length, 1e-6) * step
    )
    return lifted


def _add_light(
    total: NDArray[np.float32],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    light: Light,
    caster: Caster,
) -> None:
    place = np.array(light[:3], np.float32)
    toward = place - points
    square = (toward**2).sum(1)
    distance = np.sqrt(square)
    slope = (toward * normals).sum(1) / np.maximum(distance, 1e-6)
    near = (slope > 0) & (distance < REACH)
    strength = slope / (square + 0.2)
    if light.facing != (0.0, 0.0):
        out = -(toward[:, :2] @ np.array(light.facing, np.float32)) / np.maximum(distance, 1e-6)
        strength *= out
        near &= out > 0
    chosen = np.flatnonzero(near)
    for start in range(0, len(chosen), CHUNK):
        part = chosen[start : start + CHUNK]
        lit = part[~caster.blocked(points[part], np.broadcast_to(place, (len(part), 3)))]
        total[lit] += strength[lit, None] * np.array(light.colour, np.float32)


def _surroundings(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    caster: Caster,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Return the triangles around each vertex, as its light comes from them, (V, R).

    Their density falls with the cosine to the normal; the number after the last triangle stands
    for nothing.
    """
    found = []
    ball = rng.standard_normal((BOUNCE_RAYS, 3)).astype(np.float32)
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    for direction in ball:
        way = normals + direction * np.float32(0.999)
        way /= np.maximum(np.sqrt((way**2).sum(1, keepdims=True)), 1e-6)
        hits = caster.cast(np.concatenate([points, way], 1, dtype=np.float32))['primitive_ids']
        found.append(np.where(hits == 0xFFFFFFFF, -1, hits.astype(np.int64)))  # noqa: PLR2004
    return np.stack(found, 1)
