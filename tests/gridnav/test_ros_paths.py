"""Paths on request, with a stand-in for nav2_msgs."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan

from gridnav.ros.conversions import to_path_of_points, to_pose_stamped
from gridnav.ros.paths import PathError, PathFailure, PathServer
from gridnav.ros.validation import InvalidMessage

GOAL = to_pose_stamped(1.0, 2.0, stamp=3, frame_id='map')


@dataclass
class Request:
    """The goal of Nav2's action in Jazzy."""

    goal: PoseStamped = field(default_factory=lambda: GOAL)
    start: PoseStamped = field(default_factory=PoseStamped)
    planner_id: str = ''
    use_start: bool = False


@dataclass
class Result:
    """Its result, with its error codes."""

    NONE = 0
    UNKNOWN = 200
    INVALID_PLANNER = 201
    TF_ERROR = 202
    START_OUTSIDE_MAP = 203
    GOAL_OUTSIDE_MAP = 204
    START_OCCUPIED = 205
    GOAL_OCCUPIED = 206
    TIMEOUT = 207
    NO_VALID_PATH = 208
    path: Path = field(default_factory=Path)
    planning_time: Duration = field(default_factory=Duration)
    error_code: int = 0
    error_msg: str = ''


class GoalHandle:
    """What rclpy hands to the action's callback."""

    def __init__(self, **request: Any) -> None:  # noqa: ANN401
        """Make a request."""
        self.request = Request(**request)
        self.ended = ''

    def succeed(self) -> None:
        """Note the success."""
        self.ended = 'succeeded'

    def abort(self) -> None:
        """Note the failure."""
        self.ended = 'aborted'


class FakeNode:
    """As much of a node as a path server uses."""

    def __init__(self) -> None:
        """Remember what is said and served."""
        self.said: list[str] = []
        self.services: dict[str, Any] = {}
        self.counts: list[str] = []
        self.diagnostics = SimpleNamespace(count=self.counts.append)

    def create_service(self, _: type, name: str, callback: object) -> None:
        """Remember a service."""
        self.services[name] = callback

    def warn(self, _: str, sentence: str) -> None:
        """Remember a warning."""
        self.said.append(sentence)

    def log_exception(self, what: str, error: BaseException) -> None:
        """Remember an error."""
        self.said.append(f'{what}: {error}')

    def get_logger(self) -> Any:  # noqa: ANN401
        """Return what logs."""
        return SimpleNamespace(info=self.said.append)


@pytest.fixture
def nav2(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Install a stand-in for nav2_msgs; the server's name and callback come back in it."""
    made: dict[str, Any] = {}
    package: Any = ModuleType('nav2_msgs')
    package.action = ModuleType('nav2_msgs.action')
    package.action.ComputePathToPose = SimpleNamespace(Result=Result)

    def serve(_: object, kind: object, name: str, execute: object) -> None:
        made.update(kind=kind, name=name, execute=execute)

    monkeypatch.setitem(sys.modules, 'nav2_msgs', package)
    monkeypatch.setitem(sys.modules, 'nav2_msgs.action', package.action)
    monkeypatch.setattr('rclpy.action.ActionServer', serve)
    return made


def server(compute: Any) -> FakeNode:  # noqa: ANN401 - any stand-in
    """Offer paths."""
    node: Any = FakeNode()
    PathServer(node, compute, 'compute_path_to_pose', ('vgdp', 'GridBased'))
    made: FakeNode = node
    return made


def path_to(_: PoseStamped | None, goal: PoseStamped) -> Path:
    """Compute a path of two poses."""
    end = (goal.pose.position.x, goal.pose.position.y)
    return to_path_of_points([(0.0, 0.0), end], stamp=9, frame_id='map')


def test_the_action_answers_with_a_path(nav2: dict[str, Any]) -> None:
    """From the robot, or from a start if there is one."""
    starts: list[PoseStamped | None] = []

    def compute(start: PoseStamped | None, goal: PoseStamped) -> Path:
        starts.append(start)
        return path_to(start, goal)

    server(compute)
    assert nav2['name'] == 'compute_path_to_pose'
    for planner_id in ('', 'vgdp', 'GridBased'):
        handle = GoalHandle(planner_id=planner_id, start=GOAL, use_start=planner_id == 'vgdp')
        result = nav2['execute'](handle)
        assert (handle.ended, result.error_code) == ('succeeded', 0)
        assert len(result.path.poses) == 2
        assert result.planning_time.sec == 0
    assert starts == [None, GOAL, None]


@pytest.mark.parametrize('failure', list(PathFailure))
def test_every_error_has_its_code(nav2: dict[str, Any], failure: PathFailure) -> None:
    """Nav2's own numbers, with a sentence."""

    def compute(_: PoseStamped | None, __: PoseStamped) -> Path:
        raise PathError(failure, 'There is a reason.')

    node = server(compute)
    handle = GoalHandle()
    result = nav2['execute'](handle)
    assert handle.ended == 'aborted'
    assert result.error_code == 200 + list(PathFailure).index(failure)
    assert result.error_msg == 'There is a reason.'
    assert not result.path.poses
    assert any('There is a reason' in sentence for sentence in node.said)


def test_errors_that_nobody_named(nav2: dict[str, Any]) -> None:
    """A pose in another frame, a planner that is not there, and anything unexpected."""

    def compute(start: PoseStamped | None, _: PoseStamped) -> Path:
        if start is None:
            msg = 'Its frame_id is moon.'
            raise InvalidMessage(msg)
        msg = 'bad luck'
        raise RuntimeError(msg)

    node = server(compute)
    assert nav2['execute'](GoalHandle()).error_code == Result.TF_ERROR
    assert nav2['execute'](GoalHandle(planner_id='Smac')).error_code == Result.INVALID_PLANNER
    assert nav2['execute'](GoalHandle(use_start=True)).error_code == Result.UNKNOWN
    assert any('bad luck' in sentence for sentence in node.said)


def test_the_service_is_always_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without nav2_msgs too; where there is no path it answers with an empty one."""
    monkeypatch.setitem(sys.modules, 'nav2_msgs', None)
    node = server(path_to)
    assert any('nav2_msgs is not installed' in sentence for sentence in node.said)
    serve = node.services['~/get_plan']
    response = serve(GetPlan.Request(goal=GOAL), GetPlan.Response())
    assert [p.pose.position.x for p in response.plan.poses] == [0.0, 1.0]

    def nowhere(_: PoseStamped | None, __: PoseStamped) -> Path:
        raise PathError(PathFailure.NO_VALID_PATH, 'A wall.')

    serve = server(nowhere).services['~/get_plan']
    assert not serve(GetPlan.Request(goal=GOAL), GetPlan.Response()).plan.poses
