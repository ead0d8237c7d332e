"""Paths on request: the service ``GetPlan`` and, where it is installed, Nav2's action."""

from __future__ import annotations

import time
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from builtin_interfaces.msg import Duration
from nav_msgs.srv import GetPlan

from gridnav.ros.conversions import NANOSECONDS
from gridnav.ros.validation import InvalidMessage

if TYPE_CHECKING:
    from collections.abc import Callable

    from geometry_msgs.msg import PoseStamped
    from nav_msgs.msg import Path

    from gridnav.ros.node import BaseNode

    ComputePath = Callable[[PoseStamped | None, PoseStamped], Path]


class PathFailure(StrEnum):
    """Why there is no path, by the names of the error codes of Nav2's ComputePathToPose."""

    UNKNOWN = 'UNKNOWN'
    INVALID_PLANNER = 'INVALID_PLANNER'
    TF_ERROR = 'TF_ERROR'
    START_OUTSIDE_MAP = 'START_OUTSIDE_MAP'
    GOAL_OUTSIDE_MAP = 'GOAL_OUTSIDE_MAP'
    START_OCCUPIED = 'START_OCCUPIED'
    GOAL_OCCUPIED = 'GOAL_OCCUPIED'
    TIMEOUT = 'TIMEOUT'
    NO_VALID_PATH = 'NO_VALID_PATH'


class PathError(Exception):
    """There is no path.

    Attributes:
        failure: Why.
    """

    def __init__(self, failure: PathFailure, sentence: str) -> None:
        super().__init__(sentence)
        self.failure = failure


class PathServer:
    """Offers paths as the service ``~/get_plan`` and as an action of Nav2.

    Args:
        node: Which offers them.
        compute: Returns the path from a start, or from the robot if that is None, to a goal;
            raises `PathError` if there is none.
        action: Name of the action; none is offered if it is empty or nav2_msgs not installed.
        planner_ids: Names that a client may ask for; any other is an INVALID_PLANNER.
    """

    def __init__(
        self,
        node: BaseNode[Any],
        compute: ComputePath,
        action: str,
        planner_ids: tuple[str, ...],
    ) -> None:
        self._node = node
        self._compute = compute
        self._planner_ids = planner_ids
        node.create_service(GetPlan, '~/get_plan', self._serve)
        if not action:
            return
        try:
            from nav2_msgs.action import ComputePathToPose  # noqa: PLC0415 - optional
        except ImportError:
            node.get_logger().info(f'nav2_msgs is not installed, so there is no {action!r}.')
        else:
            from rclpy.action import ActionServer  # noqa: PLC0415 - only needed here

            self._result = ComputePathToPose.Result
            self._server = ActionServer(node, ComputePathToPose, action, self._execute)

    def _serve(self, request: GetPlan.Request, response: GetPlan.Response) -> GetPlan.Response:
        """Answer the service: an empty path where there is none, as the type has no error."""
        start = request.start if request.start.header.frame_id else None
        try:
            response.plan = self._path(start, request.goal)
        except PathError as error:
            self._node.warn('no path', f'No path ({error.failure}): {error}')
        return response

    def _execute(self, goal_handle: Any) -> Any:  # noqa: ANN401 - of the optional nav2_msgs
        """Answer the action; its result names the error."""
        began = time.monotonic()
        request, result = goal_handle.request, self._result()
        try:
            self._check_planner(request.planner_id)
            start = request.start if request.use_start else None
            result.path = self._path(start, request.goal)
        except PathError as error:
            result.error_code = getattr(self._result, error.failure)
            result.error_msg = str(error)
            self._node.warn('no path', f'No path ({error.failure}): {error}')
            goal_handle.abort()
        else:
            result.error_code = self._result.NONE
            goal_handle.succeed()
        seconds, rest = divmod(round((time.monotonic() - began) * NANOSECONDS), NANOSECONDS)
        result.planning_time = Duration(sec=seconds, nanosec=rest)
        return result

    def _check_planner(self, name: str) -> None:
        if name and name not in self._planner_ids:
            msg = f'There is no planner {name!r}, only {", ".join(self._planner_ids)}.'
            raise PathError(PathFailure.INVALID_PLANNER, msg)

    def _path(self, start: PoseStamped | None, goal: PoseStamped) -> Path:
        try:
            path = self._compute(start, goal)
        except (PathError, InvalidMessage) as error:
            self._node.diagnostics.count('paths: none')
            if isinstance(error, PathError):
                raise
            raise PathError(PathFailure.TF_ERROR, str(error)) from error
        except Exception as error:
            self._node.log_exception('A path could not be computed', error)
            raise PathError(PathFailure.UNKNOWN, str(error)) from error
        self._node.diagnostics.count('paths: found')
        return path
