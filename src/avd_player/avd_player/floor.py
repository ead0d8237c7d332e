"""Which way is up, and where the floor is: from poses of cameras and points that they saw."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from numpy.typing import NDArray

HYPOTHESES = 600
THICKNESS_M = 0.03
"""Points this near to a plane are on it."""

ROUNDS = 5
"""So often a plane is fitted to the points on it."""

PATCH_SHARE = 0.05
"""The corners of a plane are taken from this share of the points, the nearest to one of them."""

LEVEL_HYPOTHESES = 150
"""Planes that are just level, for rooms of which little is floor."""

REFINED = 30
"""So many of the best planes are fitted before one is chosen."""

BELOW_WEIGHT = 3.0
"""Below the floor there is nothing: a point there speaks this much against a plane."""

MIN_SHARE = 0.01
"""A floor has at least this share of the points,"""

MIN_POINTS = 50
"""and no less than this many."""

MAX_POINTS = 5_000

HEADINGS_SPREAD = 0.02
"""Second eigenvalue from which the cameras' right axes span a level plane."""


class Floor(NamedTuple):
    """A plane: ``up @ point + offset`` is the height of a point above it."""

    up: NDArray[np.float64]
    offset: float

    def heights(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how high points (N, 3) are above it, (N,)."""
        return points @ self.up + self.offset

    def to_level(self) -> NDArray[np.float64]:
        """Return what takes points into a frame with z up and z = 0 on the floor, (4, 4).

        Its x axis is that of the points' frame, seen from above; where that one is upright, the
        z axis takes its place.
        """
        axis = np.eye(3)[0 if abs(self.up[0]) < 0.9 else 2]  # noqa: PLR2004
        x = axis - self.up * (axis @ self.up)
        x /= np.linalg.norm(x)
        level = np.eye(4)
        level[:3, :3] = x, np.cross(self.up, x), self.up
        level[2, 3] = self.offset
        return level


def down_of(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return which way is down in the world, (3,), from its rotations into cameras, (N, 3, 3).

    Cameras are held level, so gravity is at right angles to all their right axes; where they all
    look the same way, it is the mean of their down axes.
    """
    mean_down: NDArray[np.float64] = rotations[:, 1].mean(axis=0)
    right = rotations[:, 0]
    values, vectors = np.linalg.eigh(right.T @ right / len(right))
    down = mean_down
    if values[1] > HEADINGS_SPREAD:
        down = vectors[:, 0] * np.copysign(1.0, vectors[:, 0] @ mean_down)
    unit: NDArray[np.float64] = down / np.linalg.norm(down)
    return unit


def fit_floor(
    points: NDArray[np.float64], down: NDArray[np.float64], tolerance: float = 0.26
) -> Floor | None:
    """Fit the floor: the level plane that many points are on and few are below.

    Args:
        points: In metres, (N, 3).
        down: Roughly the direction of gravity, (3,).
        tolerance: How far the plane may be from level, in radians.

    Returns:
        The floor; None if there is no such plane.
    """
    rng = np.random.default_rng(0)
    if len(points) < MIN_POINTS:
        return None
    some = points
    if len(points) > MAX_POINTS:
        some = points[rng.choice(len(points), MAX_POINTS, replace=False)]
    # Corners near to each other, as they are likelier on one surface than any three points.
    seeds = rng.integers(len(some), size=HYPOTHESES)
    patch = max(3, round(PATCH_SHARE * len(some)))
    near = cKDTree(some).query(some[seeds], patch)[1]
    picked = near[np.arange(HYPOTHESES)[:, None], rng.integers(patch, size=(HYPOTHESES, 2))]
    origins = some[seeds]
    ups = np.cross(some[picked[:, 0]] - origins, some[picked[:, 1]] - origins)
    lengths = np.linalg.norm(ups, axis=1)
    is_plane = lengths > 0
    ups, origins = ups[is_plane] / lengths[is_plane, None], origins[is_plane]
    ups *= np.where(ups @ down > 0, -1.0, 1.0)[:, None]
    level = -(ups @ down) > np.cos(tolerance)
    ups, origins = ups[level], origins[level]
    planes = [
        Floor(up, offset)
        for up, offset in zip(ups, -np.einsum('ij,ij->i', ups, origins), strict=True)
    ]
    planes += [Floor(-down, float(point @ down)) for point in some[seeds[:LEVEL_HYPOTHESES]]]
    best = np.argsort([-_score(plane, some) for plane in planes], kind='stable')[:REFINED]
    refined = [_refined(planes[index], some, down, tolerance) for index in best]
    floor = max(refined, key=lambda plane: _score(plane, some))
    on = np.count_nonzero(np.abs(floor.heights(some)) < THICKNESS_M)
    if on < max(MIN_POINTS, MIN_SHARE * len(some)):
        return None
    return _refined(floor, points, down, tolerance)


def _score(floor: Floor, points: NDArray[np.float64]) -> float:
    """Return how much of the points (N, 3) speaks for a floor."""
    heights = floor.heights(points)
    on = np.count_nonzero(np.abs(heights) < THICKNESS_M)
    return on - BELOW_WEIGHT * np.count_nonzero(heights < -2 * THICKNESS_M)


def _refined(
    floor: Floor, points: NDArray[np.float64], down: NDArray[np.float64], tolerance: float
) -> Floor:
    """Return the plane of the points (N, 3) on a floor, as long as it stays level."""
    for _ in range(ROUNDS):
        near = points[np.abs(floor.heights(points)) < THICKNESS_M]
        if len(near) < MIN_POINTS:
            break
        center = near.mean(axis=0)
        normal = np.linalg.eigh(np.cov((near - center).T))[1][:, 0]
        normal *= -np.copysign(1.0, normal @ down)
        if -(normal @ down) < np.cos(tolerance):
            break
        floor = Floor(normal, -float(normal @ center))
    return floor


def levelled(floor: Floor, points: NDArray[np.float64], down: NDArray[np.float64]) -> Floor:
    """Return a floor at right angles to gravity (3,), through the middle of its points (N, 3).

    Poses that look all around know gravity better than points, which are few and lie in patches.
    """
    near = points[np.abs(floor.heights(points)) < THICKNESS_M]
    return Floor(-down, float(np.median(near @ down)))


def lowest_floor(points: NDArray[np.float64], down: NDArray[np.float64]) -> Floor:
    """Return the level plane below all but the lowest hundredth of the points (N, 3)."""
    lowest = np.percentile(points @ -down, 1)
    return Floor(-down, -float(lowest))


class GridAlignment(NamedTuple):
    """How positions lie on a grid: turn by ``yaw`` (radians), then move by ``offset`` (m)."""

    yaw: float
    offset: NDArray[np.float64]


def align_to_grid(positions: NDArray[np.float64], step: float) -> GridAlignment:
    """Find how positions (P, 2) have to be turned and moved so as to be multiples of a step.

    They are turned by 45 degrees and moved by half a step at most. Where they are on no grid,
    nothing is turned, or nothing moved.
    """
    apart = positions[:, None] - positions[None]
    lengths = np.linalg.norm(apart, axis=-1)
    near = apart[(lengths > 0.7 * step) & (lengths < 1.2 * step)]
    yaw = -_mean_phase(4 * np.arctan2(near[:, 1], near[:, 0])) / 4
    cosine, sine = np.cos(yaw), np.sin(yaw)
    turned = positions @ np.array([[cosine, sine], [-sine, cosine]])
    phases = 2 * np.pi * turned / step
    offset = -np.array([_mean_phase(phase) for phase in phases.T]) * step / (2 * np.pi)
    return GridAlignment(float(yaw), offset)


def _mean_phase(phases: NDArray[np.float64]) -> float:
    """Return the mean of angles, or 0 where they have none in common."""
    if not len(phases):
        return 0.0
    mean = np.exp(1j * phases).mean()
    return float(np.angle(mean)) if abs(mean) > 0.5 else 0.0  # noqa: PLR2004
