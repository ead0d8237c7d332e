"""What images and cameras of messages hold, whatever the messages are made of."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from gridnav.rgbd import Camera

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    class RawImage(Protocol):
        """A ``sensor_msgs/Image`` of any library."""

        encoding: str
        width: int
        height: int
        step: int
        is_bigendian: int
        data: Any

    class RawCamera(Protocol):
        """A ``sensor_msgs/CameraInfo`` of any library."""

        width: int
        height: int
        k: Sequence[float]
        binning_x: int
        binning_y: int
        roi: Any


COLOR_ENCODINGS = ('rgb8', 'bgr8', 'rgba8', 'bgra8', 'mono8')
"""Colour as it is understood."""

DEPTH_ENCODINGS = ('16UC1', '32FC1')
"""Depth as it is understood: millimetres and metres."""

_LAYOUTS: dict[str, tuple[type, int]] = {
    'rgb8': (np.uint8, 3),
    'bgr8': (np.uint8, 3),
    'rgba8': (np.uint8, 4),
    'bgra8': (np.uint8, 4),
    'mono8': (np.uint8, 1),
    '16UC1': (np.uint16, 1),
    '32FC1': (np.float32, 1),
}
"""Type and number of the values of a pixel."""

MAX_SIDE = 16384
"""No image may be wider or higher than this, in pixels."""


def check_image(image: RawImage, encodings: Collection[str]) -> None:
    """Refuse an image that can't be used.

    Args:
        image: The image.
        encodings: What is understood: `COLOR_ENCODINGS` or `DEPTH_ENCODINGS`.

    Raises:
        ValueError: With one sentence that says why.
    """
    if image.encoding not in encodings:
        msg = f'Its encoding is {image.encoding!r}, expected {" or ".join(encodings)}.'
        raise ValueError(msg)
    _check_size(image.width, image.height)
    kind, channels = _LAYOUTS[image.encoding]
    value_bytes = np.dtype(kind).itemsize
    if image.is_bigendian and value_bytes > 1:
        msg = f'It is big-endian; {image.encoding} is only read as little-endian.'
        raise ValueError(msg)
    used = image.width * channels * value_bytes
    if image.step < used:
        msg = (
            f'Its step is {image.step} bytes, but {image.width} pixels of {image.encoding} need '
            f'{used}.'
        )
        raise ValueError(msg)
    if len(image.data) != image.step * image.height:
        msg = f'It has {len(image.data)} bytes for {image.height} rows of {image.step} bytes.'
        raise ValueError(msg)


def decode_image(image: RawImage) -> NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]:
    """Return a (checked) image as RGB (H, W, 3) or depth (H, W) of its own type."""
    kind, channels = _LAYOUTS[image.encoding]
    dtype = np.dtype(kind).newbyteorder('<')
    used = image.width * channels * dtype.itemsize
    rows = np.frombuffer(image.data, dtype=np.uint8).reshape(image.height, image.step)
    values: NDArray[Any] = np.ascontiguousarray(rows[:, :used]).view(dtype)
    values = values.astype(kind, copy=False)
    if image.encoding in DEPTH_ENCODINGS:
        return values
    pixels = values.reshape(image.height, image.width, channels)
    if channels == 1:
        return np.repeat(pixels, 3, axis=2)
    pixels = pixels[..., :3]
    if image.encoding.startswith('bgr'):
        pixels = pixels[..., ::-1]
    return np.ascontiguousarray(pixels)


def check_camera(camera: RawCamera) -> None:
    """Refuse a camera that can't be used; its distortion is not looked at.

    Raises:
        ValueError: With one sentence that says why.
    """
    _check_size(camera.width, camera.height)
    values = [float(value) for value in camera.k]
    fx, skew, cx, lower, fy, cy, *last = values
    if not all(math.isfinite(value) for value in values):
        msg = f'Its intrinsics k are not finite {values}.'
        raise ValueError(msg)
    if fx <= 0 or fy <= 0:
        msg = f'Its focal lengths are {fx} and {fy} pixels, expected more than 0.'
        raise ValueError(msg)
    if skew or lower or last != [0.0, 0.0, 1.0]:
        msg = f'Its intrinsics k are not those of a pinhole camera {values}.'
        raise ValueError(msg)
    if not (0 <= cx <= camera.width and 0 <= cy <= camera.height):
        msg = (
            f'Its principal point ({cx}, {cy}) is outside its {camera.width} x '
            f'{camera.height} pixels.'
        )
        raise ValueError(msg)
    roi = camera.roi
    is_cut = (roi.width, roi.height) not in ((0, 0), (camera.width, camera.height))
    if max(camera.binning_x, camera.binning_y) > 1 or is_cut:
        msg = 'It speaks of a binned image or a part of one, only whole images are supported.'
        raise ValueError(msg)


def decode_camera(camera: RawCamera) -> Camera:
    """Return the pinhole camera of a (checked) message; its distortion is not looked at."""
    fx, _, cx, _, fy, cy, *_ = (float(value) for value in camera.k)
    return Camera(int(camera.width), int(camera.height), fx, fy, cx, cy)


def _check_size(width: int, height: int) -> None:
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        msg = f'Its size is {width} x {height} pixels, expected 1 to {MAX_SIDE} each.'
        raise ValueError(msg)
