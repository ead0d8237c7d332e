"""The node bev_mapper with RGB-D images, over DDS."""

from __future__ import annotations

import array
import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger
from tests.ros_helpers import wait_for

from bev_mapper.rgbd_mapper import MapperConfig, RgbdMapper
from bev_mapper.rgbd_node import StepViews
from bev_mapper.room import MOUNT, render, walk
from gridnav.grid import GridGeometry
from gridnav.rgbd import VIEW_SUFFIX, Camera
from gridnav.ros.conversions import from_occupancy_grid, header, to_nanoseconds
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, RELIABLE_QOS, SENSOR_QOS
from gridnav.ros.rgbd import to_camera_info, to_image, to_pose_3d
from maze_sim.map_file import read_map

if TYPE_CHECKING:
    from pathlib import Path

    from tests.ros_helpers import Probe, StartNode

    from gridnav.rgbd import RgbdFrame

MAPPER = 'bev_mapper.node'
STAMP = 1_000_000_000_000
CAMERA = Camera(160, 120, 115.0, 113.0, 79.5, 59.5)
PARAMETERS = {
    'input': 'rgbd',
    'camera_z': MOUNT.z,
    'camera_pitch': MOUNT.pitch,
    'width': 45,
    'height': 45,
    'origin_x': -2.25,
    'origin_y': -2.25,
    'growth': 15,
    'wait': 0.3,
    'reliable_images': True,
}
CONFIG = MapperConfig(GridGeometry(45, 45, 0.1, -2.25, -2.25), growth=15)


IMAGES = QoSProfile(depth=100)


class Robot:
    """Sends frames to a mapper and records its maps."""

    def __init__(self, probe: Probe, images: QoSProfile = IMAGES) -> None:
        """Connect to the mapper."""
        self.maps = probe.record(OccupancyGrid, 'map', MAP_QOS)
        self.probability = probe.record(OccupancyGrid, 'bev_mapper/probability', MAP_QOS)
        self.color = probe.publisher(Image, 'camera/color/image_raw', images)
        self.depth = probe.publisher(Image, 'camera/depth/image_raw', images)
        self.info = probe.publisher(CameraInfo, 'camera/camera_info', images)
        self.odom = probe.publisher(Odometry, 'odom', RELIABLE_QOS)
        self.episode = probe.publisher(DiagnosticStatus, 'episode', EPISODE_QOS)
        # That the publishers know the mapper does not mean that it knows them.
        frame = render(CAMERA, walk(0, 10))
        stamps = iter(range(STAMP - 1000, STAMP))

        def heard() -> bool:
            self.send(frame, next(stamps))
            time.sleep(0.1)
            return bool(self.maps)

        wait_for(heard)
        time.sleep(0.3)
        assert probe.call(Trigger, 'bev_mapper/reset', Trigger.Request()).success
        self.maps.clear()

    def send(self, frame: RgbdFrame, stamp: int, **spoilt: Any) -> None:  # noqa: ANN401
        """Send the parts of a frame, some of them spoilt as a dictionary of paths says."""
        for name, message in messages(frame, stamp).items():
            for path, value in spoilt.get(name, {}).items():
                spoil(message, path, value)
            getattr(self, name).publish(message)

    def wait_map(self, stamp: int) -> OccupancyGrid:
        """Wait for the map of a stamp and return it."""

        def found() -> list[OccupancyGrid]:
            return [m for m in list(self.maps) if to_nanoseconds(m.header.stamp) == stamp]

        wait_for(found)
        return found()[-1]


def messages(frame: RgbdFrame, stamp: int) -> dict[str, Any]:
    """Return the messages of a frame; the pose comes last, as that of a player."""
    odometry = Odometry(header=header(stamp, 'odom'), child_frame_id='base_link')
    odometry.pose.pose = to_pose_3d(frame.pose)
    optical = 'camera_color_optical_frame'
    return {
        'color': to_image(frame.color, stamp=stamp, frame_id=optical),
        'depth': to_image(frame.depth, stamp=stamp, frame_id=optical),
        'info': to_camera_info(frame.camera, stamp=stamp, frame_id=optical),
        'odom': odometry,
    }


def spoil(message: Any, path: str, value: object) -> None:  # noqa: ANN401 - any message
    """Set a field of a message by its dotted path."""
    *parents, name = path.split('.')
    for parent in parents:
        message = getattr(message, parent)
    setattr(message, name, value)


def views(number: int, camera: Camera = CAMERA) -> list[RgbdFrame]:
    """Return some frames of a walk."""
    return [render(camera, walk(index, number), STAMP + index) for index in range(number)]


def test_the_map_is_that_of_the_core_to_the_last_bit(
    node_process: StartNode, probe: Probe, tmp_path: Path
) -> None:
    """Published after each frame with its stamp; points, probability, reset and save."""
    folder = tmp_path / 'saved'
    node = node_process(MAPPER, {**PARAMETERS, 'points_period': 0.1, 'save_folder': folder})
    robot = Robot(probe)
    points = probe.record(PointCloud2, 'points', SENSOR_QOS)
    mapper = RgbdMapper(CONFIG)
    for frame in views(10):
        robot.send(frame, frame.stamp)
        mapper.add(replace(frame, mount=MOUNT))
        cells, geometry = from_occupancy_grid(robot.wait_map(frame.stamp))
        assert geometry == mapper.grid.geometry
        assert np.array_equal(cells, mapper.grid.occupancy)
    assert len(robot.maps) == 10
    wait_for(lambda: robot.probability[-1].header.stamp == robot.maps[-1].header.stamp)
    cells, _ = from_occupancy_grid(robot.probability[-1])
    assert np.array_equal(cells, mapper.grid.probability)

    cloud = mapper.cloud.points()
    wait_for(lambda: points and points[-1].width == len(cloud.labels))
    seen = np.frombuffer(points[-1].data, dtype='<f4,<f4,<f4,u1,u1,u1,u1,<u4')
    assert [field.name for field in points[-1].fields] == ['x', 'y', 'z', 'rgb', 'label']
    assert np.allclose(seen['f0'], cloud.positions[:, 0], atol=1e-5)
    assert np.array_equal(np.stack([seen[f] for f in ('f5', 'f4', 'f3')], 1), cloud.colors)
    assert np.array_equal(seen['f7'], cloud.labels)

    response = probe.call(Trigger, 'bev_mapper/save', Trigger.Request())
    assert response.success, response.message
    assert response.message == f'Wrote map.pgm, map.yaml and cloud.ply into {folder}.'
    world = read_map(folder / 'map.yaml')
    assert np.array_equal(world.blocked, mapper.grid.occupancy != 0)
    assert (folder / 'cloud.ply').stat().st_size > 16 * len(cloud.labels)

    assert probe.call(Trigger, 'bev_mapper/reset', Trigger.Request()).success
    robot.send(frame, STAMP + 100)
    mapper.clear()
    mapper.add(replace(frame, mount=MOUNT))
    cells, _ = from_occupancy_grid(robot.wait_map(STAMP + 100))
    assert np.array_equal(cells, mapper.grid.occupancy)
    node.assert_alive()


def test_a_robot_that_looks_around_gets_one_map_for_all_views(
    node_process: StartNode, probe: Probe
) -> None:
    """All twelve at once; where one got lost, the map comes a little later without it."""
    node_process(MAPPER, {**PARAMETERS, 'views_per_step': 12, 'wait': 1.0})
    robot = Robot(probe)
    # All of them together fit into what DDS shares between processes by default.
    frames = views(12, CAMERA.resized(80, 60))
    for frame in frames:
        robot.send(frame, frame.stamp)
    robot.wait_map(STAMP + 11)
    for frame in frames[:11]:
        robot.send(frame, frame.stamp + 100)
    robot.wait_map(STAMP + 110)
    stamps = [to_nanoseconds(m.header.stamp) - STAMP for m in robot.maps]
    assert stamps == [11, 110]


def test_a_step_whose_views_are_named_is_complete_without_those_that_are_missing(
    node_process: StartNode, probe: Probe
) -> None:
    """The robot's own pose, which comes last, says so."""
    node_process(MAPPER, {**PARAMETERS, 'views_per_step': 12, 'wait': 60.0})
    robot = Robot(probe)
    as_view = {'child_frame_id': f'base_link{VIEW_SUFFIX}'}
    frames = views(5, CAMERA.resized(80, 60))
    for frame in frames[:4]:
        robot.send(frame, frame.stamp, odom=as_view)
    robot.send(frames[4], frames[4].stamp)
    robot.wait_map(STAMP + 4)
    assert len(robot.maps) == 1


def test_views_of_a_step_are_counted_by_their_poses() -> None:
    """A step is over with the robot's own pose, whose stamp its map has in any case."""
    step = StepViews()
    assert step.add_pose(1, is_view=False)
    assert step.wanted(12) == 12
    assert not step.is_over
    assert [step.add_pose(stamp, is_view=True) for stamp in (5, 6, 6)] == [True, True, False]
    assert step.wanted(12) == 12
    assert step.add_pose(7, is_view=False)
    assert step.is_over
    assert (step.wanted(12), step.wanted(2)) == (3, 2)
    assert step.end_step(6) == 7
    assert not step.is_over
    assert not step.add_pose(7, is_view=False)
    assert step.add_pose(8, is_view=False)
    assert (step.wanted(12), step.end_step(-1)) == (1, 8)


def test_cameras_with_the_qos_of_sensors_are_heard(node_process: StartNode, probe: Probe) -> None:
    """By default; what gets lost on the way is not missed."""
    node_process(MAPPER, {**PARAMETERS, 'reliable_images': False})
    Robot(probe, SENSOR_QOS)


def test_a_new_episode_begins_from_nothing(node_process: StartNode, probe: Probe) -> None:
    """What was seen of the new world before the word of it is kept."""
    node_process(MAPPER, PARAMETERS)
    robot = Robot(probe)
    first, second, third = views(3)
    for frame in (first, second):
        robot.send(frame, frame.stamp)
        robot.wait_map(frame.stamp)
    robot.episode.publish(EpisodeStatus('avd_player', 'running', STAMP + 1).to_message())
    wait_for(lambda: len(robot.maps) == 3)
    robot.send(third, third.stamp)
    cells, _ = from_occupancy_grid(robot.wait_map(third.stamp))
    mapper = RgbdMapper(CONFIG)
    for frame in (second, third):
        mapper.add(frame)
    assert np.array_equal(cells, mapper.grid.occupancy)


NAN_DEPTH = np.full((120, 160), np.nan, dtype=np.float32)

BAD: list[tuple[str, dict[str, object], str]] = [
    ('color', {'encoding': 'yuv422'}, "Its encoding is 'yuv422'"),
    ('color', {'step': 7}, 'Its step is 7 bytes'),
    ('color', {'data': array.array('B', [1, 2, 3])}, 'It has 3 bytes'),
    ('color', {'width': 0}, 'Its size is 0 x 120'),
    ('depth', {'encoding': 'rgb8'}, "Its encoding is 'rgb8'"),
    ('depth', {'is_bigendian': 1}, 'It is big-endian'),
    ('depth', {'height': 119}, 'rows of 320 bytes'),
    ('depth', {'header.frame_id': ''}, 'Its frame_id is empty'),
    ('depth', {'header.stamp.nanosec': 2**32 - 1}, 'Its stamp is not a time'),
    ('info', {'k': np.zeros(9)}, 'Its focal lengths are 0.0 and 0.0'),
    ('info', {'k': np.full(9, math.nan)}, 'are not finite'),
    ('info', {'width': 640, 'height': 480}, 'parts of unequal size'),
    ('odom', {'pose.pose.orientation.w': 7.0}, 'is not a unit quaternion'),
    ('odom', {'pose.pose.position.z': math.nan}, 'Its position is not finite'),
    ('odom', {'header.frame_id': 'moon'}, "Its frame_id is 'moon'"),
    ('odom', {'pose.pose.position.x': 9e5}, 'more than the limit of'),
]


def test_malformed_messages_are_refused_and_the_next_good_one_is_mapped(
    node_process: StartNode, probe: Probe, namespace: str
) -> None:
    """None of them ends the node or spoils the map; each is counted and most are named."""
    node = node_process(MAPPER, {**PARAMETERS, 'growth': 5, 'pose_slop': 0.0})
    robot = Robot(probe)
    diagnostics = probe.record(DiagnosticArray, '/diagnostics', RELIABLE_QOS)

    def values() -> dict[str, str]:
        found: dict[str, str] = {}
        for message in list(diagnostics):
            for status in message.status:
                if status.name == f'{namespace}/bev_mapper':
                    found = {item.key: item.value for item in status.values}
        return found

    frame = render(CAMERA, walk(0, 10))
    stamp = STAMP
    for name, spoilt, _ in BAD:
        robot.send(frame, stamp, **{name: spoilt})
        robot.send(frame, stamp + 1)
        robot.wait_map(stamp + 1)
        stamp += 2
    robot.send(replace(frame, depth=NAN_DEPTH), stamp)
    cells, geometry = from_occupancy_grid(robot.wait_map(stamp))
    mapper = RgbdMapper(replace(CONFIG, growth=5))
    for _ in BAD:
        mapper.add(frame)
    mapper.add(replace(frame, depth=NAN_DEPTH))
    assert geometry == mapper.grid.geometry
    assert np.array_equal(cells, mapper.grid.occupancy)

    def refused() -> int:
        counts = [value for key, value in values().items() if key.startswith('refused: ')]
        return sum(map(int, counts))

    wait_for(lambda: refused() == len(BAD))
    assert values()['segmenter'] == 'geometric'
    assert values()['refused: frames'] == '2'
    node.assert_alive()
    # The same kind of warning comes every five seconds at most, so the first of each is there.
    for topic, name in (
        ('color/image_raw', 'color'), ('depth/image_raw', 'depth'), ('camera_info', 'info'),
    ):  # fmt: skip
        sentence = next(sentence for kind, _, sentence in BAD if kind == name)
        assert f'Refused a message on {namespace}/camera/{topic}: {sentence}' in node.output
    assert 'Left out a frame: frame ' in node.output


def test_a_frame_without_a_pose_is_never_mapped(node_process: StartNode, probe: Probe) -> None:
    """It waits, is given up with a sentence, and a late pose does not bring it back."""
    node = node_process(MAPPER, PARAMETERS)
    robot = Robot(probe)
    frame = render(CAMERA, walk(0, 10))
    parts = messages(frame, STAMP)
    for name in ('color', 'depth', 'info'):
        getattr(robot, name).publish(parts[name])
    node.wait_output('waited 0.3 s for its pose and is left out')
    robot.odom.publish(parts['odom'])
    robot.send(frame, STAMP + 1)
    robot.wait_map(STAMP + 1)
    assert len(robot.maps) == 1


@pytest.mark.parametrize(
    ('parameters', 'sentence'),
    [
        ({'segmenter': 'dgcnn'}, "The segmenter 'dgcnn' comes without weights"),
        ({'segmenter': 'dgcnn', 'weights': '/nowhere.t7'}, 'The weights /nowhere.t7 can not be'),
        ({'segmenter': 'pointnet'}, "Parameter 'segmenter' must be 'geometric' or"),
        ({'camera_mount_source': 'tf'}, 'tf2_ros is not installed'),
        ({'width': 4096, 'height': 4096}, 'more than the limit of 4000000'),
    ],
)
def test_parameters_that_can_not_be_used_are_named(
    node_process: StartNode, parameters: dict[str, object], sentence: str
) -> None:
    """One sentence and exit code 1."""
    if 'camera_mount_source' in parameters:
        try:
            import tf2_ros  # noqa: F401, PLC0415
        except ImportError:
            pass
        else:
            pytest.skip('tf2_ros is installed')
    node = node_process(MAPPER, {'input': 'rgbd', **parameters})
    assert node.process.wait(20) == 1
    assert sentence in node.output
    assert 'Traceback' not in node.output
