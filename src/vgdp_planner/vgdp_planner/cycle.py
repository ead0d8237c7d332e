"""When to plan in lockstep with a world of cells: brings map and pose of one step together."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from gridnav import DONE, FREE, STEPS
from vgdp_planner.coarsening import make_planning_grid
from vgdp_planner.planning_grid import GridSettings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gridnav import GridGeometry
    from vgdp_planner.planner import Plan, ValueGuidedPlanner
    from vgdp_planner.planning_grid import Cell, PlanningGrid, Point

NEVER = -1

REOPENINGS = 2
"""How often places that could not be stepped on are tried again in an episode, each time when
nothing else is left."""

BLOCKED_AFTER = 3
"""A place that so many steps did not get to counts as an obstacle, unless said otherwise."""

KEPT_STAMPS = 1000
"""No more stamps of poses are kept than this."""


@dataclass(frozen=True)
class Observation:
    """What to plan on.

    Attributes:
        stamp: Of the step that made it, in nanoseconds.
        grid: The map, made ready for the planner.
        belief: Where the robot may be, (H, W); None where it is surely at the grid's start.
        in_step: Whether just what the last plan committed came of it: the planner may go on with
            the rest of that plan.
    """

    stamp: int
    grid: PlanningGrid
    belief: NDArray[np.float32] | None = None
    in_step: bool = True


@dataclass(frozen=True)
class Decision:
    """What came of planning on an observation.

    Attributes:
        committed: The steps that the plan commits, Done included.
        target: The block in which they end.
        done: Whether they end with Done.
        way: The whole plan in metres, (N, 2); empty for none.
    """

    committed: Sequence[int]
    target: Cell
    done: bool
    way: NDArray[np.float64]


class PlanningCycle:
    """Lets the planner plan once on each observation, after all that it sent was carried out.

    A pose comes for each action that was carried out, with a stamp of its own. An observation is
    complete when map and newest pose carry the same stamp, and ready when as many new stamps have
    come as actions were sent. Poses and maps that come again with a known stamp change nothing.

    A step that leads nowhere time and again, whatever the map says, leads to a place that counts
    as an obstacle from then on.

    What is looked for may be too small to be seen from where a map is made. So where nothing is
    left to see and no goal was seen, what the robot never came near to counts as unseen again.

    Args:
        settings: How a map becomes a planning grid; its blocks are what a step leads across.
        blocked_after: A place that so many steps did not get to counts as an obstacle.
        closer_look: Further than so many blocks from all places where the robot was, what was
            seen is looked at again, and then from one block nearer; 0 for never.
    """

    def __init__(
        self,
        settings: GridSettings | None = None,
        blocked_after: int = BLOCKED_AFTER,
        closer_look: int = 0,
    ) -> None:
        self._settings = replace(settings or GridSettings(), keep_resolution=True)
        self._blocked_after = blocked_after
        self._closer_look = closer_look
        self.start = NEVER
        self.finished = False
        self._map: tuple[int, NDArray[np.int8], GridGeometry] | None = None
        self._poses: dict[int, tuple[float, float]] = {}
        self._goal: tuple[int, float, float] | None = None
        self._planned = NEVER
        self._committed: Sequence[int] = ()
        self._grid: PlanningGrid | None = None
        self._noted = False
        self._forget_places()

    def _forget_places(self) -> None:
        self._settings = replace(self._settings, center=None)
        self._visited: dict[tuple[int, int], Point] = {}
        self._blocked: dict[tuple[int, int], Point] = {}
        self._failures: Counter[tuple[int, int]] = Counter()
        self._reopenings = 0
        self._looks_left = self._closer_look
        self._nearness = 0

    def begin(self, start: int) -> bool:
        """Start over with an episode that begins at a stamp; what is older is forgotten.

        What is not older stays: the first map may come before the word of the episode, as each
        comes from another process, and neither is said again.

        Returns:
            Whether the episode is new: False if something in it was planned on already.
        """
        self.start = start
        self.finished = False
        if self._map is not None and self._map[0] < start:
            self._map = None
        self._poses = {stamp: pose for stamp, pose in self._poses.items() if stamp >= start}
        if self._goal is not None and self._goal[0] < start:
            self._goal = None
        if self._planned >= start > NEVER:
            return False
        self._planned = NEVER
        self._committed = ()
        self._grid = None
        self._forget_places()
        return True

    def add_pose(self, stamp: int, x: float, y: float) -> bool:
        """Take in where the robot is, in metres in the map's frame.

        Returns:
            Whether this is news: a stamp of the episode that had not come yet.
        """
        if stamp < self.start:
            return False
        news = stamp not in self._poses
        self._poses[stamp] = (x, y)
        if len(self._poses) > KEPT_STAMPS:
            del self._poses[min(self._poses)]
        return news

    def add_map(self, stamp: int, occupancy: NDArray[np.int8], geometry: GridGeometry) -> None:
        """Take in the map: −1 unseen, 0 to 100 occupied, (H, W)."""
        if stamp >= self.start and (self._map is None or stamp >= self._map[0]):
            self._map = (stamp, occupancy, geometry)

    def set_goal(self, stamp: int, x: float, y: float) -> None:
        """Take in where the goal is, in metres in the map's frame."""
        if stamp >= self.start:
            self._goal = (stamp, x, y)

    def forget_goal(self) -> None:
        """Take back where the goal is: it was a mistake."""
        self._goal = None

    def observation(self, *, overdue: bool = False) -> Observation | None:
        """Return what to plan on, or None if it is not time yet.

        Args:
            overdue: What was sent seems to be lost: don't wait for it any longer.

        Raises:
            ValueError: If the robot is not on the map, or at an obstacle.
        """
        if self.finished or self._map is None or not self._poses:
            return None
        stamp = self._map[0]
        newest = max(self._poses)
        if stamp != newest:
            return None
        carried_out = sum(pose_stamp > self._planned for pose_stamp in self._poses)
        if carried_out < max(len(self._committed), 1) and not (overdue and self._planned >= 0):
            return None
        if self._settings.center is None:
            # Steps lead from the middle of a block to the middle of another.
            self._settings = replace(self._settings, center=self._poses[newest])
        self._note_steps()
        return Observation(stamp, self._grid_now())

    def reopened(self, observation: Observation) -> Observation | None:
        """Return an observation again, with more to see or to go to.

        For a planner that sees nowhere to go any more. Places that could not be stepped on are
        open again; and if there are none, or they were tried again often enough, what was not
        looked at from near is unseen again. None where nothing of this helps.
        """
        if self._blocked and self._reopenings < REOPENINGS:
            self._reopenings += 1
            self._blocked.clear()
            self._failures.clear()
            return replace(observation, grid=self._grid_now())
        while self._goal is None and self._looks_left:
            self._nearness = self._looks_left
            self._looks_left -= 1
            grid = self._grid_now()
            if grid.partial_map[FREE].sum() < observation.grid.partial_map[FREE].sum():
                return replace(observation, grid=grid)
        return None

    def plan(
        self, planner: ValueGuidedPlanner, observation: Observation
    ) -> tuple[Observation, Plan]:
        """Plan on an observation; where that sees nowhere to go, on one that was reopened.

        Returns:
            What was planned on in the end, and the plan with those of its steps that may be sent.
        """
        plan = planner.plan(observation.grid.partial_map, observation.grid.start)
        while plan.status != 'ok':
            again = self.reopened(observation)
            if again is None:
                break
            observation = again
            plan = planner.plan(again.grid.partial_map, again.grid.start)
        return observation, replace(plan, committed=self.to_send(plan.committed))

    def _grid_now(self) -> PlanningGrid:
        goal = None if self._goal is None else self._goal[1:]
        grid = self.grid_at(self._poses[max(self._poses)], goal)
        if not self._nearness or goal is not None:
            return grid
        free = grid.partial_map[FREE] > 0
        near = np.zeros_like(free)
        for place in [*self._visited.values(), *self._poses.values()]:
            cell = grid.geometry.cell_at(*place)
            if grid.geometry.contains(*cell):
                near[cell] = True
        near = ndimage.binary_dilation(near, np.ones((3, 3)), self._nearness, mask=free | near)
        partial_map = grid.partial_map.copy()
        partial_map[FREE] *= near
        return replace(grid, partial_map=partial_map)

    def _note_steps(self) -> None:
        """Note where the robot has been, and which of the committed steps led nowhere."""
        if self._grid is None or self._noted:
            return
        self._noted = True
        geometry = self._grid.geometry
        places = [pose for _, pose in sorted(self._poses.items())]
        for place in places:
            self._visited[self._key(place)] = place
        for action, (before, after) in zip(self._committed, pairwise(places), strict=False):
            cell = geometry.cell_at(*before)
            if action == DONE or geometry.cell_at(*after) != cell:
                continue
            row_step, col_step = STEPS[action].tolist()
            place = geometry.center_of(cell[0] + row_step, cell[1] + col_step)
            key = self._key(place)
            self._failures[key] += 1
            if self._failures[key] >= self._blocked_after and key not in self._visited:
                self._blocked[key] = place

    def _key(self, place: Point) -> tuple[int, int]:
        """Return the block of a place, counted from the one where the episode began."""
        side = self._grid.geometry.resolution if self._grid else 1.0
        x, y = self._settings.center or (0.0, 0.0)
        return round((place[0] - x) / side), round((place[1] - y) / side)

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
            occupancy,
            geometry,
            position,
            goal,
            self._settings,
            visited=self._visited.values(),
            blocked=self._blocked.values(),
        )

    @property
    def position(self) -> Point | None:
        """Where the robot is, (x, y) in metres, if it is known."""
        return self._poses[max(self._poses)] if self._poses else None

    def to_send(self, committed: Sequence[int]) -> list[int]:
        """Return those of the committed steps that may be sent now.

        Where a step that leads nowhere says at once that there is something, Done waits until the
        robot is seen to have got to where it is said.
        """
        steps = list(committed)
        if self._blocked_after == 1 and DONE in steps[1:]:
            return steps[: steps.index(DONE)]
        return steps

    def planned(self, observation: Observation, decision: Decision) -> None:
        """Note that actions were sent that were planned on an observation."""
        self._planned = observation.stamp
        self._committed = decision.committed
        self._grid = observation.grid
        self._noted = False
        self._poses = {
            stamp: pose for stamp, pose in self._poses.items() if stamp >= observation.stamp
        }

    @property
    def waiting_for(self) -> str:
        """What the next plan is waiting for, in words."""
        if self.finished:
            return 'a new episode'
        if self._map is None:
            return 'a map'
        if not self._poses:
            return 'odom'
        if self._map[0] < max(self._poses):
            return 'a map of the newest odom'
        if self._map[0] > max(self._poses):
            return 'the odom of the newest map'
        return 'what was sent to be carried out'
