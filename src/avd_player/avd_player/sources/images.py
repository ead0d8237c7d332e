"""Read image files; one that can't be used is named in one sentence."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from PIL import Image

from gridnav.rgbd import Camera, FrameError

if TYPE_CHECKING:
    from collections.abc import Iterator
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
    with _opened(path) as image:
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
    with _opened(path) as image:
        _require_size(path, image.size, size)
        image.draft('RGB', enough)
        return image.convert('RGB')


def read_depth(path: Path, size: tuple[int, int]) -> NDArray[np.uint16]:
    """Read a depth image of 16 bits and of a size (width, height), (H, W).

    Raises:
        FrameError: If it can't be read, or is of another size.
    """
    with _opened(path) as image:
        _require_size(path, image.size, size)
        if image.mode not in ('I;16', 'I'):
            msg = f'{path.name} is no depth image of 16 bits, its mode is {image.mode}.'
            raise FrameError(msg)
        return np.array(image, dtype=np.uint16)


def read_labels(path: Path, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Read an image of labels of a size (width, height), (H, W).

    Raises:
        FrameError: If it can't be read, or is of another size.
    """
    with _opened(path) as image:
        _require_size(path, image.size, size)
        if image.mode not in ('L', 'P'):
            msg = f'{path.name} is no image of labels of 8 bits, its mode is {image.mode}.'
            raise FrameError(msg)
        return np.array(image, dtype=np.uint8)


def _require_size(path: Path, size: tuple[int, int], expected: tuple[int, int]) -> None:
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


@contextmanager
def _opened(path: Path) -> Iterator[Image.Image]:
    """Open an image, and name it if it turns out not to be one, now or when it is decoded."""
    try:
        with Image.open(path) as image:
            yield image
    except FrameError:
        raise
    except FileNotFoundError as error:
        msg = f'{path.name} is missing.'
        raise FrameError(msg) from error
    except (OSError, SyntaxError, ValueError, IndexError, Image.DecompressionBombError) as error:
        reason = str(error).split('\n', maxsplit=1)[0].replace(str(path), path.name)
        msg = f'{path.name} is cut or broken ({reason}).'
        raise FrameError(msg) from error
