"""When the planner plans for a robot that moves by itself."""

from __future__ import annotations

import numpy as np
import pytest

from gridnav import DONE, FREE, GOAL, GridGeometry
from gridnav.pose import Pose2D, PoseEstimate
from vgdp_planner.cycle import Decision, Observation
from vgdp_planner.free_cycle import FreeCycle
from vgdp_planner.planning_grid import GridSettings

GEOMETRY = GridGeometry(40, 60, 0.05)
"""Ten by fifteen blocks."""


def room() -> np.ndarray:
    """Return a map, free on the left and unseen on the right."""
    occupancy = np.full(GEOMETRY.shape, -1, dtype=np.int8)
    occupancy[:, :30] = 0
    return occupancy


def at(x: float, y: float = 1.1, stamp: int = 5, **more: np.ndarray) -> PoseEstimate:
    """Put the robot somewhere."""
    return PoseEstimate(stamp, Pose2D(x, y, 0.0), **more)


@pytest.fixture
def cycle() -> FreeCycle:
    """Return a cycle that knows a map and a robot."""
    made = FreeCycle(GridSettings(0.1, 0.2))
    assert made.waiting_for == 'a map'
    made.add_map(3, room(), GEOMETRY)
    assert made.waiting_for == 'a pose'
    made.add_pose(at(0.3))
    return made


def go(cycle: FreeCycle, *, blocks: int = 2, done: bool = False) -> Observation:
    """Decide to go some blocks to the right, committing two of them."""
    observation = cycle.observation()
    assert observation is not None
    grid = observation.grid
    row, col = grid.start
    cells = [(row, col + step) for step in range(blocks + 1)]
    moves = min(2, blocks)
    decision = Decision([2] * moves + [DONE] * done, cells[moves], done, grid.way(cells))
    cycle.planned(observation, decision)
    return observation


def test_map_and_pose_need_no_equal_stamps(cycle: FreeCycle) -> None:
    """The plan is made on the newest of both, and has the newer stamp."""
    observation = go(cycle)
    assert observation.stamp == 5
    assert not observation.in_step
    assert observation.belief is None
    assert observation.grid.geometry.resolution == pytest.approx(0.2)
    cycle.add_map(7, room(), GEOMETRY)
    assert cycle.observation() is None


def test_plans_again_where_the_committed_steps_end(cycle: FreeCycle) -> None:
    """As soon as the robot is in that block; then the memory is in step."""
    go(cycle, blocks=4)
    for x in (0.35, 0.45, 0.58):
        cycle.add_pose(at(x))
        assert cycle.observation() is None
    cycle.add_pose(at(0.62, stamp=9))
    observation = cycle.observation()
    assert observation is not None
    assert observation.in_step
    assert observation.stamp == 9


def test_plans_again_when_the_way_is_blocked(cycle: FreeCycle) -> None:
    """By the newest map, ahead of the robot; what is behind it does not matter."""
    go(cycle, blocks=6)
    cycle.add_pose(at(0.55))
    occupancy = room()
    occupancy[:, 4] = 100
    cycle.add_map(8, occupancy, GEOMETRY)
    assert cycle.observation() is None
    occupancy = room()
    occupancy[20:24, 25] = 100
    cycle.add_map(9, occupancy, GEOMETRY)
    observation = cycle.observation()
    assert observation is not None
    assert not observation.in_step


def test_plans_again_for_another_goal(cycle: FreeCycle) -> None:
    """And not when the same one is said again."""
    go(cycle)
    cycle.set_goal(6, 1.1, 0.3)
    observation = go(cycle)
    assert observation.grid.partial_map[GOAL].any()
    cycle.set_goal(7, 1.1, 0.3)
    assert cycle.observation() is None


def test_a_robot_that_does_not_move_is_planned_for_again(cycle: FreeCycle) -> None:
    """When overdue; but not one that is at its goal, or has nowhere to go."""
    go(cycle)
    assert cycle.observation() is None
    assert cycle.observation(overdue=True) is not None
    cycle.set_goal(6, 0.3, 1.1)
    go(cycle, blocks=0, done=True)
    assert cycle.observation(overdue=True) is None


def test_a_robot_with_nowhere_to_go_waits_for_another_map(cycle: FreeCycle) -> None:
    """Any one: it may have opened a door."""
    observation = cycle.observation()
    assert observation is not None
    stop = Decision([], observation.grid.start, done=False, way=np.zeros((0, 2)))
    cycle.planned(observation, stop)
    assert cycle.observation() is None
    assert cycle.observation(overdue=True) is None
    cycle.add_map(4, room(), GEOMETRY)
    assert cycle.observation() is not None


def test_where_the_robot_was_nothing_is_left_to_see(cycle: FreeCycle) -> None:
    """Even if the map never shows it."""
    cycle.add_pose(at(2.1))
    observation = cycle.observation()
    assert observation is not None
    grid = observation.grid
    assert grid.partial_map[(FREE, *grid.start)] == 1
    cycle.planned(observation, Decision([DONE], grid.start, done=True, way=grid.way([grid.start])))
    cycle.add_pose(at(2.5))
    cycle.set_goal(6, 0.3, 1.1)
    observation = cycle.observation()
    assert observation is not None
    before = observation.grid.geometry.cell_at(2.1, 1.1)
    assert observation.grid.partial_map[(FREE, *before)] == 1


def test_moving_is_news(cycle: FreeCycle) -> None:
    """A quarter of a block or a turn, no trembling."""
    assert not cycle.add_pose(at(0.31))
    assert cycle.add_pose(at(0.4))
    assert not cycle.add_pose(at(0.4))
    assert cycle.add_pose(PoseEstimate(6, Pose2D(0.4, 1.1, 1.0)))


def test_a_covariance_becomes_a_belief(cycle: FreeCycle) -> None:
    """For the planner."""
    cycle.add_pose(at(0.5, covariance=np.eye(2) * 0.05))
    observation = cycle.observation()
    assert observation is not None
    assert observation.belief is not None
    assert np.count_nonzero(observation.belief) > 4


def test_an_episode_begins_and_ends(cycle: FreeCycle) -> None:
    """What is older is forgotten; after the end nothing is planned."""
    go(cycle)
    assert cycle.begin(100)
    cycle.add_map(99, room(), GEOMETRY)
    cycle.add_pose(at(0.3, stamp=101))
    assert cycle.observation() is None
    cycle.add_map(100, room(), GEOMETRY)
    go(cycle)
    cycle.finished = True
    cycle.set_goal(102, 1.0, 1.0)
    assert cycle.observation() is None


def test_what_came_before_the_word_of_its_episode_counts(cycle: FreeCycle) -> None:
    """A map, a pose and a goal of the episode stay; they may never be said again."""
    cycle.set_goal(5, 1.3, 1.1)
    observation = go(cycle)
    assert observation.grid.goal == 'ok'
    assert cycle.begin(3)
    again = go(cycle)
    assert again.stamp == observation.stamp
    assert again.grid.goal == 'ok'
    assert cycle.begin(4)
    assert cycle.waiting_for == 'a map'


def test_small_blocks_are_kept_once_they_were_needed() -> None:
    """Lest the grid changes with every map."""
    occupancy = np.full(GEOMETRY.shape, 100, dtype=np.int8)
    occupancy[1:-1, 1:-1] = 0
    # The goal is in the robot's block, but on the other side of a wall with a door far away.
    occupancy[:, 24] = 100
    occupancy[33:38, 24] = 0
    cycle = FreeCycle(GridSettings(0.0, 0.8))
    cycle.set_goal(1, 1.4, 1.1)
    cycle.add_map(5, occupancy, GEOMETRY)
    cycle.add_pose(at(1.0))
    first = go(cycle, blocks=0, done=True)
    assert first.grid.geometry.resolution < 0.8
    cycle.add_map(6, np.zeros_like(occupancy), GEOMETRY)
    cycle.set_goal(7, 0.3, 0.3)
    second = cycle.observation()
    assert second is not None
    assert second.grid.geometry.resolution == first.grid.geometry.resolution


def test_plans_again_at_the_end_of_the_way(cycle: FreeCycle) -> None:
    """Who follows it may never have been in the block of the committed steps."""
    go(cycle, blocks=4)
    cycle.add_pose(at(1.1))
    observation = cycle.observation()
    assert observation is not None
    assert not observation.in_step
