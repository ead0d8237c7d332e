"""The node ``vgdp_planner``: ``map``, ``odom``, ``goal_pose`` in, ``plan``, ``action`` out."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from std_msgs.msg import ColorRGBA, UInt8
from visualization_msgs.msg import Marker, MarkerArray

from gridnav.actions import DONE, STEPS, valid_moves
from gridnav.partial_map import OBSTACLE
from gridnav.ros.conversions import (
    from_occupancy_grid,
    header,
    to_nanoseconds,
    to_occupancy_grid,
    to_path,
)
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, MARKER_QOS, RELIABLE_QOS
from gridnav.ros.run import run_node
from gridnav.ros.validation import (
    validate_occupancy_grid,
    validate_odometry,
    validate_pose_stamped,
)
from vgdp_planner.cycle import Observation, PlanningCycle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from vgdp_planner.planner import Plan, ValueGuidedPlanner

SOURCE = 'vgdp_planner'
"""Who speaks on ``episode``."""

WORLDS = ('maze_sim', 'avd_player')
"""Those whose episodes the planner follows."""

DISCOVERY_S = 5.0
"""How long the first plan waits for somebody to listen to ``action``; finding one another takes
Fast DDS up to three seconds."""

CHECK_PERIOD_S = 0.25


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
    map_frame: str = parameter(
        'map', 'Frame of map, goal_pose and what is published', read_only=True
    )
    odom_frame: str = parameter(
        'odom', 'Frame of odom, taken to be where the map frame is', read_only=True
    )


class PlannerNode(BaseNode[PlannerParameters]):
    """Plans on each new observation and sends the first steps of the best plan."""

    def __init__(self) -> None:
        """Load the weights and start the node.

        Raises:
            ParameterError: If a parameter can't be used.
            WeightsError: If the weights can't be loaded.
            ValueError: If there is no such device.
        """
        super().__init__('vgdp_planner', PlannerParameters)
        p = self.parameters
        self._planner = load_planner(p)
        self._planner.reset(p.seed)
        self._cycle = PlanningCycle()
        self._last_news = time.monotonic()
        self._listener_deadline: float | None = None

        self._plan = self.advertise(Path, 'plan', MAP_QOS)
        self._action = self.advertise(UInt8, 'action', RELIABLE_QOS)
        self._waypoint = self.advertise(PoseStamped, 'waypoint', RELIABLE_QOS)
        self._candidates = self.advertise(MarkerArray, 'plan_candidates', MARKER_QOS)
        self._value_map = self.advertise(OccupancyGrid, 'value_map', MARKER_QOS)
        self._episode = self.advertise(DiagnosticStatus, 'episode', EPISODE_QOS)

        frames = (p.odom_frame, p.map_frame)
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
        self.subscribe(
            Odometry,
            'odom',
            self._on_odom,
            RELIABLE_QOS,
            validate=partial(validate_odometry, frames=frames),
        )
        self.subscribe(
            OccupancyGrid,
            'map',
            self._on_map,
            MAP_QOS,
            validate=partial(validate_occupancy_grid, frames=(p.map_frame,)),
        )
        self.provide_reset(self._reset)
        self.create_timer(CHECK_PERIOD_S, self._on_check)
        self.diagnostics.report(DiagnosticStatus.OK, 'waiting for a map')
        weights = p.weights or 'the shipped weights'
        self.get_logger().info(f'Planning with {weights} on {p.device}.')

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

    def _on_odom(self, message: Odometry) -> None:
        position = message.pose.pose.position
        if self._cycle.add_pose(to_nanoseconds(message.header.stamp), position.x, position.y):
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
        plan = self._planner.plan(observation.partial_map, observation.cell)
        self.diagnostics.latency(time.perf_counter() - began, 'plan')
        self._cycle.planned(observation, len(plan.committed))
        self._last_news = time.monotonic()
        self._publish_plan(observation, plan)
        self._report(plan)

    def _somebody_listens(self) -> bool:
        """Tell whether actions would arrive; after a while they are sent all the same.

        Where a planner starts beside a simulator, the two may not have found each other yet.
        """
        now = time.monotonic()
        if self._listener_deadline is None:
            self._listener_deadline = now + DISCOVERY_S
        return self._action.get_subscription_count() > 0 or now > self._listener_deadline

    def _publish_plan(self, observation: Observation, plan: Plan) -> None:
        """Publish the plan and what explains it, then the steps to execute."""
        p = self.parameters
        stamp, geometry = observation.stamp, observation.geometry
        going = plan.status == 'ok'
        actions = plan.actions.tolist() if going else []
        cells = known_way(observation.partial_map, observation.cell, actions)
        path = to_path(cells, geometry, stamp=stamp, frame_id=p.map_frame)
        self._plan.publish(path if going else Path(header=header(stamp, p.map_frame)))
        if self._candidates.get_subscription_count():
            self._candidates.publish(self._candidate_markers(observation, plan))
        if self._value_map.get_subscription_count():
            shown = value_percent(plan.value_map)
            self._value_map.publish(
                to_occupancy_grid(shown, geometry, stamp=stamp, frame_id=p.map_frame)
            )
        for index, action in enumerate(plan.committed, start=1):
            if action != DONE:
                self._waypoint.publish(path.poses[min(index, len(path.poses) - 1)])
            self._action.publish(UInt8(data=action))
        if not going:
            values = {'steps': '0'}
            status = EpisodeStatus(SOURCE, plan.status, max(self._cycle.start, 0), values)
            self._episode.publish(status.to_message())

    def _candidate_markers(self, observation: Observation, plan: Plan) -> MarkerArray:
        """Return the candidates as lines, from red for the lowest value to green."""
        stamp = header(observation.stamp, self.parameters.map_frame)
        markers = [Marker(header=stamp, ns='candidates', action=Marker.DELETEALL)]
        values = plan.candidate_values
        finite = np.isfinite(values)
        low, high = (values[finite].min(), values[finite].max()) if finite.any() else (0.0, 0.0)
        for index in np.flatnonzero(finite):
            share = float((values[index] - low) / max(high - low, 1e-6))
            cells = known_way(
                observation.partial_map, observation.cell, plan.candidates[index].tolist()
            )
            line = Marker(header=stamp, ns='candidates', id=int(index), type=Marker.LINE_STRIP)
            line.scale.x = 0.05 * observation.geometry.resolution
            line.color = ColorRGBA(r=1.0 - share, g=share, b=0.2, a=0.8)
            line.pose.orientation.w = 1.0
            line.text = f'{values[index]:.2f}'
            line.points = [
                Point(x=x, y=y, z=0.05)
                for x, y in (observation.geometry.center_of(*cell) for cell in cells)
            ]
            markers.append(line)
        return MarkerArray(markers=markers)

    def _report(self, plan: Plan) -> None:
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


def known_way(
    partial_map: NDArray[np.float32], cell: tuple[int, int], actions: Sequence[int]
) -> list[tuple[int, int]]:
    """Return the cells that a plan goes through, up to Done or a step into a known obstacle.

    Args:
        partial_map: (3, H, W).
        cell: Where the robot is, (row, col); the first one returned.
        actions: The plan.
    """
    valid = valid_moves(partial_map[OBSTACLE] > 0)
    cells = [cell]
    for action in actions:
        row, col = cells[-1]
        if action == DONE or not valid[action, row, col]:
            break
        row_step, col_step = STEPS[action].tolist()
        cells.append((row + row_step, col + col_step))
    return cells


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
