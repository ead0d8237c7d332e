"""Writing bags, and what is left of them after a crash."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2 import Reader
from tests.vgdp_bringup.synthetic import QOS, SECOND, STORE, SyntheticBag, message

from vgdp_bringup.bags import BagError, read_episodes
from vgdp_bringup.cli import main
from vgdp_bringup.recorder import BagRecorder, Counts
from vgdp_bringup.recovery import recover

if TYPE_CHECKING:
    from pathlib import Path

STORAGES = ('mcap', 'sqlite3')
LOSS_S = 1.0
"""No more than this may be lost."""


def text(content: str) -> bytes:
    """Serialize a text."""
    data = STORE.serialize_cdr(message('std_msgs/msg/String', data=content), 'std_msgs/msg/String')
    return bytes(data)


def texts(bag: Path) -> list[tuple[int, str]]:
    """Return the times and texts in a bag, read with nothing but what it brings."""
    with AnyReader([bag]) as reader:
        return [
            (received, reader.deserialize(data, connection.msgtype).data)  # type: ignore[attr-defined]
            for connection, received, data in reader.messages()
        ]


def write_texts(recorder: BagRecorder, count: int, step: int = SECOND) -> None:
    """Write texts with consecutive numbers on one topic."""
    recorder.add_topic('/said', 'std_msgs/msg/String', [QOS])
    for number in range(count):
        assert recorder.write('/said', number * step, text(str(number)))


@pytest.mark.parametrize('storage', STORAGES)
def test_what_was_written_is_read_back(tmp_path: Path, storage: str) -> None:
    """Messages, times, QoS, definitions and counts, also of a topic on which nothing was said."""
    with BagRecorder(tmp_path / 'bag', storage) as recorder:
        write_texts(recorder, 300)
        recorder.add_topic('/silent', 'nav_msgs/msg/OccupancyGrid', [QOS])
    assert texts(tmp_path / 'bag') == [(i * SECOND, str(i)) for i in range(300)]
    with Reader(tmp_path / 'bag') as reader:
        assert [c.topic for c in reader.connections] == ['/said', '/silent']
        assert [c.msgcount for c in reader.connections] == [300, 0]
        for connection in reader.connections:
            assert isinstance(connection.ext, ConnectionExtRosbag2)
            assert connection.ext.offered_qos_profiles == [QOS]
            assert connection.digest == STORE.hash_rihs01(connection.msgtype)
        assert reader.duration == 299 * SECOND + 1
        notes = getattr(reader.storage, 'metadata').custom  # noqa: B009 - not in the protocol's types
    assert notes['/said: received'] == notes['/said: written'] == '300'
    assert notes['/said: dropped'] == notes['/silent: received'] == '0'


def test_an_mcap_file_stands_alone(tmp_path: Path) -> None:
    """Foxglove opens the file without the folder: index, definitions and notes are in it."""
    with BagRecorder(tmp_path / 'bag') as recorder:
        write_texts(recorder, 10)
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 10
        assert len(summary.chunk_indexes) == 1
        assert [schema.name for schema in summary.schemas.values()] == ['std_msgs/msg/String']
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        found = [data.log_time for _, _, data in reader.iter_messages('/said', starting_at=SECOND)]
    assert found == [i * SECOND for i in range(1, 10)]
    assert records['recorder']['/said: written'] == '10'
    assert 'rosbag2' in records


@pytest.mark.parametrize('storage', STORAGES)
@pytest.mark.parametrize('limit', [{'max_bytes': 1000}, {'max_seconds': 20.0}])
def test_a_bag_is_split(tmp_path: Path, storage: str, limit: dict[str, Any]) -> None:
    """By size or by time; together the files hold everything, each with what it needs."""
    with BagRecorder(tmp_path / 'bag', storage, **limit) as recorder:
        write_texts(recorder, 300)
    assert texts(tmp_path / 'bag') == [(i * SECOND, str(i)) for i in range(300)]
    files = sorted((tmp_path / 'bag').glob('bag_*'))
    assert len(files) > 3
    per_file = [texts(file) for file in files]
    assert sum(map(len, per_file)) == 300
    if 'max_seconds' in limit:
        assert all(found[-1][0] - found[0][0] < 20 * SECOND for found in per_file)


def test_what_finds_no_room_is_counted(tmp_path: Path) -> None:
    """It is dropped at once, and the bag says so; nobody waits."""
    with BagRecorder(tmp_path / 'bag', queue_bytes=1000) as recorder:
        write_texts(recorder, 5)
        assert not recorder.write('/said', 9 * SECOND, text('x' * 2000))
        recorder.lost('/said', 3)
    counts = Counts(received=6, written=5, dropped=1, lost=3)
    assert recorder.counts() == {'/said': counts}
    with Reader(tmp_path / 'bag') as reader:
        notes = getattr(reader.storage, 'metadata').custom  # noqa: B009
    assert [notes[f'/said: {what}'] for what in vars(counts)] == ['6', '5', '1', '3']


def test_the_end_does_not_wait_for_a_slow_disk(tmp_path: Path) -> None:
    """What is not written in time is counted as dropped; the bag is whole all the same."""
    recorder = BagRecorder(tmp_path / 'bag')
    recorder.add_topic('/said', 'std_msgs/msg/String', [QOS])
    long = text('x' * 100_000)
    for number in range(2000):
        recorder.write('/said', number, long)
    recorder.close(within=0.0)
    counts = recorder.counts()['/said']
    assert counts.received == 2000 == counts.written + counts.dropped
    assert counts.dropped > 0
    assert len(texts(tmp_path / 'bag')) == counts.written


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    """A folder that exists is somebody's bag."""
    with pytest.raises(FileExistsError, match='exists already, not overwriting'):
        BagRecorder(tmp_path)


FULL_DISK = """
import pathlib, resource, sys, time
from tests.vgdp_bringup.test_recorder import text, QOS
from vgdp_bringup.recorder import BagRecorder
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
recorder = BagRecorder(pathlib.Path(sys.argv[1]))
recorder.add_topic('/said', 'std_msgs/msg/String', [QOS])
number = 0
while not recorder.failure:
    recorder.write('/said', number, text('x' * 10_000))
    number += 1
    time.sleep(0.01)
recorder.close()
counts = recorder.counts()['/said']
assert counts.received == counts.written + counts.dropped, counts
print(recorder.failure)
"""


def test_a_full_disk_is_said(tmp_path: Path) -> None:
    """The recorder goes on and says why nothing is written; what came before can be saved."""
    result = subprocess.run(
        [sys.executable, '-c', FULL_DISK, tmp_path / 'bag'],
        capture_output=True,
        text=True,
        check=True,
    )
    assert 'File too large' in result.stdout
    saved = recover(tmp_path / 'bag', tmp_path / 'saved')
    assert 10 < saved.messages <= 100


WRITE_FOREVER = """
import pathlib, sys, time
from tests.vgdp_bringup.test_recorder import text, QOS
from vgdp_bringup.recorder import BagRecorder
recorder = BagRecorder(pathlib.Path(sys.argv[1]), sys.argv[2], max_seconds=float(sys.argv[3]))
recorder.add_topic('/said', 'std_msgs/msg/String', [QOS])
print('ready', flush=True)
number = 0
while True:
    recorder.write('/said', time.time_ns(), text(f'{number} ' + 'x' * 500))
    number += 1
    time.sleep(0.001)
"""


@pytest.mark.parametrize('storage', STORAGES)
def test_kill_9_takes_no_more_than_a_second(tmp_path: Path, storage: str) -> None:
    """At random moments: everything up to one second before is there, without a gap.

    One recorder splits its bag, one of whose files may just have begun.
    """
    chance = random.Random(f'{storage} {os.getpid()}')  # noqa: S311 - a seed is all that is asked
    runs = []
    for number in range(3):
        bag = tmp_path / str(number)
        split = '0.7' if number % 2 else '0'
        process = subprocess.Popen(
            [sys.executable, '-c', WRITE_FOREVER, bag, storage, split],
            stdout=subprocess.PIPE,
        )
        runs.append((process, bag, chance.uniform(0.1, 2.5)))
    for process, _, _ in runs:
        assert process.stdout is not None
        assert process.stdout.readline() == b'ready\n'
    began = time.monotonic()
    for process, bag, moment in sorted(runs, key=lambda run: run[2]):
        time.sleep(max(began + moment - time.monotonic(), 0.0))
        killed = time.time()
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert process.stdout is not None
        process.stdout.close()
        with pytest.raises(BagError, match=r"'vgdp bag recover .*' reads what is there"):
            read_episodes(bag)
        try:
            recover(bag, bag.with_suffix('.saved'))
        except BagError as error:
            assert 'holds no whole message' in str(error)  # noqa: PT017
            assert moment < LOSS_S
            continue
        found = texts(bag.with_suffix('.saved'))
        assert [int(said.split()[0]) for _, said in found] == list(range(len(found)))
        assert found[-1][0] / SECOND > killed - LOSS_S, moment


def test_a_file_that_breaks_off_anywhere_can_be_read(tmp_path: Path) -> None:
    """Wherever an MCAP file is cut, all whole chunks before that are saved, and nothing raises."""
    bag = SyntheticBag(tmp_path / 'bag', flush_each=40)
    bag.add_episode(seed=4, start=SECOND)
    bag.close()
    whole = (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    with AnyReader([tmp_path / 'bag']) as reader:
        all_messages = [(c.topic, t, data) for c, t, data in reader.messages()]
    saved_before = 0
    for number, size in enumerate(np.linspace(0, len(whole), 25).astype(int)):
        cut = tmp_path / f'{number}.mcap'
        cut.write_bytes(whole[:size])
        try:
            saved = recover(cut, tmp_path / f'saved_{number}')
        except BagError:
            assert saved_before == 0
            continue
        assert saved_before <= saved.messages
        saved_before = saved.messages
        with AnyReader([saved.bag]) as reader:
            found = [(c.topic, t, data) for c, t, data in reader.messages()]
        assert len(found) == saved.messages
        assert set(found) <= set(all_messages)
        assert bool(saved.damage) == (size < len(whole))
    assert saved_before == len(all_messages)


def test_a_whole_bag_stays_what_it_is(tmp_path: Path) -> None:
    """Recovering what is not broken makes a bag with the same in it."""
    with BagRecorder(tmp_path / 'bag', 'sqlite3', max_bytes=1000) as recorder:
        write_texts(recorder, 100)
    before = {path.name: path.read_bytes() for path in (tmp_path / 'bag').iterdir()}
    saved = recover(tmp_path / 'bag', tmp_path / 'saved')
    assert (saved.messages, saved.damage) == (100, {})
    assert texts(tmp_path / 'saved') == texts(tmp_path / 'bag')
    assert {path.name: path.read_bytes() for path in (tmp_path / 'bag').iterdir()} == before


def test_the_command_says_what_it_saved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside the bag, which may have a dot in its name; twice is refused."""
    with BagRecorder(tmp_path / 'run.1') as recorder:
        write_texts(recorder, 5)
    file = tmp_path / 'run.1' / 'run.1_0.mcap'
    file.write_bytes(file.read_bytes()[:-3])
    assert main(['bag', 'recover', str(tmp_path / 'run.1')]) == 0
    damage, saved = capsys.readouterr().out.splitlines()
    assert damage.startswith('run.1_0.mcap: it breaks off')
    assert saved == f'5 messages saved in {tmp_path / "run.1_recovered"}'
    assert len(texts(tmp_path / 'run.1_recovered')) == 5
    assert main(['bag', 'recover', str(tmp_path / 'run.1')]) == 2
    assert 'exists already' in capsys.readouterr().err


def test_there_has_to_be_something_to_recover(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is no bag is refused in one sentence."""
    assert main(['bag', 'recover', str(tmp_path / 'missing')]) == 2
    assert 'missing does not exist' in capsys.readouterr().err
    with pytest.raises(BagError, match='missing does not exist'):
        recover(tmp_path / 'missing', tmp_path / 'saved')
    with pytest.raises(BagError, match='holds no file of a bag'):
        recover(tmp_path, tmp_path / 'saved')
    (tmp_path / 'bag_0.mcap').write_bytes(b'')
    with pytest.raises(BagError, match='holds no whole message'):
        recover(tmp_path, tmp_path / 'saved')
    assert not (tmp_path / 'saved').exists()
