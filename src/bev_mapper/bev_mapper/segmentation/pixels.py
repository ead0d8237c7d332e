"""What the network sees of a frame, and how its answer gets back to all of the frame's pixels."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gridnav.rgbd import Camera

INPUTS = (
    'red',
    'green',
    'blue',
    'distance',
    'height',
    'low height',
    'upright',
    'measured',
    'slope',
)
"""Channels of what the network sees, all of the order of 1."""

MIDDLE_M = 1.2
"""Heights are counted from here."""

LOW_M = 0.3
"""Below this a second channel shows heights larger, as what is floor is decided there."""

NEAREST_M, FARTHEST_M = 0.1, 20.0

BASELINE = 2
"""Normals are taken from the pixels so far to each side."""


def chosen(size: int, count: int) -> NDArray[np.int64]:
    """Return which `count` of `size` pixels in a row the network sees, evenly spread."""
    return ((np.arange(count) + 0.5) * (size / count)).astype(np.int64)


def network_size(height: int, width: int, pixels: int) -> tuple[int, int]:
    """Return even numbers of rows and columns, of about so many pixels, no more than there are."""
    scale = min(1.0, math.sqrt(pixels / (height * width)))
    rows, cols = (2 * max(int(size * scale / 2), 1) for size in (height, width))
    return rows, cols


def resized(camera: Camera, rows: NDArray[np.int64], cols: NDArray[np.int64]) -> Camera:
    """Return the camera of evenly spread pixels of a picture."""
    down = (rows[-1] - rows[0]) / max(len(rows) - 1, 1) or 1.0
    across = (cols[-1] - cols[0]) / max(len(cols) - 1, 1) or 1.0
    return camera._replace(
        width=len(cols),
        height=len(rows),
        fx=camera.fx / across,
        fy=camera.fy / down,
        cx=(camera.cx - cols[0]) / across,
        cy=(camera.cy - rows[0]) / down,
    )


def network_inputs(
    color: NDArray[np.uint8],
    depth: NDArray[np.float32],
    points: NDArray[np.float64],
    camera: Camera,
    camera_to_map: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return what the network sees.

    Args:
        color: RGB, (H, W, 3).
        depth: Metres, 0 where nothing was measured, (H, W).
        points: In the frame of the map, with heights above the floor, metres, (3, H, W).
        camera: Of these pixels.
        camera_to_map: Pose of the optical frame, (4, 4).

    Returns:
        The channels that `INPUTS` names, (9, H, W).
    """
    seen = np.empty((len(INPUTS), *depth.shape), dtype=np.float32)
    measured = depth > 0
    seen[:3] = np.moveaxis(color, -1, 0)
    seen[:3] *= np.float32(2 / 255)
    seen[:3] -= 1
    seen[3] = np.log(np.clip(depth, NEAREST_M, FARTHEST_M))
    height = points[2].astype(np.float32)
    seen[4] = np.clip(height - np.float32(MIDDLE_M), -2, 3)
    seen[5] = np.clip(height / np.float32(LOW_M), -1, 1)
    seen[6] = _upright(points.astype(np.float32), measured)
    seen[3:7] *= measured
    seen[7] = measured
    across = (np.arange(camera.width) - camera.cx) / camera.fx
    down = ((np.arange(camera.height) - camera.cy) / camera.fy)[:, None]
    right, below, ahead = camera_to_map[2, :3].tolist()
    seen[8] = (right * across + below * down + ahead) / np.sqrt(across**2 + down**2 + 1)
    return seen


def _upright(points: NDArray[np.float32], measured: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the normals' vertical parts, 1 for a floor and -1 for a ceiling, (H, W)."""
    rows, cols = measured.shape
    low, high = _sides(rows), _sides(cols)
    up, below = (np.take(points, side, axis=1) for side in low)
    left, right = (np.take(points, side, axis=2) for side in high)
    (ax, ay, az), (bx, by, bz) = right - left, below - up
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = np.sqrt(x * x + y * y + z * z)
    whole = length > 0
    for side in low:
        whole &= measured[side]
    for side in high:
        whole &= measured[:, side]
    # Right times down is ahead, away from the camera.
    upright: NDArray[np.float32] = np.where(whole, -z / np.maximum(length, 1e-12), 0)
    return upright.astype(np.float32)


def _sides(size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    middle = np.arange(size)
    return np.maximum(middle - BASELINE, 0), np.minimum(middle + BASELINE, size - 1)


def spread(
    labels: NDArray[np.uint8],
    few: NDArray[np.float32],
    depth: NDArray[np.float32],
) -> NDArray[np.uint8]:
    """Return the classes of all pixels of a picture, given those of some.

    Each takes that of the one of the four pixels around it whose depth is most like its own, so
    that edges stay where they are.

    Args:
        labels: Of the pixels that the network saw, (h, w).
        few: Depth of these in metres, (h, w).
        depth: Of all pixels, (H, W).
    """
    if labels.shape == depth.shape:
        return labels
    rows, cols = (_around(size, count) for size, count in zip(depth.shape, few.shape, strict=True))
    best = labels[rows[0]][:, cols[0]]
    least = np.abs(few[rows[0]][:, cols[0]] - depth)
    for row, col in ((rows[0], cols[1]), (rows[1], cols[0]), (rows[1], cols[1])):
        off = np.abs(few[row][:, col] - depth)
        closer = off < least
        np.copyto(least, off, where=closer)
        np.copyto(best, labels[row][:, col], where=closer)
    return best


def _around(size: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return for each of `size` pixels the nearest of those `chosen`, and the next nearest."""
    place = (np.arange(size) + 0.5) * (count / size) - 0.5
    nearest = np.clip(np.rint(place), 0, count - 1).astype(np.int64)
    other = np.where(place < nearest, nearest - 1, nearest + 1)
    return nearest, np.clip(other, 0, count - 1)
