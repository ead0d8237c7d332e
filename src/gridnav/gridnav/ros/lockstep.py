"""Episodes of a world that takes ``action``: one at a time, each answered by an observation."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import UInt8

from gridnav.actions import DONE
from gridnav.metrics import Outcome
from gridnav.ros.conversions import NANOSECONDS
from gridnav.ros.episode import PLANNER_GAVE_UP, EpisodeStatus
from gridnav.ros.qos import EPISODE_QOS, RELIABLE_QOS
from gridnav.ros.validation import InvalidMessage

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from gridnav.metrics import EpisodeResult
    from gridnav.ros.node import BaseNode

MAX_QUEUED = 1000
"""More actions than this never wait for their turn."""


class LockstepParameters(Protocol):
    """Parameters of a node that count here.

    Attributes:
        seed: Of the first episode; each later one adds 1, until it is set again.
        rate: Actions executed in a second; 0 executes each at once.
    """

    seed: int
    rate: float


P = TypeVar('P', bound=LockstepParameters)


@dataclass(frozen=True)
class LockstepWorld:
    """What a node does with its world when it is time for it.

    Attributes:
        begin: Puts the robot on its start, given a seed, and returns the stamp in nanoseconds of
            the first observation.
        show_start: Publishes the first observation, once the episode was announced.
        act: Takes an action.
        show_step: Publishes what came of an action.
        give_up: Ends the episode as given up.
        result: Returns what the episode came to so far.
        facts: Returns what else is said of the episode on ``episode``.
    """

    begin: Callable[[int], int]
    show_start: Callable[[], None]
    act: Callable[[int], None]
    show_step: Callable[[], None]
    give_up: Callable[[], None]
    result: Callable[[], EpisodeResult]
    facts: Callable[[], Mapping[str, object]]


class Lockstep:
    """Hands actions to a world in turn, at its pace, and says how each episode goes.

    Args:
        node: Whose world it is.
        source: Who speaks on ``episode``.
        world: What the node does with its world.

    Attributes:
        seed: Of the episode.
    """

    def __init__(self, node: BaseNode[P], source: str, world: LockstepWorld) -> None:
        self._node = node
        self._parameters: LockstepParameters = node.parameters
        self._source = source
        self._world = world
        self._actions: deque[int] = deque()
        self._base_seed = self.seed = node.parameters.seed
        self._episodes = 0
        self._start = -1
        self._episode = node.advertise(DiagnosticStatus, 'episode', EPISODE_QOS)
        self._pace = node.create_timer(1.0, self._on_pace)
        self._pace.cancel()

    def open(self) -> None:
        """Begin the first episode, then listen."""
        self._begin_episode()
        self._node.subscribe(
            DiagnosticStatus, 'episode', self._on_episode, EPISODE_QOS, single_source=False
        )
        self._node.subscribe(UInt8, 'action', self._on_action, RELIABLE_QOS)
        self._node.provide_reset(self._reset)

    @property
    def _running(self) -> bool:
        return self._world.result().outcome is Outcome.RUNNING

    def _begin_episode(self) -> None:
        if self._parameters.seed != self._base_seed:
            self._base_seed, self._episodes = self._parameters.seed, 0
        seed = self._base_seed + self._episodes
        self._start = self._world.begin(seed)
        self._episodes += 1
        self.seed = seed
        self._actions.clear()
        self._pace.cancel()
        self._publish_episode()
        self._world.show_start()

    def _reset(self) -> str:
        self._begin_episode()
        return f'A new episode with seed {self.seed} has begun.'

    def _on_action(self, message: UInt8) -> None:
        if message.data > DONE:
            msg = f'An action is a number from 0 to {DONE}, got {message.data}.'
            raise InvalidMessage(msg)
        if not self._running:
            self._node.diagnostics.count('ignored: action after the end of the episode')
            return
        if len(self._actions) >= MAX_QUEUED:
            msg = f'More than {MAX_QUEUED} actions are waiting to be executed.'
            raise InvalidMessage(msg)
        self._actions.append(message.data)
        if self._pace.is_canceled():
            self._on_pace()

    def _on_pace(self) -> None:
        """Execute the next action, or all of them when there is no pace to keep."""
        self._pace.cancel()
        while self._actions:
            self._execute(self._actions.popleft())
            if self._parameters.rate > 0:
                self._pace.timer_period_ns = round(NANOSECONDS / self._parameters.rate)
                self._pace.reset()
                return

    def _execute(self, action: int) -> None:
        """Take one action and publish what came of it."""
        began = time.perf_counter()
        self._world.act(action)
        if not self._running:
            self._end_episode()
        self._world.show_step()
        self._node.diagnostics.latency(time.perf_counter() - began, 'step')

    def _on_episode(self, message: DiagnosticStatus) -> None:
        """End the episode when the planner of this very episode gave up."""
        if message.name == self._source:
            return
        status = EpisodeStatus.from_message(message)
        gave_up = status.message in PLANNER_GAVE_UP and status.start == self._start
        if gave_up and self._running:
            self._world.give_up()
            self._node.get_logger().info(f'{status.source} gave up: {status.message}.')
            self._end_episode()

    def _end_episode(self) -> None:
        self._actions.clear()
        self._pace.cancel()
        self._publish_episode()
        result = self._world.result()
        self._node.get_logger().info(
            f'Episode with seed {self.seed} ended in {result.outcome} after {result.steps} '
            f'actions, SPL {result.spl:.2f}.'
        )

    def _publish_episode(self) -> None:
        result = self._world.result()
        values = {
            'steps': result.steps,
            'path_cost': f'{result.path_cost:.6f}',
            'expert_steps': result.expert_steps,
            'expert_cost': f'{result.expert_cost:.6f}',
            'spl': f'{result.spl:.6f}',
            'spl_steps': f'{result.spl_steps:.6f}',
            'seed': self.seed,
            **self._world.facts(),
        }
        status = EpisodeStatus(
            self._source, result.outcome, self._start, {key: str(v) for key, v in values.items()}
        )
        self._episode.publish(status.to_message())
        fine = result.outcome in (Outcome.RUNNING, Outcome.SUCCESS)
        level = DiagnosticStatus.OK if fine else DiagnosticStatus.WARN
        self._node.diagnostics.report(level, f'seed {self.seed}: {result.outcome}')
