"""Refuse messages that a node can't use, each time with one sentence that names the value.

rclpy hands over a NaN pose or a grid of 10 by 10 cells with five values without a murmur, so
every subscription validates.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gridnav.partial_map import OCCUPIED_VALUE, UNKNOWN_VALUE
from gridnav.ros.conversions import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Collection

    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import (
        Point,
        Pose,
        PoseStamped,
        PoseWithCovarianceStamped,
        Quaternion,
    )
    from nav_msgs.msg import OccupancyGrid, Odometry, Path
    from std_msgs.msg import Header

MAX_CELLS = 4096 * 4096
"""No grid may have more cells than this."""

MAX_COORDINATE_M = 1e6
"""No position may lie further out than this; it is a unit mistake or a broken sensor."""

MIN_RESOLUTION_M = 1e-3
MAX_RESOLUTION_M = 1e3

UNIT_NORM_TOLERANCE = 1e-3
"""How far the norm of a quaternion may be from 1."""

COVARIANCE_TOLERANCE = 1e-9
"""How far below 0 an eigenvalue of a covariance may be, in m²."""

ROTATION_TOLERANCE = 1e-3
"""How far a grid's origin may be turned, as the length of the quaternion's vector part."""


class InvalidMessage(ValueError):  # noqa: N818 - a message is invalid; that is no fault of ours
    """A message that can't be used; the text is one sentence that says why."""


def validate_stamp(stamp: Time) -> None:
    """Refuse a stamp before zero or with a second or more of nanoseconds."""
    if stamp.sec < 0 or not 0 <= stamp.nanosec < NANOSECONDS:
        msg = f'Its stamp is not a time ({stamp.sec} s, {stamp.nanosec} ns).'
        raise InvalidMessage(msg)


def validate_header(header: Header, frames: Collection[str] = ()) -> None:
    """Refuse a bad stamp, an empty frame, and a frame that is not one of ``frames`` (if any)."""
    validate_stamp(header.stamp)
    if not header.frame_id:
        msg = 'Its frame_id is empty.'
        raise InvalidMessage(msg)
    if frames and header.frame_id not in frames:
        expected = ' or '.join(repr(frame) for frame in frames)
        msg = f'Its frame_id is {header.frame_id!r}, expected {expected}.'
        raise InvalidMessage(msg)


def validate_position(position: Point) -> None:
    """Refuse a position that is not finite or more than 1000 km out."""
    xyz = (position.x, position.y, position.z)
    if not all(math.isfinite(value) for value in xyz):
        msg = f'Its position is not finite {xyz}.'
        raise InvalidMessage(msg)
    if max(map(abs, xyz)) > MAX_COORDINATE_M:
        msg = f'Its position {xyz} is further out than {MAX_COORDINATE_M:.0f} m.'
        raise InvalidMessage(msg)


def validate_rotation(rotation: Quaternion) -> None:
    """Refuse a quaternion that is not finite or not of length 1."""
    xyzw = (rotation.x, rotation.y, rotation.z, rotation.w)
    if not abs(math.hypot(*xyzw) - 1.0) <= UNIT_NORM_TOLERANCE:
        msg = f'Its orientation {xyzw} is not a unit quaternion.'
        raise InvalidMessage(msg)


def validate_pose(pose: Pose) -> None:
    """Refuse a pose with a bad position or rotation."""
    validate_position(pose.position)
    validate_rotation(pose.orientation)


def validate_pose_stamped(message: PoseStamped, frames: Collection[str] = ()) -> None:
    """Refuse a stamped pose that can't be used."""
    validate_header(message.header, frames)
    validate_pose(message.pose)


def validate_odometry(message: Odometry, frames: Collection[str] = ()) -> None:
    """Refuse an odometry message that can't be used; its twist is not looked at."""
    validate_header(message.header, frames)
    validate_pose(message.pose.pose)


def validate_path(message: Path, frames: Collection[str] = ()) -> None:
    """Refuse a path that can't be used; an empty one is fine."""
    validate_header(message.header, frames)
    for pose in message.poses:
        validate_position(pose.pose.position)


def validate_pose_with_covariance(
    message: PoseWithCovarianceStamped, frames: Collection[str] = ()
) -> None:
    """Refuse a pose that can't be used, and a covariance of x and y that is none."""
    validate_header(message.header, frames)
    validate_pose(message.pose.pose)
    covariance = np.array(message.pose.covariance).reshape(6, 6)[:2, :2]
    fine = np.isfinite(covariance).all() and np.allclose(covariance, covariance.T)
    if not (fine and np.linalg.eigvalsh(covariance)[0] >= -COVARIANCE_TOLERANCE):
        msg = f'Its covariance of x and y is none ({covariance.tolist()}).'
        raise InvalidMessage(msg)


def validate_occupancy_grid(
    message: OccupancyGrid, frames: Collection[str] = (), max_cells: int = MAX_CELLS
) -> None:
    """Refuse an occupancy grid that can't be used.

    Args:
        message: The grid.
        frames: The frames it may be in; any if empty.
        max_cells: The most cells it may have.

    Raises:
        InvalidMessage: With one sentence that says why.
    """
    validate_header(message.header, frames)
    info = message.info
    if not MIN_RESOLUTION_M <= info.resolution <= MAX_RESOLUTION_M:
        msg = (
            f'Its resolution is {info.resolution} m, expected {MIN_RESOLUTION_M} to '
            f'{MAX_RESOLUTION_M:.0f} m.'
        )
        raise InvalidMessage(msg)
    cells = info.width * info.height
    if cells < 1:
        msg = f'It has no cells ({info.width} x {info.height}).'
        raise InvalidMessage(msg)
    if cells > max_cells:
        msg = f'It has {info.width} x {info.height} cells, more than {max_cells} in all.'
        raise InvalidMessage(msg)
    if len(message.data) != cells:
        msg = f'It has {len(message.data)} values for {info.width} x {info.height} cells.'
        raise InvalidMessage(msg)
    values = np.frombuffer(message.data, dtype=np.int8)
    lowest, highest = int(values.min()), int(values.max())
    if lowest < UNKNOWN_VALUE or highest > OCCUPIED_VALUE:
        worst = lowest if lowest < UNKNOWN_VALUE else highest
        msg = f'It holds the value {worst}, expected {UNKNOWN_VALUE} to {OCCUPIED_VALUE}.'
        raise InvalidMessage(msg)
    validate_pose(info.origin)
    turn = info.origin.orientation
    if math.hypot(turn.x, turn.y, turn.z) > ROTATION_TOLERANCE:
        msg = 'Its origin is rotated, only grids along the axes of their frame are supported.'
        raise InvalidMessage(msg)
