"""Record serialized messages into a rosbag2 bag that a crash can't take away, without ROS.

A thread of its own writes, so that a slow disk holds nobody up. What waits for it is bounded; what
finds no room is dropped and counted.
"""

from __future__ import annotations

import math
import os
import sqlite3
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys import Stores, get_typestore

from vgdp_bringup.storage import BAG_VERSION, FILES, RecordedTopic, to_yaml

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from vgdp_bringup.storage import BagFile

FOREVER = QosTime(9223372036, 854775807)
"""How ROS 2 writes an infinite duration."""

FLUSH_S = 0.4
"""So often everything is brought to the disk; whatever happens, no more than this is lost."""

QUEUE_BYTES = 512 << 20
"""So much may wait for the disk: four seconds of 1080p colour and depth at 10 Hz."""

ROOM_PERIOD_S = 0.01
NEVER = 2**63 - 1


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


@dataclass
class Counts:
    """What became of the messages of a topic.

    Attributes:
        received: They came in; ``written`` and ``dropped`` once none waits any more.
        written: They are in the bag.
        dropped: There was no room for them, or the disk failed, or the end came first.
        lost: They never came in, as the middleware said.
    """

    received: int = 0
    written: int = 0
    dropped: int = 0
    lost: int = 0


@dataclass
class _Span:
    """When the messages of a file, or of a bag, came in, and how many they are."""

    first: int = NEVER
    last: int = 0
    messages: int = 0

    def add(self, received: int) -> None:
        self.first, self.last = min(self.first, received), max(self.last, received)
        self.messages += 1

    @property
    def duration(self) -> int:
        return max(self.last - self.first, 0)

    def to_yaml(self) -> dict[str, object]:
        return {
            'starting_time': {'nanoseconds_since_epoch': self.first},
            'duration': {'nanoseconds': self.duration},
            'message_count': self.messages,
        }


class BagRecorder:
    """A bag that is being written.

    Index and metadata come when it is closed. Until then ``vgdp bag recover`` makes them from what
    is there, which is all but the last moment.

    Attributes:
        failure: Why nothing is written any more; empty as long as all is well.
    """

    def __init__(
        self,
        path: Path,
        storage: str = 'mcap',
        *,
        max_bytes: int = 0,
        max_seconds: float = 0.0,
        queue_bytes: int = QUEUE_BYTES,
    ) -> None:
        """Create the bag.

        Args:
            path: Folder of the bag; its parents are made where they are missing.
            storage: ``'mcap'`` or ``'sqlite3'``.
            max_bytes: A file with so many bytes of data is followed by another; 0 for one file.
            max_seconds: A file that spans this time is followed by another; 0 for one file.
            queue_bytes: So much may wait for the disk.

        Raises:
            FileExistsError: If the folder exists already.
            OSError: If it can't be made.
        """
        if path.exists():
            msg = f'{path} exists already, not overwriting.'
            raise FileExistsError(msg)
        path.mkdir(parents=True)
        self.failure = ''
        self._path, self._storage = path, storage
        self._max_bytes, self._max_ns = max_bytes, round(max_seconds * 1e9)
        self._queue_bytes = queue_bytes
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._topics: dict[str, RecordedTopic] = {}
        self._counts: dict[str, Counts] = {}
        self._total = _Span()
        self._files: list[tuple[str, _Span]] = []
        self._file = self._next_file()

        self._ready = threading.Condition()
        self._queue: deque[tuple[str, int, bytes]] = deque()
        self._waiting_bytes = 0
        self._ends_at: float | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name='bag writer', daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        """Return the recorder itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bag."""
        self.close()

    @property
    def waiting_bytes(self) -> int:
        """How much waits for the disk."""
        return self._waiting_bytes

    def counts(self) -> dict[str, Counts]:
        """Return what became of the messages so far, by the full name of the topic."""
        with self._ready:
            return {name: Counts(**vars(counts)) for name, counts in self._counts.items()}

    def can_describe(self, message_type: str) -> bool:
        """Tell whether the definition of a type is known, without which no topic is added."""
        return message_type in self._typestore.fielddefs

    def knows(self, topic: str) -> bool:
        """Tell whether a topic was announced."""
        return topic in self._topics

    def add_topic(self, topic: str, message_type: str, qos: Sequence[Qos]) -> None:
        """Announce a topic, before its first message.

        Args:
            topic: Its full name.
            message_type: ``package/msg/Name``.
            qos: What its publishers offer.
        """
        definition, _ = self._typestore.generate_msgdef(message_type, ros_version=2)
        digest = self._typestore.hash_rihs01(message_type)
        self.announce(RecordedTopic(topic, message_type, tuple(qos), definition, digest))

    def announce(self, topic: RecordedTopic) -> None:
        """Announce a topic of which everything is known."""
        with self._ready:
            self._topics[topic.name] = topic
            self._counts.setdefault(topic.name, Counts())

    def write(self, topic: str, received: int, data: bytes, *, wait: bool = False) -> bool:
        """Take a serialized message (CDR) that came in at ``received`` nanoseconds.

        Args:
            topic: The full name of a topic that was announced.
            received: When it came in.
            data: The message.
            wait: Whether to wait until there is room for it.

        Returns:
            Whether there was room for it; else it is dropped, and counted as such.
        """
        with self._ready:
            counts = self._counts[topic]
            counts.received += 1
            while wait and self._waiting_bytes > self._queue_bytes // 2 and not self.failure:
                self._ready.wait(ROOM_PERIOD_S)
            full = self._waiting_bytes + len(data) > self._queue_bytes
            if self.failure or self._ends_at is not None or full:
                counts.dropped += 1
                return False
            self._queue.append((topic, received, data))
            self._waiting_bytes += len(data)
            self._ready.notify()
        return True

    def lost(self, topic: str, count: int) -> None:
        """Count messages that never came in."""
        with self._ready:
            self._counts[topic].lost += count

    def close(self, within: float = math.inf) -> None:
        """Write what waits, index and metadata; nothing can be added afterwards.

        Args:
            within: What still waits after so many seconds is left out.
        """
        if self._closed:
            return
        self._closed = True
        with self._ready:
            self._ends_at = time.monotonic() + within
            self._ready.notify()
        self._thread.join()
        try:
            for name, topic in self._topics.items():
                if name not in self._in_file:
                    self._file.add_topic(topic)
            self._finish_file()
            text = to_yaml(self._metadata())
            temporary = self._path / 'metadata.yaml.tmp'
            temporary.write_text(text, encoding='utf-8')
            temporary.replace(self._path / 'metadata.yaml')
            _sync(self._file.path)
        except (OSError, sqlite3.Error) as error:
            self.failure = self.failure or str(error)

    def _run(self) -> None:
        """Write what comes in, and bring it to the disk again and again."""
        due = time.monotonic() + FLUSH_S
        while True:
            with self._ready:
                left = due - time.monotonic()
                if not self._queue and self._ends_at is None and left > 0:
                    self._ready.wait(left)
                item = self._queue.popleft() if self._queue else None
                ends_at = self._ends_at
            try:
                if item is not None:
                    self._take(*item, ends_at)
                if time.monotonic() >= due:
                    self._flush()
                    due = time.monotonic() + FLUSH_S
            except Exception as error:  # noqa: BLE001 - else nobody would notice
                self.failure = f'{type(error).__name__}: {error}'
            if item is None and ends_at is not None:
                return

    def _take(self, topic: str, received: int, data: bytes, ends_at: float | None) -> None:
        """Write a message, unless it is too late for it."""
        late = ends_at is not None and time.monotonic() > ends_at
        written = False
        try:
            if not self.failure and not late:
                self._write(topic, received, data)
                written = True
        finally:
            with self._ready:
                self._waiting_bytes -= len(data)
                self._counts[topic].written += written
                self._counts[topic].dropped += not written

    def _write(self, topic: str, received: int, data: bytes) -> None:
        span = self._files[-1][1]
        full = self._max_bytes and self._file.size >= self._max_bytes
        old = self._max_ns and span.messages and received - span.first >= self._max_ns
        if full or old:
            self._finish_file()
            self._file = self._next_file()
            span = self._files[-1][1]
        if topic not in self._in_file:
            self._in_file.add(topic)
            self._file.add_topic(self._topics[topic])
        self._file.write(topic, received, data)
        span.add(received)
        self._total.add(received)

    def _flush(self) -> None:
        if not self.failure:
            self._file.flush()

    def _next_file(self) -> BagFile:
        make, suffix = FILES[self._storage]
        path = self._path / f'{self._path.name}_{len(self._files)}{suffix}'
        self._files.append((path.name, _Span()))
        self._in_file: set[str] = set()
        return make(path)

    def _finish_file(self) -> None:
        metadata = self._metadata()
        self._file.close(to_yaml(metadata['rosbag2_bagfile_information']), self._notes())

    def _notes(self) -> dict[str, str]:
        """Return what became of the messages, as text."""
        return {
            f'{name}: {what}': str(count)
            for name, counts in self.counts().items()
            for what, count in vars(counts).items()
        }

    def _metadata(self) -> dict[str, object]:
        counts = self.counts()
        return {
            'rosbag2_bagfile_information': {
                'version': BAG_VERSION,
                'storage_identifier': self._storage,
                **self._total.to_yaml(),
                'topics_with_message_count': [
                    {
                        'topic_metadata': {
                            'name': topic.name,
                            'type': topic.type,
                            'serialization_format': 'cdr',
                            'offered_qos_profiles': dump_qos_v9(list(topic.qos)),
                            'type_description_hash': topic.digest,
                        },
                        'message_count': counts[topic.name].written,
                    }
                    for topic in self._topics.values()
                ],
                'compression_format': '',
                'compression_mode': '',
                'relative_file_paths': [name for name, _ in self._files],
                'files': [{'path': name, **span.to_yaml()} for name, span in self._files],
                'custom_data': self._notes(),
                'ros_distro': 'jazzy',
            }
        }


def _sync(path: Path) -> None:
    """Bring a file that was closed to the disk."""
    with path.open('rb') as file:
        os.fsync(file.fileno())
