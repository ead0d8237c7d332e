"""The part of the node ``bev_mapper`` that maps RGB-D images."""

from __future__ import annotations

import array
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField

from bev_mapper.evidence_grid import Crop
from bev_mapper.frame_sync import KEPT_POSES, SyncConfig
from bev_mapper.map_files import save_cloud, save_map
from bev_mapper.rgbd_fusion import RgbdFusion
from bev_mapper.rgbd_mapper import STAGES, MapperConfig, RgbdMapper
from bev_mapper.segmentation import make_segmenter
from gridnav.grid import GridGeometry
from gridnav.partial_map import UNKNOWN_VALUE
from gridnav.rgbd import VIEW_SUFFIX, CameraMount
from gridnav.ros.conversions import NANOSECONDS, header, to_nanoseconds, to_occupancy_grid
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, RELIABLE_QOS, SENSOR_QOS
from gridnav.ros.rgbd import (
    COLOR_ENCODINGS,
    DEPTH_ENCODINGS,
    from_camera_info,
    from_image,
    from_pose_3d,
    validate_camera_info,
    validate_image,
)
from gridnav.ros.tf import FrameListener
from gridnav.ros.validation import validate_odometry

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_mapper.node import BevMapperNode, MapperParameters
    from bev_mapper.rgbd_mapper import Mode
    from bev_mapper.voxel_cloud import CloudPoints

RESOLUTION_M = 0.1
"""Side of a cell unless another one is asked for."""

CHECK_PERIOD_S = 0.25
"""How often what waits too long is looked for."""

POINT = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('rgb', '<u4'), ('label', '<u4')])


class StepViews:
    """Knows of which step the views are that come.

    A world of cells says a pose for each view of a step, those but the last with a frame of their
    own (`VIEW_SUFFIX`), and so how many views there are and what the step's stamp is.
    """

    def __init__(self) -> None:
        self._poses: set[int] = set()
        self._are_named = False
        self._step = self._ended = -1

    def add_pose(self, stamp: int, *, is_view: bool) -> bool:
        """Take in the stamp of a pose; tells whether it is new."""
        self._are_named |= is_view
        if stamp <= self._ended or stamp in self._poses:
            return False
        if self._are_named:
            self._poses.add(stamp)
            self._step = self._step if is_view else max(self._step, stamp)
        return True

    def wanted(self, at_most: int) -> int:
        """Return how many frames make the step complete."""
        if not self.is_over:
            return at_most
        return min(at_most, sum(stamp <= self._step for stamp in self._poses))

    @property
    def is_over(self) -> bool:
        """Whether the robot's own pose has come, which is the last, and no map of the step."""
        return self._are_named and self._step > self._ended

    def end_step(self, stamp: int) -> int:
        """Return the stamp of what is published of the step, given that of its newest frame."""
        if self.is_over:
            stamp = max(stamp, self._step)
        self._ended = max(self._ended, stamp)
        self._poses = {pose for pose in self._poses if pose > self._ended}
        return stamp


class RgbdInput:
    """Fuses images, cameras and poses, and publishes what comes of it."""

    def __init__(self, node: BevMapperNode) -> None:
        """Subscribe and advertise.

        Raises:
            ValueError: If the parameters do not fit together or what they ask for is not there.
        """
        self._node = node
        self._parameters = p = node.parameters
        segmenter = make_segmenter(p.segmenter, Path(p.weights) if p.weights else None)
        mapper = RgbdMapper(mapper_config(p), segmenter)
        self._frames = FrameListener(node) if p.camera_mount_source == 'tf' else None
        mount = (
            None
            if self._frames
            else CameraMount(
                p.camera_x, p.camera_y, p.camera_z, p.camera_roll, p.camera_pitch, p.camera_yaw
            )
        )
        self._fusion = RgbdFusion(mapper, sync_config(p), mount)
        self._views = StepViews()
        self._unpublished = 0
        self._news_at = 0
        self._map = node.advertise(OccupancyGrid, 'map', MAP_QOS)
        self._probability = node.advertise(OccupancyGrid, '~/probability', MAP_QOS)
        self._points = node.advertise(PointCloud2, 'points', SENSOR_QOS)
        # First, so that a new world is known before its first observation when both are waiting.
        node.subscribe(
            DiagnosticStatus, 'episode', self._on_episode, EPISODE_QOS, single_source=False
        )
        # All views of a robot that looks around come at once and wait here for their turns.
        quality = RELIABLE_QOS if p.reliable_images else SENSOR_QOS
        images = QoSProfile(depth=p.queue_size, reliability=quality.reliability)
        node.subscribe(
            Odometry,
            'odom',
            self._on_odom,
            QoSProfile(depth=KEPT_POSES, reliability=RELIABLE_QOS.reliability),
            validate=partial(validate_odometry, frames=(p.odom_frame, p.map_frame)),
        )
        node.subscribe(
            CameraInfo,
            'camera/camera_info',
            self._on_camera,
            images,
            validate=validate_camera_info,
        )
        node.subscribe(
            Image,
            'camera/color/image_raw',
            self._on_color,
            images,
            validate=partial(validate_image, encodings=COLOR_ENCODINGS),
        )
        node.subscribe(
            Image,
            'camera/depth/image_raw',
            self._on_depth,
            images,
            validate=partial(validate_image, encodings=DEPTH_ENCODINGS),
        )
        node.create_timer(CHECK_PERIOD_S, self._check)
        node.create_timer(p.points_period, self._show)
        node.diagnostics.value('segmenter', mapper.segmenter)
        node.diagnostics.report(DiagnosticStatus.OK, 'waiting for images and odom')
        node.get_logger().info(
            f'Mapping RGB-D images with the {mapper.segmenter} segmenter into cells of '
            f'{mapper.grid.geometry.resolution} m in {p.map_frame!r}.'
        )

    def reset(self) -> str:
        """Forget all frames."""
        self._fusion.clear()
        self._views = StepViews()
        self._unpublished = 0
        return 'The map is empty.'

    def save(self, folder: Path) -> str:
        """Write the map and the cloud into a folder."""
        mapper = self._fusion.mapper
        mapper.finish()
        save_map(folder, mapper.grid.occupancy, mapper.grid.geometry)
        save_cloud(folder, mapper.cloud.points())
        return f'Wrote map.pgm, map.yaml and cloud.ply into {folder}.'

    def _on_odom(self, message: Odometry) -> None:
        pose, stamp = from_pose_3d(message.pose.pose), _stamp(message)
        if self._views.add_pose(stamp, is_view=message.child_frame_id.endswith(VIEW_SUFFIX)):
            self._news_at = time.monotonic_ns()
        self._take_in(partial(self._fusion.add_pose, stamp, pose))
        self._publish_if_complete()

    def _on_camera(self, message: CameraInfo) -> None:
        camera = from_camera_info(message)
        self._take_in(partial(self._fusion.add_camera, _stamp(message), camera))

    def _on_color(self, message: Image) -> None:
        color = from_image(message).astype(np.uint8, copy=False)
        self._take_in(partial(self._fusion.add_color, _stamp(message), color))

    def _on_depth(self, message: Image) -> None:
        if self._frames is not None and self._fusion.sync.mount is None:
            found = self._frames.look_up_in_space(
                self._parameters.base_frame, message.header.frame_id
            )
            if found is not None:
                self._fusion.sync.mount = CameraMount.from_matrix(found.matrix())
        now = time.monotonic_ns()
        self._take_in(partial(self._fusion.add_depth, _stamp(message), from_image(message), now))

    def _on_episode(self, message: DiagnosticStatus) -> None:
        status = EpisodeStatus.from_message(message)
        if status.begins:
            self._unpublished = 0
            self._views = StepViews()
            self._take_in(partial(self._fusion.begin_episode, status.start))

    def _take_in(self, add: Callable[[], int]) -> None:
        """Add something to the fusion and publish the map if there is a new one."""
        began = time.perf_counter()
        fused = add()
        diagnostics, mapper = self._node.diagnostics, self._fusion.mapper
        self._report()
        if not fused:
            return
        self._news_at = time.monotonic_ns()
        self._unpublished += fused
        self._publish_if_complete()
        diagnostics.latency(time.perf_counter() - began, 'frame')
        for stage in STAGES:
            diagnostics.latency(mapper.timings[stage], stage)
        diagnostics.value('frames', mapper.frames)
        diagnostics.value('cloud: voxels', len(mapper.cloud))
        diagnostics.value('cloud: dropped voxels', mapper.cloud.dropped)
        diagnostics.report(DiagnosticStatus.OK, f'mapping, {mapper.segmenter} segmenter')

    def _report(self) -> None:
        """Say which frames were left out, and why."""
        for key, count in self._fusion.counts.items():
            self._node.diagnostics.value(key, count)
        while self._fusion.refused:
            self._node.warn('refused frame', f'Left out a frame: {self._fusion.refused.pop(0)}')

    def _publish_if_complete(self) -> None:
        wanted = self._views.wanted(self._parameters.views_per_step)
        if self._unpublished >= wanted > 0:
            self._publish()

    def _publish(self) -> None:
        self._unpublished = 0
        mapper = self._fusion.mapper
        stamp = self._views.end_step(mapper.stamp)
        for publisher, cells in (
            (self._map, mapper.grid.occupancy),
            (self._probability, mapper.grid.probability),
        ):
            publisher.publish(
                to_occupancy_grid(
                    cells,
                    mapper.grid.geometry,
                    stamp=stamp,
                    frame_id=self._parameters.map_frame,
                )
            )
        occupancy = mapper.grid.occupancy
        self._node.diagnostics.value('map: cells', occupancy.size)
        seen = np.count_nonzero(occupancy != UNKNOWN_VALUE)
        self._node.diagnostics.value('map: seen cells', seen)

    def _check(self) -> None:
        """Give up what waits too long; views of a step that got lost hold up no map."""
        now = time.monotonic_ns()
        self._fusion.expire(now)
        self._report()
        is_late = now - self._news_at > self._fusion.sync.config.wait
        if is_late and (self._unpublished or self._views.is_over):
            self._publish()

    def _show(self) -> None:
        """Publish the cloud if there is one and somebody looks, also those who came late."""
        mapper = self._fusion.mapper
        if not len(mapper.cloud) or not self._points.get_subscription_count():
            return
        cloud = mapper.cloud.points()
        self._points.publish(
            to_point_cloud(
                cloud,
                self._parameters.max_published,
                stamp=mapper.stamp,
                frame_id=self._parameters.map_frame,
            )
        )


def mapper_config(p: MapperParameters) -> MapperConfig:
    """Return how the parameters say that frames become a map."""
    resolution = p.resolution or RESOLUTION_M
    return MapperConfig(
        geometry=GridGeometry(p.height, p.width, resolution, p.origin_x, p.origin_y),
        mode=cast('Mode', p.mode),
        growth=p.growth,
        max_cells=p.max_cells,
        crop=Crop(p.min_height, p.max_height),
        footprint=p.footprint,
        free_below=p.free_below,
        max_range=p.max_range,
        max_pixels=p.max_pixels,
        max_points=p.max_points,
        fit_floor=p.fit_floor,
        voxel=p.voxel,
        max_voxels=p.max_voxels,
        relabel_every=p.relabel_every,
    )


def sync_config(p: MapperParameters) -> SyncConfig:
    """Return how the parameters say that messages are matched."""
    image_slop, pose_slop, wait = (
        round(seconds * NANOSECONDS) for seconds in (p.image_slop, p.pose_slop, p.wait)
    )
    return SyncConfig(image_slop, pose_slop, wait, p.queue_size)


def to_point_cloud(
    cloud: CloudPoints, max_points: int, *, stamp: int, frame_id: str
) -> PointCloud2:
    """Build a message of points with colour and label, of every k-th point if there are too many.

    The colour is 0xRRGGBB in the bytes of a float32, as RViz and PCL have it.
    """
    step = -(-len(cloud.labels) // max_points) or 1
    points = np.empty(len(cloud.labels[::step]), dtype=POINT)
    for axis, name in enumerate('xyz'):
        points[name] = cloud.positions[::step, axis]
    red, green, blue = cloud.colors[::step].astype(np.uint32).T
    points['rgb'] = red << 16 | green << 8 | blue
    points['label'] = cloud.labels[::step]
    kinds = dict.fromkeys('xyz', PointField.FLOAT32)
    kinds |= {'rgb': PointField.FLOAT32, 'label': PointField.UINT32}
    message = PointCloud2(header=header(stamp, frame_id), height=1, width=len(points))
    message.fields = [
        PointField(name=name, offset=4 * index, datatype=kind, count=1)
        for index, (name, kind) in enumerate(kinds.items())
    ]
    message.point_step = POINT.itemsize
    message.row_step = points.nbytes
    message.data = array.array('B', points.tobytes())
    message.is_dense = True
    return message


def _stamp(message: Odometry | CameraInfo | Image) -> int:
    return to_nanoseconds(message.header.stamp)
