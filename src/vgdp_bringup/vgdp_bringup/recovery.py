"""Make a readable bag of what a recorder left that was killed."""

from __future__ import annotations

import shutil
import sqlite3
import struct
import sys
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.rosbag2.metadata import parse_qos

from vgdp_bringup.bags import BagError
from vgdp_bringup.recorder import BagRecorder
from vgdp_bringup.storage import RecordedTopic

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Sequence

    from rosbags.interfaces import Connection

    Item = tuple[RecordedTopic, int, bytes]

STORAGES = {'.mcap': 'mcap', '.db3': 'sqlite3'}


@dataclass(frozen=True)
class Recovery:
    """What could be saved.

    Attributes:
        bag: Folder of the new bag.
        messages: How many messages it holds.
        damage: For each file that did not end as it should, its name and what is wrong with it.
    """

    bag: Path
    messages: int
    damage: dict[str, str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp bag recover``."""
    parser.add_argument(
        'bag', type=Path, metavar='BAG', help='folder of the bag, or one .mcap or .db3 file of it'
    )
    parser.add_argument(
        '--out',
        type=Path,
        metavar='FOLDER',
        help='the new bag, which must not exist (default: BAG_recovered); BAG stays as it is',
    )


def run(args: argparse.Namespace) -> int:
    """Recover a bag and say what was saved."""
    source: Path = args.bag.resolve()
    name = source.stem if source.is_file() else source.name
    recovery = recover(source, args.out or source.with_name(f'{name}_recovered'))
    for name, damage in recovery.damage.items():
        sys.stdout.write(f'{name}: {damage}\n')
    sys.stdout.write(f'{recovery.messages} messages saved in {recovery.bag}\n')
    return 0


def recover(source: Path, target: Path) -> Recovery:
    """Write a new bag with every whole message of a damaged one, which stays as it is.

    Args:
        source: Folder of the bag, or one file of it (``.mcap``, ``.db3``).
        target: Folder of the new bag, which must not exist.

    Raises:
        BagError: If there is nothing to recover from, or nothing in it.
        FileExistsError: If the target exists.
    """
    files = _files(source)
    storage = STORAGES[files[0].suffix]
    damage: dict[str, str] = {}
    with BagRecorder(target, storage) as recorder:
        for file in files:
            read = _mcap_messages if file.suffix == '.mcap' else _sqlite3_messages
            for topic, received, data in read(file, damage):
                if not recorder.knows(topic.name):
                    recorder.announce(topic)
                recorder.write(topic.name, received, data, wait=True)
    messages = sum(counts.written for counts in recorder.counts().values())
    if recorder.failure:
        msg = f'{target} could not be written: {recorder.failure}'
        raise BagError(msg)
    if not messages:
        shutil.rmtree(target)
        msg = f'{source} holds no whole message.'
        raise BagError(msg)
    return Recovery(target, messages, damage)


def _files(source: Path) -> Sequence[Path]:
    """Return the files of a bag in their order."""
    if not source.exists():
        msg = f'{source} does not exist.'
        raise BagError(msg)
    found = [source] if source.is_file() else [*source.iterdir()]
    files = [path for path in found if path.suffix in STORAGES]
    if not files:
        msg = f'{source} holds no file of a bag (.mcap or .db3).'
        raise BagError(msg)
    return sorted(files, key=_number)


def _number(path: Path) -> tuple[int, str]:
    """Return what files are sorted by: the number at the end of their name."""
    last = path.stem.rsplit('_', 1)[-1]
    return (int(last) if last.isdecimal() else 0, path.name)


def _mcap_messages(path: Path, damage: dict[str, str]) -> Iterator[Item]:
    """Read an MCAP file from its beginning as far as it is whole."""
    schemas: dict[int, Schema] = {}
    topics: dict[int, RecordedTopic] = {}
    with path.open('rb') as file:
        try:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    topics[record.id] = _topic(record, schemas[record.schema_id])
                elif isinstance(record, Message):
                    yield topics[record.channel_id], record.log_time, record.data
        except (McapError, ValueError, struct.error, KeyError) as error:
            damage[path.name] = (
                f'it breaks off before byte {file.tell()} of {path.stat().st_size} '
                f'({type(error).__name__})'
            )


def _topic(channel: Channel, schema: Schema) -> RecordedTopic:
    said = channel.metadata
    return RecordedTopic(
        channel.topic,
        schema.name,
        tuple(parse_qos(said.get('offered_qos_profiles', ''))),
        schema.data.decode(),
        said.get('topic_type_hash', ''),
    )


def _sqlite3_messages(path: Path, damage: dict[str, str]) -> Iterator[Item]:
    """Read an SQLite file with the log beside it, in a copy, as reading takes in the log."""
    log = path.with_name(f'{path.name}-wal')
    with TemporaryDirectory(dir=path.parent) as folder:
        copy = Path(shutil.copy(path, folder))
        if log.exists():
            damage[path.name] = 'it was not closed'
            shutil.copy(log, folder)
        try:
            with closing(sqlite3.connect(copy)) as connection:
                connection.execute('PRAGMA journal_mode = DELETE').fetchall()
            with Reader(copy) as reader:
                topics = {c.id: _known(c) for c in reader.connections}
                for connection_, received, data in reader.messages():
                    yield topics[connection_.id], received, bytes(data)
        except (sqlite3.Error, ReaderError) as error:
            damage[path.name] = str(error)


def _known(connection: Connection) -> RecordedTopic:
    qos = tuple(getattr(connection.ext, 'offered_qos_profiles', ()))
    return RecordedTopic(
        connection.topic, connection.msgtype, qos, connection.msgdef.data, connection.digest
    )
