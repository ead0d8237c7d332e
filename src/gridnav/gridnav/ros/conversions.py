"""Messages from arrays and numbers, and back.

Stamps are ``int`` nanoseconds, angles radians, lengths metres, cells (row, col). Array fields are
only ever set to an ``array.array``: everything else is slow in rclpy.
"""

from __future__ import annotations

import array
import math
from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry, Path
from std_msgs.msg import Header

from gridnav.grid import GridGeometry

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second."""


def to_nanoseconds(stamp: Time) -> int:
    """Return a stamp as nanoseconds."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def to_stamp(nanoseconds: int) -> Time:
    """Return nanoseconds as a stamp."""
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return Time(sec=seconds, nanosec=rest)


def header(stamp: int, frame_id: str) -> Header:
    """Build a header from nanoseconds and a frame."""
    return Header(stamp=to_stamp(stamp), frame_id=frame_id)


def to_quaternion(yaw: float) -> Quaternion:
    """Return a turn by ``yaw`` radians about z as a quaternion."""
    return Quaternion(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))


def to_yaw(rotation: Quaternion) -> float:
    """Return the yaw of a quaternion in radians, from -π to π."""
    sine = 2 * (rotation.w * rotation.z + rotation.x * rotation.y)
    cosine = 1 - 2 * (rotation.y * rotation.y + rotation.z * rotation.z)
    return math.atan2(sine, cosine)


def to_pose(x: float, y: float, yaw: float = 0.0) -> Pose:
    """Build a pose on the ground from metres and radians."""
    return Pose(position=Point(x=float(x), y=float(y), z=0.0), orientation=to_quaternion(yaw))


def to_pose_stamped(
    x: float, y: float, yaw: float = 0.0, *, stamp: int, frame_id: str
) -> PoseStamped:
    """Build a stamped pose on the ground."""
    return PoseStamped(header=header(stamp, frame_id), pose=to_pose(x, y, yaw))


def to_odometry(
    x: float, y: float, yaw: float = 0.0, *, stamp: int, frame_id: str, child_frame_id: str
) -> Odometry:
    """Build an odometry message of a robot that stands still at a pose on the ground."""
    message = Odometry(header=header(stamp, frame_id), child_frame_id=child_frame_id)
    message.pose.pose = to_pose(x, y, yaw)
    return message


def to_occupancy_grid(
    occupancy: NDArray[np.int8], geometry: GridGeometry, *, stamp: int, frame_id: str
) -> OccupancyGrid:
    """Build an occupancy grid message.

    Args:
        occupancy: Percent of occupancy, -1 where unknown, (H, W).
        geometry: Where the grid lies; its shape must be (H, W).
        stamp: Nanoseconds.
        frame_id: Frame of the grid's origin.

    Raises:
        ValueError: If the shapes differ.
    """
    if occupancy.shape != geometry.shape:
        msg = f'The grid is {occupancy.shape}, but its geometry says {geometry.shape}.'
        raise ValueError(msg)
    message = OccupancyGrid(header=header(stamp, frame_id))
    message.info = MapMetaData(
        map_load_time=message.header.stamp,
        resolution=float(geometry.resolution),
        width=geometry.cols,
        height=geometry.rows,
        origin=to_pose(geometry.origin_x, geometry.origin_y),
    )
    message.data = array.array('b', occupancy.astype(np.int8, copy=False).tobytes())
    return message


def to_geometry(info: MapMetaData) -> GridGeometry:
    """Return where a (valid) occupancy grid message lies.

    The resolution is a float32 in the message; it is rounded to seven digits, so that 0.05 comes
    back as 0.05 and cells keep their place on wide maps.
    """
    return GridGeometry(
        rows=int(info.height),
        cols=int(info.width),
        resolution=float(f'{info.resolution:.7g}'),
        origin_x=float(info.origin.position.x),
        origin_y=float(info.origin.position.y),
    )


def from_occupancy_grid(message: OccupancyGrid) -> tuple[NDArray[np.int8], GridGeometry]:
    """Return the cells (H, W) and the placement of a (valid) occupancy grid message."""
    geometry = to_geometry(message.info)
    cells = np.frombuffer(message.data, dtype=np.int8).reshape(geometry.shape)
    return cells.copy(), geometry


def to_path(
    cells: Sequence[tuple[int, int]], geometry: GridGeometry, *, stamp: int, frame_id: str
) -> Path:
    """Build a path through the centres of cells (row, col)."""
    points = [geometry.center_of(row, col) for row, col in cells]
    return to_path_of_points(points, stamp=stamp, frame_id=frame_id)


def to_path_of_points(points: Sequence[tuple[float, float]], *, stamp: int, frame_id: str) -> Path:
    """Build a path through points (x, y) in metres.

    Each pose looks to the next one that lies elsewhere, the last ones keep the direction.
    """
    yaws: list[float] = [0.0] * len(points)
    yaw = 0.0
    for i in range(1, len(points)):
        dx, dy = points[i][0] - points[i - 1][0], points[i][1] - points[i - 1][1]
        if dx or dy:
            yaw = math.atan2(dy, dx)
        yaws[i - 1] = yaws[i] = yaw
    path = Path(header=header(stamp, frame_id))
    path.poses = [
        to_pose_stamped(x, y, yaw, stamp=stamp, frame_id=frame_id)
        for (x, y), yaw in zip(points, yaws, strict=True)
    ]
    return path
