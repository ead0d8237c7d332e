"""The node ``bev_mapper``: fuses ``local_map`` and ``odom`` into ``map``."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry

from bev_mapper.grid_fusion import DEFAULT_GROWTH, DEFAULT_MAX_CELLS, GridFusion
from bev_mapper.local_map_fusion import LocalMapFusion, Window
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
    MIN_RESOLUTION_M,
    InvalidMessage,
    validate_occupancy_grid,
    validate_odometry,
)

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass
class MapperParameters:
    """Parameters of the node."""

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
        1.0,
        'Side of a cell; a local map of another resolution is refused',
        unit='m',
        low=MIN_RESOLUTION_M,
        high=MAX_RESOLUTION_M,
        read_only=True,
    )
    growth: int = parameter(
        DEFAULT_GROWTH,
        'How much a side of the map grows at least when something is seen beyond it',
        unit='cells',
        low=1,
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


class BevMapperNode(BaseNode[MapperParameters]):
    """Publishes the map that all local views make together."""

    def __init__(self) -> None:
        """Start the node.

        Raises:
            ParameterError: If a parameter can't be used.
            ValueError: If the first map is larger than ``max_cells``.
        """
        super().__init__('bev_mapper', MapperParameters)
        p = self.parameters
        geometry = GridGeometry(p.height, p.width, p.resolution, p.origin_x, p.origin_y)
        self._fusion = LocalMapFusion(GridFusion(geometry, p.growth, p.max_cells))
        self._map = self.advertise(OccupancyGrid, 'map', MAP_QOS)
        # First, so that a new world is known before its first observation when both are waiting.
        self.subscribe(
            DiagnosticStatus, 'episode', self._on_episode, EPISODE_QOS, single_source=False
        )
        self.subscribe(
            Odometry,
            'odom',
            self._on_odom,
            RELIABLE_QOS,
            validate=partial(validate_odometry, frames=(p.odom_frame, p.map_frame)),
        )
        self.subscribe(
            OccupancyGrid,
            'local_map',
            self._on_local_map,
            RELIABLE_QOS,
            validate=partial(validate_occupancy_grid, frames=(p.map_frame, p.base_frame)),
        )
        self.provide_reset(self._reset)
        self.diagnostics.report(DiagnosticStatus.OK, 'waiting for local_map and odom')
        self.get_logger().info(
            f'Mapping from {p.height} x {p.width} cells of {p.resolution} m in {p.map_frame!r}.'
        )

    def _on_odom(self, message: Odometry) -> None:
        pose = message.pose.pose
        pose_2d = Pose2D(pose.position.x, pose.position.y, to_yaw(pose.orientation))
        stamp = to_nanoseconds(message.header.stamp)
        self._take_in(partial(self._fusion.add_pose, stamp, pose_2d))

    def _on_local_map(self, message: OccupancyGrid) -> None:
        occupancy, geometry = from_occupancy_grid(message)
        on_robot = message.header.frame_id == self.parameters.base_frame
        stamp = to_nanoseconds(message.header.stamp)
        self._take_in(
            partial(self._fusion.add_window, stamp, Window(occupancy, geometry, on_robot))
        )

    def _on_episode(self, message: DiagnosticStatus) -> None:
        status = EpisodeStatus.from_message(message)
        if status.begins:
            self._take_in(partial(self._fusion.begin_episode, status.start))

    def _reset(self) -> str:
        self._fusion.clear()
        return 'The map is empty.'

    def _take_in(self, add: Callable[[], bool]) -> None:
        """Add something to the fusion and publish the map if there is a new one."""
        began = time.perf_counter()
        grid = self._fusion.grid
        grid.growth, grid.max_cells = self.parameters.growth, self.parameters.max_cells
        try:
            has_map = add()
        except ValueError as error:
            raise InvalidMessage(str(error)) from error
        for key, count in self._fusion.counts.items():
            self.diagnostics.value(key, count)
        if not has_map:
            return
        self._map.publish(
            to_occupancy_grid(
                grid.occupancy,
                grid.geometry,
                stamp=self._fusion.stamp,
                frame_id=self.parameters.map_frame,
            )
        )
        self.diagnostics.latency(time.perf_counter() - began, 'map')
        self.diagnostics.value('map: cells', grid.occupancy.size)
        self.diagnostics.value(
            'map: seen cells', np.count_nonzero(grid.occupancy != UNKNOWN_VALUE)
        )
        self.diagnostics.report(DiagnosticStatus.OK, 'mapping')


def main() -> int:
    """Run the node; the executable ``bev_mapper_node``."""
    return run_node(BevMapperNode)


if __name__ == '__main__':
    sys.exit(main())
