"""Searching a home for a thing in one process: player, mapper and planner, as over ROS.

Views come from the scene, the mapper makes a map of them, the cycle that the planner's node has
makes the planning grid, and what was committed is carried out step by step. Nobody sees more of
the scene than the views of the positions where the robot was.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gridnav import DONE
from gridnav.metrics import Outcome
from vgdp_experiments.search.mapping import SceneMapper
from vgdp_experiments.search.noise import Sensors
from vgdp_experiments.search.searchers import Sight
from vgdp_planner.cycle import Decision, PlanningCycle
from vgdp_planner.planning_grid import GridSettings, OccupiedError, OutsideMapError

if TYPE_CHECKING:
    from collections.abc import Callable

    from avd_player.simulation import ActiveVisionSimulation
    from gridnav.metrics import EpisodeResult
    from vgdp_experiments.search.searchers import Searcher
    from vgdp_experiments.search.views import SmallViews
    from vgdp_planner.cycle import Observation

IMAGE_WIDTH = 480
"""Pixels."""

STEP_M = 0.3
"""Side of the grid of positions."""

ROBOT_RADIUS_M = 0.2
GOAL_TOLERANCE_M = 1.5
"""Bottles stand on tables and counters."""

GOAL_REACH_M = 0.8
"""Done succeeds within 1 m, and where a bottle was seen to be may be wrong by some decimetres."""

BLOCKED_AFTER = 1
"""Moves of a scene's robot do not slip: where one leads nowhere there is something."""

CLOSER_LOOK_CELLS = 3
"""A bottle is not seen from as far as floor and walls are."""

NANOSECONDS_A_STEP = 1_000_000_000


@dataclass(frozen=True)
class SearchStep:
    """What there is to show of a step.

    Attributes:
        observation: What was planned on.
        committed: What was decided.
    """

    observation: Observation
    committed: list[int]


def search(
    simulation: ActiveVisionSimulation,
    searcher: Searcher,
    seed: int,
    *,
    mapper: SceneMapper | None = None,
    start: int | None = None,
    on_step: Callable[[SearchStep], None] | None = None,
) -> EpisodeResult:
    """Search a scene once, from a start drawn from the seed.

    Done is said only where the goal is confirmed: one that the robot got to without being sure of
    it is given up instead, and the search goes on.

    Args:
        simulation: The scene and what is looked for.
        searcher: Decides.
        seed: Of the start, and of what the searcher draws.
        mapper: Maps what the robot senses; one for all searches of a scene saves most of the
            time. The scene as it is, mapped anew, if None.
        start: Index of the position to start from instead.
        on_step: Called after each decision.
    """
    mapper = mapper or SceneMapper(Sensors(simulation.scene))
    mapper.clear()
    simulation.restart(seed, start)
    searcher.reset(seed)
    settings = GridSettings(
        ROBOT_RADIUS_M, STEP_M, goal_tolerance=GOAL_TOLERANCE_M, goal_reach=GOAL_REACH_M
    )
    cycle = PlanningCycle(settings, BLOCKED_AFTER, CLOSER_LOOK_CELLS)
    cycle.begin(0)
    stamp = 0
    _take_in(simulation, mapper, cycle, stamp)
    while simulation.outcome is Outcome.RUNNING:
        try:
            observation, committed = _decide(
                cycle, searcher, partial(mapper.sensors.views, simulation.looked_at)
            )
        except (OccupiedError, OutsideMapError):
            # What is mapped leaves no place for the robot, and standing still changes nothing.
            committed = []
        if not committed:
            simulation.give_up()
            break
        committed = cycle.to_send(committed)
        if committed == [DONE] and simulation.goal and not simulation.sightings.confirmed:
            simulation.doubt()
            _say_goal(simulation, cycle, stamp)
            continue
        grid = observation.grid
        cycle.planned(
            observation,
            Decision(committed, grid.start, DONE in committed, np.empty((0, 2))),
        )
        if on_step is not None:
            on_step(SearchStep(observation, committed))
        for action in committed:
            if simulation.outcome is not Outcome.RUNNING:
                break
            simulation.step(action)
            stamp += NANOSECONDS_A_STEP
            if action != DONE:
                _take_in(simulation, mapper, cycle, stamp)
    return simulation.result()


def _decide(
    cycle: PlanningCycle, searcher: Searcher, views: Callable[[], SmallViews]
) -> tuple[Observation, list[int]]:
    """Return what to plan on and what is decided, as the planner's node does."""
    observation = cycle.observation()
    if observation is None:
        msg = f'The cycle waits for {cycle.waiting_for}, which never comes.'
        raise RuntimeError(msg)
    committed = searcher.decide(Sight(observation.grid, views))
    while not committed:
        again = cycle.reopened(observation)
        if again is None:
            break
        observation, committed = again, searcher.decide(Sight(again.grid, views))
    return observation, committed


def _take_in(
    simulation: ActiveVisionSimulation, mapper: SceneMapper, cycle: PlanningCycle, stamp: int
) -> None:
    """Map what the robot sees now, and tell the cycle of it."""
    mapper.look(simulation.looked_at)
    pose = mapper.sensors.pose(simulation.heading_name)
    cycle.add_pose(stamp, pose.x, pose.y)
    cycle.add_map(stamp, mapper.grid.occupancy, mapper.grid.geometry)
    _say_goal(simulation, cycle, stamp)


def _say_goal(simulation: ActiveVisionSimulation, cycle: PlanningCycle, stamp: int) -> None:
    goal = simulation.goal
    if goal is None:
        cycle.forget_goal()
    else:
        cycle.set_goal(stamp, goal[0], goal[1])
