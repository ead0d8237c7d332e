"""Read image files; one that can't be used is named in one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np
from PIL import Image

from gridnav.rgbd import Camera, FrameError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

T = TypeVar('T', bound=np.generic)

SAMPLED_POINTS = 1500
"""No more points of an image go into fitting a floor."""

MAX_SAMPLED_DEPTH_M = 5.0
"""Points further away are too inexact for that."""


def image_size(path: Path) -> tuple[int, int]:
    """Return the width and height of an image without decoding it.

    Raises:
        FrameError: If it can't be read.
    """
    with _open(path) as image:
        return image.size


def read_color(path: Path, size: tuple[int, int], enough: tuple[int, int]) -> Image.Image:
    """Read a colour image.

    Args:
        path: A JPEG or PNG.
        size: The width and height that it must have.
        enough: Width and height that will do; a large JPEG is decoded the faster for it.

    Raises:
        FrameError: If it can't be read, or is of another size.
    """
    image = _open(path)
    require_size(path, image.size, size)
    image.draft('RGB', enough)
    return _load(path, image).convert('RGB')


def read_depth(path: Path, size: tuple[int, int]) -> NDArray[np.uint16]:
    """Read a depth image of 16 bits and of a size (width, height), (H, W).

    Raises:
        FrameError: If it can't be read, or is of another size.
    """
    image = _open(path)
    require_size(path, image.size, size)
    if image.mode not in ('I;16', 'I'):
        msg = f'{path.name} is no depth image of 16 bits, its mode is {image.mode}.'
        raise FrameError(msg)
    return np.asarray(_load(path, image)).astype(np.uint16)


def read_labels(path: Path, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Read an image of labels of a size (width, height), (H, W).

    Raises:
        FrameError: If it can't be read, or is of another size.
    """
    image = _open(path)
    require_size(path, image.size, size)
    if image.mode not in ('L', 'P'):
        msg = f'{path.name} is no image of labels of 8 bits, its mode is {image.mode}.'
        raise FrameError(msg)
    return np.asarray(_load(path, image))


def require_size(path: Path, size: tuple[int, int], expected: tuple[int, int]) -> None:
    """Refuse an image whose width and height are not the expected ones."""
    if size != expected:
        msg = (
            f'{path.name} is {size[0]} x {size[1]} pixels, expected {expected[0]} x {expected[1]}.'
        )
        raise FrameError(msg)


def scaled_camera(camera: Camera, width: int) -> Camera:
    """Return the camera of pictures of a width, with square pixels; 0 leaves it as it is."""
    if width in (0, camera.width):
        return camera
    return camera.resized(width, max(1, round(camera.height * width / camera.width)))


def nearest_pixels(picture: NDArray[T], camera: Camera) -> NDArray[T]:
    """Bring depth or labels (h, w) to the size of a camera, each pixel the nearest one."""
    height, width = picture.shape
    rows = ((np.arange(camera.height) + 0.5) * height / camera.height).astype(np.intp)
    columns = ((np.arange(camera.width) + 0.5) * width / camera.width).astype(np.intp)
    return picture[np.ix_(rows, columns)]


def sample_depth(
    depth: NDArray[np.floating],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return some pixels (u, v) of a depth image in metres, (N, 2), and their depth, (N,)."""
    stride = max(1, int(np.sqrt(depth.size / SAMPLED_POINTS)))
    part = depth[::stride, ::stride].astype(np.float64)
    rows, columns = np.nonzero((part > 0) & (part < MAX_SAMPLED_DEPTH_M))
    pixels = stride * np.column_stack((columns, rows)).astype(np.float64)
    return pixels, part[rows, columns]


def _open(path: Path) -> Image.Image:
    try:
        return Image.open(path)
    except FileNotFoundError as error:
        msg = f'{path.name} is missing.'
        raise FrameError(msg) from error
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        msg = f'{path.name} is no image that can be read.'
        raise FrameError(msg) from error


def _load(path: Path, image: Image.Image) -> Image.Image:
    try:
        image.load()
    except (OSError, SyntaxError, ValueError, IndexError) as error:
        msg = f'{path.name} is cut or broken ({error}).'
        raise FrameError(msg) from error
    return image
