"""Points of the world from depth images."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from gridnav.rgbd import MILLIMETRE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gridnav.rgbd import Camera, RgbdFrame

NOISE_ROWS = 4
"""Every fourth row is enough to tell the noise by."""

NORMAL_MEDIAN = 1.4826
"""A normal distribution's standard deviation over the median of its absolute values."""

SMOOTHED_FROM_M = (0.005, 0.01, 0.02)
"""Noise from which on depth is smoothed over gaps of one, two and three pixels, too."""

INVALID_MM = 65535
"""Some cameras write this where they measured nothing, others 0."""


def thin(frame: RgbdFrame, max_pixels: int) -> RgbdFrame:
    """Return every k-th pixel of every k-th row of a frame, with k as small as may be.

    Nothing is averaged: the points that are left are points of the whole frame.

    Args:
        frame: The frame.
        max_pixels: How many pixels may be left at most.
    """
    height, width = frame.depth.shape
    if height * width <= max_pixels:
        return frame
    step = math.ceil(math.sqrt(height * width / max_pixels))
    while _left(height, step) * _left(width, step) > max_pixels:
        step += 1
    first = step // 2
    camera = frame.camera
    depth = frame.depth[first::step, first::step]
    return replace(
        frame,
        color=frame.color[first::step, first::step],
        depth=depth,
        labels=None if frame.labels is None else frame.labels[first::step, first::step],
        camera=camera._replace(
            width=depth.shape[1],
            height=depth.shape[0],
            fx=camera.fx / step,
            fy=camera.fy / step,
            cx=(camera.cx - first) / step,
            cy=(camera.cy - first) / step,
        ),
    )


def _left(side: int, step: int) -> int:
    return len(range(step // 2, side, step))


def depth_in_metres(
    depth: NDArray[np.uint16] | NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return depth in metres (H, W), 0 where nothing was measured: 65535 mm, NaN or infinite."""
    if depth.dtype == np.uint16:
        metres = depth * MILLIMETRE
        metres[depth == INVALID_MM] = 0.0
        return metres
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0.0)).astype(np.float32)


def depth_noise(depth: NDArray[np.float32]) -> float:
    """Return the standard deviation of a depth image's noise in metres, about.

    Along a row the depth of a flat surface has next to no second difference, so what there is in
    the middle of all pixels is noise; edges are few.

    Args:
        depth: In metres, 0 where nothing was measured, (H, W).
    """
    rows = depth[::NOISE_ROWS]
    left, middle, right = rows[:, :-2], rows[:, 1:-1], rows[:, 2:]
    whole = (left > 0) & (middle > 0) & (right > 0)
    bends = np.abs(left - 2 * middle + right)[whole]
    if not len(bends):
        return 0.0
    return float(NORMAL_MEDIAN * np.median(bends) / math.sqrt(6))


def smooth(depth: NDArray[np.float32], noise: float) -> NDArray[np.float32]:
    """Return a depth image with less noise.

    Each pixel becomes the median of itself and of two others beside it, then of two above and
    below, with gaps that grow: edges stay sharp, and 50 mm of noise become less than 10 mm.

    Args:
        depth: In metres, 0 where nothing was measured, (H, W).
        noise: Its standard deviation in metres.
    """
    for gap, least in enumerate(SMOOTHED_FROM_M, start=1):
        if noise > least:
            depth = _medians(_medians(depth, gap).T, gap).T
    return depth


def _medians(depth: NDArray[np.float32], gap: int) -> NDArray[np.float32]:
    """Return the medians of each pixel and of those so far to its sides, (H, W)."""
    framed = np.pad(depth, ((0, 0), (gap, gap)))
    left, right = framed[:, : -2 * gap], framed[:, 2 * gap :]
    # Beside what was not measured a pixel stays as it is.
    left, right = (np.where(side > 0, side, depth) for side in (left, right))
    found = np.maximum(np.minimum(left, depth), np.minimum(np.maximum(left, depth), right))
    return np.where(depth > 0, found, depth)


def unproject(
    depth: NDArray[np.float32], camera: Camera, camera_to_map: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return where the pixels' points are.

    A pixel (u, v) of depth d is at d·((u − cx)/fx, (v − cy)/fy, 1) in the optical frame. As the
    first two depend on the column alone and on the row alone, turning them into the frame of the
    map takes one sum and two products for each coordinate.

    Args:
        depth: Along the optical axis in metres, (H, W).
        camera: Of the depth image.
        camera_to_map: What takes points of the optical frame into that of the map, (4, 4).

    Returns:
        In metres, (3, H, W); the camera itself where the depth is 0.
    """
    across, down = _rays(camera)
    points = np.empty((3, *depth.shape))
    for axis, (x, y, z, origin) in enumerate(camera_to_map[:3].tolist()):
        np.multiply((x * across + z) + (y * down)[:, None], depth, out=points[axis])
        points[axis] += origin
    return points


@lru_cache(maxsize=8)
def _rays(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the slopes of the columns (W,) and of the rows (H,)."""
    across = (np.arange(camera.width, dtype=np.float64) - camera.cx) / camera.fx
    down = (np.arange(camera.height, dtype=np.float64) - camera.cy) / camera.fy
    return across, down
