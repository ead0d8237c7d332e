"""The node avd_player over DDS."""

from __future__ import annotations

import math
import signal
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import UInt8
from std_srvs.srv import Trigger
from tests.avd_player.tiny_scene import BOTTLE
from tests.ros_helpers import wait_for

from avd_player import ActiveVisionSimulation, AvdSource, Scene, SearchRules
from avd_player.avd_format import COLOR_FOLDER, DEPTH_FOLDER, depth_name
from gridnav.actions import DONE
from gridnav.rgbd import CameraMount
from gridnav.ros.conversions import to_nanoseconds, to_yaw
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.qos import BURST_QOS, EPISODE_QOS, MAP_QOS, RELIABLE_QOS
from gridnav.ros.rgbd import (
    COLOR_ENCODINGS,
    DEPTH_ENCODINGS,
    from_camera_info,
    from_image,
    from_pose_3d,
    validate_camera_info,
    validate_image,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.avd_player.tiny_scene import TinyScene
    from tests.ros_helpers import NodeProcess, Probe, StartNode

    from gridnav.rgbd import RgbdFrame

PLAYER = 'avd_player.node'

SEARCH: dict[str, object] = {
    'mode': 'closed_loop',
    'width': 96,
    'reach': 0.5,
    'min_expert_steps': 1,
    'observation_period': 600.0,
}


def stamp_of(message: Any) -> int:  # noqa: ANN401 - any stamped message
    """Return the stamp in nanoseconds."""
    return to_nanoseconds(message.header.stamp)


class Viewer:
    """Records what a player publishes, in the order in which it comes."""

    def __init__(self, probe: Probe, images_qos: object = BURST_QOS) -> None:
        """Listen to the player."""
        self.probe = probe
        self.all: list[tuple[str, Any]] = []
        for kind, topic, qos in (
            (Image, 'camera/color/image_raw', images_qos),
            (Image, 'camera/depth/image_raw', images_qos),
            (CameraInfo, 'camera/camera_info', images_qos),
            (Odometry, 'odom', BURST_QOS),
            (PoseStamped, 'goal_pose', MAP_QOS),
        ):
            probe.node.create_subscription(
                kind, topic, lambda m, t=topic: self.all.append((t, m)), qos
            )
        self.episodes = probe.record(DiagnosticStatus, 'episode', EPISODE_QOS)

    def of(self, topic: str) -> list[Any]:
        """Return the messages of a topic so far."""
        return [message for name, message in list(self.all) if name == topic]

    @property
    def colors(self) -> list[Any]:
        """The colour images."""
        return self.of('camera/color/image_raw')

    @property
    def odom(self) -> list[Any]:
        """The poses."""
        return self.of('odom')

    def step_ends(self) -> list[Any]:
        """Return the poses that end a step, each once."""
        ends = {stamp_of(m): m for m in self.odom if m.child_frame_id == 'base_link'}
        return [ends[stamp] for stamp in sorted(ends)]

    def status(self) -> EpisodeStatus:
        """Return the latest word of the world."""
        return EpisodeStatus.from_message(self.episodes[-1])

    def call(self, name: str) -> Any:  # noqa: ANN401 - a response
        """Call a service of the player."""
        return self.probe.call(Trigger, f'avd_player/{name}', Trigger.Request())

    def play_again(self, *others: list[Any]) -> None:
        """Replay from the start: what came before the two knew each other is lost in part.

        Args:
            others: More lists of messages to begin anew.
        """
        wait_for(lambda: self.odom and self.colors)
        self.call('pause')
        time.sleep(0.3)
        self.all[:] = [entry for entry in self.all if entry[0] == 'goal_pose']
        for messages in others:
            messages.clear()
        self.call('reset')
        self.call('resume')

    def set_parameter(self, name: str, value: object) -> Any:  # noqa: ANN401 - a result
        """Set a parameter of the player."""
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        response = self.probe.call(SetParameters, 'avd_player/set_parameters', request)
        return response.results[0]


def assert_shows(frame: RgbdFrame, mount: CameraMount, messages: list[Any]) -> None:
    """Check that pose, colour, depth and camera say what a frame says."""
    odometry, color, depth, info = messages
    assert odometry.header.frame_id == 'odom'
    matrix = from_pose_3d(odometry.pose.pose).matrix() @ mount.matrix()
    np.testing.assert_allclose(matrix, frame.camera_to_map(), atol=1e-9)
    validate_image(color, COLOR_ENCODINGS, ('camera_color_optical_frame',))
    validate_image(depth, DEPTH_ENCODINGS, ('camera_color_optical_frame',))
    validate_camera_info(info, ('camera_color_optical_frame',))
    np.testing.assert_array_equal(from_image(color), frame.color)
    np.testing.assert_array_equal(from_image(depth), frame.depth)
    assert from_camera_info(info) == frame.camera


@pytest.fixture
def start_player(node_process: StartNode) -> Callable[..., NodeProcess]:
    """Return a function that starts the node."""

    def start(**parameters: object) -> NodeProcess:
        return node_process(PLAYER, parameters)

    return start


def test_a_search_from_the_first_look_to_success(
    tiny: TinyScene, start_player: Callable[..., NodeProcess], probe: Probe
) -> None:
    """All views of each position, their poses in their order, the goal and the end."""
    viewer = Viewer(probe)
    player = start_player(
        source=tiny.folder, start_position=0, seed=4, **(SEARCH | {'observation_period': 0.5})
    )
    source = AvdSource(tiny.folder, 96)
    scene = Scene(source)
    simulation = ActiveVisionSimulation(scene, SearchRules(reach=0.5, min_expert_steps=1))
    simulation.restart(start=0)
    action = probe.publisher(UInt8, 'action', RELIABLE_QOS)
    for number, move in enumerate((None, 4, 1, 2, DONE)):
        if move is not None:
            action.publish(UInt8(data=move))
            simulation.step(move)
        wait_for(lambda n=number: len(viewer.step_ends()) > n)  # type: ignore[misc]
        end = viewer.step_ends()[number]
        stamp = stamp_of(end)
        wait_for(lambda s=stamp: s in map(stamp_of, viewer.colors))  # type: ignore[misc]
        views = {stamp_of(m): m for m in viewer.odom if stamp_of(m) // 1000 == stamp // 1000}
        assert sorted(views) == list(range(stamp - 11, stamp + 1))
        assert (stamp - 11) % 1000 == 0
        names = simulation.seen_names
        ahead = names.index(simulation.heading_name)
        colors = {stamp_of(m): m for m in viewer.colors}
        depths = {stamp_of(m): m for m in viewer.of('camera/depth/image_raw')}
        infos = {stamp_of(m): m for m in viewer.of('camera/camera_info')}
        for back, name in enumerate(reversed(names[ahead + 1 :] + names[: ahead + 1])):
            messages = [kind[stamp - back] for kind in (views, colors, depths, infos)]
            assert_shows(source.read(name), source.mount, messages)
            assert views[stamp - back].child_frame_id == (
                'base_link_view' if back else 'base_link'
            )
        off = math.remainder(to_yaw(end.pose.pose.orientation) - simulation._yaw, math.tau)
        assert abs(off) <= math.pi / 12 + 1e-3

    assert viewer.status().start == stamp_of(viewer.step_ends()[0]) - 11
    wait_for(lambda: viewer.status().message == 'success')
    values = viewer.status().values
    result = simulation.result()
    assert values['steps'] == '4'
    assert values['bumps'] == '1'
    assert float(values['path_cost']) == pytest.approx(result.path_cost, abs=1e-5)
    assert float(values['spl']) == pytest.approx(result.spl, abs=1e-5)
    assert values['expert_steps'] == str(result.expert_steps)
    assert (values['scene'], values['target']) == ('Home_001_1', 'coca_cola_glass_bottle')
    [goal, *_] = viewer.of('goal_pose')
    bottle = source.map_from_world @ tiny.world_from_truth @ np.append(BOTTLE.mean(axis=0), 1)
    position = goal.pose.position
    assert np.linalg.norm((position.x, position.y, position.z) - bottle[:3]) < 0.12
    assert goal.header.frame_id == 'map'
    player.assert_alive()


def test_the_latest_observation_is_repeated_for_late_joiners(
    tiny: TinyScene, start_player: Callable[..., NodeProcess], make_probe: Callable[[], Probe]
) -> None:
    """With its stamps, whole, to a best-effort subscriber, too, if its queue holds a step."""
    start_player(source=tiny.folder, **(SEARCH | {'observation_period': 0.3}))
    first = Viewer(make_probe())
    wait_for(lambda: len(first.step_ends()) == 1)
    best_effort = QoSProfile(depth=BURST_QOS.depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    late = Viewer(make_probe(), best_effort)
    wait_for(lambda: len({stamp_of(m) for m in late.colors}) == 12)
    wait_for(lambda: len({stamp_of(m) for m in late.odom}) == 12)
    assert {stamp_of(m) for m in late.colors} == {stamp_of(m) for m in late.odom}
    assert stamp_of(late.step_ends()[0]) == stamp_of(first.step_ends()[0])


def test_the_heading_alone_and_depth_in_metres(
    tiny: TinyScene, start_player: Callable[..., NodeProcess], probe: Probe
) -> None:
    """One view a step; NaN where nothing was measured; the next episode on request."""
    viewer = Viewer(probe)
    start_player(source=tiny.folder, views='heading', depth_encoding='32FC1', **SEARCH)
    wait_for(lambda: viewer.odom and viewer.of('camera/depth/image_raw'))
    depth = from_image(viewer.of('camera/depth/image_raw')[-1])
    assert depth.dtype == np.float32
    assert np.isnan(depth[:, 0]).all()
    assert 0.3 < np.nanmedian(depth) < 4
    start = viewer.status().start
    assert stamp_of(viewer.odom[-1]) == start
    response = viewer.call('reset')
    assert response.message == 'A new episode with seed 1 has begun.'
    wait_for(lambda: viewer.status().start > start)
    wait_for(lambda: stamp_of(viewer.odom[-1]) == viewer.status().start)
    assert len(viewer.odom) == 2
    result = viewer.set_parameter('start_position', 99)
    assert result.successful
    response = viewer.call('reset')
    assert not response.success
    assert response.message == 'A start is a position from 0 to 5, got 99.'


def test_bad_actions_and_the_planner_giving_up(
    tiny: TinyScene, start_player: Callable[..., NodeProcess], probe: Probe
) -> None:
    """They are refused, and end the episode; after that actions are ignored."""
    viewer = Viewer(probe)
    player = start_player(source=tiny.folder, views='heading', **SEARCH)
    action = probe.publisher(UInt8, 'action', RELIABLE_QOS)
    episode = probe.publisher(DiagnosticStatus, 'episode', EPISODE_QOS)
    wait_for(lambda: viewer.episodes and viewer.odom)
    action.publish(UInt8(data=9))
    player.wait_output('An action is a number from 0 to 8, got 9.')
    start = viewer.status().start
    episode.publish(EpisodeStatus('vgdp_planner', 'exhausted', start - 1).to_message())
    episode.publish(EpisodeStatus('vgdp_planner', 'exhausted', start).to_message())
    wait_for(lambda: viewer.status().message == 'gave_up')
    action.publish(UInt8(data=0))
    time.sleep(0.3)
    assert len(viewer.odom) == 1
    player.assert_alive()


def test_a_replay_with_pause_step_and_seek(
    tiny: TinyScene, start_player: Callable[..., NodeProcess], probe: Probe
) -> None:
    """Images before poses of equal stamps; the goal once it was seen; to the end."""
    viewer = Viewer(probe)
    player = start_player(source=tiny.folder, width=48, rate=50.0, frame=60)
    viewer.play_again()
    wait_for(lambda: len(viewer.odom) == 12)
    source = AvdSource(tiny.folder, 48)
    stamps = [stamp_of(m) for m in viewer.odom]
    assert stamps == sorted(set(stamps))
    wait_for(lambda: len(viewer.colors) == 12)
    assert [stamp_of(m) for m in viewer.colors] == stamps
    for name, message in zip(tiny.names[60:], viewer.odom, strict=True):
        matrix = from_pose_3d(message.pose.pose).matrix() @ source.mount.matrix()
        np.testing.assert_allclose(matrix, source.camera_to_map(name), atol=1e-9)
    assert len(viewer.of('goal_pose')) >= 1

    assert viewer.call('step').message == 'There is no frame left.'
    # Paused now: a frame that is sought is shown, alone.
    assert viewer.set_parameter('frame', 5).successful
    wait_for(lambda: len(viewer.odom) == 13)
    response = viewer.call('step')
    assert response.message == f'Played {tiny.names[6]}, paused before frame 7.'
    wait_for(lambda: len(viewer.odom) == 14)
    np.testing.assert_array_equal(from_image(viewer.colors[13]), source.read(tiny.names[6]).color)
    refused = viewer.set_parameter('frame', 72)
    assert (refused.successful, refused.reason) == (
        False,
        'A frame is a number from 0 to 71, got 72.',
    )
    assert viewer.set_parameter('loop', value=True).successful
    viewer.set_parameter('frame', 70)
    assert viewer.call('resume').message == 'Playing from frame 71.'
    wait_for(lambda: len(viewer.odom) > 20)
    assert viewer.call('pause').success
    time.sleep(0.1)
    count = len(viewer.odom)
    time.sleep(0.3)
    assert len(viewer.odom) == count
    assert viewer.call('reset').success
    wait_for(lambda: len(viewer.odom) == count + 1)
    player.assert_alive()
    # In the midst of playing.
    assert viewer.call('resume').success
    assert player.end(signal.SIGINT) < 2.0


def test_a_replay_by_its_own_clock(
    tiny: TinyScene, start_player: Callable[..., NodeProcess], probe: Probe
) -> None:
    """Stamps are those of the recording and go on in a loop; /clock says them."""
    viewer = Viewer(probe)
    clocks = probe.record(Clock, '/clock', RELIABLE_QOS)
    start_player(source=tiny.folder, width=48, publish_clock=True, frame=69, loop=True)
    viewer.play_again(clocks)
    wait_for(lambda: len(viewer.odom) >= 5 and len(clocks) >= 5)
    stamps = [stamp_of(m) for m in viewer.odom[:5]]
    assert stamps[:3] == [7_000_000_000, 7_100_000_000, 7_200_000_000]
    assert stamps[2] < stamps[3] < stamps[4] == stamps[3] + 100_000_000
    assert [to_nanoseconds(m.clock) for m in clocks[:5]] == stamps


def test_a_carried_camera_is_replayed(
    kitchen: Path, start_player: Callable[..., NodeProcess], probe: Probe
) -> None:
    """Its pose has all six degrees of freedom."""
    viewer = Viewer(probe)
    player = start_player(source=kitchen, width=64, rate=100.0)
    wait_for(lambda: len(viewer.odom) >= 5)
    pose = from_pose_3d(viewer.odom[0].pose.pose)
    assert 1.2 < pose.z < 1.6
    # It looks down at the table.
    assert (pose.matrix() @ CameraMount().matrix())[2, 2] < -0.2
    assert viewer.of('goal_pose') == []
    player.assert_alive()


def test_broken_files_are_left_out(
    damaged: Callable[[], Path], start_player: Callable[..., NodeProcess], probe: Probe
) -> None:
    """One sentence in the log, and the next frame; a step ends with its pose all the same."""
    folder = damaged()
    names = sorted(path.name for path in (folder / COLOR_FOLDER).iterdir())
    for name in names[:12]:
        (folder / COLOR_FOLDER / name).write_bytes(b'')
    (folder / DEPTH_FOLDER / depth_name(names[14])).write_bytes(b'')
    viewer = Viewer(probe)
    player = start_player(source=folder, width=48, rate=100.0)
    wait_for(lambda: len(viewer.odom) == 59)
    assert f'A frame is left out: {names[0]} is cut or broken' in player.output
    assert player.end(signal.SIGTERM) < 2.0
    viewer.all.clear()
    player = start_player(source=folder, start_position=0, **SEARCH)
    wait_for(lambda: len(viewer.odom) == 1)
    assert viewer.odom[0].child_frame_id == 'base_link'
    assert viewer.colors == []
    player.assert_alive()


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        (
            {'source': "''"},
            "Parameter 'source' must be the folder of a scene or sequence, got noth",
        ),
        ({'target': 'teapot'}, "There is no instance 'teapot', but for example coca_cola_glass_b"),
        ({'mode': 'closed_loop'}, 'Home_001_1 has no position 10 moves from where coca_cola'),
    ],
)
def test_what_can_not_be_played_is_named(
    tiny: TinyScene,
    start_player: Callable[..., NodeProcess],
    parameters: dict[str, object],
    reason: str,
) -> None:
    """One sentence and exit code 1."""
    player = start_player(**({'source': tiny.folder} | parameters))
    assert player.process.wait(30) == 1
    assert f'Can not start: {reason}' in player.output
    assert 'Traceback' not in player.output
