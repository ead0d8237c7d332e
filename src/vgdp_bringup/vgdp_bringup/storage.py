"""The files of a rosbag2 bag, written so that what is in them survives a crash.

Everything handed to ``flush`` is on the disk, in whole records, when it returns. What a file still
lacks then, its index and its metadata, ``recovery`` makes anew from the records.
"""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import yaml
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Protocol

    from rosbags.interfaces import Qos

    class BagFile(Protocol):
        """One file of a bag, open for writing."""

        path: Path
        size: int

        def __init__(self, path: Path) -> None:
            """Create the file, which must not exist."""

        def add_topic(self, topic: RecordedTopic) -> None:
            """Announce a topic, before its first message."""

        def write(self, topic: str, received: int, data: bytes) -> None:
            """Add a serialized message that came in at ``received`` nanoseconds."""

        def flush(self) -> None:
            """Bring everything so far to the disk."""

        def close(self, metadata: str, notes: Mapping[str, str]) -> None:
            """Write what comes last: index, metadata of the bag so far (YAML), and notes."""


CHUNK_BYTES = 4 << 20
"""A chunk of an MCAP file is not made larger than this, unless by one message alone."""

ENCODINGS = ('ros2msg', 'ros2idl')
IDL_START = '=' * 80 + '\nIDL: '
"""How a definition in IDL begins; any other is in the language of ``.msg`` files."""

BAG_VERSION = 9
NOTES = 'recorder'
"""Name of the metadata record with the recorder's notes."""


@dataclass(frozen=True)
class RecordedTopic:
    """What a bag says about a topic.

    Attributes:
        name: Its full name.
        type: Type of its messages, ``package/msg/Name``.
        qos: What its publishers offer.
        definition: Definition of the type with all that it is made of.
        digest: Hash of the type (REP-2016), empty if it is not known.
    """

    name: str
    type: str
    qos: tuple[Qos, ...] = field(default=(), compare=False)
    definition: str = field(default='', compare=False)
    digest: str = field(default='', compare=False)

    @property
    def encoding(self) -> str:
        """The language of the definition; empty if there is none."""
        if not self.definition:
            return ''
        return ENCODINGS[self.definition.startswith(IDL_START)]

    @property
    def qos_text(self) -> str:
        """The offered QoS as YAML."""
        return to_yaml(dump_qos_v9(list(self.qos))).strip() if self.qos else ''


def to_yaml(content: object) -> str:
    """Return YAML as rosbag2 reads it."""
    # The one in C, where there is one, is ten times as fast, which counts when a node has to end.
    dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
    text: str = yaml.dump(content, Dumper=dumper, sort_keys=False)
    return text


class McapFile:
    """An MCAP file without compression; each flush ends a chunk."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        self._file = path.open('xb')
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        self._writer.start('ros2')
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._written: dict[str, int] = {}

    def add_topic(self, topic: RecordedTopic) -> None:
        """See ``BagFile``."""
        if topic.type not in self._schemas:
            self._schemas[topic.type] = self._writer.register_schema(
                topic.type, topic.encoding, topic.definition.encode()
            )
        self._channels[topic.name] = self._writer.register_channel(
            topic.name,
            'cdr',
            self._schemas[topic.type],
            {'offered_qos_profiles': topic.qos_text, 'topic_type_hash': topic.digest},
        )
        self._written[topic.name] = 0

    def write(self, topic: str, received: int, data: bytes) -> None:
        """See ``BagFile``."""
        self._writer.add_message(
            self._channels[topic], received, data, received, self._written[topic]
        )
        self._written[topic] += 1
        self.size += len(data)

    def flush(self) -> None:
        """See ``BagFile``."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        os.fsync(self._file.fileno())

    def close(self, metadata: str, notes: Mapping[str, str]) -> None:
        """See ``BagFile``."""
        with self._file:
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._writer.add_metadata('rosbag2', {'serialized_metadata': metadata})
            if notes:
                self._writer.add_metadata(NOTES, dict(notes))
            self._writer.finish()  # type: ignore[no-untyped-call]


class Sqlite3File:
    """An SQLite file; each flush ends a transaction.

    A write-ahead log lies beside it until it is closed. The notes are in the metadata alone.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = 0
        # Made in one thread, used by another one after that.
        self._connection = sqlite3.connect(path, check_same_thread=False)
        self._connection.executescript(Sqlite3Writer.SQLITE_SCHEMA)
        self._connection.execute('PRAGMA journal_mode = WAL')
        self._connection.execute('PRAGMA synchronous = FULL')
        self._ids: dict[str, int] = {}
        self._types: set[str] = set()

    def add_topic(self, topic: RecordedTopic) -> None:
        """See ``BagFile``."""
        self._ids[topic.name] = len(self._ids) + 1
        if topic.type not in self._types:
            self._types.add(topic.type)
            self._connection.execute(
                'INSERT INTO message_definitions (topic_type, encoding,'
                ' encoded_message_definition, type_description_hash) VALUES (?, ?, ?, ?)',
                (topic.type, topic.encoding, topic.definition, topic.digest),
            )
        self._connection.execute(
            'INSERT INTO topics VALUES (?, ?, ?, ?, ?, ?)',
            (self._ids[topic.name], topic.name, topic.type, 'cdr', topic.qos_text, topic.digest),
        )

    def write(self, topic: str, received: int, data: bytes) -> None:
        """See ``BagFile``."""
        self._connection.execute(
            'INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)',
            (self._ids[topic], received, data),
        )
        self.size += len(data)

    def flush(self) -> None:
        """See ``BagFile``."""
        self._connection.commit()

    def close(self, metadata: str, notes: Mapping[str, str]) -> None:
        """See ``BagFile``."""
        del notes
        with closing(self._connection):
            self._connection.execute(
                'INSERT INTO metadata (metadata_version, metadata) VALUES (?, ?)',
                (BAG_VERSION, metadata),
            )
            self._connection.commit()
            # One file, as readers expect, that takes in the log.
            self._connection.execute('PRAGMA journal_mode = DELETE')


FILES: dict[str, tuple[type[BagFile], str]] = {
    'mcap': (McapFile, '.mcap'),
    'sqlite3': (Sqlite3File, '.db3'),
}
"""What writes each kind of storage, and how its files are called."""
