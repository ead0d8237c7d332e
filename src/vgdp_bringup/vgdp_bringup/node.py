"""The recorder node: everything the stack says, in a rosbag2 bag."""

from __future__ import annotations

import importlib
import sys
from copy import copy
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from gridnav.ros import qos as profiles
from gridnav.ros.conversions import NANOSECONDS
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.run import run_node
from vgdp_bringup.recorder import FOREVER, QUEUE_BYTES, BagRecorder
from vgdp_bringup.topics import TOPICS, Topic

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.duration import Duration
    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

QUEUE_DEPTH = 1000
"""So many messages of a topic may wait in the middleware; none must get lost."""

SENSOR_QUEUE_DEPTH = 20
"""The same for cameras, whose images would fill the memory."""

WATCH_PERIOD_S = 0.25
"""So often the recorder looks who publishes what."""

CLOSE_S = 0.5
"""What still waits for the disk this long after the end is left out of the bag, and counted."""

MEGABYTE = 1_000_000

TRANSFORMS = ('/tf', '/tf_static')
"""Recorded besides the topics of the stack where somebody publishes them."""


@dataclass
class RecorderParameters:
    """Parameters of the recorder."""

    bag: str = parameter(
        '',
        'Folder of the bag to write, which must not exist yet; empty for rosbag2_<date>-<time>',
        read_only=True,
    )
    topics: str = parameter(
        '',
        'Names of the topics to record, with spaces between them; empty for all of the stack',
        read_only=True,
    )
    storage: str = parameter(
        'mcap', 'Kind of the files', choices=('mcap', 'sqlite3'), read_only=True
    )
    max_size: int = parameter(
        0,
        'A file of so many megabytes is followed by another; 0 for one file',
        unit='MB',
        low=0,
        high=1_000_000,
        read_only=True,
    )
    max_duration: float = parameter(
        0.0,
        'A file that spans so many seconds is followed by another; 0 for one file',
        unit='s',
        low=0.0,
        high=1e6,
        read_only=True,
    )
    queue_size: int = parameter(
        QUEUE_BYTES // MEGABYTE,
        'So much may wait for the disk; what finds no room is dropped and counted',
        unit='MB',
        low=1,
        high=1_000_000,
        read_only=True,
    )


class RecorderNode(BaseNode[RecorderParameters]):
    """Records topics, serialized as they come in, with the QoS they are offered with.

    The bag is closed when the node is destroyed; ``vgdp bag recover`` reads one that was not.
    """

    def __init__(self) -> None:
        """Create the bag and subscribe to everything.

        Raises:
            ParameterError: If a parameter can't be used.
            FileExistsError: If the bag exists already.
        """
        super().__init__('recorder', RecorderParameters)
        p = self.parameters
        path = Path(p.bag or datetime.now(UTC).strftime('rosbag2_%Y_%m_%d-%H_%M_%S'))
        self._recorder = BagRecorder(
            path,
            p.storage,
            max_bytes=p.max_size * MEGABYTE,
            max_seconds=p.max_duration,
            queue_bytes=p.queue_size * MEGABYTE,
        )
        chosen = p.topics.split() or [*(topic.name for topic in TOPICS), *TRANSFORMS]
        table = {self.resolve_topic_name(topic.name): topic for topic in TOPICS}
        self._chosen = {self.resolve_topic_name(name): name for name in chosen}
        self._known = {name: table[name] for name in self._chosen if name in table}
        self._subscriptions_of: dict[str, Subscription] = {}
        self._types: dict[str, str] = {name: topic.type for name, topic in self._known.items()}
        for name, topic in self._known.items():
            # A camera's images are taken as they are offered, once they are.
            if topic.qos != 'SENSOR':
                self._subscribe(name, qos_of(topic))
        self.create_timer(WATCH_PERIOD_S, self._watch)
        self.get_logger().info(f'Recording {len(self._chosen)} topics to {path.resolve()}.')

    def destroy_node(self) -> None:
        """Close the bag, then end the node."""
        for name, topic in self._known.items():
            if not self._recorder.knows(name):
                self._recorder.add_topic(name, topic.type, [to_qos(qos_of(topic))])
        self._recorder.close(within=CLOSE_S)
        if self._recorder.failure:
            self.get_logger().error(f'The bag is incomplete: {self._recorder.failure}')
        for name, counts in self._recorder.counts().items():
            if counts.dropped:
                self.get_logger().warning(
                    f'{counts.dropped} of {counts.received} messages of {name} are not in the bag.'
                )
        super().destroy_node()

    def _subscribe(self, name: str, qos: QoSProfile) -> None:
        """Subscribe to a topic of a known type, in place of an earlier subscription."""
        if name in self._subscriptions_of:
            self.destroy_subscription(self._subscriptions_of.pop(name))
        queue = copy(qos)
        queue.depth = SENSOR_QUEUE_DEPTH if self._is_camera(name) else QUEUE_DEPTH
        self._subscriptions_of[name] = self.create_subscription(
            load_message_class(self._types[name]),
            name,
            partial(self._receive, name),
            queue,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(message_lost=partial(self._lost, name)),
        )

    def _is_camera(self, name: str) -> bool:
        return name in self._known and self._known[name].qos == 'SENSOR'

    def _receive(self, name: str, data: bytes) -> None:
        received = self.get_clock().now().nanoseconds
        self._announce(name)
        self._recorder.write(name, received, data)
        self.diagnostics.received(self._chosen[name])

    def _lost(self, name: str, status: Any) -> None:  # noqa: ANN401 - a type of rclpy's C++ part
        self._announce(name)
        self._recorder.lost(name, status.total_count_change)

    def _announce(self, name: str) -> None:
        """Tell the bag about a topic, with what is offered on it now, before its first message."""
        if self._recorder.knows(name):
            return
        fallback = qos_of(self._known[name]) if name in self._known else None
        offered = [
            to_qos(info.qos_profile, fallback) for info in self.get_publishers_info_by_topic(name)
        ]
        if not offered and fallback is not None:
            offered = [to_qos(fallback)]
        self._recorder.add_topic(name, self._types[name], offered)

    def _watch(self) -> None:
        """Subscribe to what has come up or is offered otherwise than expected; say how it goes."""
        for name in self._chosen:
            publishers = self.get_publishers_info_by_topic(name)
            if publishers:
                self._adapt(name, publishers)
        dropped = 0
        for name, counts in self._recorder.counts().items():
            short = self._chosen[name]
            self.diagnostics.value(f'{short}: written', counts.written)
            self.diagnostics.value(f'{short}: dropped', counts.dropped)
            self.diagnostics.value(f'{short}: lost', counts.lost)
            dropped += counts.dropped
        self.diagnostics.value('waiting (MB)', f'{self._recorder.waiting_bytes / MEGABYTE:.1f}')
        if self._recorder.failure:
            sentence = f'Nothing is recorded any more: {self._recorder.failure}'
            self.diagnostics.report(DiagnosticStatus.ERROR, sentence)
            self.warn('failure', sentence)
        elif dropped:
            sentence = f'The disk is too slow: {dropped} messages are not in the bag.'
            self.diagnostics.report(DiagnosticStatus.WARN, sentence)
            self.warn('dropped', sentence)
        else:
            self.diagnostics.report(DiagnosticStatus.OK, 'recording')

    def _adapt(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Make sure that a subscription hears all publishers of its topic."""
        subscription = self._subscriptions_of.get(name)
        if subscription is not None and all(
            qos_check_compatible(info.qos_profile, subscription.qos_profile)[0]
            != QoSCompatibility.ERROR
            for info in publishers
        ):
            return
        message_type = self._types.setdefault(name, publishers[0].topic_type)
        if not self._recorder.can_describe(message_type):
            self._leave_out(name, f'the definition of {message_type} is not known')
            return
        try:
            self._subscribe(name, common_qos([info.qos_profile for info in publishers]))
        except (ImportError, AttributeError) as error:
            self._leave_out(name, str(error))

    def _leave_out(self, name: str, reason: str) -> None:
        """Say that a topic can't be recorded."""
        self.diagnostics.value(f'{self._chosen[name]}: not recorded', reason)
        self.warn(name, f'{name} is not recorded: {reason}')


def common_qos(offered: Sequence[QoSProfile]) -> QoSProfile:
    """Return the strongest profile that hears all publishers."""
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in offered)
    kept = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in offered)
    return QoSProfile(
        depth=QUEUE_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
    )


def to_qos(profile: QoSProfile, fallback: QoSProfile | None = None) -> Qos:
    """Return a profile as bags hold it.

    Args:
        profile: The profile; one that was discovered says nothing of history and depth.
        fallback: Where those are taken from in that case.
    """
    history = QosHistory[profile.history.name]
    depth = profile.depth
    if history is QosHistory.UNKNOWN and fallback is not None:
        history, depth = QosHistory[fallback.history.name], fallback.depth
    return Qos(
        history=history,
        depth=depth,
        reliability=QosReliability[profile.reliability.name],
        durability=QosDurability[profile.durability.name],
        deadline=_to_time(profile.deadline),
        lifespan=_to_time(profile.lifespan),
        liveliness=QosLiveliness[profile.liveliness.name],
        liveliness_lease_duration=_to_time(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def _to_time(duration: Duration) -> QosTime:
    """Return a duration as bags hold it; none at all is for ever."""
    seconds, rest = divmod(duration.nanoseconds, NANOSECONDS)
    return QosTime(seconds, rest) if duration.nanoseconds else FOREVER


def qos_of(topic: Topic) -> QoSProfile:
    """Return the profile that a topic's publishers offer."""
    profile: QoSProfile = getattr(profiles, f'{topic.qos}_QOS')
    return profile


def load_message_class(name: str) -> Any:  # noqa: ANN401 - generated classes
    """Return the class of a message type, ``package/msg/Name``."""
    package, _, message = name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), message)


def message_class(topic: Topic) -> Any:  # noqa: ANN401 - generated classes
    """Return the class of a topic's messages."""
    return load_message_class(topic.type)


def main() -> int:
    """Run the node; the executable ``recorder_node``."""
    return run_node(RecorderNode)


if __name__ == '__main__':
    sys.exit(main())
