"""Bags of a run that never was: a robot that knows the maze walks to the goal."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from gridnav.actions import DONE
from gridnav.grid import GridGeometry
from gridnav.partial_map import to_occupancy
from maze_sim import MazeSimulation, cost_to_go, make_mazes, shortest_actions
from vgdp_bringup.recorder import BagRecorder, offered_qos
from vgdp_bringup.topics import TOPICS

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SECOND = 1_000_000_000
PLANNING = 50_000_000
"""Nanoseconds between a map and its plan."""

STORE = get_typestore(Stores.ROS2_JAZZY)
QOS = offered_qos(10, reliable=True, transient_local=False)


def message(kind: str, **fields: Any) -> Any:  # noqa: ANN401 - generated types
    """Build a message of rosbags."""
    return STORE.types[kind](**fields)


def header(stamp: int, frame: str = 'map') -> Any:  # noqa: ANN401
    """Build a header."""
    seconds, rest = divmod(stamp, SECOND)
    time = message('builtin_interfaces/msg/Time', sec=seconds, nanosec=rest)
    return message('std_msgs/msg/Header', stamp=time, frame_id=frame)


def point(x: float, y: float) -> Any:  # noqa: ANN401
    """Build a point on the ground."""
    return message('geometry_msgs/msg/Point', x=x, y=y, z=0.0)


def pose(x: float, y: float) -> Any:  # noqa: ANN401
    """Build a pose that looks east."""
    rotation = message('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0)
    return message('geometry_msgs/msg/Pose', position=point(x, y), orientation=rotation)


def grid(stamp: int, cells: NDArray[np.int8], geometry: GridGeometry) -> Any:  # noqa: ANN401
    """Build an occupancy grid."""
    info = message(
        'nav_msgs/msg/MapMetaData',
        map_load_time=header(stamp).stamp,
        resolution=geometry.resolution,
        width=geometry.cols,
        height=geometry.rows,
        origin=pose(geometry.origin_x, geometry.origin_y),
    )
    return message(
        'nav_msgs/msg/OccupancyGrid', header=header(stamp), info=info, data=cells.reshape(-1)
    )


def odometry(stamp: int, x: float, y: float) -> Any:  # noqa: ANN401
    """Build an odometry message."""
    zero = message('geometry_msgs/msg/Vector3', x=0.0, y=0.0, z=0.0)
    return message(
        'nav_msgs/msg/Odometry',
        header=header(stamp, 'odom'),
        child_frame_id='base_link',
        pose=message(
            'geometry_msgs/msg/PoseWithCovariance', pose=pose(x, y), covariance=np.zeros(36)
        ),
        twist=message(
            'geometry_msgs/msg/TwistWithCovariance',
            twist=message('geometry_msgs/msg/Twist', linear=zero, angular=zero),
            covariance=np.zeros(36),
        ),
    )


def stamped(stamp: int, x: float, y: float) -> Any:  # noqa: ANN401
    """Build a stamped pose."""
    return message('geometry_msgs/msg/PoseStamped', header=header(stamp), pose=pose(x, y))


def path(stamp: int, points: list[tuple[float, float]]) -> Any:  # noqa: ANN401
    """Build a path."""
    poses = [stamped(stamp, x, y) for x, y in points]
    return message('nav_msgs/msg/Path', header=header(stamp), poses=poses)


def line(stamp: int, number: int, points: list[tuple[float, float]], value: float) -> Any:  # noqa: ANN401
    """Build the marker of a candidate plan."""
    color = message('std_msgs/msg/ColorRGBA', r=0.0, g=1.0, b=0.0, a=1.0)
    kind = 'visualization_msgs/msg/Marker'
    fields: dict[str, Any] = {
        'header': header(stamp),
        'ns': 'candidates',
        'id': number,
        'type': 4,
        'action': 0,
        'pose': pose(0.0, 0.0),
        'scale': message('geometry_msgs/msg/Vector3', x=0.1, y=0.0, z=0.0),
        'color': color,
        'lifetime': message('builtin_interfaces/msg/Duration', sec=0, nanosec=0),
        'frame_locked': False,
        'points': [point(x, y) for x, y in points],
        'colors': [],
        'texture_resource': '',
        'texture': message(
            'sensor_msgs/msg/CompressedImage',
            header=header(stamp),
            format='',
            data=np.zeros(0, dtype=np.uint8),
        ),
        'uv_coordinates': [],
        'text': f'{value:.2f}',
        'mesh_resource': '',
        'mesh_file': message(
            'visualization_msgs/msg/MeshFile', filename='', data=np.zeros(0, dtype=np.uint8)
        ),
        'mesh_use_embedded_materials': False,
    }
    return message(kind, **fields)


def status(name: str, text: str, start: int, **values: object) -> Any:  # noqa: ANN401
    """Build a message for ``episode``."""
    pairs = {'start': f'{start // SECOND}.{start % SECOND:09d}', **values}
    items = [
        message('diagnostic_msgs/msg/KeyValue', key=key, value=str(value))
        for key, value in pairs.items()
    ]
    return message(
        'diagnostic_msgs/msg/DiagnosticStatus',
        level=0,
        name=name,
        message=text,
        hardware_id='',
        values=items,
    )


class SyntheticBag:
    """A bag that gets filled."""

    def __init__(self, folder: Path, namespace: str = '/', flush_each: int = 0) -> None:
        """Create the bag with all topics; each so many messages make a chunk of their own."""
        self._recorder = BagRecorder(folder)
        self._flush_each, self._added = flush_each, 0
        self._types = {topic.name: topic.type for topic in TOPICS}
        self._namespace = namespace
        for topic in TOPICS:
            self._recorder.add_topic(self._full(topic.name), topic.type, [QOS])

    def _full(self, topic: str) -> str:
        return topic if topic.startswith('/') else self._namespace + topic

    def add(self, topic: str, received: int, content: Any) -> None:  # noqa: ANN401
        """Write a message."""
        data = bytes(STORE.serialize_cdr(content, self._types[topic]))
        self._recorder.write(self._full(topic), received, data)
        self._added += 1
        if self._flush_each and self._added % self._flush_each == 0:
            while self._recorder.waiting_bytes:
                time.sleep(0.001)
            self._recorder._file.flush()

    def add_episode(self, seed: int, start: int) -> None:
        """Write an episode in a maze of 15 x 15 cells, one step a second, from ``start`` on."""
        maze = make_mazes(1, 15, seed)[0]
        geometry = GridGeometry(15, 15, 1.0)
        simulation = MazeSimulation([maze])
        costs = cost_to_go(maze.blocked, maze.goal)
        values = np.where(np.isfinite(costs), 100 - 100 * costs / costs[maze.start], -1)
        actions = [*shortest_actions(maze.blocked, maze.start, maze.goal), DONE]
        self.add('episode', start, status('maze_sim', 'running', start, seed=seed))
        goal_said = False
        for step, action in enumerate([*actions, None]):
            stamp = start + step * SECOND
            x, y = geometry.center_of(*simulation.cells[0].tolist())
            goal = geometry.center_of(*maze.goal)
            if simulation.goal_seen[0] and not goal_said:
                self.add('goal_pose', stamp, stamped(stamp, *goal))
                goal_said = True
            for again in (0, SECOND // 2):
                self.add('odom', stamp + again, odometry(stamp, x, y))
            cells = to_occupancy(simulation.partial_maps[0])
            self.add('map', stamp, grid(stamp, cells, geometry))
            if action is None:
                break
            plan = [(x, y), (x + 1.0, y), (x + 2.0, y)]
            self.add('plan', stamp + PLANNING, path(stamp, plan))
            lines = [
                line(stamp, number, [(x, y), (x + dx, y + dy)], value)
                for number, (dx, dy, value) in enumerate(
                    [(2.0, 0.0, -3.0), (0.0, 2.0, -9.0), (-2.0, 0.0, -70.0)][: 1 + step % 3]
                )
            ]
            markers = message('visualization_msgs/msg/MarkerArray', markers=lines)
            self.add('plan_candidates', stamp + PLANNING, markers)
            shown = np.clip(values, -1, 100).astype(np.int8)
            self.add('value_map', stamp + PLANNING, grid(stamp, shown, geometry))
            simulation.step(np.array([action]))
        result = simulation.results()[0]
        self.add(
            'episode',
            stamp,
            status(
                'maze_sim',
                result.outcome,
                start,
                seed=seed,
                steps=result.steps,
                spl=result.spl,
                rows=15,
                cols=15,
                view_range=2,
            ),
        )

    def close(self) -> None:
        """Make it readable."""
        self._recorder.close()
