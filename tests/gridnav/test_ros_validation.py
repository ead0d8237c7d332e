"""What a node refuses, each for its own reason."""

from __future__ import annotations

import array
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from gridnav.grid import GridGeometry
from gridnav.ros.conversions import to_occupancy_grid, to_odometry, to_pose_stamped
from gridnav.ros.validation import (
    InvalidMessage,
    validate_occupancy_grid,
    validate_odometry,
    validate_pose_stamped,
)

if TYPE_CHECKING:
    from geometry_msgs.msg import PoseStamped
    from nav_msgs.msg import OccupancyGrid, Odometry


def good_grid() -> OccupancyGrid:
    """Return a grid of 2 x 3 cells."""
    occupancy = np.array([[0, 100, -1], [50, 0, 0]], dtype=np.int8)
    return to_occupancy_grid(
        occupancy, GridGeometry(2, 3, 0.05, -1.0, 2.0), stamp=10, frame_id='map'
    )


def good_odometry() -> Odometry:
    """Return a pose in odom."""
    return to_odometry(1.0, 2.0, 0.3, stamp=10, frame_id='odom', child_frame_id='base_link')


def good_pose() -> PoseStamped:
    """Return a pose in map."""
    return to_pose_stamped(1.0, 2.0, 0.3, stamp=10, frame_id='map')


def set_field(message: object, path: str, value: object) -> None:
    """Set a field of a message by its dotted path, unchecked as a remote sender's is."""
    *parents, name = path.split('.')
    for parent in parents:
        message = getattr(message, parent)
    setattr(message, f'_{name}', value)


HEADER_FAULTS: list[tuple[str, Any, str]] = [
    ('header.frame_id', '', 'frame_id is empty'),
    ('header.frame_id', 'world', "frame_id is 'world'"),
    ('header.stamp.nanosec', 1_000_000_000, 'stamp'),
    ('header.stamp.sec', -1, 'stamp'),
]

POSE_FAULTS: list[tuple[str, Any, str]] = [
    ('position.x', math.nan, 'position is not finite'),
    ('position.y', math.inf, 'position is not finite'),
    ('position.z', -math.inf, 'position is not finite'),
    ('position.x', 1.1e6, 'further out'),
    ('position.y', -1e300, 'further out'),
    ('orientation.w', math.nan, 'unit quaternion'),
    ('orientation.w', math.inf, 'unit quaternion'),
    ('orientation.w', 0.9, 'unit quaternion'),
    ('orientation.z', 1e200, 'unit quaternion'),
]

GRID_FAULTS: list[tuple[str, Any, str]] = [
    *HEADER_FAULTS,
    *[(f'info.origin.{path}', value, reason) for path, value, reason in POSE_FAULTS],
    ('info.resolution', 0.0, 'resolution is 0.0'),
    ('info.resolution', -1.0, 'resolution is -1.0'),
    ('info.resolution', math.nan, 'resolution is nan'),
    ('info.resolution', math.inf, 'resolution is inf'),
    ('info.resolution', 1e-30, 'resolution is 1e-30'),
    ('info.width', 0, 'no cells'),
    ('info.height', 0, 'no cells'),
    ('info.width', 4, '6 values for 4 x 2'),
    ('info.height', 2**16, 'values for 3 x 65536'),
    ('info.height', 2**32 - 1, 'more than'),
    ('data', array.array('b'), '0 values'),
    ('data', array.array('b', [0, 0, 0, 0, 0, -2]), 'value -2'),
    ('data', array.array('b', [0, 0, 0, 0, 0, 101]), 'value 101'),
]


@pytest.mark.parametrize(('path', 'value', 'reason'), GRID_FAULTS)
def test_a_bad_grid_is_refused(path: str, value: object, reason: str) -> None:
    """By one sentence that names the value."""
    message = good_grid()
    set_field(message, path, value)
    with pytest.raises(InvalidMessage, match=reason) as caught:
        validate_occupancy_grid(message, frames=('map',))
    assert str(caught.value).endswith('.')
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('path', 'value', 'reason'),
    [*HEADER_FAULTS, *[(f'pose.pose.{path}', value, why) for path, value, why in POSE_FAULTS]],
)
def test_a_bad_odometry_is_refused(path: str, value: object, reason: str) -> None:
    """By one sentence that names the value."""
    message = good_odometry()
    set_field(message, path, value)
    with pytest.raises(InvalidMessage, match=reason):
        validate_odometry(message, frames=('odom', 'map'))


@pytest.mark.parametrize(
    ('path', 'value', 'reason'),
    [*HEADER_FAULTS, *[(f'pose.{path}', value, why) for path, value, why in POSE_FAULTS]],
)
def test_a_bad_pose_is_refused(path: str, value: object, reason: str) -> None:
    """By one sentence that names the value."""
    message = good_pose()
    set_field(message, path, value)
    with pytest.raises(InvalidMessage, match=reason):
        validate_pose_stamped(message, frames=('map',))


def test_an_all_zero_orientation_is_refused() -> None:
    """It is what a sender leaves who forgot it, and no rotation."""
    message = good_pose()
    message.pose.orientation.z = message.pose.orientation.w = 0.0
    with pytest.raises(InvalidMessage, match='unit quaternion'):
        validate_pose_stamped(message)


@pytest.mark.parametrize('axis', ['x', 'y', 'z'])
def test_a_rotated_grid_is_refused(axis: str) -> None:
    """Cells would lie elsewhere than we put them."""
    message = good_grid()
    setattr(message.info.origin.orientation, axis, math.sin(0.1))
    message.info.origin.orientation.w = math.cos(0.1)
    with pytest.raises(InvalidMessage, match='rotated'):
        validate_occupancy_grid(message)


def test_the_limit_of_cells_can_be_set() -> None:
    """Six cells are more than five."""
    with pytest.raises(InvalidMessage, match='more than 5'):
        validate_occupancy_grid(good_grid(), max_cells=5)
    validate_occupancy_grid(good_grid(), max_cells=6)


def test_good_messages_pass() -> None:
    """With the frames named and with any frame."""
    validate_occupancy_grid(good_grid(), frames=('map', 'base_link'))
    validate_occupancy_grid(good_grid())
    validate_odometry(good_odometry(), frames=('odom', 'map'))
    validate_pose_stamped(good_pose(), frames=('map',))
    validate_pose_stamped(good_pose())
