"""Images, cameras and poses in space as messages, and what is refused."""

from __future__ import annotations

import array
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.gridnav.test_ros_validation import set_field

from gridnav.rgbd import Camera, Pose3D
from gridnav.ros import rgbd
from gridnav.ros.conversions import to_nanoseconds
from gridnav.ros.validation import InvalidMessage

if TYPE_CHECKING:
    from sensor_msgs.msg import CameraInfo, Image

RNG = np.random.default_rng(0)
COLOR = RNG.integers(0, 256, (3, 5, 3), dtype=np.uint8)
MILLIMETRES = RNG.integers(0, 65536, (3, 5), dtype=np.uint16)
CAMERA = Camera(5, 3, 4.5, 4.25, 2.0, 1.25)


def image(picture: Any) -> Image:  # noqa: ANN401 - any array
    """Return a picture as a message."""
    return rgbd.to_image(picture, stamp=7, frame_id='optical')


def info() -> CameraInfo:
    """Return a camera as a message."""
    return rgbd.to_camera_info(CAMERA, stamp=7, frame_id='optical')


@pytest.mark.parametrize(
    ('picture', 'encoding'),
    [
        (COLOR, 'rgb8'),
        (MILLIMETRES, '16UC1'),
        (np.array([[0.5, math.nan], [0.0, 3.25]], np.float32), '32FC1'),
    ],
)
def test_images_come_back(picture: Any, encoding: str) -> None:  # noqa: ANN401 - any array
    """Values, type, size and stamp survive, and the message is one that is accepted."""
    message = image(picture)
    assert isinstance(message.data, array.array)
    assert (message.encoding, message.is_bigendian) == (encoding, 0)
    assert to_nanoseconds(message.header.stamp) == 7
    kinds = rgbd.COLOR_ENCODINGS if encoding == 'rgb8' else rgbd.DEPTH_ENCODINGS
    rgbd.validate_image(message, kinds, ('optical',))
    back = rgbd.from_image(message)
    assert back.dtype == picture.dtype
    np.testing.assert_array_equal(back, picture)


@pytest.mark.parametrize('encoding', ['bgr8', 'rgba8', 'bgra8'])
def test_other_orders_of_colour_are_read(encoding: str) -> None:
    """Blue first or last, with or without a fourth value, rows longer than their pixels."""
    channels = len(encoding) - 1
    pixels = COLOR[..., ::-1] if encoding.startswith('bgr') else COLOR
    rows = np.full((3, 5 * channels + 2), 9, np.uint8)
    rows[:, : 5 * channels].reshape(3, 5, channels)[..., :3] = pixels
    message = image(COLOR)
    message.encoding, message.step = encoding, rows.shape[1]
    message.data = array.array('B', rows.tobytes())
    rgbd.validate_image(message, rgbd.COLOR_ENCODINGS)
    np.testing.assert_array_equal(rgbd.from_image(message), COLOR)


def test_grey_becomes_colour() -> None:
    """A picture of one channel is grey."""
    message = image(COLOR)
    message.encoding, message.step = 'mono8', 5
    message.data = array.array('B', COLOR[..., 0].tobytes())
    rgbd.validate_image(message, rgbd.COLOR_ENCODINGS)
    back = rgbd.from_image(message)
    np.testing.assert_array_equal(back, COLOR[..., :1].repeat(3, axis=2))


def test_a_picture_without_encoding_is_named() -> None:
    """Neither four channels nor double precision."""
    for picture in (np.zeros((2, 2, 4), np.uint8), np.zeros((2, 2))):
        with pytest.raises(ValueError, match='There is no encoding'):
            image(picture)


def test_cameras_come_back() -> None:
    """Size and intrinsics survive."""
    message = info()
    rgbd.validate_camera_info(message, ('optical',))
    assert rgbd.from_camera_info(message) == CAMERA
    assert message.p[0] == CAMERA.fx
    message.roi.width, message.roi.height = 5, 3
    rgbd.validate_camera_info(message)


def test_poses_in_space_come_back() -> None:
    """All seven numbers survive; a quaternion is made exact."""
    pose = Pose3D(1.0, -2.0, 0.5, 0.5, -0.5, 0.5, 0.5)
    assert rgbd.from_pose_3d(rgbd.to_pose_3d(pose)) == pose
    message = rgbd.to_pose_3d(pose._replace(qw=0.5005))
    assert math.hypot(*rgbd.from_pose_3d(message)[3:]) == pytest.approx(1.0, abs=1e-12)


IMAGE_FAULTS: list[tuple[str, Any, str]] = [
    ('header.frame_id', '', 'frame_id is empty'),
    ('header.frame_id', 'elsewhere', "frame_id is 'elsewhere'"),
    ('encoding', '', "encoding is '', expected 16UC1 or 32FC1"),
    ('encoding', 'rgb8', "encoding is 'rgb8'"),
    ('width', 0, 'size is 0 x 3'),
    ('height', 2**32 - 1, 'size is 5 x 4294967295'),
    ('is_bigendian', 1, 'It is big-endian'),
    ('step', 9, 'step is 9 bytes, but 5 pixels of 16UC1 need 10'),
    ('width', 6, 'step is 10 bytes, but 6 pixels'),
    ('encoding', '32FC1', 'step is 10 bytes, but 5 pixels of 32FC1 need 20'),
    ('height', 4, '30 bytes for 4 rows of 10 bytes'),
    ('data', array.array('B'), '0 bytes for 3 rows'),
]


@pytest.mark.parametrize(('field', 'value', 'reason'), IMAGE_FAULTS)
def test_bad_images_are_refused(field: str, value: object, reason: str) -> None:
    """Each for its own reason, in one sentence."""
    message = image(MILLIMETRES)
    set_field(message, field, value)
    with pytest.raises(InvalidMessage, match=reason) as error:
        rgbd.validate_image(message, rgbd.DEPTH_ENCODINGS, ('optical',))
    assert str(error.value).count('\n') == 0


K = [4.5, 0.0, 2.0, 0.0, 4.25, 1.25, 0.0, 0.0, 1.0]

INFO_FAULTS: list[tuple[str, Any, str]] = [
    ('header.frame_id', '', 'frame_id is empty'),
    ('width', 0, 'size is 0 x 3'),
    ('k', [0.0] * 9, 'focal lengths are 0.0 and 0.0'),
    ('k', [*K[:4], -4.0, *K[5:]], 'focal lengths are 4.5 and -4.0'),
    ('k', [math.nan, *K[1:]], 'not finite'),
    ('k', [K[0], 3.0, *K[2:]], 'not those of a pinhole camera'),
    ('k', [*K[:8], 0.0], 'not those of a pinhole camera'),
    ('k', [*K[:2], 320.0, *K[3:]], r'principal point \(320.0, 1.25\) is outside its 5 x 3'),
    ('binning_x', 2, 'binned image'),
    ('roi.width', 3, 'a part of one'),
]


@pytest.mark.parametrize(('field', 'value', 'reason'), INFO_FAULTS)
def test_bad_cameras_are_refused(field: str, value: Any, reason: str) -> None:  # noqa: ANN401
    """Each for its own reason, in one sentence."""
    message = info()
    set_field(message, field, value)
    with pytest.raises(InvalidMessage, match=reason):
        rgbd.validate_camera_info(message, ('optical',))
