"""Transforms, where ``tf2_ros`` can be imported (it is no PyPI package)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import TransformStamped

from gridnav.ros.conversions import header, to_quaternion

if TYPE_CHECKING:
    from rclpy.node import Node


class FrameBroadcaster:
    """Broadcasts transforms on the ground; without ``tf2_ros`` it says so and does nothing."""

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
        if self._broadcaster is None:
            return
        message = TransformStamped(header=header(stamp, parent), child_frame_id=child)
        message.transform.translation.x = float(x)
        message.transform.translation.y = float(y)
        message.transform.rotation = to_quaternion(yaw)
        self._broadcaster.sendTransform(message)
