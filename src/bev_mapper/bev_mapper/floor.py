"""Where the floor is: near z = 0, but neither exactly nor level.

A camera that sits half a degree or a centimetre otherwise than is said, or a pose that is a little
off, tilts the floor. What is said is the prior; what is seen corrects it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

FloatOrArray = TypeVar('FloatOrArray', float, 'NDArray[np.float64]')

PRIOR_OFFSET_M = 0.05
PRIOR_SLOPE = 0.03
"""Standard deviations of the floor's height under the camera and of its slope, when unseen."""

GATE_M = 0.1
GATE_SLOPE = 0.05
"""A point may be of the floor if it is no further from z = 0 than the first, and the second for
each metre of distance: five centimetres and three degrees off, at least."""

NOISE_M = 0.03
NOISE_SLOPE = 0.01
SIGMAS = 2.5
"""Once the floor was seen, its points are no further from where it is thought to be than the
first, the second for each metre, and so many standard deviations of what is thought."""

ROUNDS = 4

POINT_SIGMA_M = 0.02
MAX_POINTS = 20.0
"""However many points a frame has, they count as no more than this: their errors go together."""

MANY = 0.05
FEW = 0.005
"""Shares of a picture. With less floor than the first it counts for less, with less than the
second for nothing, as it may be something low."""

MEMORY = 0.8
"""What earlier frames count when the next one comes."""

SAMPLES = 1500

EVERY = 2
"""Every second pixel of every second row will do."""

BASELINE = 2
"""Normals are taken from the pixels so far to each side, of those."""

UPRIGHT = 0.9
"""Cosine of the angle up to which a surface may be floor."""


class Plane(NamedTuple):
    """A floor z = offset + slope_x·x + slope_y·y in the frame of the map."""

    offset: float = 0.0
    slope_x: float = 0.0
    slope_y: float = 0.0

    def height_at(self, x: FloatOrArray, y: FloatOrArray) -> FloatOrArray:
        """Return the floor's z in metres at places in metres."""
        return self.offset + self.slope_x * x + self.slope_y * y


class FloorTracker:
    """Fits the floor in each frame, with what earlier frames said about it.

    The errors that matter go with the camera: as it turns, so does the tilt that a wrong mounting
    angle makes. So what is remembered is the plane in the level frame of the camera.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all frames."""
        self._information = np.zeros((3, 3))
        self._vector = np.zeros(3)

    def fit(
        self,
        points: NDArray[np.float64],
        valid: NDArray[np.bool_],
        camera_to_map: NDArray[np.float64],
    ) -> Plane:
        """Return the floor of a frame.

        Args:
            points: Of the pixels in the frame of the map, (3, H, W).
            valid: Which pixels have one, (H, W).
            camera_to_map: Pose of the optical frame, (4, 4).
        """
        self._information *= MEMORY
        self._vector *= MEMORY
        axes, place = _level_axes(camera_to_map), camera_to_map[:2, 3]
        some = slice(EVERY // 2, None, EVERY)
        sample, share = _candidates(points[:, some, some], valid[some, some], place)
        if share > FEW:
            self._take_in((sample[:2].T - place) @ axes.T, sample[2], share)
        state, _ = self._solve()
        slope = axes.T @ state[1:]
        return Plane(float(state[0] - slope @ place), *slope.tolist())

    def _take_in(
        self, places: NDArray[np.float64], heights: NDArray[np.float64], share: float
    ) -> None:
        """Add what a frame's level points say.

        Args:
            places: Ahead and to the left of the camera, metres, (N, 2).
            heights: z in metres, (N,).
            share: Of the picture that they stand for.
        """
        rows = np.column_stack([np.ones(len(places)), places])
        distance = np.hypot(*places.T)
        state, covariance = self._solve()
        doubt = np.sqrt(((rows @ covariance) * rows).sum(axis=1))
        gates = np.minimum(
            NOISE_M + NOISE_SLOPE * distance + SIGMAS * doubt, GATE_M + GATE_SLOPE * distance
        )
        information, vector = self._information, self._vector
        for shrink in np.linspace(1.0, 1.0 / ROUNDS, ROUNDS):
            limits = np.maximum(shrink * gates, NOISE_M + NOISE_SLOPE * distance)
            near = np.abs(heights - rows @ state) < limits
            part = share * near.mean()
            if part < FEW:
                self._information, self._vector = information, vector
                return
            weight = MAX_POINTS * min(part / MANY, 1.0) / near.sum() / POINT_SIGMA_M**2
            self._information = information + weight * rows[near].T @ rows[near]
            self._vector = vector + weight * rows[near].T @ heights[near]
            state, _ = self._solve()

    def _solve(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return offset under the camera, slopes ahead and to the left (3,), and covariance."""
        prior = np.diag([PRIOR_OFFSET_M**-2, PRIOR_SLOPE**-2, PRIOR_SLOPE**-2])
        covariance = np.asarray(np.linalg.inv(prior + self._information), dtype=np.float64)
        return covariance @ self._vector, covariance


def _level_axes(camera_to_map: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the directions ahead and to the left of a camera, level, (2, 2)."""
    # The image's upper edge is ahead of one that looks straight down.
    ahead = camera_to_map[:2, 2] - camera_to_map[:2, 1] * abs(camera_to_map[2, 2])
    ahead = ahead / max(float(np.hypot(*ahead)), np.finfo(float).tiny)
    return np.array([ahead, [-ahead[1], ahead[0]]])


def _candidates(
    points: NDArray[np.float64], valid: NDArray[np.bool_], place: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return some level points near z = 0, (3, N), and the share of the picture that is so."""
    near = valid.copy()
    # Their neighbours must be in the picture.
    near[:BASELINE] = near[-BASELINE:] = False
    near[:, :BASELINE] = near[:, -BASELINE:] = False
    x, y, z = points
    distance = np.sqrt((x - place[0]) ** 2 + (y - place[1]) ** 2)
    near &= np.abs(z) < GATE_M + GATE_SLOPE * distance
    pixels = np.flatnonzero(near)
    step = max(1, len(pixels) // SAMPLES)
    pixels = pixels[::step]
    width = valid.shape[1]
    sides = (pixels - BASELINE, pixels + BASELINE)
    ends = (pixels - BASELINE * width, pixels + BASELINE * width)
    flat, has_point = points.reshape(3, -1), valid.reshape(-1)
    whole = np.logical_and.reduce([has_point[near] for near in (*sides, *ends)])
    normals = np.cross(
        flat[:, sides[1]] - flat[:, sides[0]], flat[:, ends[1]] - flat[:, ends[0]], axis=0
    )
    length = np.sqrt((normals**2).sum(axis=0))
    level = whole & (np.abs(normals[2]) > UPRIGHT * length)
    return flat[:, pixels[level]], float(level.sum() * step / valid.size)
