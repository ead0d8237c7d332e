"""Images, cameras and poses in space: messages from arrays, back, and what is refused."""

from __future__ import annotations

import array
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion
from sensor_msgs.msg import CameraInfo, Image

from gridnav.images import (
    COLOR_ENCODINGS,
    DEPTH_ENCODINGS,
    check_camera,
    check_image,
    decode_camera,
    decode_image,
)
from gridnav.rgbd import Camera, Pose3D
from gridnav.ros.conversions import header
from gridnav.ros.validation import InvalidMessage, validate_header

__all__ = [
    'COLOR_ENCODINGS',
    'DEPTH_ENCODINGS',
    'from_camera_info',
    'from_image',
    'from_pose_3d',
    'to_camera_info',
    'to_image',
    'to_pose_3d',
    'validate_camera_info',
    'validate_image',
]

if TYPE_CHECKING:
    from collections.abc import Collection

    from numpy.typing import NDArray


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
    return decode_image(message)


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
    try:
        check_image(message, encodings)
    except ValueError as error:
        raise InvalidMessage(str(error)) from error


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
    return decode_camera(message)


def validate_camera_info(message: CameraInfo, frames: Collection[str] = ()) -> None:
    """Refuse a camera that can't be used; its distortion is not looked at.

    Args:
        message: The camera.
        frames: The frames it may be in; any if empty.

    Raises:
        InvalidMessage: With one sentence that says why.
    """
    validate_header(message.header, frames)
    try:
        check_camera(message)
    except ValueError as error:
        raise InvalidMessage(str(error)) from error


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
