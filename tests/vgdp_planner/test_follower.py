"""Following a path with two driven wheels."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gridnav import GridGeometry
from gridnav.pose import Pose2D
from maze_sim import Maze
from maze_sim.kinematic import KinematicSimulation, RobotConfig
from vgdp_planner.follower import FollowerSettings, PathFollower

PERIOD = 0.05


def straight(length: float = 3.0) -> np.ndarray:
    """Return a path to the east."""
    return np.stack([np.arange(0, length, 0.05), np.zeros(round(length / 0.05))], axis=-1)


def follower(path: np.ndarray, **changes: float) -> PathFollower:
    """Return one that follows a path."""
    made = PathFollower(FollowerSettings(**changes))
    made.set_path(path)
    return made


def test_without_a_plan_it_stands() -> None:
    """Also with an empty one, and after a stop."""
    made = PathFollower(FollowerSettings())
    assert made.command(Pose2D(), PERIOD).reason == 'no plan'
    made.set_path(straight())
    assert made.command(Pose2D(), PERIOD).reason == 'driving'
    made.stop()
    command = made.command(Pose2D(), PERIOD)
    assert (command.speed, command.turn_rate, command.reason) == (0.0, 0.0, 'no plan')


def test_it_turns_on_the_spot_where_the_path_is_behind_it() -> None:
    """To the nearer side."""
    for yaw, sign in ((2.0, -1), (-2.0, 1), (3.1, -1)):
        command = follower(straight()).command(Pose2D(0, 0, yaw), PERIOD)
        assert command.reason == 'turning'
        assert command.speed == 0
        assert math.copysign(1, command.turn_rate) == sign


@given(st.floats(-1, 4), st.floats(-1, 1), st.floats(-4, 4), st.floats(0.1, 2))
def test_commands_keep_the_limits(x: float, y: float, yaw: float, limit: float) -> None:
    """Wherever the robot is: speed, turn rate, and no driving backwards."""
    made = follower(straight(), max_speed=limit, max_turn_rate=limit)
    for _ in range(3):
        command = made.command(Pose2D(x, y, yaw), PERIOD)
        assert 0 <= command.speed <= limit + 1e-9
        assert abs(command.turn_rate) <= limit + 1e-9


def test_it_gains_speed_slowly_and_brakes_at_the_end() -> None:
    """And arrives within the tolerance."""
    made = follower(straight(), max_acceleration=1.0)
    speeds = [made.command(Pose2D(0.5, 0, 0), PERIOD).speed for _ in range(20)]
    assert speeds[0] < 0.1
    assert speeds == sorted(speeds)
    assert speeds[-1] == pytest.approx(0.4)
    assert made.command(Pose2D(2.83, 0, 0), PERIOD).speed <= 0.4
    assert made.command(Pose2D(2.9, 0, 0), PERIOD).reason == 'arrived'


def test_an_obstacle_in_the_newest_map_stops_it() -> None:
    """On the way ahead and near it; not behind, not far ahead, not beside."""
    geometry = GridGeometry(60, 100, 0.05, -1.0, -1.5)

    def reason(x: float, y: float) -> str:
        occupancy = np.zeros((60, 100), dtype=np.int8)
        occupancy[geometry.cell_at(x, y)] = 100
        made = follower(straight(), robot_radius=0.2)
        made.set_map(occupancy, geometry)
        return made.command(Pose2D(1.0, 0, 0), PERIOD).reason

    assert reason(1.4, 0.0) == 'obstacle'
    assert reason(1.4, 0.17) == 'obstacle'
    assert reason(1.4, 0.3) == 'driving'
    assert reason(0.5, 0.0) == 'driving'
    assert reason(2.5, 0.0) == 'driving'


def test_a_robot_too_near_to_a_wall_may_leave_it() -> None:
    """The path leads away from it."""
    geometry = GridGeometry(60, 100, 0.05, -1.0, -1.5)
    occupancy = np.zeros((60, 100), dtype=np.int8)
    occupancy[:, geometry.cell_at(-0.1, 0)[1]] = 100
    made = follower(straight(), robot_radius=0.2)
    made.set_map(occupancy, geometry)
    assert made.command(Pose2D(0.0, 0, 0), PERIOD).reason == 'driving'


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_it_stays_on_the_path(seed: int) -> None:
    """Around random corners the robot is never far from it, and comes to its end."""
    rng = np.random.default_rng(seed)
    hall = np.ones((40, 40), dtype=np.bool_)
    hall[1:-1, 1:-1] = False
    robot = KinematicSimulation(
        Maze(hall, (20, 20), (1, 1), 19, 19.0), 1.0, 0.5, RobotConfig(odometry_noise=0.0)
    )
    corners = [np.array(robot.pose[:2])]
    for angle in np.cumsum(rng.choice([-1, 1], 8)) * math.pi / 2:
        corners.append(corners[-1] + [round(math.cos(angle)), round(math.sin(angle))])
    path = np.concatenate(
        [
            begin + np.linspace(0, 1, 20, endpoint=False)[:, None] * (end - begin)
            for begin, end in pairwise(corners)
        ]
    )
    made = follower(path, max_speed=0.6, max_turn_rate=2.0, lookahead=0.3)
    for _ in range(900):
        command = made.command(robot.pose, PERIOD)
        if command.reason == 'arrived':
            break
        robot.drive(command.speed, command.turn_rate, PERIOD)
        assert np.hypot(*(path - np.array(robot.pose[:2])).T).min() < 0.15
    assert command.reason == 'arrived'


def test_a_path_that_comes_back_is_followed_to_its_turn() -> None:
    """Its end is beside the robot from the beginning."""
    out = straight(1.5)
    made = follower(np.concatenate([out, out[::-1]]))
    x, yaw, furthest = 0.0, 0.0, 0.0
    for _ in range(600):
        command = made.command(Pose2D(x, 0.0, yaw), PERIOD)
        if command.reason == 'arrived':
            break
        yaw += command.turn_rate * PERIOD
        x += command.speed * PERIOD * math.cos(yaw)
        furthest = max(furthest, x)
        made.set_path(np.concatenate([out, out[::-1]]))
    assert command.reason == 'arrived'
    assert furthest > 1.2
