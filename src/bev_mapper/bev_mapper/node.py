"""The node ``bev_mapper``: fuses local views or RGB-D images with ``odom`` into ``map``."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry
from std_srvs.srv import Trigger

from bev_mapper.grid_fusion import DEFAULT_GROWTH, DEFAULT_MAX_CELLS, GridFusion
from bev_mapper.local_map_fusion import LocalMapFusion, Window
from bev_mapper.map_files import save_map
from bev_mapper.rgbd_mapper import Mode
from bev_mapper.rgbd_node import RgbdInput
from bev_mapper.segmentation import SEGMENTERS
from gridnav.grid import GridGeometry
from gridnav.partial_map import UNKNOWN_VALUE
from gridnav.pose import Pose2D
from gridnav.ros.conversions import (
    from_occupancy_grid,
    to_nanoseconds,
    to_occupancy_grid,
    to_yaw,
)
from gridnav.ros.episode import EpisodeStatus
from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.qos import EPISODE_QOS, MAP_QOS, RELIABLE_QOS
from gridnav.ros.run import run_node
from gridnav.ros.validation import (
    MAX_CELLS,
    MAX_COORDINATE_M,
    MAX_RESOLUTION_M,
    InvalidMessage,
    validate_occupancy_grid,
    validate_odometry,
)

if TYPE_CHECKING:
    from collections.abc import Callable


RESOLUTION_M = 1.0
"""Side of a cell with local maps, unless another one is asked for."""


@dataclass
class MapperParameters:
    """Parameters of the node."""

    input: str = parameter(
        'local_map',
        "What the map is made of: the topic 'local_map', or RGB-D images under 'camera'",
        choices=('local_map', 'rgbd'),
        read_only=True,
    )
    width: int = parameter(
        15, 'Columns of the map at first', unit='cells', low=1, high=4096, read_only=True
    )
    height: int = parameter(
        15, 'Rows of the map at first', unit='cells', low=1, high=4096, read_only=True
    )
    origin_x: float = parameter(
        0.0,
        'x of the lower-left corner of the map at first',
        unit='m',
        low=-MAX_COORDINATE_M,
        high=MAX_COORDINATE_M,
        read_only=True,
    )
    origin_y: float = parameter(
        0.0,
        'y of the lower-left corner of the map at first',
        unit='m',
        low=-MAX_COORDINATE_M,
        high=MAX_COORDINATE_M,
        read_only=True,
    )
    resolution: float = parameter(
        0.0,
        'Side of a cell, 0 for 1 m with local maps and 0.1 m with RGB-D images; a local map of '
        'another resolution is refused',
        unit='m',
        low=0.0,
        high=MAX_RESOLUTION_M,
        read_only=True,
    )
    growth: int = parameter(
        DEFAULT_GROWTH,
        'How much a side of the map grows at least when something is seen beyond it; 0 keeps a '
        'map of RGB-D images as it is',
        unit='cells',
        low=0,
        high=1024,
    )
    max_cells: int = parameter(
        DEFAULT_MAX_CELLS,
        'The map never grows beyond this',
        unit='cells',
        low=1,
        high=MAX_CELLS,
    )
    map_frame: str = parameter('map', 'Frame of the map', read_only=True)
    odom_frame: str = parameter(
        'odom', 'Frame of odom, taken to be where the map frame is', read_only=True
    )
    base_frame: str = parameter(
        'base_link',
        'Frame of the robot; a local map in it is placed by the pose in odom',
        read_only=True,
    )
    segmenter: str = parameter(
        'geometric',
        'RGB-D: what tells floor from obstacles',
        choices=SEGMENTERS,
        read_only=True,
    )
    weights: str = parameter('', 'RGB-D: file of the weights of the segmenter', read_only=True)
    mode: str = parameter(
        'evidence',
        'RGB-D: evidence adds up what frames say about a cell, majority counts the points of the '
        'cloud as in the paper',
        choices=get_args(Mode),
        read_only=True,
    )
    camera_mount_source: str = parameter(
        'parameters',
        "RGB-D: where the camera is on the robot: as camera_x to camera_yaw say, or from 'tf'",
        choices=('parameters', 'tf'),
        read_only=True,
    )
    camera_x: float = parameter(
        0.0, 'The camera is so far ahead of the base', unit='m', read_only=True
    )
    camera_y: float = parameter(
        0.0, 'The camera is so far to the left of the base', unit='m', read_only=True
    )
    camera_z: float = parameter(
        0.0, 'The camera is so far above the base', unit='m', read_only=True
    )
    camera_roll: float = parameter(
        0.0, 'The camera is turned so much about its axis', unit='rad', read_only=True
    )
    camera_pitch: float = parameter(
        0.0, 'The camera looks down so much', unit='rad', read_only=True
    )
    camera_yaw: float = parameter(
        0.0, 'The camera looks to the left so much', unit='rad', read_only=True
    )
    image_slop: float = parameter(
        0.0,
        'RGB-D: colour image and camera_info may be so far from the depth image; 0 takes equal '
        'stamps alone',
        unit='s',
        low=0.0,
        high=1.0,
        read_only=True,
    )
    pose_slop: float = parameter(
        0.1,
        'RGB-D: where no pose has the stamp of the depth image, it is taken between two that are '
        'no further away than this',
        unit='s',
        low=0.0,
        high=10.0,
        read_only=True,
    )
    wait: float = parameter(
        5.0,
        'RGB-D: a depth image waits so long for the rest, then it is left out',
        unit='s',
        low=0.0,
        high=60.0,
        read_only=True,
    )
    queue_size: int = parameter(
        32, 'RGB-D: how many images wait at most', low=1, high=1000, read_only=True
    )
    reliable_images: bool = parameter(
        default=False,
        description='RGB-D: have images sent again that got lost; the camera must offer that, as '
        'avd_player does',
        read_only=True,
    )
    views_per_step: int = parameter(
        1,
        'RGB-D: a map is published after so many frames, such as all views of a robot that looks '
        'around, or when no more came for as long as wait says',
        low=1,
        high=1000,
    )
    min_height: float = parameter(
        0.08,
        'RGB-D: what is lower is no obstacle',
        unit='m',
        low=0.0,
        high=1.0,
        read_only=True,
    )
    max_height: float = parameter(
        1.5,
        'RGB-D: what is higher is above the robot',
        unit='m',
        low=0.1,
        high=10.0,
        read_only=True,
    )
    max_range: float = parameter(
        5.0,
        'RGB-D: depth beyond this is not mapped',
        unit='m',
        low=0.1,
        high=100.0,
        read_only=True,
    )
    footprint: float = parameter(
        0.2,
        'RGB-D: radius around the robot that is free',
        unit='m',
        low=0.0,
        high=10.0,
        read_only=True,
    )
    free_below: float = parameter(
        0.3,
        'RGB-D: where the floor was not seen, a cell is free if the camera looked through it '
        'lower than this',
        unit='m',
        low=0.0,
        high=10.0,
        read_only=True,
    )
    fit_floor: bool = parameter(
        True,  # noqa: FBT003
        'RGB-D: look for the floor a few degrees and centimetres from where it is said to be',
        read_only=True,
    )
    max_pixels: int = parameter(
        130_000,
        'RGB-D: the segmenter gets no more pixels of an image than this',
        low=1000,
        high=1_000_000,
        read_only=True,
    )
    max_points: int = parameter(
        40_000,
        'RGB-D: no more pixels of an image than this become points',
        low=1000,
        high=1_000_000,
        read_only=True,
    )
    voxel: float = parameter(
        0.04,
        "RGB-D: side of the cloud's voxels",
        unit='m',
        low=0.01,
        high=1.0,
        read_only=True,
    )
    max_voxels: int = parameter(
        1_000_000,
        'RGB-D: the most voxels of the cloud; then those not seen for longest make room',
        low=1000,
        high=20_000_000,
        read_only=True,
    )
    relabel_every: int = parameter(
        0,
        'RGB-D: dgcnn and swin3d label the cloud after so many frames, 0 for ~/save alone; '
        'what is new has the labels of the geometric segmenter',
        low=0,
        high=100_000,
        read_only=True,
    )
    points_period: float = parameter(
        1.0,
        'RGB-D: points are published so often, while somebody listens',
        unit='s',
        low=0.05,
        high=3600.0,
        read_only=True,
    )
    max_published: int = parameter(
        100_000,
        'RGB-D: of a larger cloud only every k-th point is published',
        low=1,
        high=10_000_000,
    )
    save_folder: str = parameter(
        'saved_map', 'Folder into which ~/save writes; it is made if there is none'
    )


class BevMapperNode(BaseNode[MapperParameters]):
    """Publishes the map that all views make together."""

    def __init__(self) -> None:
        """Start the node.

        Raises:
            ParameterError: If a parameter can't be used.
            ValueError: If parameters do not fit together.
        """
        super().__init__('bev_mapper', MapperParameters)
        make = RgbdInput if self.parameters.input == 'rgbd' else LocalMapInput
        self._input = make(self)
        self.provide_reset(self._input.reset)
        self.create_service(Trigger, '~/save', self._save)

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        folder = Path(self.parameters.save_folder).absolute()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            response.message = self._input.save(folder)
            response.success = True
        except OSError as error:
            response.message = f'{folder} can not be written to: {error.strerror}.'
            response.success = False
        return response


class LocalMapInput:
    """Fuses local views and poses, and publishes what comes of it."""

    def __init__(self, node: BevMapperNode) -> None:
        """Subscribe and advertise.

        Raises:
            ValueError: If the first map is larger than ``max_cells``.
        """
        self._node = node
        self._parameters = p = node.parameters
        resolution = p.resolution or RESOLUTION_M
        geometry = GridGeometry(p.height, p.width, resolution, p.origin_x, p.origin_y)
        self._fusion = LocalMapFusion(GridFusion(geometry, p.growth, p.max_cells))
        self._map = node.advertise(OccupancyGrid, 'map', MAP_QOS)
        # First, so that a new world is known before its first observation when both are waiting.
        node.subscribe(
            DiagnosticStatus, 'episode', self._on_episode, EPISODE_QOS, single_source=False
        )
        node.subscribe(
            Odometry,
            'odom',
            self._on_odom,
            RELIABLE_QOS,
            validate=partial(validate_odometry, frames=(p.odom_frame, p.map_frame)),
        )
        node.subscribe(
            OccupancyGrid,
            'local_map',
            self._on_local_map,
            RELIABLE_QOS,
            validate=partial(validate_occupancy_grid, frames=(p.map_frame, p.base_frame)),
        )
        node.diagnostics.report(DiagnosticStatus.OK, 'waiting for local_map and odom')
        node.get_logger().info(
            f'Mapping from {p.height} x {p.width} cells of {resolution} m in {p.map_frame!r}.'
        )

    def reset(self) -> str:
        """Forget all views."""
        self._fusion.clear()
        return 'The map is empty.'

    def save(self, folder: Path) -> str:
        """Write the map into a folder."""
        save_map(folder, self._fusion.grid.occupancy, self._fusion.grid.geometry)
        return f'Wrote map.pgm and map.yaml into {folder}.'

    def _on_odom(self, message: Odometry) -> None:
        pose = message.pose.pose
        pose_2d = Pose2D(pose.position.x, pose.position.y, to_yaw(pose.orientation))
        stamp = to_nanoseconds(message.header.stamp)
        self._take_in(partial(self._fusion.add_pose, stamp, pose_2d))

    def _on_local_map(self, message: OccupancyGrid) -> None:
        occupancy, geometry = from_occupancy_grid(message)
        on_robot = message.header.frame_id == self._parameters.base_frame
        stamp = to_nanoseconds(message.header.stamp)
        self._take_in(
            partial(self._fusion.add_window, stamp, Window(occupancy, geometry, on_robot))
        )

    def _on_episode(self, message: DiagnosticStatus) -> None:
        status = EpisodeStatus.from_message(message)
        if status.begins:
            self._take_in(partial(self._fusion.begin_episode, status.start))

    def _take_in(self, add: Callable[[], bool]) -> None:
        """Add something to the fusion and publish the map if there is a new one."""
        began = time.perf_counter()
        grid, diagnostics = self._fusion.grid, self._node.diagnostics
        # The node's parameters can change at run time.
        grid.growth, grid.max_cells = max(self._parameters.growth, 1), self._parameters.max_cells
        try:
            has_map = add()
        except ValueError as error:
            raise InvalidMessage(str(error)) from error
        for key, count in self._fusion.counts.items():
            diagnostics.value(key, count)
        if not has_map:
            return
        self._map.publish(
            to_occupancy_grid(
                grid.occupancy,
                grid.geometry,
                stamp=self._fusion.stamp,
                frame_id=self._parameters.map_frame,
            )
        )
        diagnostics.latency(time.perf_counter() - began, 'map')
        diagnostics.value('map: cells', grid.occupancy.size)
        diagnostics.value('map: seen cells', np.count_nonzero(grid.occupancy != UNKNOWN_VALUE))
        diagnostics.report(DiagnosticStatus.OK, 'mapping')


def main() -> int:
    """Run the node; the executable ``bev_mapper_node``."""
    return run_node(BevMapperNode)


if __name__ == '__main__':
    sys.exit(main())
