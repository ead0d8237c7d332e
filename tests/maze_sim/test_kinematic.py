"""The robot on two driven wheels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from maze_sim import Maze, make_mazes
from maze_sim.kinematic import KinematicSimulation, RobotConfig

QUIET = RobotConfig(odometry_noise=0.0, pose_noise=0.0)


def hall(length: int = 9) -> Maze:
    """Return a corridor from west to east with the goal at its end."""
    blocked = np.ones((3, length), dtype=np.bool_)
    blocked[1, 1:-1] = False
    goal = (1, length - 2)
    return Maze(blocked, (1, 1), goal, length - 3, float(length - 3))


def test_it_drives_straight_and_on_circles() -> None:
    """A quarter of a circle of one metre ends a metre ahead and a metre to the left."""
    robot = KinematicSimulation(hall(), 4.0, 0.2, QUIET)
    assert robot.pose[:2] == (6.0, 6.0)
    robot.drive(0.5, 0.0, 1.0)
    assert robot.pose == pytest.approx((6.5, 6.0, 0.0))
    robot.drive(0.5, 0.5, math.pi)
    assert robot.pose == pytest.approx((7.5, 7.0, math.pi / 2))
    assert robot.odometry == pytest.approx((1.5, 1.0, math.pi / 2))
    assert robot.time == pytest.approx(1 + math.pi)


def test_commands_are_cut_and_must_be_finite() -> None:
    """No robot is faster than its wheels."""
    robot = KinematicSimulation(hall(), config=QUIET)
    robot.drive(50.0, 0.0, 0.5)
    assert robot.pose.x == pytest.approx(2.0)
    with pytest.raises(ValueError, match='nan'):
        robot.drive(math.nan, 0.0, 0.1)


def test_touching_a_wall_is_a_collision() -> None:
    """By its round body; an ended episode stands still."""
    robot = KinematicSimulation(hall(), config=QUIET)
    robot.drive(0.0, 1.0, math.pi / 2)
    robot.drive(0.5, 0.0, 0.58)
    assert str(robot.outcome) == 'running'
    robot.drive(0.5, 0.0, 0.06)
    assert str(robot.outcome) == 'collision'
    before = robot.pose
    robot.drive(-0.5, 0.0, 1.0)
    assert robot.pose == before


def test_success_is_to_stand_still_at_the_goal() -> None:
    """Driving over it is not enough."""
    robot = KinematicSimulation(hall(), config=QUIET)
    robot.drive(1.0, 0.0, 6.0)
    assert str(robot.outcome) == 'running'
    robot.drive(0.0, 0.0, 0.1)
    assert str(robot.outcome) == 'success'
    assert robot.distance == pytest.approx(6.0)


def test_time_runs_out() -> None:
    """Also for a robot that does nothing."""
    robot = KinematicSimulation(hall(), config=QUIET, max_time=2.0)
    robot.drive(0.0, 0.0, 1.9)
    assert str(robot.outcome) == 'running'
    robot.drive(0.0, 0.0, 0.2)
    assert str(robot.outcome) == 'timeout'


def test_the_map_grows_and_is_true() -> None:
    """It shows what the beams reach, walls and free, and nothing behind walls."""
    [maze] = make_mazes(1, 15, 3)
    robot = KinematicSimulation(maze, 1.0, 0.1, QUIET)
    occupancy, before = robot.map()
    truth = maze.blocked.repeat(10, axis=0).repeat(10, axis=1)
    row, col = round(before.origin_y / 0.1), round(before.origin_x / 0.1)
    part = truth[row : row + before.rows, col : col + before.cols]
    assert part[occupancy == 100].all()
    assert not part[occupancy == 0].any()
    assert (occupancy == 100).any()
    assert (occupancy == 0).sum() > 50
    hidden = np.pad(truth, 1, constant_values=True)
    deep = hidden[:-2, 1:-1] & hidden[2:, 1:-1] & hidden[1:-1, :-2] & hidden[1:-1, 2:] & truth
    behind = occupancy[deep[row : row + before.rows, col : col + before.cols]]
    # A beam that slips between two corners ends in the middle of a wall.
    assert (behind == 100).sum() < 0.05 * (occupancy == 100).sum()
    assert not (behind == 0).any()
    robot.drive(0.5, 0.0, 0.5)
    robot.look()
    assert np.count_nonzero(robot.map()[0] >= 0) >= np.count_nonzero(occupancy >= 0)


def test_the_goal_is_seen_when_the_beams_reach_it() -> None:
    """Three metres, and not from the start of the corridor."""
    robot = KinematicSimulation(hall(), config=QUIET)
    assert not robot.goal_seen
    assert robot.goal == (7.5, 1.5)
    robot.drive(1.0, 0.0, 3.5)
    robot.look()
    assert robot.goal_seen


def test_noise() -> None:
    """Odometry drifts by the seed, and the pose on the map is as good as its covariance says."""
    noisy = RobotConfig(odometry_noise=0.05, pose_noise=0.1)

    def end(seed: int) -> tuple[float, float, float]:
        robot = KinematicSimulation(hall(), config=noisy, seed=seed)
        robot.drive(0.5, 0.0, 10.0)
        assert robot.pose == pytest.approx((6.5, 1.5, 0.0))
        return robot.odometry

    assert end(1) == end(1)
    ends = np.array([end(seed) for seed in range(40)])
    assert 0.05 < ends[:, 0].std() < 0.2
    robot = KinematicSimulation(hall(), config=noisy)
    fixes = [robot.fix(7) for _ in range(200)]
    spread = np.cov(np.array([fix.pose[:2] for fix in fixes]).T)
    assert fixes[0].covariance is not None
    assert spread == pytest.approx(fixes[0].covariance, abs=0.005)
