"""The recorder node: everything the stack says, in a rosbag2 bag."""

from __future__ import annotations

import importlib
import sys
from copy import copy
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from gridnav.ros import qos as profiles
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.run import run_node
from vgdp_bringup.recorder import BagRecorder, offered_qos
from vgdp_bringup.topics import TOPICS, Topic

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

QUEUE_DEPTH = 1000
"""So many messages of a topic may wait while the disk is busy; none must get lost."""


@dataclass
class RecorderParameters:
    """Parameters of the recorder."""

    bag: str = parameter(
        '',
        'Folder of the bag to write, which must not exist yet; empty for rosbag2_<date>-<time>',
        read_only=True,
    )


class RecorderNode(BaseNode[RecorderParameters]):
    """Records the topics of ``TOPICS``, serialized as they come in, with their QoS.

    The bag is closed when the node is destroyed, and not readable before.
    """

    def __init__(self) -> None:
        """Create the bag and subscribe to everything."""
        super().__init__('recorder', RecorderParameters)
        path = Path(self.parameters.bag or datetime.now(UTC).strftime('rosbag2_%Y_%m_%d-%H_%M_%S'))
        self._recorder = BagRecorder(path)
        for topic in TOPICS:
            self._record(topic)
        self.get_logger().info(f'Recording {len(TOPICS)} topics to {path.resolve()}.')

    def destroy_node(self) -> None:
        """Close the bag, then end the node."""
        self._recorder.close()
        super().destroy_node()

    def _record(self, topic: Topic) -> None:
        name = self.resolve_topic_name(topic.name)
        qos = qos_of(topic)
        self._recorder.add_topic(
            name,
            topic.type,
            offered_qos(
                qos.depth,
                reliable=qos.reliability == ReliabilityPolicy.RELIABLE,
                transient_local=qos.durability == DurabilityPolicy.TRANSIENT_LOCAL,
            ),
        )

        def receive(data: bytes) -> None:
            self._recorder.write(name, self.get_clock().now().nanoseconds, data)
            self.diagnostics.received(topic.name)

        queue = copy(qos)
        queue.depth = max(qos.depth, QUEUE_DEPTH)
        self.create_subscription(message_class(topic), topic.name, receive, queue, raw=True)


def qos_of(topic: Topic) -> QoSProfile:
    """Return the profile that a topic's publishers offer."""
    profile: QoSProfile = getattr(profiles, f'{topic.qos}_QOS')
    return profile


def message_class(topic: Topic) -> Any:  # noqa: ANN401 - generated classes
    """Return the class of a topic's messages."""
    package, _, name = topic.type.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


def main() -> int:
    """Run the node; the executable ``recorder_node``."""
    return run_node(RecorderNode)


if __name__ == '__main__':
    sys.exit(main())
