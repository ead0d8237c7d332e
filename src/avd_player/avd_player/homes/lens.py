"""The camera of the scans: COLMAP's fisheye model, for drawing pictures through it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gridnav.rgbd import Camera

if TYPE_CHECKING:
    from numpy.typing import NDArray

NEWTON_STEPS = 12


class Lens(NamedTuple):
    """A camera with the distortion of COLMAP's OPENCV_FISHEYE.

    A ray at the angle θ to the optical axis is drawn at the distance
    θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), in focal lengths.

    Attributes:
        camera: Without the distortion.
        distortion: k1 to k4.
    """

    camera: Camera
    distortion: tuple[float, float, float, float]

    def resized(self, width: int, height: int) -> Lens:
        """Return the lens of the same pictures at another size."""
        return Lens(self.camera.resized(width, height), self.distortion)

    def directions(self) -> NDArray[np.float32]:
        """Return where each pixel looks, with 1 along the optical axis, (H, W, 3).

        A surface that a ray meets at t of its length so has the depth t.
        """
        camera = self.camera
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        distorted = np.hypot(x, y)
        theta = distorted.copy()
        for _ in range(NEWTON_STEPS):
            square = theta * theta
            value, slope = np.ones_like(theta), np.ones_like(theta)
            power = square
            for order, k in enumerate(self.distortion, start=1):
                value = value + k * power
                slope = slope + (2 * order + 1) * k * power
                power = power * square
            theta -= (theta * value - distorted) / slope
        scale = np.where(distorted > 0, np.tan(theta) / np.maximum(distorted, 1e-12), 1.0)
        return np.stack([x * scale, y * scale, np.ones_like(x)], -1).astype(np.float32)

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the pixels of points of the optical frame with z > 0, (..., 2)."""
        camera = self.camera
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        radius = np.hypot(x, y)
        theta = np.arctan(radius)
        power, total = np.ones_like(theta), np.ones_like(theta)
        for k in self.distortion:
            power = power * theta * theta
            total = total + k * power
        scale = np.where(radius > 0, theta * total / np.maximum(radius, 1e-12), 1.0)
        return np.stack([camera.fx * x * scale + camera.cx, camera.fy * y * scale + camera.cy], -1)


AVD_LENS = Lens(
    Camera(1920, 1080, 1049.51, 1092.28, 927.269, 545.76),
    (0.382444, 0.105826, 0.000859549, -0.00143275),
)
"""The camera of AVD's Home_001_1."""
