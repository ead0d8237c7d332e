"""Fisheye lenses: where a ray ends in the picture, and pictures without distortion."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from PIL import Image

from gridnav.rgbd import Camera

if TYPE_CHECKING:
    from numpy.typing import NDArray

T = TypeVar('T', bound=np.generic)

MESH_PX = 16
"""A colour image is straightened in pieces of this side; within one the lens is bilinear, which
for the lenses of the dataset is wrong by less than a tenth of a pixel."""

NEWTON_STEPS = 8


class Lens(NamedTuple):
    """A camera as COLMAP's ``OPENCV_FISHEYE`` has it.

    Lengths are pixels, measured from the upper left corner of the image: the middle of the first
    pixel is at (0.5, 0.5).
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    def camera(self) -> Camera:
        """Return the pinhole camera of the straightened images of full size."""
        return Camera(self.width, self.height, self.fx, self.fy, self.cx - 0.5, self.cy - 0.5)

    def resized(self, width: int, height: int) -> Lens:
        """Return the lens of the same pictures at another size."""
        across, down = width / self.width, height / self.height
        scaled = self.fx * across, self.fy * down, self.cx * across, self.cy * down
        return Lens(width, height, *scaled, *self[6:])

    def project(self, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where rays (x, y, 1), given as (..., 2), end in the picture, (..., 2).

        θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), θ the angle to the optical axis.
        """
        radius = np.hypot(rays[..., 0], rays[..., 1])
        theta = np.arctan(radius)
        bent = self._bend(theta)
        stretch = np.divide(bent, radius, out=np.ones_like(radius), where=radius > 0)
        return rays * stretch[..., None] * (self.fx, self.fy) + (self.cx, self.cy)

    def unproject(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rays (x, y, 1) of points of the picture, both (..., 2)."""
        bent_rays = (points - (self.cx, self.cy)) / (self.fx, self.fy)
        bent = np.hypot(bent_rays[..., 0], bent_rays[..., 1])
        theta = np.minimum(bent, np.pi / 2)
        for _ in range(NEWTON_STEPS):
            square = theta * theta
            slope = 1 + square * (
                3 * self.k1
                + square * (5 * self.k2 + square * (7 * self.k3 + square * 9 * self.k4))
            )
            theta = np.clip(theta - (self._bend(theta) - bent) / slope, 0.0, 1.5)
        stretch = np.divide(np.tan(theta), bent, out=np.ones_like(bent), where=bent > 0)
        return bent_rays * stretch[..., None]

    def directions(self) -> NDArray[np.float32]:
        """Return where the middle of each pixel looks, with 1 along the optical axis, (H, W, 3).

        A surface that a ray meets at t of its length so has the depth t.
        """
        middles = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        rays = self.unproject(np.stack(middles, -1))
        return np.concatenate([rays, np.ones_like(rays[..., :1])], -1).astype(np.float32)

    def _bend(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        square = theta * theta
        bent: NDArray[np.float64] = theta * (
            1 + square * (self.k1 + square * (self.k2 + square * (self.k3 + square * self.k4)))
        )
        return bent


class Straightener:
    """Turns pictures taken through a lens into those of a pinhole camera, of any size.

    What the lens did not see is black, and has no depth and no label.
    """

    def __init__(self, lens: Lens, camera: Camera) -> None:
        self._lens = lens
        self._camera = camera

    def color(self, image: Image.Image) -> NDArray[np.uint8]:
        """Straighten a colour image of any size, bilinearly, to uint8 (H, W, 3)."""
        across, down = image.width / self._lens.width, image.height / self._lens.height
        scale = np.tile((across, down), 4)
        mesh = [(box, tuple((corners * scale).tolist())) for box, corners in self._mesh]
        size = self._camera.width, self._camera.height
        straight = image.transform(
            size, Image.Transform.MESH, mesh, resample=Image.Resampling.BILINEAR
        )
        return np.asarray(straight)

    def values(self, picture: NDArray[T], outside: int = 0) -> NDArray[T]:
        """Straighten depth or labels (h, w) of the lens's size by the nearest pixel to (H, W)."""
        index, is_outside = self._nearest
        straight: NDArray[T] = picture.reshape(-1)[index]
        straight[is_outside] = outside
        return straight.reshape(self._camera.height, self._camera.width)

    def _source(self, u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where the lens has the pixels of the camera, (len(v), len(u), 2)."""
        camera = self._camera
        rays = np.stack(
            np.meshgrid((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy), axis=-1
        )
        return self._lens.project(rays)

    @cached_property
    def _mesh(self) -> list[tuple[tuple[int, int, int, int], NDArray[np.float64]]]:
        """Boxes of the camera's picture and the corners (8,) they come from, nw sw se ne."""
        camera = self._camera
        columns = np.append(np.arange(0, camera.width, MESH_PX), camera.width)
        rows = np.append(np.arange(0, camera.height, MESH_PX), camera.height)
        corners = self._source(columns - 0.5, rows - 0.5)
        return [
            (
                (int(columns[j]), int(rows[i]), int(columns[j + 1]), int(rows[i + 1])),
                corners[[i, i + 1, i + 1, i], [j, j, j + 1, j + 1]].reshape(-1),
            )
            for i in range(len(rows) - 1)
            for j in range(len(columns) - 1)
        ]

    @cached_property
    def _nearest(self) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
        """The flat index of each pixel's source, and which pixels have none, (H · W,)."""
        camera, lens = self._camera, self._lens
        u = np.arange(camera.width, dtype=np.float64)
        v = np.arange(camera.height, dtype=np.float64)
        pixels = np.floor(self._source(u, v)).astype(np.int32)
        column, row = pixels[..., 0], pixels[..., 1]
        outside = (column < 0) | (column >= lens.width) | (row < 0) | (row >= lens.height)
        index = np.where(outside, 0, row * lens.width + column)
        return index.reshape(-1), outside.reshape(-1)
