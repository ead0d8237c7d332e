"""``vgdp map`` on bags, against the node."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import CameraInfo, Image
from tests.ros_helpers import wait_for

from bev_mapper.room import MOUNT, render, walk
from gridnav.rgbd import Camera, CameraMount
from gridnav.ros.conversions import from_occupancy_grid, header, to_nanoseconds
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.qos import MAP_QOS
from gridnav.ros.rgbd import to_camera_info, to_image, to_pose_3d
from vgdp_bringup.cli import main
from vgdp_bringup.mapping import MapOptions, map_source
from vgdp_bringup.recorder import BagRecorder

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.ros_helpers import Probe, StartNode

    from gridnav.rgbd import RgbdFrame

STAMP = 1_000_000_000_000
STEP = 100_000_000
CAMERA = Camera(160, 120, 115.0, 113.0, 79.5, 59.5)
OPTICAL = 'camera_color_optical_frame'
TYPES = {
    'camera/color/image_raw': Image,
    'camera/depth/image_raw': Image,
    'camera/camera_info': CameraInfo,
    'odom': Odometry,
}
STORE = get_typestore(Stores.ROS2_JAZZY)


def frames() -> list[RgbdFrame]:
    """Return a walk, its camera tilted otherwise than is said."""
    tilted = MOUNT._replace(pitch=MOUNT.pitch + 0.02, roll=0.01)
    return [
        render(CAMERA, walk(number, 8), STAMP + number * STEP, mount=tilted) for number in range(8)
    ]


def messages(frame: RgbdFrame) -> dict[str, Any]:
    """Return the messages of a frame by topic."""
    odometry = Odometry(header=header(frame.stamp, 'odom'), child_frame_id='base_link')
    odometry.pose.pose = to_pose_3d(frame.pose)
    stamp = frame.stamp
    return {
        'camera/color/image_raw': to_image(frame.color, stamp=stamp, frame_id=OPTICAL),
        'camera/depth/image_raw': to_image(frame.depth, stamp=stamp, frame_id=OPTICAL),
        'camera/camera_info': to_camera_info(frame.camera, stamp=stamp, frame_id=OPTICAL),
        'odom': odometry,
    }


def write_bag(
    folder: Path,
    *,
    change: Callable[[str, Any], Any] | None = None,
    mount: CameraMount | None = None,
    episode: tuple[int, int] | None = None,
) -> Path:
    """Write a bag with the frames.

    Args:
        folder: Of the bag.
        change: Gets each topic and message; returns what is written instead, or None.
        mount: What the bag says about the camera.
        episode: When an episode begins, and when the word of it comes.
    """
    with BagRecorder(folder) as recorder:
        for topic, kind in TYPES.items():
            recorder.add_topic(
                f'/robot/{topic}', f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}', []
            )
        if episode is not None:
            recorder.add_topic('/robot/episode', 'diagnostic_msgs/msg/DiagnosticStatus', [])
            status = EpisodeStatus('avd_player', 'running', episode[0]).to_message()
            recorder.write('/robot/episode', episode[1], serialize_message(status))
        if mount is not None:
            recorder.add_topic('/tf_static', 'tf2_msgs/msg/TFMessage', [])
            recorder.write('/tf_static', STAMP, static_transform(mount))
        for frame in frames():
            for topic, message in messages(frame).items():
                kept = change(topic, message) if change else message
                if kept is not None:
                    recorder.write(f'/robot/{topic}', frame.stamp, serialize_message(kept))
    return folder


def static_transform(mount: CameraMount) -> bytes:
    """Return the message of a chain of two transforms from the robot to the camera's optics."""
    t = STORE.types
    from gridnav.rgbd import Pose3D  # noqa: PLC0415

    def edge(parent: str, child: str, pose: Pose3D) -> Any:  # noqa: ANN401
        stamp = t['builtin_interfaces/msg/Time'](sec=0, nanosec=0)
        return t['geometry_msgs/msg/TransformStamped'](
            header=t['std_msgs/msg/Header'](stamp=stamp, frame_id=parent),
            child_frame_id=child,
            transform=t['geometry_msgs/msg/Transform'](
                translation=t['geometry_msgs/msg/Vector3'](*pose[:3]),
                rotation=t['geometry_msgs/msg/Quaternion'](*pose[3:]),
            ),
        )

    optics = CameraMount().matrix()
    body = Pose3D.from_matrix(mount.matrix() @ np.linalg.inv(optics))
    edges = [
        edge('camera_link', OPTICAL, Pose3D.from_matrix(optics)),
        edge('base_link', 'camera_link', body),
    ]
    message = t['tf2_msgs/msg/TFMessage'](transforms=edges)
    return bytes(STORE.serialize_cdr(message, 'tf2_msgs/msg/TFMessage'))


def test_the_map_of_a_bag_is_that_of_the_node(
    node_process: StartNode, probe: Probe, tmp_path: Path
) -> None:
    """To the last bit, with the node's defaults and those of the command."""
    node_process(
        'bev_mapper.node',
        {
            'input': 'rgbd',
            'camera_z': MOUNT.z,
            'camera_pitch': MOUNT.pitch,
            'reliable_images': True,
        },
    )
    maps = probe.record(OccupancyGrid, 'map', MAP_QOS)
    probabilities = probe.record(OccupancyGrid, 'bev_mapper/probability', MAP_QOS)
    publishers = {
        topic: probe.publisher(kind, topic, QoSProfile(depth=100)) for topic, kind in TYPES.items()
    }
    for frame in frames():
        for topic, message in messages(frame).items():
            publishers[topic].publish(message)
        wait_for(lambda: maps and to_nanoseconds(maps[-1].header.stamp) == frame.stamp)  # noqa: B023
    wait_for(lambda: probabilities and probabilities[-1].header == maps[-1].header)
    bag = write_bag(tmp_path / 'bag')
    grid = map_source(MapOptions(bag, tmp_path, mount=MOUNT)).mapper.grid
    cells, geometry = from_occupancy_grid(maps[-1])
    assert geometry == grid.geometry
    assert np.array_equal(cells, grid.occupancy)
    assert np.array_equal(from_occupancy_grid(probabilities[-1])[0], grid.probability)


def test_the_command_writes_files_and_says_what_is_in_them(
    ros: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The camera's place comes from the bag's static transforms."""
    del ros
    bag, out = write_bag(tmp_path / 'bag', mount=MOUNT), tmp_path / 'out'
    assert main(['map', str(bag), '-o', str(out), '--resolution', '0.2']) == 0
    assert '8 frames in ' in capsys.readouterr().out
    names = {'map.pgm', 'map.yaml', 'cloud.ply', 'map.png', 'summary.json'}
    assert {path.name for path in out.iterdir()} == names
    found = json.loads((out / 'summary.json').read_text())
    assert (found['frames'], found['resolution_m'], found['segmenter']) == (8, 0.2, 'geometric')
    assert found['cells']['free'] > 100
    given = map_source(MapOptions(bag, out, resolution=0.2, mount=MOUNT)).mapper.grid
    assert found['cells']['occupied'] == (given.occupancy == 100).sum()


@pytest.mark.parametrize(('said', 'dropped'), [(-1, 12), (5 * STEP - 1, 0)])
def test_a_bag_with_an_episode_is_mapped_from_its_start(
    ros: None, tmp_path: Path, said: int, dropped: int
) -> None:
    """Frames before it are of another world, whenever the word of it comes."""
    del ros
    bag = write_bag(tmp_path / 'bag', episode=(STAMP + 3 * STEP, STAMP + said))
    mapping = map_source(MapOptions(bag, tmp_path, mount=MOUNT))
    assert mapping.mapper.frames == 5
    assert mapping.counts['dropped: older than the episode'] == dropped


def test_broken_messages_are_named_and_the_rest_is_mapped(ros: None, tmp_path: Path) -> None:
    """One sentence for each."""
    del ros
    seen = {'count': 0}

    def change(topic: str, message: Any) -> Any:  # noqa: ANN401
        if topic == 'odom':
            seen['count'] += 1
            if seen['count'] == 2:
                message.pose.pose.orientation.w = 5.0
            return None if seen['count'] == 4 else message
        if topic == 'camera/depth/image_raw' and seen['count'] == 5:
            message.encoding = '8UC1'
        return message

    bag = write_bag(tmp_path / 'bag', change=change)
    mapping = map_source(MapOptions(bag, tmp_path, mount=MOUNT, pose_slop=0.01))
    assert mapping.mapper.frames == 5
    assert any('on odom: Its pose' in sentence for sentence in mapping.skipped)
    assert any("Its encoding is '8UC1'" in sentence for sentence in mapping.skipped)
    assert mapping.counts['dropped: depth without pose'] == 2


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ([], 'does not say where the camera is on the robot, give --mount.'),
        (['--segmenter', 'pointnet'], "There is no segmenter 'pointnet'"),
        (['--segmenter', 'ground_truth', '--mount', *'000000'], 'no frame that could be mapped'),
        (['--resolution', '0'], 'The resolution must be finite and above 0 m'),
        (['--namespace', '/nobody'], 'has none of the topics of RGB-D images below /nobody/'),
    ],
)
def test_what_can_not_be_mapped_is_refused(
    ros: None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    sentence: str,
) -> None:
    """In one sentence; nothing is written."""
    del ros
    bag = write_bag(tmp_path / 'bag')
    assert main(['map', str(bag), '-o', str(tmp_path / 'out'), *options]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith('error: ')
    assert sentence in error
    assert not (tmp_path / 'out').exists()
