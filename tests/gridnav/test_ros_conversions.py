"""Messages from numbers and arrays, and back."""

from __future__ import annotations

import array
import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gridnav.grid import GridGeometry
from gridnav.ros import conversions as convert

coordinates = st.floats(-1e6, 1e6)
stamps = st.integers(0, 2**31 * convert.NANOSECONDS - 1)


@given(stamps)
def test_stamps_come_back(nanoseconds: int) -> None:
    """No nanosecond is lost."""
    stamp = convert.to_stamp(nanoseconds)
    assert 0 <= stamp.nanosec < convert.NANOSECONDS
    assert convert.to_nanoseconds(stamp) == nanoseconds


@given(st.floats(-math.pi, math.pi))
def test_yaw_comes_back(yaw: float) -> None:
    """As an angle, so -π and π are one."""
    back = convert.to_yaw(convert.to_quaternion(yaw))
    assert math.cos(back - yaw) == pytest.approx(1.0, abs=1e-12)


@given(
    occupancy=arrays(
        np.int8,
        st.tuples(st.integers(1, 8), st.integers(1, 8)),
        elements=st.integers(-1, 100),
    ),
    resolution=st.sampled_from([0.05, 0.1, 1.0, 0.3, 100.0]),
    x=coordinates,
    y=coordinates,
    stamp=stamps,
)
def test_occupancy_grids_come_back(
    occupancy: np.ndarray, resolution: float, x: float, y: float, stamp: int
) -> None:
    """Cells, placement and stamp survive; the resolution too, though it travels as a float32."""
    rows, cols = occupancy.shape
    geometry = GridGeometry(rows, cols, resolution, x, y)
    message = convert.to_occupancy_grid(occupancy, geometry, stamp=stamp, frame_id='map')
    assert isinstance(message.data, array.array)
    message.info.resolution = float(np.float32(message.info.resolution))
    cells, placement = convert.from_occupancy_grid(message)
    assert np.array_equal(cells, occupancy)
    assert placement == geometry
    assert convert.to_nanoseconds(message.header.stamp) == stamp


def test_rows_run_along_y_in_the_message() -> None:
    """Row-major from the lower-left corner, as nav_msgs says."""
    occupancy = np.array([[0, 100, -1], [100, 0, 0]], dtype=np.int8)
    message = convert.to_occupancy_grid(
        occupancy, GridGeometry(2, 3, 1.0), stamp=0, frame_id='map'
    )
    assert list(message.data) == [0, 100, -1, 100, 0, 0]
    assert (message.info.width, message.info.height) == (3, 2)


def test_grid_and_geometry_must_agree() -> None:
    """A grid of another shape is refused."""
    with pytest.raises(ValueError, match='geometry'):
        convert.to_occupancy_grid(
            np.zeros((2, 3), dtype=np.int8), GridGeometry(3, 2, 1.0), stamp=0, frame_id='map'
        )


def test_the_cells_can_be_written_to() -> None:
    """They are a copy, not a view of the message."""
    message = convert.to_occupancy_grid(
        np.zeros((2, 3), dtype=np.int8), GridGeometry(2, 3, 1.0), stamp=0, frame_id='map'
    )
    cells, _ = convert.from_occupancy_grid(message)
    cells[0, 0] = 100
    assert message.data[0] == 0


def test_a_large_grid_converts_fast() -> None:
    """Setting the data from a list or an ndarray takes a hundred times as long."""
    occupancy = np.zeros((1000, 1000), dtype=np.int8)
    began = time.perf_counter()
    convert.to_occupancy_grid(occupancy, GridGeometry(1000, 1000, 0.05), stamp=0, frame_id='map')
    assert time.perf_counter() - began < 0.1


def test_a_path_looks_where_it_goes() -> None:
    """Each pose looks to the next cell, the last ones keep the direction, staying is no turn."""
    cells = [(0, 0), (0, 1), (1, 1), (1, 1)]
    path = convert.to_path(cells, GridGeometry(2, 2, 1.0), stamp=5, frame_id='map')
    assert [(p.pose.position.x, p.pose.position.y) for p in path.poses] == [
        (0.5, 0.5),
        (1.5, 0.5),
        (1.5, 1.5),
        (1.5, 1.5),
    ]
    yaws = [convert.to_yaw(p.pose.orientation) for p in path.poses]
    assert yaws == pytest.approx([0, math.pi / 2, math.pi / 2, math.pi / 2])
    assert {p.header.frame_id for p in path.poses} == {'map'}
    assert all(convert.to_nanoseconds(p.header.stamp) == 5 for p in [path, *path.poses])


def test_an_empty_path_is_a_path() -> None:
    """It says: no plan."""
    path = convert.to_path([], GridGeometry(2, 2, 1.0), stamp=5, frame_id='map')
    assert list(path.poses) == []


def test_odometry_carries_pose_and_frames() -> None:
    """Pose in odom, twist zero."""
    message = convert.to_odometry(
        1.5, 2.5, math.pi / 2, stamp=7, frame_id='odom', child_frame_id='base_link'
    )
    assert (message.header.frame_id, message.child_frame_id) == ('odom', 'base_link')
    assert (message.pose.pose.position.x, message.pose.pose.position.y) == (1.5, 2.5)
    assert convert.to_yaw(message.pose.pose.orientation) == pytest.approx(math.pi / 2)
