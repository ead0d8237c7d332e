"""The node ``avd_player``: plays recorded homes, or lets a robot move in them by ``action``."""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from avd_player.avd_format import GRID_M
from avd_player.replay import Replay
from avd_player.scene import MAX_LINK_M, Scene, TargetSightings
from avd_player.simulation import (
    DEFAULT_TARGET,
    GOAL_MOVED_M,
    VIEWS,
    ActiveVisionSimulation,
    SearchRules,
)
from avd_player.sources import AvdSource, PosedSequence, mounted_pose, open_source
from gridnav.rgbd import MILLIMETRE, VIEW_SUFFIX, CameraMount, FrameError, Pose3D, RgbdFrame
from gridnav.ros.conversions import NANOSECONDS, header, to_nanoseconds, to_stamp
from gridnav.ros.lockstep import Lockstep, LockstepWorld
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.qos import BURST_QOS, MAP_QOS, RELIABLE_QOS
from gridnav.ros.rgbd import to_camera_info, to_image, to_pose_3d
from gridnav.ros.run import run_node
from gridnav.ros.tf import FrameBroadcaster

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray
    from rclpy.parameter import Parameter

    from gridnav.metrics import EpisodeResult

SOURCE = 'avd_player'
"""Who speaks on ``episode``."""

REPLAY, CLOSED_LOOP = 'replay', 'closed_loop'

STEP_NS = 1000
"""Stamps of a step differ by nanoseconds, those of two steps by this at least."""

DISCOVERY_S = 5.0
"""So long the node waits at first for somebody who takes in images and poses."""

DISCOVERY_PERIOD_S = 0.05

MAX_DEPTH_M = 65.535
"""As far as millimetres go in an image."""


@dataclass
class AvdPlayerParameters:
    """Parameters of the node; those of a search take effect with the next episode."""

    source: str = parameter(
        '',
        'Folder of a scene of the Active Vision Dataset or of a 7-Scenes or TUM sequence',
        read_only=True,
    )
    mode: str = parameter(
        REPLAY,
        'Whether the frames are replayed in order, or each action is carried out and answered',
        choices=(REPLAY, CLOSED_LOOP),
        read_only=True,
    )
    rate: float = parameter(
        0.0,
        'Frames (replay) or actions (closed loop) in a second; 0 for the pace of the recording, '
        'and for each action at once',
        unit='Hz',
        low=0.0,
        high=1000.0,
    )
    loop: bool = parameter(
        False,  # noqa: FBT003
        'Whether a replay begins again at its end',
    )
    frame: int = parameter(
        0,
        'Number of the frame that a replay begins with; setting it goes there at once',
        low=0,
        high=2**31 - 1,
    )
    publish_clock: bool = parameter(
        False,  # noqa: FBT003
        'Whether /clock is published, in a replay with the times of the recording',
        read_only=True,
    )
    width: int = parameter(
        640,
        'Width of the published images, at most that on disk; 0 for that',
        unit='pixels',
        low=0,
        high=8192,
        read_only=True,
    )
    depth_encoding: str = parameter(
        '16UC1', 'Depth in millimetres or in metres', choices=('16UC1', '32FC1'), read_only=True
    )
    target: str = parameter(DEFAULT_TARGET, 'Name of the instance to look for', read_only=True)
    views: str = parameter(
        'all', 'What is seen at a position: all around, or where the robot looks', choices=VIEWS
    )
    start_position: int = parameter(
        -1, 'Number of the position to start from; -1 draws it', low=-1, high=2**31 - 1
    )
    seed: int = parameter(
        0,
        'Seed of the start; each reset adds 1 until it is set again',
        low=0,
        high=2**31 - 1,
    )
    max_steps: int = parameter(500, 'Actions after which the episode ends', low=1, high=1_000_000)
    min_expert_steps: int = parameter(
        10, 'Moves from a drawn start to where Done succeeds, at least', low=0, high=100_000
    )
    reach: float = parameter(
        1.0,
        'Distance from the target within which Done succeeds; at the nearest position it does too',
        unit='m',
        low=0.0,
        high=100.0,
    )
    max_difficulty: int = parameter(
        4, 'Boxes of the target count as seen up to this difficulty', low=1, high=5
    )
    max_range: float = parameter(
        6.0, 'The target is not seen from further away', unit='m', low=0.1, high=65.0
    )
    max_link: float = parameter(
        MAX_LINK_M,
        'How far a move leads at most',
        unit='m',
        low=0.05,
        high=10.0,
        read_only=True,
    )
    observation_period: float = parameter(
        2.0,
        'In a closed loop the latest observation is published again after this time without a '
        'new one',
        unit='s',
        low=0.01,
        high=600.0,
        read_only=True,
    )
    map_frame: str = parameter('map', 'Frame of goal_pose', read_only=True)
    odom_frame: str = parameter('odom', 'Frame of odom, the same place as map', read_only=True)
    base_frame: str = parameter('base_link', 'Frame of the robot', read_only=True)
    camera_frame: str = parameter(
        'camera_color_optical_frame', 'Frame of the images', read_only=True
    )

    def __post_init__(self) -> None:
        """Refuse to play nothing."""
        if not self.source:
            msg = "Parameter 'source' must be the folder of a scene or sequence, got nothing."
            raise ValueError(msg)

    def rules(self) -> SearchRules:
        """Return what a search looks for."""
        return SearchRules(
            self.target,
            self.reach,
            self.max_difficulty,
            self.max_range,
            self.max_steps,
            self.min_expert_steps,
            self.views,
        )


class View(NamedTuple):
    """What is published of one frame; of one that can't be read, the pose alone."""

    odometry: Odometry
    images: tuple[Image, Image, CameraInfo] | None


class AvdPlayerNode(BaseNode[AvdPlayerParameters]):
    """Publishes frames, by themselves or in answer to actions."""

    def __init__(self) -> None:
        """Open the source and start to play.

        Raises:
            ParameterError: If a parameter can't be used.
            FrameError: If the source can't be.
            ValueError: If there is no such target, start or frame, or no scene to move in.
        """
        super().__init__('avd_player', AvdPlayerParameters)
        p = self.parameters
        self._player = self._open()
        self._scene: Scene | None = None
        if isinstance(self._player, AvdSource):
            self._scene = Scene(self._player, p.max_link)
        self._mount: CameraMount = self._player.mount
        self._stamp = -1
        self._published_goal: NDArray[np.float64] | None = None

        self._color = self.advertise(Image, 'camera/color/image_raw', BURST_QOS)
        self._depth = self.advertise(Image, 'camera/depth/image_raw', BURST_QOS)
        self._info = self.advertise(CameraInfo, 'camera/camera_info', BURST_QOS)
        self._odom = self.advertise(Odometry, 'odom', BURST_QOS)
        self._goal_pose = self.advertise(PoseStamped, 'goal_pose', MAP_QOS)
        self._time = self.advertise(Clock, '/clock', RELIABLE_QOS) if p.publish_clock else None
        self._frames = FrameBroadcaster(self)
        self.get_logger().info(
            f'{self._player.name}: {len(self._player.frame_names)} frames; the camera is '
            f'{self._mount.z:.3f} m above the base frame and looks {self._mount.pitch:.4f} rad '
            f'down.'
        )
        for key, value in self._mount._asdict().items():
            self.diagnostics.value(f'camera mount {key}', f'{value:.4f}')
        self._heard_by = time.monotonic() + DISCOVERY_S
        self._discovery = self.create_timer(DISCOVERY_PERIOD_S, self._on_discovery)
        if p.mode == REPLAY:
            self._start_replay()
        elif self._scene is None:
            msg = f'One can only move in scenes of the Active Vision Dataset; {p.source} is none.'
            raise ValueError(msg)
        else:
            self._start_search(self._scene)

    def _open(self) -> AvdSource | PosedSequence:
        """Open the source; what is wrong with it goes to the log."""
        p = self.parameters
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter('always')
            source = open_source(p.source, p.width)
            _ = source.mount
        for warning in caught:
            self.get_logger().warning(str(warning.message))
        return source

    # Replay

    def _start_replay(self) -> None:
        p = self.parameters
        self._replay = Replay(self._player.frame_names, p.frame, loop=p.loop)
        self._sightings = TargetSightings()
        self._instance = None if self._scene is None else self._scene.instance_id(p.target)
        self._last_recorded: int | None = None
        self._shift = 0
        self._offer('pause', self._pause)
        self._offer('resume', self._resume)
        self._offer('step', self._step)
        self.provide_reset(self._rewind)
        self.add_on_set_parameters_callback(self._check_seek)
        self.add_post_set_parameters_callback(self._on_parameters)
        self._pace = self.create_timer(1.0 / NANOSECONDS, self._on_frame_due)
        self._pace.cancel()
        self.diagnostics.report(DiagnosticStatus.OK, 'playing')

    def _offer(self, name: str, act: Callable[[], str]) -> None:
        """Offer a service that does something and says what it did."""

        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.message = act()
            response.success = True
            return response

        self.create_service(Trigger, f'~/{name}', serve)

    def _pause(self) -> str:
        self._replay.paused = True
        self._pace.cancel()
        self.diagnostics.report(DiagnosticStatus.OK, 'paused')
        return f'Paused before frame {self._replay.next_index}.'

    def _resume(self) -> str:
        self._replay.paused = False
        self._schedule(0)
        self.diagnostics.report(DiagnosticStatus.OK, 'playing')
        return f'Playing from frame {self._replay.next_index}.'

    def _step(self) -> str:
        self._pause()
        frame = self._next_frame()
        if frame is None:
            return 'There is no frame left.'
        self._play_frame(frame)
        return f'Played {frame.name}, paused before frame {self._replay.next_index}.'

    def _rewind(self) -> str:
        self._seek(self.parameters.frame)
        return f'Playing from frame {self.parameters.frame}.'

    def _check_seek(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse a frame that is not there."""
        last = len(self._replay.names) - 1
        for change in changes:
            if change.name == 'frame' and change.value > last:
                reason = f'A frame is a number from 0 to {last}, got {change.value}.'
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def _on_parameters(self, changes: list[Parameter]) -> None:
        for change in changes:
            if change.name == 'frame':
                self._seek(change.value)

    def _seek(self, index: int) -> None:
        """Go to a frame; show it even if the replay is paused."""
        self._replay.seek(index)
        self._last_recorded = None
        self._shift = 0
        frame = self._next_frame() if self._replay.paused else None
        if frame is not None:
            self._play_frame(frame)
        if not self._replay.paused:
            self._schedule(0)

    def _schedule(self, nanoseconds: int) -> None:
        self._pace.timer_period_ns = max(nanoseconds, 1)
        self._pace.reset()

    def _on_frame_due(self) -> None:
        """Publish the frame that is due, and wait for the next one as long as it takes."""
        self._pace.cancel()
        began = time.monotonic_ns()
        frame = self._next_frame()
        if frame is None:
            return
        self._play_frame(frame)
        rate, following = self.parameters.rate, self._replay.next_name
        period = round(NANOSECONDS / rate) if rate > 0 else 0
        if rate == 0 and following is not None:
            period = self._player.stamp_of(following) - frame.stamp
        self._schedule(period - (time.monotonic_ns() - began))

    def _next_frame(self) -> RgbdFrame | None:
        """Read the next frame that can be read; None at the end."""
        self._replay.loop = self.parameters.loop
        for _ in range(len(self._replay.names)):
            name = self._replay.take()
            if name is None:
                break
            frame = self._read(name)
            if frame is not None:
                return frame
        self.diagnostics.report(DiagnosticStatus.OK, 'finished')
        return None

    def _play_frame(self, frame: RgbdFrame) -> None:
        """Publish a frame, with what was seen of the target before it."""
        if self._time is None:
            self._advance_stamp()
        else:
            # In a loop the recorded times go on where they ended.
            if self._last_recorded is not None and frame.stamp < self._last_recorded:
                self._shift = self._stamp + STEP_NS - frame.stamp
            self._last_recorded = frame.stamp
            self._stamp = frame.stamp + self._shift
        if self._scene is not None and self._instance is not None:
            p = self.parameters
            point = self._scene.sighting(frame.name, self._instance, p.max_difficulty, p.max_range)
            if point is not None:
                self._sightings.add(frame.name, point)
                self._publish_goal(self._sightings.things[0])
        self._say_time()
        view = self._view(frame.name, frame, self._stamp, self.parameters.base_frame)
        self._publish_images(view)
        self._publish_pose(view.odometry)
        self.diagnostics.value('frame', f'{self._replay.next_index - 1} ({frame.name})')

    # Closed loop

    def _start_search(self, scene: Scene) -> None:
        self._arena = scene
        self._observation: list[View] = []
        self._repeat = self.create_timer(
            self.parameters.observation_period, self._publish_observation
        )
        world = LockstepWorld(
            begin=self._begin,
            show_start=self._show_start,
            act=self._act,
            show_step=self._publish_step,
            give_up=self._give_up,
            result=self._result,
            facts=self._facts,
        )
        self._lockstep = Lockstep(self, SOURCE, world)
        self._lockstep.open()

    def _begin(self, seed: int) -> int:
        """Put the robot on its start."""
        p = self.parameters
        simulation = ActiveVisionSimulation(self._arena, p.rules())
        simulation.restart(seed, None if p.start_position < 0 else p.start_position)
        self._simulation = simulation
        self._published_goal = None
        self._advance_stamp()
        return self._stamp

    def _show_start(self) -> None:
        """Publish the first views, unless that waits for somebody who sees them."""
        if self._discovery.is_canceled():
            self._publish_step()
        simulation = self._simulation
        self.get_logger().info(
            f'Episode with seed {self._lockstep.seed}: {self._arena.name}, from position '
            f'{simulation.position} of {len(self._arena.views)}, '
            f'{simulation.result().expert_steps} moves for one who knows it.'
        )

    def _on_discovery(self) -> None:
        """Show the first views once somebody sees them: some of them make another map."""
        publishers = (self._color, self._depth, self._info, self._odom)
        heard = all(publisher.get_subscription_count() for publisher in publishers)
        if heard or time.monotonic() > self._heard_by:
            self._discovery.cancel()
            if self.parameters.mode != REPLAY:
                self._publish_step()
            elif not self._replay.paused:
                self._schedule(0)

    def _act(self, action: int) -> None:
        """Take one action."""
        self._simulation.step(action)
        self._advance_stamp()

    def _give_up(self) -> None:
        self._simulation.give_up()

    def _result(self) -> EpisodeResult:
        return self._simulation.result()

    def _facts(self) -> dict[str, object]:
        """Return what is said of the episode besides how it goes."""
        simulation, rules = self._simulation, self._simulation.rules
        return {
            'bumps': simulation.bumps,
            'scene': simulation.scene.name,
            'positions': len(simulation.scene.views),
            'start_position': simulation.start,
            'target': rules.target,
            'reach': rules.reach,
            'views': rules.views,
            'max_steps': rules.max_steps,
            'resolution': GRID_M,
        }

    def _publish_step(self) -> None:
        """Publish a new step: the images, the goal if it was seen, and then the poses.

        The last view is the one where the robot looks, if it can be read; its pose comes last of
        all and carries the stamp of the step, which is later than those of the other views by
        nanoseconds.
        """
        simulation, base = self._simulation, self.parameters.base_frame
        self._say_time()
        frames = [(name, self._read(name)) for name in simulation.looked_at]
        # A step ends with its pose, even where no image can be read.
        frames = [(name, frame) for name, frame in frames if frame is not None] or frames[-1:]
        first = self._stamp
        self._stamp = first + len(frames) - 1
        self._observation = []
        for stamp, (name, frame) in enumerate(frames, start=first):
            child = base if stamp == self._stamp else base + VIEW_SUFFIX
            view = self._view(name, frame, stamp, child)
            self._publish_images(view)
            self._observation.append(view)
        if simulation.goal is not None:
            self._publish_goal(np.array(simulation.goal))
        self._publish_poses()
        self._repeat.reset()
        self.diagnostics.value('steps', simulation.steps)

    def _publish_observation(self) -> None:
        """Publish the latest observation once more, for those that came late."""
        for view in self._observation:
            self._publish_images(view)
        self._publish_poses()

    def _publish_poses(self) -> None:
        for view in self._observation:
            self._publish_pose(view.odometry)

    # Both

    def _advance_stamp(self) -> None:
        """Give what comes next its stamp: now in whole microseconds, but later than all before."""
        now = self.get_clock().now().nanoseconds
        self._stamp = max(now // STEP_NS, self._stamp // STEP_NS + 1) * STEP_NS

    def _say_time(self) -> None:
        if self._time is not None:
            self._time.publish(Clock(clock=to_stamp(self._stamp)))

    def _read(self, name: str) -> RgbdFrame | None:
        """Read a frame; one that can't be read is named and left out."""
        began = time.perf_counter()
        try:
            frame = self._player.read(name) if self._scene is None else self._scene.frame(name)
        except FrameError as error:
            self.diagnostics.count('left out: frames that can not be read')
            self.warn(f'frame {name}', f'A frame is left out: {error}')
            return None
        self.diagnostics.latency(time.perf_counter() - began, 'read')
        return frame

    def _view(self, name: str, frame: RgbdFrame | None, stamp: int, child: str) -> View:
        """Return what is published of a frame; its pose is exact for the mount of the node."""
        p = self.parameters
        odometry = Odometry(header=header(stamp, p.odom_frame), child_frame_id=child)
        odometry.pose.pose = to_pose_3d(mounted_pose(self._player, name))
        if frame is None:
            return View(odometry, None)
        images = (
            to_image(frame.color, stamp=stamp, frame_id=p.camera_frame),
            to_image(self._encoded(frame), stamp=stamp, frame_id=p.camera_frame),
            to_camera_info(frame.camera, stamp=stamp, frame_id=p.camera_frame),
        )
        return View(odometry, images)

    def _encoded(self, frame: RgbdFrame) -> NDArray[np.generic]:
        """Return the depth in the encoding that was asked for."""
        depth = frame.depth
        in_millimetres = depth.dtype == np.uint16
        if self.parameters.depth_encoding == '32FC1':
            metres = depth.astype(np.float32)
            if in_millimetres:
                metres *= MILLIMETRE
            metres[~(metres > 0)] = np.nan
            return metres
        if in_millimetres:
            return depth
        measured = np.nan_to_num(depth).clip(0, MAX_DEPTH_M)
        millimetres: NDArray[np.uint16] = np.rint(measured * 1000).astype(np.uint16)
        return millimetres

    def _publish_images(self, view: View) -> None:
        if view.images is None:
            return
        for publisher, message in zip(
            (self._color, self._depth, self._info), view.images, strict=True
        ):
            publisher.publish(message)

    def _publish_pose(self, odometry: Odometry) -> None:
        """Publish where the robot is, after the images that belong to it."""
        p = self.parameters
        stamp = to_nanoseconds(odometry.header.stamp)
        self._frames.send(stamp, p.map_frame, p.odom_frame, 0.0, 0.0, 0.0)
        self._frames.send_3d(stamp, p.odom_frame, p.base_frame, odometry.pose.pose)
        mount = to_pose_3d(Pose3D.from_matrix(self._mount.matrix()))
        self._frames.send_3d(stamp, p.base_frame, p.camera_frame, mount)
        self._odom.publish(odometry)

    def _publish_goal(self, position: NDArray[np.float64]) -> None:
        """Publish where the target is, unless that has hardly changed."""
        known = self._published_goal
        if known is not None and np.linalg.norm(position - known) < GOAL_MOVED_M:
            return
        self._published_goal = position
        goal = PoseStamped(header=header(self._stamp, self.parameters.map_frame))
        goal.pose = to_pose_3d(Pose3D(*position.tolist()))
        self._goal_pose.publish(goal)


def main() -> int:
    """Run the node; the executable ``avd_player_node``."""
    return run_node(AvdPlayerNode)


if __name__ == '__main__':
    sys.exit(main())
