"""Views of synthetic homes as many different cameras and robots would have made them.

A network that is trained on clean pictures of one renderer knows that renderer. What is changed
here, each time anew, is what differs between homes, cameras and robots.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from scipy import ndimage

from avd_player.homes.noise import DepthNoise, add_noise
from bev_mapper.segmentation.pixels import network_inputs
from bev_mapper.unprojection import depth_in_metres, unproject

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vgdp_experiments.home_views import View

T = TypeVar('T', np.uint8, np.uint16)

CROP = (96, 128)
"""Rows and columns of what is trained on: a part of a view, which stands for narrower lenses."""

WORLD_SCALE = (0.85, 1.2)
"""Everything may be this much smaller or larger: rooms and furniture are not alike everywhere."""

SIGMAS_MM = ((0.45, 0.0, 8.0), (0.3, 8.0, 35.0), (0.25, 35.0, 120.0))
"""How often depth is how noisy: a share, and the least and the largest standard deviation."""

QUADRATIC_MM = 4.0
"""Largest noise that grows with the depth's square, at one metre."""

WAVES_M = 0.03
"""Largest standard deviation of slowly varying errors of depth."""

STEPS_MM = (0.0, 0.0, 1.0, 10.0, 30.0)

OFFSET_M, TILT_DEG = 0.025, 0.8
"""Standard deviations of errors of the floor's height and slope."""

BAD_POSE, BAD_POSE_TIMES = 0.15, 3.0
"""A share of the poses is so many times worse."""


class Sample(NamedTuple):
    """What the network is trained on.

    Attributes:
        seen: float32 (9, H, W).
        labels: uint8 (H, W).
    """

    seen: NDArray[np.float32]
    labels: NDArray[np.uint8]


def spoil(view: View, rng: np.random.Generator) -> Sample:
    """Return a part of a view with all that may go wrong."""
    view = _part(view, rng)
    scale = rng.uniform(*WORLD_SCALE)
    depth = _spoiled_depth(view, rng, scale)
    mount = view.mount._replace(z=view.mount.z * scale).matrix()
    points = unproject(depth, view.camera, mount)
    worse = BAD_POSE_TIMES if rng.random() < BAD_POSE else 1.0
    slope = np.tan(np.radians(worse * TILT_DEG)) * rng.standard_normal(2)
    points[2] += worse * OFFSET_M * rng.standard_normal()
    points[2] += slope[0] * points[0] + slope[1] * points[1]
    color = spoiled_color(view.color, rng)
    return Sample(network_inputs(color, depth, points, view.camera, mount), view.labels)


def _part(view: View, rng: np.random.Generator) -> View:
    """Return a part of a view, maybe mirrored."""
    rows, cols = view.depth.shape
    height, width = min(CROP[0], rows), min(CROP[1], cols)
    top, left = int(rng.integers(rows - height + 1)), int(rng.integers(cols - width + 1))
    mirrored = _chance(rng, 0.5)
    camera, mount = view.camera, view.mount
    cx = camera.cx - left
    return view._replace(
        color=_cut(view.color, top, left, height, width, mirrored=mirrored),
        depth=_cut(view.depth, top, left, height, width, mirrored=mirrored),
        labels=_cut(view.labels, top, left, height, width, mirrored=mirrored),
        camera=camera._replace(
            width=width,
            height=height,
            cx=width - 1 - cx if mirrored else cx,
            cy=camera.cy - top,
        ),
        mount=mount._replace(roll=-mount.roll) if mirrored else mount,
    )


def _cut(
    image: NDArray[T], top: int, left: int, height: int, width: int, *, mirrored: bool
) -> NDArray[T]:
    part = image[top : top + height, left : left + width]
    return part[:, ::-1] if mirrored else part


def _spoiled_depth(view: View, rng: np.random.Generator, scale: float) -> NDArray[np.float32]:
    """Return depth in metres with noise and holes, (H, W)."""
    clean = depth_in_metres(view.depth)
    depth = clean * np.float32(scale)
    shape = depth.shape
    if _chance(rng, 0.5):
        quadratic = np.float32(0.001 * QUADRATIC_MM * rng.random())
        depth += quadratic * depth**2 * rng.standard_normal(shape, np.float32) * (depth > 0)
    if _chance(rng, 0.4):
        waves = _waves(rng, shape, int(rng.integers(3, 10)))
        depth += np.float32(WAVES_M * rng.random()) * waves * (depth > 0)
    often, least, largest = zip(*SIGMAS_MM, strict=True)
    which = int(rng.choice(len(often), p=often))
    noise = DepthNoise(
        sigma=rng.uniform(least[which], largest[which]),
        step=float(rng.choice(STEPS_MM)),
        edges=rng.uniform(0.0, 1.0) if _chance(rng, 0.6) else 0.0,
        dark=rng.uniform(0.0, 1.0) if _chance(rng, 0.5) else 0.0,
    )
    depth = add_noise(np.maximum(depth, 0.0), noise, rng, view.color)
    depth[_holes(view, rng, clean)] = 0.0
    return depth


def _holes(view: View, rng: np.random.Generator, clean: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Tell where nothing is measured, (H, W)."""
    holes = np.zeros(clean.shape, np.bool_)
    if _chance(rng, 0.5):  # beyond the camera's reach
        holes |= clean > rng.uniform(2.5, 8.0)
    if _chance(rng, 0.4):  # too near
        holes |= clean < rng.uniform(0.3, 0.9)
    if _chance(rng, 0.4):  # glass, and things like it
        for kind in rng.integers(13, size=2):
            holes |= (view.labels == kind) & (_chance(rng, 0.5))
    if _chance(rng, 0.35):  # patches of any form
        holes |= _waves(rng, clean.shape, int(rng.integers(2, 8))) > rng.uniform(0.8, 2.0)
    for _ in range(int(rng.integers(3)) if _chance(rng, 0.3) else 0):
        rows, cols = (np.sort(rng.integers(size + 1, size=2)) for size in clean.shape)
        holes[slice(*rows.tolist()), slice(*cols.tolist())] = True
    return holes


def _chance(rng: np.random.Generator, share: float) -> bool:
    return bool(rng.random() < share)


def _waves(rng: np.random.Generator, shape: tuple[int, ...], cells: int) -> NDArray[np.float32]:
    """Return smooth noise of standard deviation about 1, (H, W)."""
    coarse = rng.standard_normal((cells, cells), np.float32)
    factors = [(size - 1) / (cells - 1) for size in shape]
    places = [np.arange(size) / factor for size, factor in zip(shape, factors, strict=True)]
    waves: NDArray[np.float32] = ndimage.map_coordinates(
        coarse, np.meshgrid(*places, indexing='ij'), order=1, mode='nearest'
    )
    return waves * np.float32(1.4)


def spoiled_color(color: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) in other light and by another camera."""
    if _chance(rng, 0.08):  # colour is of no use at all
        return np.full_like(color, rng.integers(256))
    image = color.astype(np.float32) * np.float32(1 / 255)
    image **= np.float32(np.exp(rng.normal(0.0, 0.3)))
    if _chance(rng, 0.25):  # other colours for everything
        image = image[..., rng.permutation(3)]
    grey = image.mean(axis=2, keepdims=True)
    saturation = 0.0 if _chance(rng, 0.1) else rng.uniform(0.3, 1.6)
    image = grey + (image - grey) * np.float32(saturation)
    image *= np.exp(rng.normal(0.0, 0.12, 3)).astype(np.float32)
    mean = image.mean(dtype=np.float32)
    image = mean + (image - mean) * np.float32(rng.uniform(0.5, 1.4))
    image *= np.float32(np.exp(rng.normal(0.0, 0.25)))
    if _chance(rng, 0.4):  # light and shadow
        image *= np.exp(0.25 * _waves(rng, image.shape[:2], int(rng.integers(2, 6))))[..., None]
    if _chance(rng, 0.3):  # out of focus
        image = ndimage.uniform_filter(image, (3, 3, 1))
    if _chance(rng, 0.5):
        image += np.float32(rng.uniform(0.0, 0.06)) * rng.standard_normal(image.shape, np.float32)
    return (np.clip(image, 0.0, 1.0) * np.float32(255)).astype(np.uint8)
