"""Transforms, where ``tf2_ros`` can be imported (it is no PyPI package)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import TransformStamped
from rclpy.time import Time

from gridnav.pose import Pose2D, PoseEstimate
from gridnav.rgbd import Pose3D
from gridnav.ros.conversions import header, to_nanoseconds, to_pose, to_yaw

if TYPE_CHECKING:
    from geometry_msgs.msg import Pose
    from rclpy.node import Node


class FrameBroadcaster:
    """Broadcasts transforms; without ``tf2_ros`` it says so and does nothing."""

    def __init__(self, node: Node) -> None:
        """Prepare to broadcast for a node."""
        self._broadcaster: Any = None
        try:
            from tf2_ros import TransformBroadcaster  # noqa: PLC0415 - optional
        except ImportError:
            node.get_logger().info('tf2_ros is not installed, so no transforms are broadcast.')
        else:
            self._broadcaster = TransformBroadcaster(node)

    def send(self, stamp: int, parent: str, child: str, x: float, y: float, yaw: float) -> None:
        """Broadcast where ``child`` is in ``parent``: nanoseconds, metres, radians."""
        self.send_3d(stamp, parent, child, to_pose(x, y, yaw))

    def send_3d(self, stamp: int, parent: str, child: str, pose: Pose) -> None:
        """Broadcast where ``child`` is in ``parent``, in space."""
        if self._broadcaster is None:
            return
        message = TransformStamped(header=header(stamp, parent), child_frame_id=child)
        message.transform.translation.x = pose.position.x
        message.transform.translation.y = pose.position.y
        message.transform.translation.z = pose.position.z
        message.transform.rotation = pose.orientation
        self._broadcaster.sendTransform(message)


class FrameListener:
    """Looks up where a frame is in another one.

    Args:
        node: Which listens.

    Raises:
        ValueError: If tf2_ros is not installed.
    """

    def __init__(self, node: Node) -> None:
        try:
            from tf2_ros import (  # noqa: PLC0415 - optional
                Buffer,
                TransformException,
                TransformListener,
            )
        except ImportError as error:
            msg = "tf2_ros is not installed, so no pose can come from 'tf'."
            raise ValueError(msg) from error
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, node)
        self._failure = TransformException

    def look_up(self, parent: str, child: str) -> PoseEstimate | None:
        """Return where ``child`` is in ``parent`` now, or None if that is not known (yet)."""
        found = self._find(parent, child)
        if found is None:
            return None
        moved = found.transform
        pose = Pose2D(moved.translation.x, moved.translation.y, to_yaw(moved.rotation))
        if not all(math.isfinite(value) for value in pose):
            return None
        return PoseEstimate(to_nanoseconds(found.header.stamp), pose)

    def look_up_in_space(self, parent: str, child: str) -> Pose3D | None:
        """Return the pose in space of ``child`` in ``parent``, or None as ``look_up`` does."""
        found = self._find(parent, child)
        if found is None:
            return None
        place, turn = found.transform.translation, found.transform.rotation
        pose = Pose3D(place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)
        return pose if all(math.isfinite(value) for value in pose) else None

    def _find(self, parent: str, child: str) -> TransformStamped | None:
        try:
            return self._buffer.lookup_transform(parent, child, Time())
        except self._failure:
            return None
