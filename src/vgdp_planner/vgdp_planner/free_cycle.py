"""When to plan for a robot that moves by itself: on the newest map and the newest pose."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vgdp_planner.coarsening import make_planning_grid
from vgdp_planner.cycle import NEVER, Decision, Observation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gridnav import GridGeometry
    from gridnav.pose import PoseEstimate
    from vgdp_planner.planning_grid import GridSettings, PlanningGrid, Point

NEWS_SHARE = 0.25
"""A robot that moved by this share of a block, or turned by this many radians, is on its way."""


@dataclass(frozen=True)
class _Plan:
    """The plan that is being followed.

    Attributes:
        target: Centre of the block in which its committed steps end, in metres.
        resolution: Side of that block.
        decision: What was decided.
    """

    target: Point
    resolution: float
    decision: Decision

    @property
    def is_going(self) -> bool:
        """Whether it leads the robot to where it is to plan again."""
        return bool(self.decision.committed) and not self.decision.done

    def ends_at(self, place: Point) -> bool:
        """Tell whether a place is where to plan again.

        That is the block in which the committed steps end, or the end of the whole way: who
        follows it may cut the corner of a block.
        """
        if not self.is_going:
            return False
        in_target = np.abs(np.subtract(place, self.target)).max() <= self.resolution / 2
        at_end = np.hypot(*np.subtract(place, self.decision.way[-1])) <= self.resolution / 2
        return bool(in_target or at_end)

    def is_in_step(self, grid: PlanningGrid) -> bool:
        """Tell whether the robot's block on a grid is the one in which the steps end."""
        same = grid.geometry.resolution == self.resolution
        return same and grid.geometry.cell_at(*self.target) == grid.start

    def is_clear(self, grid: PlanningGrid, place: Point) -> bool:
        """Tell whether what is left of the way from a place is clear; a stop never is."""
        way = self.decision.way
        if not self.decision.committed:
            return False
        nearest = int(np.hypot(*(way - place).T).argmin())
        return grid.is_clear(way[nearest:])


class FreeCycle:
    """Lets the planner plan when the robot has carried out what was committed, or can not.

    That is when it enters the block in which the committed steps end, when it comes to the end of
    the way, when the newest map has an obstacle on it, when the goal changes, and when it does not
    move any more. In between the plan stands.

    Args:
        settings: How a map becomes a planning grid.
    """

    def __init__(self, settings: GridSettings) -> None:
        self._asked = settings
        self._map: tuple[int, NDArray[np.int8], GridGeometry] | None = None
        self._pose: PoseEstimate | None = None
        self._goal: tuple[int, Point] | None = None
        self.begin(NEVER)

    def begin(self, start: int) -> bool:
        """Start over, with an episode that begins at a stamp; what is older is forgotten.

        What is not older stays: where the world only moves on once it is told to, a map that came
        before the word of its episode is not said again.
        """
        self.start = start
        self.finished = False
        self._settings = self._asked
        if self._map is not None and self._map[0] < start:
            self._map = None
        if self._pose is not None and self._pose.stamp < start:
            self._pose = None
        if self._goal is not None and self._goal[0] < start:
            self._goal = None
        self._map_is_new = self._map is not None
        self._goal_is_new = self._goal is not None
        self._moved_from: PoseEstimate | None = None
        self._plan: _Plan | None = None
        self._visited: dict[tuple[int, int], Point] = {}
        if self._pose is not None:
            self.add_pose(self._pose)
        return True

    def add_pose(self, pose: PoseEstimate) -> bool:
        """Take in where the robot is.

        Returns:
            Whether this is news: the robot has moved.
        """
        self._pose = pose
        side = self._plan.resolution if self._plan else self._asked.resolution or 1.0
        self._note_visit(pose.pose[:2], side)
        before = self._moved_from
        if before is not None:
            distance = np.hypot(pose.pose.x - before.pose.x, pose.pose.y - before.pose.y)
            turn = np.cos(pose.pose.yaw - before.pose.yaw)
            if distance < NEWS_SHARE * side and turn > np.cos(NEWS_SHARE):
                return False
        self._moved_from = pose
        return True

    def _note_visit(self, place: Point, side: float) -> None:
        self._visited[int(place[0] // side), int(place[1] // side)] = place

    def add_map(self, stamp: int, occupancy: NDArray[np.int8], geometry: GridGeometry) -> None:
        """Take in the map: −1 unseen, 0 to 100 occupied, (rows, cols)."""
        if stamp >= self.start:
            self._map = (stamp, occupancy, geometry)
            self._map_is_new = True

    def set_goal(self, stamp: int, x: float, y: float) -> None:
        """Take in where the goal is, in metres in the map's frame."""
        if stamp >= self.start:
            self._goal_is_new |= self._goal is None or self._goal[1] != (x, y)
            self._goal = (stamp, (x, y))

    def observation(self, *, overdue: bool = False) -> Observation | None:
        """Return what to plan on, or None while the plan stands.

        Args:
            overdue: The robot does not move: don't wait for it any longer.

        Raises:
            ValueError: If the robot is not on the map, or at an obstacle.
        """
        latest, pose = self._map, self._pose
        if self.finished or latest is None or pose is None:
            return None
        place = pose.pose[:2]
        arrived = self._plan is not None and self._plan.ends_at(place)
        due = self._plan is None or self._goal_is_new or arrived
        due |= overdue and self._plan is not None and self._plan.is_going
        if not due and not self._map_is_new:
            return None
        grid = self.grid_at(place, None if self._goal is None else self._goal[1])
        self._map_is_new = False
        if not due and self._plan is not None and self._plan.is_clear(grid, place):
            return None
        self._goal_is_new = False
        belief = None if pose.covariance is None else grid.belief(place, pose.covariance)
        in_step = arrived and self._plan is not None and self._plan.is_in_step(grid)
        return Observation(max(latest[0], pose.stamp), grid, belief, in_step)

    def planned(self, observation: Observation, decision: Decision) -> None:
        """Note what was planned on an observation."""
        geometry = observation.grid.geometry
        self._plan = _Plan(geometry.center_of(*decision.target), geometry.resolution, decision)
        if geometry.resolution < self._settings.resolution:
            # Where smaller blocks were needed once they are kept, lest the grid changes with
            # every map.
            self._settings = replace(self._settings, resolution=geometry.resolution)

    def grid_at(self, position: Point, goal: Point | None) -> PlanningGrid:
        """Return the planning grid of the newest map for a robot and a goal somewhere on it.

        Raises:
            ValueError: If there is no map yet, or the robot would not be on it, or at an obstacle.
        """
        if self._map is None:
            msg = 'There is no map yet.'
            raise ValueError(msg)
        _, occupancy, geometry = self._map
        return make_planning_grid(
            occupancy, geometry, position, goal, self._settings, visited=self._visited.values()
        )

    @property
    def position(self) -> Point | None:
        """Where the robot is, (x, y) in metres, if it is known."""
        return None if self._pose is None else self._pose.pose[:2]

    @property
    def waiting_for(self) -> str:
        """What the next plan is waiting for, in words."""
        if self.finished:
            return 'a new episode'
        if self._map is None:
            return 'a map'
        if self._pose is None:
            return 'a pose'
        return 'the robot to get to the end of what was committed'
