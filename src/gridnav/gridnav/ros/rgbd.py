"""Images, cameras and poses in space: messages from arrays, back, and what is refused."""

from __future__ import annotations

import array
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion
from sensor_msgs.msg import CameraInfo, Image

from gridnav.rgbd import Camera, Pose3D
from gridnav.ros.conversions import header
from gridnav.ros.validation import InvalidMessage, validate_header

if TYPE_CHECKING:
    from collections.abc import Collection

    from numpy.typing import NDArray

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


def to_image(picture: NDArray[np.generic], *, stamp: int, frame_id: str) -> Image:
    """Build an image message.

    Args:
        picture: RGB as uint8 (H, W, 3), or depth (H, W) as uint16 in millimetres or float32 in
            metres.
        stamp: Nanoseconds.
        frame_id: Optical frame of the camera.

    Raises:
        ValueError: If it is none of these.
    """
    kinds = {(3, 'uint8'): 'rgb8', (2, 'uint16'): '16UC1', (2, 'float32'): '32FC1'}
    encoding = kinds.get((picture.ndim, picture.dtype.name))
    if encoding is None or (encoding == 'rgb8' and picture.shape[2] != 3):  # noqa: PLR2004
        msg = f'There is no encoding for an image of {picture.dtype} {picture.shape}.'
        raise ValueError(msg)
    little = picture.astype(picture.dtype.newbyteorder('<'), copy=False)
    message = Image(header=header(stamp, frame_id), encoding=encoding, is_bigendian=0)
    message.height, message.width = picture.shape[:2]
    message.step = picture.nbytes // message.height
    message.data = array.array('B', little.tobytes())
    return message


def from_image(message: Image) -> NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]:
    """Return a (valid) image message as RGB (H, W, 3) or depth (H, W) of its own type."""
    kind, channels = _LAYOUTS[message.encoding]
    dtype = np.dtype(kind).newbyteorder('<')
    used = message.width * channels * dtype.itemsize
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.step)
    values: NDArray[Any] = np.ascontiguousarray(rows[:, :used]).view(dtype)
    values = values.astype(kind, copy=False)
    if message.encoding in DEPTH_ENCODINGS:
        return values
    pixels = values.reshape(message.height, message.width, channels)
    if channels == 1:
        return np.repeat(pixels, 3, axis=2)
    pixels = pixels[..., :3]
    if message.encoding.startswith('bgr'):
        pixels = pixels[..., ::-1]
    return np.ascontiguousarray(pixels)


def validate_image(
    message: Image, encodings: Collection[str], frames: Collection[str] = ()
) -> None:
    """Refuse an image that can't be used.

    Args:
        message: The image.
        encodings: What is understood: `COLOR_ENCODINGS` or `DEPTH_ENCODINGS`.
        frames: The frames it may be in; any if empty.

    Raises:
        InvalidMessage: With one sentence that says why.
    """
    validate_header(message.header, frames)
    if message.encoding not in encodings:
        msg = f'Its encoding is {message.encoding!r}, expected {" or ".join(encodings)}.'
        raise InvalidMessage(msg)
    _validate_size(message.width, message.height)
    kind, channels = _LAYOUTS[message.encoding]
    value_bytes = np.dtype(kind).itemsize
    if message.is_bigendian and value_bytes > 1:
        msg = f'It is big-endian; {message.encoding} is only read as little-endian.'
        raise InvalidMessage(msg)
    used = message.width * channels * value_bytes
    if message.step < used:
        msg = (
            f'Its step is {message.step} bytes, but {message.width} pixels of '
            f'{message.encoding} need {used}.'
        )
        raise InvalidMessage(msg)
    if len(message.data) != message.step * message.height:
        msg = (
            f'It has {len(message.data)} bytes for {message.height} rows of {message.step} bytes.'
        )
        raise InvalidMessage(msg)


def to_camera_info(camera: Camera, *, stamp: int, frame_id: str) -> CameraInfo:
    """Build the message of a camera without distortion."""
    message = CameraInfo(header=header(stamp, frame_id), distortion_model='plumb_bob')
    message.width, message.height = camera.width, camera.height
    fx, fy, cx, cy = (float(value) for value in camera[2:])
    message.d = array.array('d', bytes(40))
    message.k = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
    message.r = np.eye(3).ravel()
    message.p = np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0])
    return message


def from_camera_info(message: CameraInfo) -> Camera:
    """Return the pinhole camera of a (valid) message; its distortion is not looked at."""
    fx, _, cx, _, fy, cy, *_ = (float(value) for value in message.k)
    return Camera(int(message.width), int(message.height), fx, fy, cx, cy)


def validate_camera_info(message: CameraInfo, frames: Collection[str] = ()) -> None:
    """Refuse a camera that can't be used; its distortion is not looked at.

    Args:
        message: The camera.
        frames: The frames it may be in; any if empty.

    Raises:
        InvalidMessage: With one sentence that says why.
    """
    validate_header(message.header, frames)
    _validate_size(message.width, message.height)
    values = [float(value) for value in message.k]
    fx, skew, cx, lower, fy, cy, *last = values
    if not all(math.isfinite(value) for value in values):
        msg = f'Its intrinsics k are not finite {values}.'
        raise InvalidMessage(msg)
    if fx <= 0 or fy <= 0:
        msg = f'Its focal lengths are {fx} and {fy} pixels, expected more than 0.'
        raise InvalidMessage(msg)
    if skew or lower or last != [0.0, 0.0, 1.0]:
        msg = f'Its intrinsics k are not those of a pinhole camera {values}.'
        raise InvalidMessage(msg)
    if not (0 <= cx <= message.width and 0 <= cy <= message.height):
        msg = (
            f'Its principal point ({cx}, {cy}) is outside its {message.width} x '
            f'{message.height} pixels.'
        )
        raise InvalidMessage(msg)
    roi = message.roi
    is_cut = (roi.width, roi.height) not in ((0, 0), (message.width, message.height))
    if max(message.binning_x, message.binning_y) > 1 or is_cut:
        msg = 'It speaks of a binned image or a part of one, only whole images are supported.'
        raise InvalidMessage(msg)


def to_pose_3d(pose: Pose3D) -> Pose:
    """Return a pose in space as a message."""
    x, y, z, qx, qy, qz, qw = (float(value) for value in pose)
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def from_pose_3d(message: Pose) -> Pose3D:
    """Return the pose in space of a (valid) message, its quaternion made exact."""
    position, turn = message.position, message.orientation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    quaternion /= np.linalg.norm(quaternion)
    return Pose3D(position.x, position.y, position.z, *quaternion.tolist())


def _validate_size(width: int, height: int) -> None:
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        msg = f'Its size is {width} x {height} pixels, expected 1 to {MAX_SIDE} each.'
        raise InvalidMessage(msg)
