"""The node ``vgdp_planner``: ``map``, the robot's pose, ``goal_pose`` in, ``plan`` out."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from std_msgs.msg import ColorRGBA, UInt8
from visualization_msgs.msg import Marker, MarkerArray

from gridnav.actions import DONE
from gridnav.rgbd import VIEW_SUFFIX
from gridnav.ros.conversions import (
    from_occupancy_grid,
    header,
    to_nanoseconds,
    to_occupancy_grid,
    to_path_of_points,
)
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.paths import PathError, PathFailure, PathServer
from gridnav.ros.poses import SOURCES, PoseSource
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, MARKER_QOS, RELIABLE_QOS
from gridnav.ros.run import run_node
from gridnav.ros.validation import (
    MAX_CELLS,
    MAX_RESOLUTION_M,
    validate_occupancy_grid,
    validate_odometry,
    validate_pose_stamped,
)
from vgdp_planner.cycle import BLOCKED_AFTER, Decision, Observation, PlanningCycle
from vgdp_planner.free_cycle import FreeCycle
from vgdp_planner.planning_grid import GoalState, GridSettings, OccupiedError, OutsideMapError
from vgdp_planner.route import (
    NoRouteError,
    RouteTimeoutError,
    find_route,
    known_way,
    onward_way,
    plan_blocks,
    seen_way,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gridnav.pose import PoseEstimate
    from vgdp_planner.planner import Plan, ValueGuidedPlanner
    from vgdp_planner.planning_grid import PlanningGrid

SOURCE = 'vgdp_planner'
"""Who speaks on ``episode``."""

WORLDS = ('maze_sim', 'avd_player')
"""Those whose episodes the planner follows."""

DISCOVERY_S = 5.0
"""How long the first plan waits for somebody to listen to ``action``; finding one another takes
Fast DDS up to three seconds."""

CHECK_PERIOD_S = 0.25

REPEAT_PERIOD_S = 0.5
"""For a robot that moves by itself the standing plan is published again this often."""

GOAL_FAILURES: dict[GoalState, PathFailure] = {
    'outside': PathFailure.GOAL_OUTSIDE_MAP,
    'occupied': PathFailure.GOAL_OCCUPIED,
    'unreachable': PathFailure.NO_VALID_PATH,
}
"""Why no path leads to a goal, by Nav2's names."""

PLANNER_IDS = ('vgdp', 'GridBased')
"""What a client of the action may call the planner; the second is Nav2's own default."""

LOCKSTEP = 'lockstep'
"""The pose source of a world of cells, in which each action is a step and has a stamp."""

FREE_RESOLUTION_M = 0.4
"""Side of a block for a robot that moves by itself, where no other was asked for."""


@dataclass
class PlannerParameters:
    """Parameters of the node."""

    seed: int = parameter(0, 'Seed of the random numbers of an episode', low=0, high=2**31 - 1)
    weights: str = parameter(
        '', 'Folder with the weights; the shipped ones if empty', read_only=True
    )
    device: str = parameter('cpu', 'Where the networks run: cpu or cuda', read_only=True)
    threads: int = parameter(
        1,
        'CPU threads of the networks; more than one is slower where other processes are busy',
        low=1,
        high=256,
        read_only=True,
    )
    action_timeout: float = parameter(
        5.0,
        'Without any news for this long after an action, it counts as lost and the planner plans '
        'again',
        unit='s',
        low=0.1,
        high=3600.0,
    )
    pose_source: str = parameter(
        LOCKSTEP,
        "Where the robot's pose comes from: 'lockstep' waits for an odom and a map with the stamp "
        'of each action; all others plan on the newest of both for a robot that moves by itself',
        choices=(LOCKSTEP, *SOURCES),
        read_only=True,
    )
    robot_radius: float = parameter(
        0.0,
        'No plan brings the centre of the robot nearer to an obstacle than this',
        unit='m',
        low=0.0,
        high=10.0,
        read_only=True,
    )
    planning_resolution: float = parameter(
        0.0,
        'Side of the cells that a map is coarsened to; 0 for its own cells in lockstep, else for '
        f'{FREE_RESOLUTION_M} m',
        unit='m',
        low=0.0,
        high=MAX_RESOLUTION_M,
        read_only=True,
    )
    max_planning_cells: int = parameter(
        40_000,
        'A map that would have more cells than this is coarsened further',
        unit='cells',
        low=100,
        high=MAX_CELLS,
        read_only=True,
    )
    goal_tolerance: float = parameter(
        0.0,
        'Where the goal is at an obstacle, such as a thing on a table, the nearest place up to '
        'this far from it will do',
        unit='m',
        low=0.0,
        high=100.0,
        read_only=True,
    )
    goal_reach: float = parameter(
        0.0,
        'Any place this near to the goal will do that was seen to be free',
        unit='m',
        low=0.0,
        high=100.0,
        read_only=True,
    )
    blocked_after: int = parameter(
        BLOCKED_AFTER,
        'In lockstep, a place that so many steps did not get to counts as an obstacle',
        unit='steps',
        low=1,
        high=1000,
        read_only=True,
    )
    closer_look: int = parameter(
        0,
        'In lockstep, where nothing is left to see and no goal was seen, what lies further than '
        'so many cells from where the robot was is looked at again; 0 for never',
        unit='cells',
        low=0,
        high=100,
        read_only=True,
    )
    path_action: str = parameter(
        'compute_path_to_pose',
        "Name of Nav2's action for paths on request, where nav2_msgs is installed; none if empty",
        read_only=True,
    )
    path_time_limit: float = parameter(
        5.0, 'A path on request is given up after this time', unit='s', low=0.1, high=600.0
    )
    map_frame: str = parameter(
        'map', 'Frame of map, goal_pose and what is published', read_only=True
    )
    odom_frame: str = parameter(
        'odom',
        "Frame of odom; but with the pose source 'amcl_pose' taken to be where the map frame is",
        read_only=True,
    )
    base_frame: str = parameter(
        'base_link', "Frame of the robot, for the pose source 'tf'", read_only=True
    )


class PlannerNode(BaseNode[PlannerParameters]):
    """Plans on each new observation and sends the first steps of the best plan."""

    def __init__(self) -> None:
        """Load the weights and start the node.

        Raises:
            ParameterError: If a parameter can't be used.
            WeightsError: If the weights can't be loaded.
            ValueError: If there is no such device, or no TF for the pose source 'tf'.
        """
        super().__init__('vgdp_planner', PlannerParameters)
        p = self.parameters
        self._planner = load_planner(p)
        self._planner.reset(p.seed)
        self._cycle = make_cycle(p)
        self._path = Path()
        self._verdict = ''
        self._last_news = time.monotonic()
        self._listener_deadline: float | None = None

        self._plan = self.advertise(Path, 'plan', MAP_QOS)
        self._action = self.advertise(UInt8, 'action', RELIABLE_QOS)
        self._waypoint = self.advertise(PoseStamped, 'waypoint', RELIABLE_QOS)
        self._candidates = self.advertise(MarkerArray, 'plan_candidates', MARKER_QOS)
        self._value_map = self.advertise(OccupancyGrid, 'value_map', MARKER_QOS)
        self._episode = self.advertise(DiagnosticStatus, 'episode', EPISODE_QOS)

        # First, so that a new world is known before its first observation when both are waiting.
        self.subscribe(
            DiagnosticStatus, 'episode', self._on_episode, EPISODE_QOS, single_source=False
        )
        self.subscribe(
            PoseStamped,
            'goal_pose',
            self._on_goal,
            MAP_QOS,
            validate=partial(validate_pose_stamped, frames=(p.map_frame,)),
            single_source=False,
        )
        self._take_in_poses(self._cycle)
        self.subscribe(
            OccupancyGrid,
            'map',
            self._on_map,
            MAP_QOS,
            validate=partial(validate_occupancy_grid, frames=(p.map_frame,)),
        )
        self.provide_reset(self._reset)
        self._paths = PathServer(self, self._compute_path, p.path_action, PLANNER_IDS)
        self.create_timer(CHECK_PERIOD_S, self._on_check)
        self.diagnostics.report(DiagnosticStatus.OK, 'waiting for a map')
        weights = p.weights or 'the shipped weights'
        self.get_logger().info(f'Planning with {weights} on {p.device}.')

    def _take_in_poses(self, cycle: PlanningCycle | FreeCycle) -> None:
        p = self.parameters
        if isinstance(cycle, PlanningCycle):
            self.subscribe(
                Odometry,
                'odom',
                partial(self._on_odom, cycle),
                RELIABLE_QOS,
                validate=partial(validate_odometry, frames=(p.odom_frame, p.map_frame)),
            )
            return
        self._poses = PoseSource(
            self,
            p.pose_source,
            partial(self._on_pose, cycle),
            map_frame=p.map_frame,
            odom_frame=p.odom_frame,
            base_frame=p.base_frame,
        )
        self.create_timer(REPEAT_PERIOD_S, self._repeat)
        if p.robot_radius == 0:
            self.get_logger().warning('The robot_radius is 0 m: plans lead along the walls.')

    def _on_episode(self, message: DiagnosticStatus) -> None:
        if message.name not in WORLDS:
            return
        status = EpisodeStatus.from_message(message)
        if status.begins and status.start > self._cycle.start:
            if self._cycle.begin(status.start):
                self._planner.reset(self.parameters.seed)
            self._plan_if_ready()
        elif not status.begins and status.start == self._cycle.start:
            self._cycle.finished = True
            self.diagnostics.report(DiagnosticStatus.OK, f'the episode ended: {status.message}')

    def _reset(self) -> str:
        self._planner.reset(self.parameters.seed)
        return f'The best-plan memory is empty; the seed is {self.parameters.seed}.'

    def _on_goal(self, message: PoseStamped) -> None:
        position = message.pose.position
        self._cycle.set_goal(to_nanoseconds(message.header.stamp), position.x, position.y)

    def _on_odom(self, cycle: PlanningCycle, message: Odometry) -> None:
        if message.child_frame_id.endswith(VIEW_SUFFIX):
            return
        position = message.pose.pose.position
        stamp = to_nanoseconds(message.header.stamp)
        if cycle.add_pose(stamp, position.x, position.y):
            self._last_news = time.monotonic()
        self._plan_if_ready()

    def _on_pose(self, cycle: FreeCycle, estimate: PoseEstimate) -> None:
        if cycle.add_pose(estimate):
            self._last_news = time.monotonic()
        self._plan_if_ready()

    def _on_map(self, message: OccupancyGrid) -> None:
        occupancy, geometry = from_occupancy_grid(message)
        self._cycle.add_map(to_nanoseconds(message.header.stamp), occupancy, geometry)
        self._plan_if_ready()

    def _on_check(self) -> None:
        """Plan again when what was sent seems to be lost; say what the planner waits for."""
        quiet = time.monotonic() - self._last_news
        self._plan_if_ready(overdue=quiet > self.parameters.action_timeout)
        if quiet > 2 * CHECK_PERIOD_S:
            waiting = f'waiting for {self._cycle.waiting_for}'
            self.diagnostics.value('waiting', waiting)

    def _plan_if_ready(self, *, overdue: bool = False) -> None:
        """Plan once on each complete observation."""
        try:
            observation = self._cycle.observation(overdue=overdue)
        except ValueError as error:
            # Not refused as a message: the timer meets it again and again, too.
            self.diagnostics.count('not planned: robot off the map')
            self.warn('off the map', str(error))
            return
        if observation is None or not self._somebody_listens():
            return
        if overdue:
            self.diagnostics.count('lost: actions')
            self.warn('lost', 'Nothing came of the last actions; planning again.')
        began = time.perf_counter()
        if not observation.in_step:
            self._planner.reset(self.parameters.seed)
        if isinstance(self._cycle, PlanningCycle):
            observation, plan = self._cycle.plan(self._planner, observation)
        else:
            grid, belief = observation.grid, observation.belief
            plan = self._planner.plan(grid.partial_map, grid.start if belief is None else belief)
        self.diagnostics.latency(time.perf_counter() - began, 'plan')
        self._last_news = time.monotonic()
        self._publish_plan(observation, plan)
        self._report(observation.grid, plan)

    def _somebody_listens(self) -> bool:
        """Tell whether actions would arrive; after a while they are sent all the same.

        Where a planner starts beside a simulator, the two may not have found each other yet.
        """
        if self.moves_by_itself:
            return True
        now = time.monotonic()
        if self._listener_deadline is None:
            self._listener_deadline = now + DISCOVERY_S
        return self._action.get_subscription_count() > 0 or now > self._listener_deadline

    @property
    def moves_by_itself(self) -> bool:
        """Whether the robot follows `plan` or `waypoint`; else it takes each `action`."""
        return isinstance(self._cycle, FreeCycle)

    def _repeat(self) -> None:
        """Say the standing plan again: who follows it knows that it is still meant."""
        if self._path.poses and not self._cycle.finished:
            self._plan.publish(self._path)

    def _publish_plan(self, observation: Observation, plan: Plan) -> None:
        """Publish the plan and what explains it, then the steps to execute."""
        p = self.parameters
        stamp, grid = observation.stamp, observation.grid
        going = plan.status == 'ok'
        blocks, moves = plan_blocks(grid, plan)
        if self.moves_by_itself:
            blocks = onward_way(seen_way(grid.partial_map, blocks), moves)
        way = grid.way(blocks, via=moves) if going else np.empty((0, 2))
        done = DONE in plan.committed
        decision = Decision(plan.committed, blocks[moves], done, way)
        self._cycle.planned(observation, decision)

        self._path = to_path_of_points(way.tolist(), stamp=stamp, frame_id=p.map_frame)
        self._plan.publish(self._path)
        if self._candidates.get_subscription_count():
            self._candidates.publish(self._candidate_markers(observation, plan))
        if self._value_map.get_subscription_count():
            shown = value_percent(plan.value_map)
            self._value_map.publish(
                to_occupancy_grid(shown, grid.geometry, stamp=stamp, frame_id=p.map_frame)
            )
        if self.moves_by_itself:
            if plan.committed:
                to_target = grid.way(blocks[: moves + 1]).tolist()
                reached = to_path_of_points(to_target, stamp=stamp, frame_id=p.map_frame)
                self._waypoint.publish(reached.poses[-1])
        else:
            self._send_actions(plan.committed)
        if not going and not (self.moves_by_itself and plan.status == self._verdict):
            values = {'steps': '0'}
            status = EpisodeStatus(SOURCE, plan.status, max(self._cycle.start, 0), values)
            self._episode.publish(status.to_message())
        self._verdict = plan.status

    def _send_actions(self, committed: Sequence[int]) -> None:
        """Publish the steps to execute, and where they lead."""
        poses = self._path.poses
        for index, action in enumerate(committed, start=1):
            if action != DONE:
                self._waypoint.publish(poses[min(index, len(poses) - 1)])
            self._action.publish(UInt8(data=action))

    def _candidate_markers(self, observation: Observation, plan: Plan) -> MarkerArray:
        """Return the candidates as lines, from red for the lowest value to green."""
        stamp = header(observation.stamp, self.parameters.map_frame)
        grid = observation.grid
        markers = [Marker(header=stamp, ns='candidates', action=Marker.DELETEALL)]
        values = plan.candidate_values
        finite = np.isfinite(values)
        low, high = (values[finite].min(), values[finite].max()) if finite.any() else (0.0, 0.0)
        for index in np.flatnonzero(finite):
            share = float((values[index] - low) / max(high - low, 1e-6))
            cells = known_way(grid.partial_map, grid.start, plan.candidates[index].tolist())
            line = Marker(header=stamp, ns='candidates', id=int(index), type=Marker.LINE_STRIP)
            line.scale.x = 0.05 * grid.geometry.resolution
            line.color = ColorRGBA(r=1.0 - share, g=share, b=0.2, a=0.8)
            line.pose.orientation.w = 1.0
            line.text = f'{values[index]:.2f}'
            line.points = [
                Point(x=x, y=y, z=0.05)
                for x, y in (grid.geometry.center_of(*cell) for cell in cells)
            ]
            markers.append(line)
        return MarkerArray(markers=markers)

    def _compute_path(self, start: PoseStamped | None, goal: PoseStamped) -> Path:
        """Return the path from a pose, or from the robot, to another pose.

        Raises:
            PathError: If there is none.
            InvalidMessage: If a pose can't be used.
        """
        p = self.parameters
        poses = [goal] if start is None else [goal, start]
        for pose in poses:
            validate_pose_stamped(pose, frames=(p.map_frame,))
        ends = [(pose.pose.position.x, pose.pose.position.y) for pose in poses]
        position = self._cycle.position if start is None else ends[1]
        if position is None:
            raise PathError(PathFailure.TF_ERROR, 'It is not known where the robot is.')
        try:
            grid = self._cycle.grid_at(position, ends[0])
            if grid.goal in GOAL_FAILURES:
                sentence = f'The goal at {ends[0]} m is {grid.goal}.'
                raise PathError(GOAL_FAILURES[grid.goal], sentence)
            way = find_route(self._planner, grid, p.seed, p.path_time_limit)
        except OutsideMapError as error:
            raise PathError(PathFailure.START_OUTSIDE_MAP, str(error)) from error
        except OccupiedError as error:
            raise PathError(PathFailure.START_OCCUPIED, str(error)) from error
        except NoRouteError as error:
            raise PathError(PathFailure.NO_VALID_PATH, str(error)) from error
        except RouteTimeoutError as error:
            raise PathError(PathFailure.TIMEOUT, str(error)) from error
        stamp = self.get_clock().now().nanoseconds
        path = to_path_of_points(way.tolist(), stamp=stamp, frame_id=p.map_frame)
        path.poses[-1].pose.orientation = goal.pose.orientation
        return path

    def _report(self, grid: PlanningGrid, plan: Plan) -> None:
        rows, cols = grid.geometry.shape
        side = f'{grid.geometry.resolution:.3g} m'
        self.diagnostics.value('planning grid', f'{rows} x {cols} cells of {side}')
        if grid.lost:
            self.warn('lost', f'Cells of {side} close some ways; raise max_planning_cells.')
        if grid.goal in ('outside', 'occupied'):
            self.warn('goal', f'The goal is left out: it is {grid.goal}.')
        self.diagnostics.count(f'plans: {plan.source}')
        self.diagnostics.value('value', f'{plan.value:.2f}')
        self.diagnostics.value('waiting', '')
        if plan.status == 'ok':
            self.diagnostics.report(DiagnosticStatus.OK, 'planning')
            return
        reason = {
            'exhausted': 'nothing reachable is left to see and no goal was seen',
            'unreachable': 'the goal was seen, but no way leads there',
            'stuck': 'no sampled plan begins with a safe step',
        }[plan.status]
        self.diagnostics.report(DiagnosticStatus.WARN, f'{plan.status}: {reason}')
        self.warn(plan.status, f'Stopped: {reason}.')


def make_cycle(parameters: PlannerParameters) -> PlanningCycle | FreeCycle:
    """Return what says when to plan, for the pose source of the parameters."""
    p = parameters
    settings = GridSettings.from_parameters(**vars(p))
    if p.pose_source == LOCKSTEP:
        return PlanningCycle(settings, p.blocked_after, p.closer_look)
    return FreeCycle(replace(settings, resolution=settings.resolution or FREE_RESOLUTION_M))


def load_planner(parameters: PlannerParameters) -> ValueGuidedPlanner:
    """Load the planner that the parameters describe.

    Raises:
        WeightsError: If the weights can't be loaded.
        ValueError: If there is no such device.
    """
    # Here, as it takes seconds, in which the process already ends well on a signal.
    import torch  # noqa: PLC0415

    from vgdp_planner.planner import ValueGuidedPlanner  # noqa: PLC0415

    torch.set_num_threads(parameters.threads)
    try:
        return ValueGuidedPlanner.from_pretrained(parameters.weights or None, parameters.device)
    except RuntimeError as error:
        msg = f'The planner does not start on the device {parameters.device!r}: {error}'
        raise ValueError(msg) from error


def value_percent(value_map: NDArray[np.float32]) -> NDArray[np.int8]:
    """Scale values (H, W) to 0 for the lowest up to 100; −1 where there is none."""
    known = np.isfinite(value_map)
    shown = np.full(value_map.shape, -1, dtype=np.int8)
    if known.any():
        low, high = value_map[known].min(), value_map[known].max()
        shown[known] = np.round(100 * (value_map[known] - low) / max(high - low, 1e-6))
    return shown


def main() -> int:
    """Run the node; the executable ``planner_node``."""
    return run_node(PlannerNode)


if __name__ == '__main__':
    sys.exit(main())
