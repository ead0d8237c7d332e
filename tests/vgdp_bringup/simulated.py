"""Bags of runs as the nodes would make them, by the cores alone and in no time."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
from tests.vgdp_bringup import synthetic
from tests.vgdp_bringup.synthetic import SECOND, SyntheticBag, message

from bev_mapper import GridFusion, LocalMapFusion, Pose2D, Window
from gridnav.grid import GridGeometry
from maze_sim import MazeSimulation, make_mazes
from vgdp_bringup.replay import decision_of
from vgdp_planner.cycle import PlanningCycle
from vgdp_planner.planning_grid import GridSettings
from vgdp_planner.route import known_way, plan_blocks

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from vgdp_planner.cycle import Observation
    from vgdp_planner.planner import Plan, ValueGuidedPlanner

MILLISECOND = SECOND // 1000
MAPPING, PLANNING, ACTING = 2 * MILLISECOND, 30 * MILLISECOND, MILLISECOND


class SimulatedRobot:
    """A robot with mapper and planner that records what it does."""

    def __init__(
        self,
        folder: Path,
        planner: ValueGuidedPlanner,
        namespace: str = '/',
        *,
        fineness: int = 1,
        parameters: dict[str, object] | None = None,
    ) -> None:
        """Create the bag.

        Args:
            folder: Of the bag.
            planner: Of the robot.
            namespace: Where the robot has its topics.
            fineness: Cells of the map along the side of a step.
            parameters: Of the planner's node, as it says them in its diagnostics.
        """
        self._fineness = fineness
        self._parameters = parameters or {}
        self.bag = SyntheticBag(folder, namespace)
        self._planner = planner
        self._namespace = namespace
        self._sources: dict[str, int] = {}

    def close(self) -> None:
        """Make the bag readable."""
        self.bag.close()

    def run(self, seed: int, start: int, size: int = 15, max_steps: int = 500) -> None:
        """Go through an episode that begins at a stamp; five steps a second."""
        maze = make_mazes(1, size, seed)[0]
        world = MazeSimulation([maze], 2, max_steps)
        # From a small map on, so that it has to grow.
        fusion = LocalMapFusion(GridFusion(GridGeometry(9, 9, 1.0)))
        cycle = PlanningCycle(GridSettings(resolution=1.0))
        fusion.begin_episode(start)
        cycle.begin(start)
        self._planner.reset(seed)
        geometry = GridGeometry(len(maze.blocked), len(maze.blocked), 1.0)
        self._say(world, start, start, seed)
        queue: list[int] = []
        stamp = start
        goal_said = False
        while True:
            now = stamp
            row, col = world.cells[0].tolist()
            x, y = geometry.center_of(row, col)
            if world.goal_seen[0] and not goal_said:
                goal_said = True
                goal = geometry.center_of(*maze.goal)
                self.bag.add('goal_pose', now, synthetic.stamped(stamp, *goal))
                cycle.set_goal(stamp, *goal)
            self.bag.add('odom', now, synthetic.odometry(stamp, x, y))
            window = GridGeometry(5, 5, 1.0, col - 2.0, row - 2.0)
            view = world.windows()[0]
            self.bag.add('local_map', now, synthetic.grid(stamp, view, window))
            fusion.add_window(stamp, Window(view, window))
            assert fusion.add_pose(stamp, Pose2D(x, y))
            cycle.add_pose(stamp, x, y)
            now += MAPPING
            cells, place = self._map(fusion.grid)
            self.bag.add('map', now, synthetic.grid(stamp, cells, place))
            cycle.add_map(stamp, cells, place)
            if not world.active[0]:
                break
            observation = cycle.observation()
            if observation is not None:
                now += PLANNING + (seed * 7 + len(queue) + world.steps[0]) % 13 * MILLISECOND
                queue = self._plan(cycle, observation, int(now))
            world.step(np.array([queue.pop(0)]))
            stamp += SECOND // 5
        self._say(world, start, stamp, seed)

    def _map(self, grid: GridFusion) -> tuple[NDArray[np.int8], GridGeometry]:
        """Return the map with smaller cells."""
        k, place = self._fineness, grid.geometry
        cells = grid.occupancy.repeat(k, axis=0).repeat(k, axis=1)
        rows, cols = cells.shape
        fine = GridGeometry(rows, cols, place.resolution / k, place.origin_x, place.origin_y)
        return cells, fine

    def _plan(self, cycle: PlanningCycle, observation: Observation, now: int) -> list[int]:
        observation, plan = cycle.plan(self._planner, observation)
        grid = observation.grid
        cycle.planned(observation, decision_of(plan, grid))
        stamp = observation.stamp
        blocks, moves = plan_blocks(grid, plan)
        way = [(x, y) for x, y in grid.way(blocks, via=moves).tolist()]
        self.bag.add('plan', now, synthetic.path(stamp, way))
        lines = [
            synthetic.line(stamp, index, self._way(observation, actions), value)
            for index, (actions, value) in enumerate(
                zip(plan.candidates.tolist(), plan.candidate_values.tolist(), strict=True)
            )
            if np.isfinite(value)
        ]
        markers = message('visualization_msgs/msg/MarkerArray', markers=lines)
        self.bag.add('plan_candidates', now, markers)
        for action in plan.committed:
            self.bag.add('action', now + ACTING, message('std_msgs/msg/UInt8', data=action))
        self._report(plan, now)
        return list(plan.committed)

    def _way(self, observation: Observation, actions: list[int]) -> list[tuple[float, float]]:
        """Return the points of a plan up to Done or a step into a known obstacle."""
        grid = observation.grid
        cells = known_way(grid.partial_map, grid.start, actions)
        return [grid.geometry.center_of(*cell) for cell in cells]

    def _report(self, plan: Plan, now: int) -> None:
        self._sources[plan.source] = self._sources.get(plan.source, 0) + 1
        name = f'{self._namespace}vgdp_planner'
        pairs: dict[str, object] = {
            f'plans: {source}': count for source, count in self._sources.items()
        }
        if self._parameters:
            pairs['parameters'] = json.dumps(self._parameters)
        status = synthetic.status(name, 'planning', 0, **pairs)
        array = message(
            'diagnostic_msgs/msg/DiagnosticArray', header=synthetic.header(now), status=[status]
        )
        self.bag.add('/diagnostics', now, array)

    def _say(self, world: MazeSimulation, start: int, now: int, seed: int) -> None:
        result = world.results()[0]
        values = {
            'steps': result.steps,
            'path_cost': result.path_cost,
            'expert_steps': result.expert_steps,
            'expert_cost': result.expert_cost,
            'spl': f'{result.spl:.6f}',
            'seed': seed,
            'rows': len(world.mazes[0].blocked),
            'cols': len(world.mazes[0].blocked),
            'view_range': 2,
        }
        self.bag.add(
            'episode', now, synthetic.status('maze_sim', str(result.outcome), start, **values)
        )
