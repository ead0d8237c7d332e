"""Where a robot that moves by itself is on its map: from TF, from ``odom``, or from AMCL."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from gridnav.pose import Pose2D, PoseEstimate, PoseTracker
from gridnav.ros.conversions import to_nanoseconds, to_yaw
from gridnav.ros.qos import MAP_QOS, RELIABLE_QOS
from gridnav.ros.tf import FrameListener
from gridnav.ros.validation import validate_odometry, validate_pose_with_covariance

if TYPE_CHECKING:
    from collections.abc import Callable

    from geometry_msgs.msg import Pose

    from gridnav.ros.node import BaseNode

SOURCES = ('odom', 'tf', 'amcl_pose')
"""'odom' takes the frame of odom to be where the map's frame is; 'tf' looks the base frame up in
the map's; 'amcl_pose' takes a pose on the map, with its covariance, and moves it on by odom."""

LOOKUP_PERIOD_S = 0.05


class PoseSource:
    """Calls back with each new estimate of where the robot is in the map's frame.

    Args:
        node: Which subscribes.
        source: One of `SOURCES`.
        callback: Gets each estimate.
        map_frame: Frame of the estimates.
        odom_frame: Frame of odom.
        base_frame: Frame of the robot, for 'tf'.

    Raises:
        ValueError: If the source is 'tf' where tf2_ros is not installed.
    """

    def __init__(
        self,
        node: BaseNode[Any],
        source: str,
        callback: Callable[[PoseEstimate], None],
        *,
        map_frame: str,
        odom_frame: str,
        base_frame: str,
    ) -> None:
        self._callback = callback
        self._tracker = PoseTracker()
        self._on_map = source == 'odom'
        self._newest = -1
        if source == 'tf':
            self._frames = FrameListener(node)
            self._edge = (map_frame, base_frame)
            node.create_timer(LOOKUP_PERIOD_S, self._look_up)
            return
        node.subscribe(
            Odometry,
            'odom',
            self._on_odom,
            RELIABLE_QOS,
            validate=partial(validate_odometry, frames=(odom_frame, map_frame)),
        )
        if source == 'amcl_pose':
            node.subscribe(
                PoseWithCovarianceStamped,
                'amcl_pose',
                self._on_amcl_pose,
                MAP_QOS,
                validate=partial(validate_pose_with_covariance, frames=(map_frame,)),
            )

    def _look_up(self) -> None:
        found = self._frames.look_up(*self._edge)
        if found is not None and found.stamp != self._newest:
            self._newest = found.stamp
            self._callback(found)

    def _on_odom(self, message: Odometry) -> None:
        stamp, pose = to_nanoseconds(message.header.stamp), to_pose_2d(message.pose.pose)
        if self._on_map:
            self._callback(PoseEstimate(stamp, pose))
            return
        self._tracker.add_odometry(stamp, pose)
        self._publish()

    def _on_amcl_pose(self, message: PoseWithCovarianceStamped) -> None:
        # Row-major over x, y, z and three angles; only the ground matters.
        covariance = np.array(message.pose.covariance).reshape(6, 6)[:2, :2]
        stamp = to_nanoseconds(message.header.stamp)
        self._tracker.add_fix(PoseEstimate(stamp, to_pose_2d(message.pose.pose), covariance))
        self._publish()

    def _publish(self) -> None:
        estimate = self._tracker.estimate
        if estimate is not None:
            self._callback(estimate)


def to_pose_2d(pose: Pose) -> Pose2D:
    """Return a pose on the ground."""
    return Pose2D(pose.position.x, pose.position.y, to_yaw(pose.orientation))
