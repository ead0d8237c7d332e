"""What follows a run for the terminal."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest
from geometry_msgs.msg import Point
from nav_msgs.msg import Path
from visualization_msgs.msg import Marker, MarkerArray

from gridnav.ros.conversions import to_path_of_points
from gridnav.ros.qos import MAP_QOS, MARKER_QOS
from vgdp_bringup.watcher import RunWatcher

if TYPE_CHECKING:
    from tests.ros_helpers import Probe


def test_the_value_is_that_of_the_chosen_plan(probe: Probe) -> None:
    """A planner that stops has no plan, and no candidate is like that."""
    chosen = Marker(text='-3.25', points=[Point(x=1.0, y=2.0)])
    markers = [Marker(action=Marker.DELETEALL), Marker(text='-9', points=[Point()]), chosen]
    with RunWatcher(int(os.environ['ROS_DOMAIN_ID'])) as watcher:
        plans = probe.publisher(Path, '/plan', MAP_QOS)
        candidates = probe.publisher(MarkerArray, '/plan_candidates', MARKER_QOS)
        for points, shown in ([(1.0, 2.0)], markers), ([], markers[:1]):
            plans.publish(to_path_of_points(points, stamp=5, frame_id='map'))
            for _ in range(100):
                watcher.spin(0.05)
                if watcher.progress.plan == points:
                    break
            candidates.publish(MarkerArray(markers=shown))
            watcher.spin(0.5)
            assert watcher.progress.plan == points
            assert watcher.progress.value == pytest.approx(-3.25)
