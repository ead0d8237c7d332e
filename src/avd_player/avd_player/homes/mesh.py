# ruff: noqa: PLR2004 - sizes of things
"""Triangles with what is known about them, and the shapes that homes are made of.

Lengths are in metres. Normals point out of what is solid: whether a ray starts inside of
something can be told from the first triangle that it meets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Mesh:
    """Triangles.

    Attributes:
        vertices: Metres, float32 (V, 3).
        normals: Unit vectors for shading, float32 (V, 3).
        uvs: Coordinates in the texture, metres on the surface unless the texture is a picture,
            float32 (V, 2).
        faces: Vertices of the triangles, counter-clockwise from outside, int32 (T, 3).
        materials: Indices into the textures of the home, int32 (T,).
        labels: Indices into `gridnav.rgbd.CLASSES`, uint8 (T,).
        instances: 1 for the first of the home's things, and so on, 0 elsewhere, uint8 (T,).
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]
    faces: NDArray[np.int32]
    materials: NDArray[np.int32]
    labels: NDArray[np.uint8]
    instances: NDArray[np.uint8]

    def moved(self, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Mesh:
        """Return it turned about the z axis (radians), then shifted."""
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]], np.float32)
        shift = np.array([x, y, z], np.float32)
        return replace(self, vertices=self.vertices @ turn + shift, normals=self.normals @ turn)

    def mirrored(self) -> Mesh:
        """Return its mirror image, left and right exchanged."""
        flip = np.array([-1.0, 1.0, 1.0], np.float32)
        return replace(
            self,
            vertices=self.vertices * flip,
            normals=self.normals * flip,
            faces=np.ascontiguousarray(self.faces[:, ::-1]),
        )

    def marked(self, instance: int) -> Mesh:
        """Return it as a thing that is looked for."""
        return replace(self, instances=np.full(len(self.faces), instance, np.uint8))


def join(meshes: Iterable[Mesh]) -> Mesh:
    """Return one mesh of several."""
    parts = list(meshes)
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts.tolist(), strict=False)]
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.uvs for part in parts]),
        np.concatenate(faces).astype(np.int32),
        np.concatenate([part.materials for part in parts]),
        np.concatenate([part.labels for part in parts]),
        np.concatenate([part.instances for part in parts]),
    )


def mesh(
    vertices: ArrayLike,
    normals: ArrayLike,
    uvs: ArrayLike,
    faces: ArrayLike,
    material: int,
    label: int,
) -> Mesh:
    """Return triangles of one material and class."""
    corners = np.asarray(faces, np.int32)
    return Mesh(
        np.asarray(vertices, np.float32),
        np.asarray(normals, np.float32),
        np.asarray(uvs, np.float32),
        corners,
        np.full(len(corners), material, np.int32),
        np.full(len(corners), label, np.uint8),
        np.zeros(len(corners), np.uint8),
    )


@cache
def _lattice(across: int, along: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the corners of the cells of the unit square, and two triangles for each cell."""
    u, v = np.meshgrid(np.linspace(0, 1, across + 1), np.linspace(0, 1, along + 1))
    low = (np.arange(along)[:, None] * (across + 1) + np.arange(across)).ravel()
    high = low + across + 1
    faces = np.concatenate(
        [np.stack([low, low + 1, high + 1], 1), np.stack([low, high + 1, high], 1)]
    )
    return np.stack([u.ravel(), v.ravel()], 1), faces.astype(np.int32)


def rectangle(
    corner: Sequence[float],
    right: Sequence[float],
    up: Sequence[float],
    material: int,
    label: int,
    *,
    cell: float = 0.0,
    fit: bool = False,
) -> Mesh:
    """Return a rectangle that is seen from where `right` points right and `up` up.

    Args:
        corner: Its lower left.
        right: Its lower edge.
        up: Its left edge.
        material: What it is made of.
        label: What it belongs to.
        cell: Light is computed at points so far apart; only in the corners if 0.
        fit: Whether the texture is stretched over it once, and not repeated.
    """
    edges = np.array([right, up], np.float64)
    lengths = np.sqrt((edges**2).sum(1))
    counts = np.ceil(lengths / cell).clip(1, 60).astype(int) if cell else (1, 1)
    points, faces = _lattice(int(counts[0]), int(counts[1]))
    normal = np.cross(edges[0], edges[1]) / (lengths[0] * lengths[1])
    uvs = points * (1.0 if fit else lengths)
    if not fit:
        uvs = uvs + np.abs(np.array([corner[0] + corner[1], corner[2]])) % 7.0
    return mesh(
        np.array(corner) + points @ edges,
        np.broadcast_to(normal, (len(points), 3)),
        uvs,
        faces,
        material,
        label,
    )


_CUBE = np.array(
    [
        # corner, right, up of each side, as seen from outside
        [[0, 0, 0], [0, 1, 0], [1, 0, 0]],
        [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
        [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
        [[1, 1, 0], [-1, 0, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 1, 0], [0, -1, 0], [0, 0, 1]],
    ],
    np.float64,
)
_CUBE_CORNERS = np.stack(
    [
        _CUBE[:, 0],
        _CUBE[:, 0] + _CUBE[:, 1],
        _CUBE[:, 0] + _CUBE[:, 1] + _CUBE[:, 2],
        _CUBE[:, 0] + _CUBE[:, 2],
    ],
    axis=1,
)
_CUBE_NORMALS = np.repeat(np.cross(_CUBE[:, 1], _CUBE[:, 2]), 4, axis=0)
_CUBE_FACES = (np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(6)[:, None, None]).reshape(
    -1, 3
)
_CUBE_AXES = np.abs(_CUBE[:, 1:]).argmax(-1)


def box(
    low: Sequence[float],
    high: Sequence[float],
    material: int,
    label: int,
    *,
    cell: float = 0.0,
) -> Mesh:
    """Return a box; the grain of its texture runs along the longer edge of each side.

    Args:
        low: Corner with the smallest coordinates.
        high: Corner with the largest ones.
        material: What it is made of.
        label: What it belongs to.
        cell: Light is computed at points so far apart; only in the corners if 0.
    """
    start = np.array(low, np.float64)
    size = np.array(high, np.float64) - start
    if cell and size.max() > cell:
        return join(
            rectangle(
                start + side[0] * size, side[1] * size, side[2] * size, material, label, cell=cell
            )
            for side in _CUBE
        )
    extents = size[_CUBE_AXES]
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * extents[:, None]
    turned = extents[:, 1] > extents[:, 0]
    corners[turned] = corners[turned][..., ::-1]
    corners += np.abs(start[0] * 3.1 + start[1] * 1.7 + start[2] * 2.3) % 5.0
    return mesh(
        start + _CUBE_CORNERS.reshape(-1, 3) * size,
        _CUBE_NORMALS,
        corners.reshape(-1, 2),
        _CUBE_FACES,
        material,
        label,
    )


def smooth_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the mean directions of the triangles around each vertex, (V, 3)."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Vertices in one place, as along a seam, share their normal.
    _, place = np.unique(np.round(vertices, 5), axis=0, return_inverse=True)
    place = place.ravel()
    normals = np.zeros((int(place.max()) + 1, 3))
    np.add.at(normals, place[faces].ravel(), np.repeat(across, 3, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return normals[place]


def lathe(
    profile: Sequence[tuple[float, float]],
    material: int,
    label: int,
    *,
    center: tuple[float, float] = (0.0, 0.0),
    segments: int = 12,
    fit: bool = False,
) -> Mesh:
    """Return what is turned from a profile about a vertical axis.

    Args:
        profile: Radius and height of its points from below to above; begin and end with radius 0
            for a solid.
        material: What it is made of.
        label: What it belongs to.
        center: Where the axis is.
        segments: Corners of a circle.
        fit: Whether the texture goes around once, from the lowest to the highest point.
    """
    radii, heights = np.array(profile, np.float64).T
    turns, faces = _lattice(segments, len(profile) - 1)
    angle = turns[:, 0] * 2 * np.pi
    ring = np.repeat(np.arange(len(profile)), segments + 1)
    vertices = np.stack(
        [
            center[0] + radii[ring] * np.cos(angle),
            center[1] + radii[ring] * np.sin(angle),
            heights[ring],
        ],
        axis=1,
    )
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces = faces[np.abs(area).max(1) > 1e-12]
    if fit:
        uvs = np.stack([turns[:, 0], (heights[ring] - heights[0]) / np.ptp(heights)], 1)
    else:
        uvs = np.stack([heights[ring], turns[:, 0] * 2 * np.pi * radii.max()], 1)
    return mesh(vertices, smooth_normals(vertices, faces), uvs, faces, material, label)


def cylinder(
    x: float,
    y: float,
    low: float,
    high: float,
    radius: float,
    material: int,
    label: int,
    *,
    segments: int = 12,
    top: float | None = None,
) -> Mesh:
    """Return an upright cylinder, or a cone's stump where the radius of its top is another."""
    above = radius if top is None else top
    ends = (
        [(0.0, low), (radius, low)],
        [(radius, low), (above, high)],
        [(above, high), (0.0, high)],
    )
    return join(lathe(part, material, label, center=(x, y), segments=segments) for part in ends)


def rod(
    start: Sequence[float],
    end: Sequence[float],
    radius: float,
    material: int,
    label: int,
    *,
    segments: int = 6,
) -> Mesh:
    """Return a round rod between two points."""
    first = np.array(start, np.float64)
    along = np.array(end, np.float64) - first
    length = float(np.linalg.norm(along))
    upright = cylinder(0.0, 0.0, 0.0, length, radius, material, label, segments=segments)
    z = along / length
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    turn = np.stack([x, np.cross(z, x), z]).astype(np.float32)
    return replace(
        upright,
        vertices=upright.vertices @ turn + first.astype(np.float32),
        normals=upright.normals @ turn,
    )


def cushion(
    center: Sequence[float],
    half: Sequence[float],
    material: int,
    label: int,
    *,
    roundness: float = 0.45,
    rings: int = 8,
    segments: int = 16,
    tilt: float = 0.0,
) -> Mesh:
    """Return a rounded box (superellipsoid): a ball at roundness 1, nearly a box at 0.2.

    Args:
        center: Its middle.
        half: Half of its sizes.
        material: What it is made of.
        label: What it belongs to.
        roundness: From above 0 to 1.
        rings: Circles from below to above.
        segments: Corners of a circle.
        tilt: Turn about the x axis, radians.
    """
    points, faces = _lattice(segments, rings)
    around, up = points[:, 0] * 2 * np.pi, (points[:, 1] - 0.5) * np.pi

    def power(values: NDArray[np.float64]) -> NDArray[np.float64]:
        values = np.where(np.abs(values) < 1e-9, 0.0, values)
        return np.sign(values) * np.abs(values) ** roundness

    unit = np.stack(
        [
            power(np.cos(up)) * power(np.cos(around)),
            power(np.cos(up)) * power(np.sin(around)),
            power(np.sin(up)),
        ],
        axis=1,
    )
    vertices = unit * np.array(half)
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces = faces[np.abs(area).max(1) > 1e-12]
    normals = smooth_normals(vertices, faces)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
    uvs = vertices[:, :2] + vertices[:, 2:] * 0.7
    return mesh(vertices @ turn + np.array(center), normals @ turn, uvs, faces, material, label)
