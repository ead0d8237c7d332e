"""When the planner plans."""

from __future__ import annotations

import numpy as np
import pytest

from gridnav import DONE, FREE, GOAL, OBSTACLE, GridGeometry
from vgdp_planner.cycle import Decision, Observation, PlanningCycle
from vgdp_planner.planning_grid import GridSettings

GEOMETRY = GridGeometry(3, 4, 0.5)
OCCUPANCY = np.zeros((3, 4), dtype=np.int8)


def going(actions: int) -> Decision:
    """Decide to take some steps."""
    return Decision([2] * actions, (0, 0), done=False, way=np.zeros((0, 2)))


def seen(cycle: PlanningCycle, stamp: int, x: float = 0.25) -> None:
    """Give the cycle pose and map of one step."""
    cycle.add_pose(stamp, x, 0.25)
    cycle.add_map(stamp, OCCUPANCY, GEOMETRY)


def test_plans_once_on_each_observation() -> None:
    """An observation is there once; then one with a new stamp must come for each action."""
    cycle = PlanningCycle()
    seen(cycle, 10)
    observation = cycle.observation()
    assert observation is not None
    assert (observation.stamp, observation.grid.start) == (10, (0, 0))
    assert observation.grid.partial_map[FREE].all()
    cycle.planned(observation, going(2))
    seen(cycle, 10)
    assert cycle.observation() is None
    seen(cycle, 11, 0.75)
    assert cycle.observation() is None
    seen(cycle, 12, 1.25)
    observation = cycle.observation()
    assert observation is not None
    assert (observation.stamp, observation.grid.start) == (12, (0, 2))


def test_map_and_pose_must_be_of_one_step() -> None:
    """The map of an older step than the newest pose is not planned on, nor a newer one."""
    cycle = PlanningCycle()
    assert cycle.waiting_for == 'a map'
    cycle.add_map(5, OCCUPANCY, GEOMETRY)
    assert cycle.waiting_for == 'odom'
    cycle.add_pose(4, 0.1, 0.1)
    assert cycle.observation() is None
    cycle.add_pose(6, 0.1, 0.1)
    assert cycle.observation() is None
    assert cycle.waiting_for == 'a map of the newest odom'
    cycle.add_map(6, OCCUPANCY, GEOMETRY)
    assert cycle.observation() is not None
    cycle.add_map(5, OCCUPANCY, GEOMETRY)
    assert cycle.observation() is not None


def test_lost_actions_are_not_waited_for_forever() -> None:
    """When overdue, the newest complete observation is planned on again."""
    cycle = PlanningCycle()
    seen(cycle, 1)
    observation = cycle.observation()
    assert observation is not None
    cycle.planned(observation, going(2))
    assert cycle.observation() is None
    assert cycle.observation(overdue=True) is not None
    seen(cycle, 2)
    assert cycle.observation() is None
    assert cycle.observation(overdue=True) is not None
    cycle.add_pose(3, 0.1, 0.1)
    assert cycle.observation(overdue=True) is None


def test_a_new_episode_forgets_the_old_one() -> None:
    """What is older than the episode's start is ignored, its goal as well."""
    cycle = PlanningCycle()
    seen(cycle, 1)
    cycle.set_goal(1, 1.9, 1.4)
    observation = cycle.observation()
    assert observation is not None
    assert observation.grid.partial_map[GOAL, 2, 3] == 1
    cycle.begin(100)
    seen(cycle, 99)
    cycle.set_goal(99, 0.1, 0.1)
    assert cycle.observation() is None
    seen(cycle, 100)
    observation = cycle.observation()
    assert observation is not None
    assert not observation.grid.partial_map[GOAL].any()


def test_the_word_of_a_new_episode_may_come_late() -> None:
    """Map, pose and goal of the new episode that came before its announcement are kept."""
    cycle = PlanningCycle()
    seen(cycle, 100)
    cycle.set_goal(100, 1.9, 1.4)
    assert cycle.begin(100)
    observation = cycle.observation()
    assert observation is not None
    assert observation.grid.partial_map[GOAL, 2, 3] == 1


def test_an_episode_that_was_planned_on_is_not_new() -> None:
    """Announced after its first plan, an episode goes on: the actions sent are waited for."""
    cycle = PlanningCycle()
    seen(cycle, 100)
    observation = cycle.observation()
    assert observation is not None
    cycle.planned(observation, going(2))
    assert not cycle.begin(100)
    seen(cycle, 101)
    assert cycle.observation() is None
    seen(cycle, 102)
    assert cycle.observation() is not None
    assert cycle.begin(200)


def test_finished() -> None:
    """After the end of an episode nothing is planned until the next begins."""
    cycle = PlanningCycle()
    seen(cycle, 1)
    cycle.finished = True
    assert cycle.observation(overdue=True) is None
    cycle.begin(2)
    seen(cycle, 2)
    assert cycle.observation() is not None


def test_a_robot_off_the_map_is_named() -> None:
    """A pose off the map is an error that says where."""
    cycle = PlanningCycle()
    seen(cycle, 1, x=77.0)
    with pytest.raises(ValueError, match='77'):
        cycle.observation()


def test_only_a_new_stamp_is_news() -> None:
    """A pose that is said again, or of an older episode, is none."""
    cycle = PlanningCycle()
    cycle.begin(10)
    assert not cycle.add_pose(9, 0.1, 0.1)
    assert cycle.add_pose(10, 0.1, 0.1)
    assert not cycle.add_pose(10, 0.1, 0.1)


def test_old_poses_are_dropped() -> None:
    """Poses that come without end take no memory without end."""
    cycle = PlanningCycle()
    for stamp in range(5000):
        cycle.add_pose(stamp, 0.1, 0.1)
    cycle.add_map(4999, OCCUPANCY, GEOMETRY)
    assert cycle.observation() is not None


@pytest.mark.parametrize('settings', [GridSettings(), GridSettings(resolution=1.0)])
def test_a_place_that_cannot_be_stepped_on_is_an_obstacle(settings: GridSettings) -> None:
    """After so many steps that led nowhere, though the map is free there; until it is reopened."""
    cycle = PlanningCycle(settings, blocked_after=2)
    free, geometry = np.zeros((6, 8), dtype=np.int8), GridGeometry(6, 8, 0.5)
    side = settings.resolution or 0.5

    def at(stamp: int) -> Observation:
        cycle.add_pose(stamp, side / 2, side / 2)
        cycle.add_map(stamp, free, geometry)
        observation = cycle.observation()
        assert observation is not None
        return observation

    def ahead(observation: Observation) -> tuple[int, int]:
        return observation.grid.geometry.cell_at(1.5 * side, side / 2)

    for stamp in (10, 11):
        observation = at(stamp)
        assert observation.grid.partial_map[(FREE, *ahead(observation))] == 1
        # A step to the right, which the world does not let happen.
        cycle.planned(observation, going(1))
    observation = at(12)
    assert observation.grid.partial_map[(OBSTACLE, *ahead(observation))] == 1
    assert observation.grid.partial_map[(FREE, *ahead(observation))] == 0
    for _ in range(2):
        again = cycle.reopened(observation)
        assert again is not None
        assert again.grid.partial_map[(FREE, *ahead(again))] == 1
        for _ in range(2):
            cycle.planned(again, going(1))
            again = at(again.stamp + 1)
        observation = again
        assert observation.grid.partial_map[(OBSTACLE, *ahead(observation))] == 1
    assert cycle.reopened(observation) is None


def test_what_was_seen_from_afar_is_looked_at_again() -> None:
    """From nearer and nearer, until the goal is known or nothing is left to come nearer to."""
    cycle = PlanningCycle(closer_look=2)
    corridor, geometry = np.zeros((1, 9), dtype=np.int8), GridGeometry(1, 9, 0.5)

    def at(stamp: int, x: float) -> Observation:
        cycle.add_pose(stamp, x, 0.25)
        cycle.add_map(stamp, corridor, geometry)
        observation = cycle.observation()
        assert observation is not None
        return observation

    def free(observation: Observation) -> list[int]:
        return np.flatnonzero(observation.grid.partial_map[FREE]).tolist()

    observation = at(10, 0.25)
    assert free(observation) == list(range(9))
    again = cycle.reopened(observation)
    assert again is not None
    assert free(again) == [0, 1, 2]
    cycle.planned(again, going(1))
    again = at(11, 0.75)
    assert free(again) == [0, 1, 2, 3]
    last = cycle.reopened(again)
    assert last is not None
    assert free(last) == [0, 1, 2]
    assert cycle.reopened(last) is None
    cycle.set_goal(11, 4.25, 0.25)
    cycle.planned(last, going(1))
    assert len(free(at(12, 1.25))) == 9


def test_done_waits_until_the_robot_is_there() -> None:
    """Where a step may lead nowhere at once; by itself it is sent."""
    careful, other = PlanningCycle(blocked_after=1), PlanningCycle()
    assert careful.to_send([2, 3, DONE]) == [2, 3]
    assert careful.to_send([DONE]) == [DONE]
    assert careful.to_send([2, 3]) == [2, 3]
    assert other.to_send([2, DONE]) == [2, DONE]


def test_a_goal_is_taken_back() -> None:
    """The next observation has none."""
    cycle = PlanningCycle()
    cycle.begin(0)
    cycle.add_pose(0, 0.5, 0.5)
    cycle.add_map(0, np.zeros((5, 5), dtype=np.int8), GridGeometry(5, 5, 1.0))
    cycle.set_goal(0, 3.5, 3.5)
    assert cycle.grid_at((0.5, 0.5), (3.5, 3.5)).goal == 'ok'
    cycle.forget_goal()
    observation = cycle.observation()
    assert observation is not None
    assert observation.grid.goal == 'none'
