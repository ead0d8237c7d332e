"""Which way is up, and where the floor is: from poses of cameras and points that they saw."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

HYPOTHESES = 300
THICKNESS_M = 0.03
"""Points this near to a plane are on it."""

ROUNDS = 3
"""So often the plane is fitted to the points on it."""

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
    corners = some[rng.integers(len(some), size=(HYPOTHESES, 3))]
    ups = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(ups, axis=1)
    ups = ups[lengths > 0] / lengths[lengths > 0, None]
    ups *= np.where(ups @ down > 0, -1.0, 1.0)[:, None]
    offsets = -np.einsum('ij,ij->i', ups, corners[lengths > 0, 0])
    level = -(ups @ down) > np.cos(tolerance)
    # Level planes through single points, for rooms of which little is floor.
    heights = some[rng.integers(len(some), size=HYPOTHESES // 2)] @ down
    ups = np.vstack([ups[level], np.tile(-down, (len(heights), 1))])
    offsets = np.concatenate([offsets[level], heights])

    distances = some @ ups.T + offsets
    on = (np.abs(distances) < THICKNESS_M).sum(axis=0)
    below = (distances < -2 * THICKNESS_M).sum(axis=0)
    best = int(np.argmax(on - BELOW_WEIGHT * below))
    if on[best] < max(MIN_POINTS, MIN_SHARE * len(some)):
        return None
    up, offset = ups[best], float(offsets[best])
    for _ in range(ROUNDS):
        near = points[np.abs(points @ up + offset) < THICKNESS_M]
        center = near.mean(axis=0)
        normal = np.linalg.svd(near - center, full_matrices=False)[2][2]
        normal *= -np.copysign(1.0, normal @ down)
        if -(normal @ down) < np.cos(tolerance):
            break
        up, offset = normal, -float(normal @ center)
    return Floor(up, offset)


def levelled(floor: Floor, points: NDArray[np.float64], down: NDArray[np.float64]) -> Floor:
    """Return a floor at right angles to gravity (3,), through the middle of its points (N, 3).

    Poses that look all around know gravity better than points, which are few and lie in patches.
    """
    near = points[np.abs(points @ floor.up + floor.offset) < THICKNESS_M]
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
