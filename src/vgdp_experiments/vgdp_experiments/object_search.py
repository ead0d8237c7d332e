"""Searching a home for a thing in one process: player, mapper and planner, as over ROS.

Views come from the scene, the mapper makes a map of them, the cycle that the planner's node has
makes the planning grid, and what was committed is carried out step by step. Nobody sees more of
the scene than the views of the positions where the robot was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from avd_player.sources import mounted_pose
from bev_mapper.rgbd_mapper import MapperConfig, RgbdMapper
from gridnav import DONE, GridGeometry
from gridnav.metrics import Outcome
from gridnav.rgbd import Pose3D
from vgdp_experiments.methods.frontier import NearestFrontier
from vgdp_planner.cycle import Decision, PlanningCycle
from vgdp_planner.planning_grid import GridSettings

if TYPE_CHECKING:
    from collections.abc import Callable

    from avd_player.simulation import ActiveVisionSimulation
    from bev_mapper.segmentation import Segmenter
    from gridnav.metrics import EpisodeResult
    from vgdp_planner.cycle import Observation
    from vgdp_planner.planner import ValueGuidedPlanner
    from vgdp_planner.planning_grid import PlanningGrid

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

NANOSECONDS_A_STEP = 1_000_000_000


class Searcher(Protocol):
    """Decides where to go on planning grids."""

    def reset(self, seed: int) -> None:
        """Begin an episode."""

    def decide(self, grid: PlanningGrid) -> list[int]:
        """Return the steps to take before deciding again, none to give up."""


class PlannerSearcher:
    """Lets the planner decide.

    Args:
        planner: The planner.
    """

    def __init__(self, planner: ValueGuidedPlanner) -> None:
        self._planner = planner

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._planner.reset(seed)

    def decide(self, grid: PlanningGrid) -> list[int]:
        """Return what the planner commits."""
        return self._planner.plan(grid.partial_map, grid.start).committed


class FrontierSearcher:
    """Goes to the nearest frontier of the same grids until the target is seen."""

    def __init__(self) -> None:
        self._explorer = NearestFrontier()
        self._geometry: GridGeometry | None = None

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._geometry = None
        self._explorer.reset(range(1), seed)

    def decide(self, grid: PlanningGrid) -> list[int]:
        """Return one step to the nearest frontier, or to the goal."""
        if grid.geometry != self._geometry:
            # It knows its target by a cell, which is another place now.
            self._geometry = grid.geometry
            self._explorer.reset(range(1), 0)
        cells, active = np.array([grid.start]), np.ones(1, dtype=np.bool_)
        return self._explorer.act(grid.partial_map[None], cells, active)[0]


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
    cycle = PlanningCycle(settings, BLOCKED_AFTER)
    cycle.begin(0)
    stamp = 0
    _take_in(simulation, mapper, cycle, stamp)
    while simulation.outcome is Outcome.RUNNING:
        observation, committed = _decide(cycle, searcher)
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


def _decide(cycle: PlanningCycle, searcher: Searcher) -> tuple[Observation, list[int]]:
    """Return what to plan on and what is decided, as the planner's node does."""
    observation = cycle.observation()
    if observation is None:
        msg = f'The cycle waits for {cycle.waiting_for}, which never comes.'
        raise RuntimeError(msg)
    committed = searcher.decide(observation.grid)
    again = None if committed else cycle.reopened(observation)
    if again is not None:
        observation, committed = again, searcher.decide(again.grid)
    return observation, committed


def _take_in(
    simulation: ActiveVisionSimulation, mapper: RgbdMapper, cycle: PlanningCycle, stamp: int
) -> None:
    """Map what the robot sees now, and tell the cycle of it."""
    scene = simulation.scene
    pose = Pose3D()
    for name in simulation.looked_at:
        pose = mounted_pose(scene.source, name)
        frame = scene.frame(name)
        mapper.add(replace(frame, stamp=stamp, pose=pose, mount=scene.source.mount))
    cycle.add_pose(stamp, pose.x, pose.y)
    cycle.add_map(stamp, mapper.grid.occupancy, mapper.grid.geometry)
    goal = simulation.goal
    if goal is not None:
        cycle.set_goal(stamp, goal[0], goal[1])
