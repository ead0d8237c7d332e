"""Where a robot is on its map, over DDS and from a stand-in for tf2_ros."""

from __future__ import annotations

import math
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from tests.ros_helpers import wait_for

from gridnav.ros.conversions import header, to_nanoseconds, to_odometry, to_pose, to_quaternion
from gridnav.ros.poses import PoseSource
from gridnav.ros.qos import MAP_QOS, RELIABLE_QOS
from gridnav.ros.validation import InvalidMessage, validate_pose_with_covariance

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.ros_helpers import Probe, StartNode

    from gridnav.pose import PoseEstimate

NODE = str(Path(__file__).parent / 'pose_node.py')


def odometry(stamp: int, x: float, y: float, yaw: float = 0.0) -> Odometry:
    """Build odometry in the frame odom."""
    return to_odometry(x, y, yaw, stamp=stamp, frame_id='odom', child_frame_id='base_link')


def pose_on_map(stamp: int, x: float, y: float, variance: float) -> PoseWithCovarianceStamped:
    """Build a pose as AMCL does."""
    message = PoseWithCovarianceStamped(header=header(stamp, 'map'))
    message.pose.pose = to_pose(x, y)
    covariance = np.diag([variance, 2 * variance, 0.0, 0.0, 0.0, 0.1])
    message.pose.covariance = covariance.ravel()
    return message


def test_from_odom(node_process: StartNode, probe: Probe) -> None:
    """The frame of odom is taken to be where the map's frame is."""
    node_process(NODE, {'source': 'odom'}).wait_output('Listening')
    estimates = probe.record(PoseStamped, 'estimate', RELIABLE_QOS)
    poses = probe.publisher(Odometry, 'odom', RELIABLE_QOS)
    wait_for(lambda: probe.node.count_publishers('estimate') > 0)
    poses.publish(odometry(7, 1.0, 2.0))
    wait_for(lambda: estimates)
    assert to_nanoseconds(estimates[0].header.stamp) == 7
    assert estimates[0].pose.position.y == 2.0


def test_from_amcl_pose(node_process: StartNode, probe: Probe) -> None:
    """A latched pose on the map is moved on by odometry; bad ones are refused."""
    node = node_process(NODE, {'source': 'amcl_pose'})
    node.wait_output('Listening')
    estimates = probe.record(PoseStamped, 'estimate', RELIABLE_QOS)
    fixes = probe.publisher(PoseWithCovarianceStamped, 'amcl_pose', MAP_QOS)
    poses = probe.publisher(Odometry, 'odom', RELIABLE_QOS)
    wait_for(lambda: probe.node.count_publishers('estimate') > 0)
    fixes.publish(pose_on_map(5, 4.0, 3.0, -1.0))
    node.wait_output('covariance')
    fixes.publish(pose_on_map(5, 4.0, 3.0, 0.25))
    wait_for(lambda: estimates)
    first = estimates[0].pose.position
    assert (first.x, first.y, first.z) == (4.0, 3.0, 0.5)
    poses.publish(odometry(6, 1.0, 1.0))
    poses.publish(odometry(7, 2.0, 1.0))
    wait_for(lambda: len(estimates) == 3)
    assert estimates[-1].pose.position.x == pytest.approx(5.0)
    assert to_nanoseconds(estimates[-1].header.stamp) == 7


def test_a_covariance_that_is_none() -> None:
    """Not finite, not symmetric, or with a negative variance."""
    validate_pose_with_covariance(pose_on_map(1, 0.0, 0.0, 0.0), ('map',))
    for index, value in ((0, math.nan), (1, 0.5), (7, -0.1)):
        message = pose_on_map(1, 0.0, 0.0, 0.01)
        message.pose.covariance[index] = value
        with pytest.raises(InvalidMessage, match='covariance'):
            validate_pose_with_covariance(message)


@pytest.mark.skipif(find_spec('tf2_ros') is not None, reason='tf2_ros is installed')
def test_tf_without_tf2_ros_is_refused(node_process: StartNode) -> None:
    """With one sentence that says why."""
    node = node_process(NODE, {'source': 'tf'})
    assert node.process.wait(60) == 1
    assert "tf2_ros is not installed, so no pose can come from 'tf'" in node.output


class Missing(Exception):  # noqa: N818 - tf2_ros calls it TransformException
    """A transform that is not known."""


def test_from_tf(monkeypatch: pytest.MonkeyPatch) -> None:
    """What tf2_ros knows of the base frame in the map's frame, each stamp once."""
    known: dict[tuple[str, str], TransformStamped] = {}

    class Buffer:
        def lookup_transform(self, parent: str, child: str, _: object) -> TransformStamped:
            if (parent, child) not in known:
                raise Missing
            return known[parent, child]

    stub: Any = ModuleType('tf2_ros')
    stub.Buffer, stub.TransformException = Buffer, Missing
    stub.TransformListener = lambda buffer, node: (buffer, node)
    monkeypatch.setitem(sys.modules, 'tf2_ros', stub)
    timers: list[Callable[[], None]] = []
    node: Any = SimpleNamespace(create_timer=lambda _, callback: timers.append(callback))
    estimates: list[PoseEstimate] = []
    frames = {'map_frame': 'map', 'odom_frame': 'odom', 'base_frame': 'base_link'}
    PoseSource(node, 'tf', estimates.append, **frames)
    [look_up] = timers
    look_up()
    assert not estimates
    transform = TransformStamped(header=header(9, 'map'), child_frame_id='base_link')
    transform.transform.translation.x = 1.5
    transform.transform.rotation = to_quaternion(0.5)
    known['map', 'base_link'] = transform
    look_up()
    look_up()
    [estimate] = estimates
    assert estimate.stamp == 9
    assert estimate.pose == pytest.approx((1.5, 0.0, 0.5))
    transform.transform.translation.y = math.nan
    transform.header = header(10, 'map')
    look_up()
    assert len(estimates) == 1
