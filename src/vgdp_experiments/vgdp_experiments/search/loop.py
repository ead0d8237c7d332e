"""Searching a home for a thing in one process: player, mapper and planner, as over ROS.

Views come from the scene, the mapper makes a map of them, the cycle that the planner's node has
makes the planning grid, and what was committed is carried out step by step. Nobody sees more of
the scene than the views of the positions where the robot was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from avd_player.sources import mounted_pose
from bev_mapper.rgbd_mapper import MapperConfig, RgbdMapper
from gridnav import DONE, GridGeometry
from gridnav.metrics import Outcome
from gridnav.rgbd import Pose3D
from vgdp_experiments.search.searchers import Sight
from vgdp_planner.cycle import Decision, PlanningCycle
from vgdp_planner.planning_grid import GridSettings

if TYPE_CHECKING:
    from collections.abc import Callable

    from avd_player.simulation import ActiveVisionSimulation
    from bev_mapper.segmentation import Segmenter
    from gridnav.metrics import EpisodeResult
    from gridnav.rgbd import RgbdFrame
    from vgdp_experiments.search.searchers import Searcher
    from vgdp_planner.cycle import Observation

STEP_M = 0.3
"""Side of the grid of positions."""

MAP_CELL_M = 0.1
MAP_CELLS = 45
"""The map begins with so many rows and columns."""

GROWTH_CELLS = 15
"""It grows by whole blocks."""

FREE_BELOW_M = 1.2
"""The camera does not see the floor beside the robot. What it looks over from all around is taken
to be free, rather than searched step by step."""

MAPPED_RANGE_M = 3.0
"""What is further away is not mapped: a bottle there would not be seen yet."""

ROBOT_RADIUS_M = 0.2
GOAL_TOLERANCE_M = 1.5
"""Bottles stand on tables and counters."""

BLOCKED_AFTER = 1
"""Moves of a scene's robot do not slip: where one leads nowhere there is something."""

CLOSER_LOOK_CELLS = 3
"""A bottle is not seen from as far as floor and walls are."""

NANOSECONDS_A_STEP = 1_000_000_000


def mapper_config() -> MapperConfig:
    """Return how a home is mapped: the positions lie in the middle of cells."""
    corner = -MAP_CELL_M * MAP_CELLS / 2
    geometry = GridGeometry(MAP_CELLS, MAP_CELLS, MAP_CELL_M, corner, corner)
    return MapperConfig(
        geometry=geometry,
        growth=GROWTH_CELLS,
        free_below=FREE_BELOW_M,
        max_range=MAPPED_RANGE_M,
    )


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
    segmenter: Segmenter | None = None,
    start: int | None = None,
    on_step: Callable[[SearchStep], None] | None = None,
) -> EpisodeResult:
    """Search a scene once, from a start drawn from the seed.

    Args:
        simulation: The scene and what is looked for.
        searcher: Decides.
        seed: Of the start, and of what the searcher draws.
        segmenter: What the mapper tells floor from obstacles by, the geometric one if None.
        start: Index of the position to start from instead.
        on_step: Called after each decision.
    """
    simulation.restart(seed, start)
    searcher.reset(seed)
    mapper = RgbdMapper(mapper_config(), segmenter)
    settings = GridSettings(ROBOT_RADIUS_M, STEP_M, goal_tolerance=GOAL_TOLERANCE_M)
    cycle = PlanningCycle(settings, BLOCKED_AFTER, CLOSER_LOOK_CELLS)
    cycle.begin(0)
    stamp = 0
    _take_in(simulation, mapper, cycle, stamp)
    while simulation.outcome is Outcome.RUNNING:
        observation, committed = _decide(cycle, searcher, partial(_views, simulation, stamp))
        if not committed:
            simulation.give_up()
            break
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
    cycle: PlanningCycle, searcher: Searcher, views: Callable[[], list[RgbdFrame]]
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


def _views(simulation: ActiveVisionSimulation, stamp: int) -> list[RgbdFrame]:
    """Return what the robot sees now."""
    scene = simulation.scene
    return [
        replace(
            scene.frame(name),
            stamp=stamp,
            pose=mounted_pose(scene.source, name),
            mount=scene.source.mount,
        )
        for name in simulation.looked_at
    ]


def _take_in(
    simulation: ActiveVisionSimulation, mapper: RgbdMapper, cycle: PlanningCycle, stamp: int
) -> None:
    """Map what the robot sees now, and tell the cycle of it."""
    pose = Pose3D()
    for frame in _views(simulation, stamp):
        mapper.add(frame)
        pose = frame.pose
    cycle.add_pose(stamp, pose.x, pose.y)
    cycle.add_map(stamp, mapper.grid.occupancy, mapper.grid.geometry)
    goal = simulation.goal
    if goal is not None:
        cycle.set_goal(stamp, goal[0], goal[1])
