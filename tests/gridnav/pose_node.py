"""A node for the tests of pose sources: says again where it takes the robot to be."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geometry_msgs.msg import PoseStamped

from gridnav.ros.conversions import to_pose_stamped
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.poses import SOURCES, PoseSource
from gridnav.ros.qos import RELIABLE_QOS
from gridnav.ros.run import run_node

if TYPE_CHECKING:
    from gridnav.pose import PoseEstimate


@dataclass
class PoseParameters:
    """Parameters of the node."""

    source: str = parameter('odom', 'Where the pose comes from', choices=SOURCES)


class PoseNode(BaseNode[PoseParameters]):
    """Publishes each estimate on ``estimate``."""

    def __init__(self) -> None:
        """Start it."""
        super().__init__('poses', PoseParameters)
        self._estimate = self.advertise(PoseStamped, 'estimate', RELIABLE_QOS)
        self._source = PoseSource(
            self,
            self.parameters.source,
            self._on_estimate,
            map_frame='map',
            odom_frame='odom',
            base_frame='base_link',
        )
        self.get_logger().info('Listening.')

    def _on_estimate(self, estimate: PoseEstimate) -> None:
        message = to_pose_stamped(*estimate.pose, stamp=estimate.stamp, frame_id='map')
        if estimate.covariance is not None:
            message.pose.position.z = float(estimate.covariance[1, 1])
        self._estimate.publish(message)


if __name__ == '__main__':
    sys.exit(run_node(PoseNode))
