"""The recorder over real DDS."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability, QosReliability
from std_msgs.msg import UInt8
from tests.ros_helpers import wait_for

from gridnav.grid import GridGeometry
from gridnav.ros.conversions import to_occupancy_grid, to_pose_stamped
from gridnav.ros.qos import MAP_QOS, RELIABLE_QOS
from vgdp_bringup.topics import TOPICS

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from tests.ros_helpers import NodeProcess, Probe, StartNode

RECORDER = 'vgdp_bringup.node'
WARM_UP = 255


def record(
    bag: Path, namespace: str
) -> tuple[dict[str, Connection], dict[str, list[tuple[int, Any]]]]:
    """Return what a bag holds by relative topic: connections, and messages with their times."""
    connections = {}
    messages: dict[str, list[tuple[int, Any]]] = {}
    # Without a typestore: a bag has to bring its own definitions.
    with AnyReader([bag]) as reader:
        for connection in reader.connections:
            connections[connection.topic.removeprefix(f'{namespace}/')] = connection
        for connection, received, data in reader.messages():
            name = connection.topic.removeprefix(f'{namespace}/')
            content = reader.deserialize(data, connection.msgtype)
            messages.setdefault(name, []).append((received, content))
    return connections, messages


def received(arrays: list[DiagnosticArray], node: str) -> dict[str, int]:
    """Return how many messages of each topic a node has received, as it says itself."""
    counts: dict[str, int] = {}
    suffix = ': received'
    for status in [status for array in list(arrays) for status in array.status]:
        if status.name == node:
            counts |= {
                item.key.removesuffix(suffix): int(item.value)
                for item in status.values
                if item.key.endswith(suffix)
            }
    return counts


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_recording_is_complete(
    probe: Probe, node_process: StartNode, namespace: str, tmp_path: Path, number: int
) -> None:
    """After either signal the bag holds every message with its content and its QoS.

    Also the map, which was published before the recorder was there.
    """
    maps = probe.node.create_publisher(OccupancyGrid, 'map', MAP_QOS)
    cells = np.arange(-1, 11, dtype=np.int8).reshape(3, 4)
    maps.publish(
        to_occupancy_grid(cells, GridGeometry(3, 4, 0.5), stamp=1_000_000_002, frame_id='map')
    )
    bag = tmp_path / 'deep' / 'bag'
    recorder = node_process(RECORDER, {'bag': bag})
    actions = probe.publisher(UInt8, 'action', RELIABLE_QOS)
    goals = probe.publisher(PoseStamped, 'goal_pose', MAP_QOS)
    statuses = probe.record(DiagnosticArray, '/diagnostics', RELIABLE_QOS)
    goals.publish(to_pose_stamped(1.5, 2.5, stamp=3, frame_id='map'))

    def counted() -> dict[str, int]:
        return received(statuses, f'{namespace}/recorder')

    def warm_up() -> bool:
        # A publisher knows its subscriber before that one knows the publisher.
        actions.publish(UInt8(data=WARM_UP))
        return counted().get('action', 0) > 0

    wait_for(warm_up)
    for action in range(200):
        actions.publish(UInt8(data=action))
        time.sleep(0.002)
    before = len(statuses)
    wait_for(lambda: len(statuses) > before + 1 and {'map', 'goal_pose'} <= counted().keys())
    assert recorder.end(number) < 2.0

    connections, messages = record(bag, namespace)
    assert set(connections) == {topic.name for topic in TOPICS}
    sent = [content.data for _, content in messages['action']]
    assert [action for action in sent if action != WARM_UP] == list(range(200))
    times = [time for time, _ in messages['action']]
    assert times == sorted(times)
    ((_, goal),) = messages['goal_pose']
    assert (goal.pose.position.x, goal.pose.position.y) == (1.5, 2.5)
    ((_, grid),) = messages['map']
    assert grid.data.tolist() == cells.reshape(-1).tolist()
    assert (grid.header.stamp.sec, grid.header.stamp.nanosec) == (1, 2)
    assert messages['/diagnostics']
    for name, durability, depth in (
        ('map', QosDurability.TRANSIENT_LOCAL, 1),
        ('episode', QosDurability.TRANSIENT_LOCAL, 10),
        ('odom', QosDurability.VOLATILE, 10),
    ):
        extension = connections[name].ext
        assert isinstance(extension, ConnectionExtRosbag2)
        (qos,) = extension.offered_qos_profiles
        assert qos.reliability is QosReliability.RELIABLE
        assert qos.durability is durability
        assert qos.depth == depth


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_empty_recording_is_readable(
    node_process: StartNode, namespace: str, tmp_path: Path, number: int
) -> None:
    """A recorder that is stopped at once leaves a bag all the same."""
    recorder = node_process(RECORDER, {'bag': tmp_path / 'bag'})
    recorder.wait_output('Recording')
    assert recorder.end(number) < 2.0
    connections, _ = record(tmp_path / 'bag', namespace)
    assert len(connections) == len(TOPICS)


def assert_refuses(recorder: NodeProcess, sentence: str) -> None:
    """Check that a recorder did not start, and why, in one line."""
    assert recorder.process.wait(15) == 1
    assert sentence in recorder.output.splitlines()[-1]
    recorder_lines = [line for line in recorder.output.splitlines() if 'Traceback' in line]
    assert recorder_lines == []


def test_an_existing_bag_is_not_touched(node_process: StartNode, tmp_path: Path) -> None:
    """It is somebody's recording."""
    (tmp_path / 'bag').mkdir()
    recorder = node_process(RECORDER, {'bag': tmp_path / 'bag'})
    assert_refuses(recorder, 'bag exists already, not overwriting.')
    assert list((tmp_path / 'bag').iterdir()) == []


def test_a_bag_has_a_name_by_default(
    node_process: StartNode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one that ``ros2 bag record`` would give it."""
    monkeypatch.chdir(tmp_path)
    recorder = node_process(RECORDER)
    recorder.wait_output('Recording')
    wait_for(lambda: list(Path().glob('rosbag2_*-*')))
    recorder.end(signal.SIGINT)
    (bag,) = Path().glob('rosbag2_*-*')
    assert (bag / 'metadata.yaml').is_file()
    assert os.listdir(bag)  # noqa: PTH208 - more than the metadata alone
