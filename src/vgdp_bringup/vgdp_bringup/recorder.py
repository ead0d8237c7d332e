"""Write serialized messages into a rosbag2 bag, without ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

if TYPE_CHECKING:
    from pathlib import Path

    from rosbags.interfaces import Connection

FOREVER = QosTime(9223372036, 854775807)
"""How ROS 2 writes an infinite duration."""


def offered_qos(depth: int, *, reliable: bool, transient_local: bool) -> Qos:
    """Return a keep-last profile as bags hold it, without deadline or lifespan."""
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        durability=(QosDurability.TRANSIENT_LOCAL if transient_local else QosDurability.VOLATILE),
        deadline=FOREVER,
        lifespan=FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=FOREVER,
        avoid_ros_namespace_conventions=False,
    )


class BagRecorder:
    """An MCAP bag that is being written.

    It is readable only once it was closed: its index and its metadata come last.
    """

    def __init__(self, path: Path) -> None:
        """Create the bag.

        Args:
            path: Folder of the bag; its parents are made where they are missing.

        Raises:
            WriterError: If the folder exists already.
        """
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        self._writer = Writer(
            path, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP
        )
        self._writer.open()

    def add_topic(self, topic: str, message_type: str, qos: Qos) -> None:
        """Announce a topic: its full name, ``package/msg/Name``, and what is offered on it."""
        self._connections[topic] = self._writer.add_connection(
            topic, message_type, typestore=self._typestore, offered_qos_profiles=[qos]
        )

    def write(self, topic: str, received: int, data: bytes) -> None:
        """Add a serialized message (CDR) that came in at ``received`` nanoseconds."""
        self._writer.write(self._connections[topic], received, data)

    def close(self) -> None:
        """Write index and metadata; nothing can be added afterwards."""
        self._writer.close()
