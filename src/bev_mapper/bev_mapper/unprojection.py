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
