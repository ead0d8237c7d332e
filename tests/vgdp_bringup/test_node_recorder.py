"""The recorder over real DDS."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from std_msgs.msg import UInt8
from tests.ros_helpers import wait_for
from tests.vgdp_bringup.filling import fill

from gridnav.grid import GridGeometry
from gridnav.ros.conversions import to_occupancy_grid, to_pose_stamped
from gridnav.ros.qos import MAP_QOS, RELIABLE_QOS
from vgdp_bringup.node import load_message_class, message_class, qos_of
from vgdp_bringup.recovery import recover
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


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_every_topic_comes_back(
    probe: Probe, node_process: StartNode, namespace: str, tmp_path: Path, storage: str
) -> None:
    """Each topic of the stack, sent with its QoS, is in the bag bit for bit."""
    recorder = node_process(RECORDER, {'bag': tmp_path / 'bag', 'storage': storage})
    sent = {topic.name: fill(message_class(topic)) for topic in TOPICS}
    publishers = {
        topic.name: probe.publisher(message_class(topic), topic.name, qos_of(topic))
        for topic in TOPICS
    }
    statuses = probe.record(DiagnosticArray, '/diagnostics', RELIABLE_QOS)

    def all_received() -> bool:
        missing = publishers.keys() - received(statuses, f'{namespace}/recorder').keys()
        for name in missing:
            publishers[name].publish(sent[name])
        return not missing

    publishers['/diagnostics'].publish(sent['/diagnostics'])
    wait_for(all_received, timeout=30)
    assert recorder.end(signal.SIGINT) < 2.0
    raw: dict[str, list[Any]] = {}
    with Reader(tmp_path / 'bag') as reader:
        for connection, _, data in reader.messages():
            content = deserialize_message(data, load_message_class(connection.msgtype))
            raw.setdefault(connection.topic.removeprefix(f'{namespace}/'), []).append(content)
    assert raw.keys() == sent.keys()
    for name, content in sent.items():
        assert content in raw[name], name
    # And without ROS, with the definitions in the bag alone.
    connections, messages = record(tmp_path / 'bag', namespace)
    assert messages.keys() == sent.keys()
    for topic in TOPICS:
        extension = connections[topic.name].ext
        assert isinstance(extension, ConnectionExtRosbag2)
        offered = qos_of(topic)
        names = {
            (qos.reliability.name, qos.durability.name) for qos in extension.offered_qos_profiles
        }
        assert (offered.reliability.name, offered.durability.name) in names, topic.name


def test_chosen_topics_alone(
    probe: Probe, node_process: StartNode, namespace: str, tmp_path: Path
) -> None:
    """Also one of another type than the stack's, and one offered with a weaker QoS than usual."""
    recorder = node_process(RECORDER, {'bag': tmp_path / 'bag', 'topics': '"odom battery"'})
    weak = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    odom_class, battery_class = (
        load_message_class(name)
        for name in ('nav_msgs/msg/Odometry', 'sensor_msgs/msg/BatteryState')
    )
    odom = probe.node.create_publisher(odom_class, 'odom', weak)
    battery = probe.publisher(battery_class, 'battery', RELIABLE_QOS)
    statuses = probe.record(DiagnosticArray, '/diagnostics', RELIABLE_QOS)

    def both() -> bool:
        odom.publish(fill(odom_class))
        battery.publish(fill(battery_class))
        return received(statuses, f'{namespace}/recorder').keys() >= {'odom', 'battery'}

    wait_for(both, timeout=30)
    recorder.end()
    connections, messages = record(tmp_path / 'bag', namespace)
    assert messages.keys() == connections.keys() == {'odom', 'battery'}
    extension = connections['odom'].ext
    assert isinstance(extension, ConnectionExtRosbag2)
    (qos,) = extension.offered_qos_profiles
    assert qos.reliability is QosReliability.BEST_EFFORT


def test_kill_9_over_dds(
    probe: Probe, node_process: StartNode, namespace: str, tmp_path: Path
) -> None:
    """What was sent up to a second before the kill is in the recovered bag, without a gap."""
    recorder = node_process(RECORDER, {'bag': tmp_path / 'bag'})
    actions = probe.publisher(UInt8, 'action', RELIABLE_QOS)
    time.sleep(0.5)
    began = time.monotonic()
    sent = []
    while time.monotonic() - began < 2.5:
        sent.append(time.time_ns())
        actions.publish(UInt8(data=len(sent) % 250))
        time.sleep(0.005)
    recorder.kill()
    killed = time.time_ns()
    recover(tmp_path / 'bag', tmp_path / 'saved')
    _, messages = record(tmp_path / 'saved', namespace)
    found = [content.data for _, content in messages['action']]
    first = found[0]
    assert first < 100
    assert found == [(first + i) % 250 for i in range(len(found))]
    assert sent[first + len(found) - 2] > killed - 1_000_000_000


@pytest.mark.parametrize('reliable', [True, False])
def test_a_camera_is_recorded(
    node_process: StartNode, namespace: str, tmp_path: Path, *, reliable: bool
) -> None:
    """Two seconds of 1080p colour and depth at 10 Hz."""
    check_camera(node_process, namespace, tmp_path / 'bag', frames=20, reliable=reliable)


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize('reliable', [True, False])
def test_a_camera_is_recorded_for_a_minute(
    node_process: StartNode, namespace: str, tmp_path: Path, *, reliable: bool
) -> None:
    """The same for a minute: more than six gigabytes."""
    check_camera(node_process, namespace, tmp_path / 'bag', frames=600, reliable=reliable)


def check_camera(
    node_process: StartNode, namespace: str, bag: Path, *, frames: int, reliable: bool
) -> None:
    """Record 1080p colour and depth at 10 Hz: whatever is missing has been counted."""
    from tests.vgdp_bringup import camera  # noqa: PLC0415

    recorder = node_process(RECORDER, {'bag': bag, 'topics': f'"{" ".join(camera.TOPICS)}"'})
    recorder.wait_output('Recording')
    sender = subprocess.Popen(
        [
            sys.executable,
            camera.__file__,
            str(frames),
            '10',
            str(reliable),
            '--ros-args',
            '-r',
            f'__ns:={namespace}',
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    said, _ = sender.communicate(timeout=300)
    assert recorder.end(signal.SIGINT) < 2.0
    with Reader(bag) as reader:
        notes = getattr(reader.storage, 'metadata').custom  # noqa: B009
        found = {c.topic: c.msgcount for c in reader.connections}
    counted = {
        what: [int(notes[f'{namespace}/{topic}: {what}']) for topic in camera.TOPICS]
        for what in ('received', 'written', 'dropped', 'lost')
    }
    sys.stdout.write(f'{said}{counted}\n')
    for index, topic in enumerate(camera.TOPICS):
        numbers = {what: values[index] for what, values in counted.items()}
        # A loss shows when a later message comes; the camera keeps five for who is slow.
        assert frames - 5 <= numbers['received'] + numbers['lost'] <= frames, counted
        assert numbers['received'] == numbers['written'] + numbers['dropped'], counted
        assert found[f'{namespace}/{topic}'] == numbers['written']
    assert counted['written'][2] > frames - 5, counted
    if frames < 100:
        assert counted['dropped'] == [0, 0, 0], counted
