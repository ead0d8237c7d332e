"""Errors of depth cameras: noise, coarse steps, and pixels without a measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

EDGE = 0.05
"""Neighbours whose depths differ by this share of them have an edge between them."""

DARK = 40.0
"""Grey, from 0 to 255, from which on downwards surfaces throw too little light back."""

_GREY = np.array([0.299, 0.587, 0.114], np.float32)

D = TypeVar('D', np.uint16, np.float32)


@dataclass(frozen=True)
class DepthNoise:
    """Errors of a depth camera.

    Attributes:
        sigma: Standard deviation of Gaussian noise in millimetres.
        step: Depths are multiples of so many millimetres; 0 for as they are.
        edges: Share of the pixels at edges of depth that have no measurement, from 0 to 1.
        dark: Share of the pixels of black surfaces that have none; less black ones lose fewer.
    """

    sigma: float = 0.0
    step: float = 0.0
    edges: float = 0.0
    dark: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        for name in ('sigma', 'step'):
            if not 0 <= getattr(self, name) < np.inf:
                msg = f'{name} is in millimetres from 0, got {getattr(self, name)}.'
                raise ValueError(msg)
        for name in ('edges', 'dark'):
            if not 0 <= getattr(self, name) <= 1:
                msg = f'{name} is a share from 0 to 1, got {getattr(self, name)}.'
                raise ValueError(msg)


def add_noise(
    depth: NDArray[D],
    noise: DepthNoise,
    rng: np.random.Generator,
    color: NDArray[np.uint8] | None = None,
) -> NDArray[D]:
    """Return a depth image as a worse camera would have made it.

    Args:
        depth: Millimetres as uint16 or metres as float32, 0 or NaN where nothing was measured,
            (H, W). It stays as it is.
        noise: The errors.
        rng: Source of the draws.
        color: RGB of the same pixels, (H, W, 3); without it nothing is dark.

    Returns:
        Depth of the same type, 0 where nothing is measured, (H, W).

    Raises:
        ValueError: If the images have different sizes.
    """
    if color is not None and color.shape[:2] != depth.shape:
        msg = f'Depth is {depth.shape} but colour {color.shape[:2]}.'
        raise ValueError(msg)
    whole = np.issubdtype(depth.dtype, np.integer)
    clean = np.nan_to_num(depth, nan=0.0) if not whole else depth
    metric = clean.astype(np.float32) * np.float32(1.0 if whole else 1000.0)
    missing = metric <= 0
    if noise.edges > 0:
        missing |= _edges(metric) & (rng.random(depth.shape, np.float32) < noise.edges)
    if noise.dark > 0 and color is not None:
        share = np.float32(noise.dark) * (1.0 - (color @ _GREY) / np.float32(DARK))
        missing |= rng.random(depth.shape, np.float32) < share
    if noise.sigma > 0:
        metric += np.float32(noise.sigma) * rng.standard_normal(depth.shape, np.float32)
    if noise.step > 0:
        metric = np.round(metric / np.float32(noise.step)) * np.float32(noise.step)
    metric[missing | (metric < 0)] = 0.0
    if whole:
        return np.minimum(np.round(metric), 65535.0).astype(depth.dtype)
    return (metric * np.float32(0.001)).astype(depth.dtype)


def _edges(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Tell which pixels have a neighbour of quite another depth, (H, W)."""
    edges = np.zeros(depth.shape, np.bool_)
    for axis in (0, 1):
        first = [slice(None), slice(None)]
        second = [slice(None), slice(None)]
        first[axis], second[axis] = slice(None, -1), slice(1, None)
        a, b = depth[tuple(first)], depth[tuple(second)]
        jump = np.abs(a - b) > EDGE * np.minimum(a, b)
        edges[tuple(first)] |= jump
        edges[tuple(second)] |= jump
    return edges
