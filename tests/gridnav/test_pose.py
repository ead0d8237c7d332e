"""Poses, and odometry with what corrects it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gridnav.pose import Pose2D, PoseEstimate, PoseTracker

poses = st.builds(Pose2D, st.floats(-100, 100), st.floats(-100, 100), st.floats(-math.pi, math.pi))


@given(poses, poses)
def test_inverse(first: Pose2D, second: Pose2D) -> None:
    """What is moved by a pose and its inverse comes back."""
    back = first.inverse().compose(first.compose(second))
    assert back[:2] == pytest.approx(second[:2], abs=1e-9)
    assert math.remainder(back.yaw - second.yaw, math.tau) == pytest.approx(0, abs=1e-9)


def test_a_quarter_turn() -> None:
    """Ahead of a robot that looks north is north."""
    assert Pose2D(1, 2, math.pi / 2).compose(Pose2D(3, 0, 0)) == pytest.approx((1, 5, math.pi / 2))


def test_odometry_moves_the_last_pose_on_the_map() -> None:
    """The odometry's frame is where the pose on the map says, at the pose's own time."""
    tracker = PoseTracker()
    tracker.add_odometry(10, Pose2D(5, 5, 0))
    assert tracker.estimate is None
    tracker.add_odometry(20, Pose2D(6, 5, 0))
    tracker.add_odometry(30, Pose2D(7, 5, 0))
    covariance = np.eye(2)
    tracker.add_fix(PoseEstimate(21, Pose2D(1, 1, math.pi / 2), covariance))
    assert tracker.estimate is not None
    assert tracker.estimate.stamp == 30
    assert tracker.estimate.pose == pytest.approx((1, 2, math.pi / 2))
    assert tracker.estimate.covariance is covariance
    tracker.add_odometry(40, Pose2D(7, 6, 0))
    assert tracker.estimate.pose == pytest.approx((0, 2, math.pi / 2))


def test_a_pose_on_the_map_alone() -> None:
    """It counts until odometry comes, and is where that begins."""
    tracker = PoseTracker()
    fix = PoseEstimate(5, Pose2D(1, 1, 0))
    tracker.add_fix(fix)
    assert tracker.estimate is fix
    tracker.add_odometry(9, Pose2D(50, 0, 0))
    assert tracker.estimate is not None
    assert tracker.estimate.pose == pytest.approx((1, 1, 0))


def test_a_clock_that_went_back() -> None:
    """Old odometry is forgotten: no pose on the map is matched with it."""
    tracker = PoseTracker()
    tracker.add_odometry(1000, Pose2D(9, 9, 0))
    tracker.add_odometry(10, Pose2D(1, 0, 0))
    tracker.add_fix(PoseEstimate(999, Pose2D(4, 4, 0)))
    assert tracker.estimate is not None
    assert tracker.estimate.stamp == 10
    assert tracker.estimate.pose == pytest.approx((4, 4, 0))


def test_a_pose_on_the_map_that_overtakes_its_odometry() -> None:
    """Until that comes the former one counts."""
    tracker = PoseTracker()
    tracker.add_odometry(10, Pose2D(0, 0, 0))
    tracker.add_fix(PoseEstimate(10, Pose2D(5, 0, 0)))
    tracker.add_fix(PoseEstimate(20, Pose2D(6.1, 0, 0)))
    assert tracker.estimate is not None
    assert tracker.estimate.pose == pytest.approx((5, 0, 0))
    tracker.add_odometry(20, Pose2D(1, 0, 0))
    assert tracker.estimate.pose == pytest.approx((6.1, 0, 0))
    tracker.add_odometry(30, Pose2D(2, 0, 0))
    assert tracker.estimate.pose == pytest.approx((7.1, 0, 0))
