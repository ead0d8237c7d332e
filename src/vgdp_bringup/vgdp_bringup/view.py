"""A view of a run in the browser, from live topics or from a bag. No ROS here.

Messages are those of ROS or those that ``rosbags`` reads; their fields have the same names.
"""

from __future__ import annotations

import signal
import sys
import time
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from rich.console import Console
from rich.progress import track

from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE
from gridnav.rgbd import VIEW_SUFFIX
from vgdp_bringup.bags import LINE_STRIP, NANOSECONDS, namespaces, read_messages, stamp_of, to_grid
from vgdp_bringup.pictures import CELL_COLORS, GOAL, PATH, PLAN, ROBOT, VALUE_COLORS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

VIEWED = (
    'camera/color/image_raw',
    'camera/depth/image_raw',
    'episode',
    'goal_pose',
    'map',
    'odom',
    'plan',
    'plan_candidates',
    'points',
    'value_map',
)
"""The topics that are shown."""

HEIGHTS = {'path': 0.05, 'candidates': 0.08, 'plan': 0.12, 'robot': 0.15}
"""How far above the map things are drawn, in cells, so that they don't hide in it."""

CAMERA_PERIOD_S = 0.2
"""Images closer together than this are left out: a browser shows no more."""

DEPTH_METERS = {'16UC1': 1000.0, '32FC1': 1.0}
"""How many units of a depth image make a metre."""

COLOR_ORDERS = {'rgb8': (0, 1, 2), 'bgr8': (2, 1, 0), 'rgba8': (0, 1, 2), 'bgra8': (2, 1, 0)}


@dataclass(frozen=True)
class ViewOptions:
    """What is shown, and where.

    Attributes:
        bag: Folder of a bag; live topics if None.
        namespace: Where the robot has its topics; where the bag has one, or ``/``, if empty.
        port: Port of the page.
        data_port: Port from which the page gets what it shows.
        open_browser: Whether to open a browser.
    """

    bag: Path | None
    namespace: str
    port: int
    data_port: int
    open_browser: bool


def run(options: ViewOptions) -> int:
    """Serve the view until Ctrl-C or SIGTERM, and return the exit status.

    Raises:
        ValueError: If the viewer is not installed or the bag can't be read.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    scene = Scene()
    try:
        scene.serve(options.port, options.data_port, open_browser=options.open_browser)
        _say(
            f'Look at http://localhost:{options.port}?url=ws://localhost:{options.data_port} ; '
            'Ctrl-C ends.'
        )
        if options.bag is None:
            from vgdp_bringup.watcher import TopicListener  # noqa: PLC0415 - needs ROS

            with TopicListener(VIEWED, scene.show, options.namespace or '/') as listener:
                while True:
                    listener.spin(1.0)
        count = show_bag(scene, options.bag, options.namespace or namespaces(options.bag)[0])
        _say(f'{count} messages of {options.bag} are there.')
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        return 0


def _say(text: str) -> None:
    sys.stdout.write(f'{text}\n')
    sys.stdout.flush()


def show_bag(scene: Scene, path: Path, namespace: str) -> int:
    """Show all of a bag and return how many messages that are.

    Raises:
        BagError: If it can't be read.
    """
    messages = read_messages(path, namespace, VIEWED)
    ordered = sorted(
        (
            (received, topic, message)
            for topic in messages
            for received, message in messages[topic]
        ),
        key=lambda item: item[0],
    )
    console = Console(stderr=True)
    hidden = not console.is_terminal
    for received, topic, message in track(
        ordered, 'sending', console=console, transient=True, disable=hidden
    ):
        scene.show(topic, received, message)
    return len(ordered)


class Scene:
    """What there is to see, sent on as it comes in."""

    def __init__(self) -> None:
        """Load the viewer.

        Raises:
            ValueError: If it is not installed.
        """
        try:
            rerun = import_module('rerun')
            blueprint = import_module('rerun.blueprint')
        except ImportError as error:
            msg = f"'vgdp view' needs rerun-sdk: pip install -r requirements-view.txt ({error})."
            raise ValueError(msg) from error
        self._rerun: Any = rerun
        self._blueprint: Any = blueprint
        self._path: list[tuple[float, float]] = []
        self._path_stamp = -1
        self._cell = 1.0
        self._mapped: dict[int, int] = {}
        self._last_image: dict[str, int] = {}
        self._handlers: dict[str, Callable[[int, Any], None]] = {
            'camera/color/image_raw': self._show_color,
            'camera/depth/image_raw': self._show_depth,
            'episode': self._show_episode,
            'goal_pose': self._show_goal,
            'map': self._show_map,
            'odom': self._show_odom,
            'plan': self._show_plan,
            'plan_candidates': self._show_candidates,
            'points': self._show_points,
            'value_map': self._show_values,
        }
        rerun.init('vgdp')

    def serve(self, web_port: int, data_port: int, *, open_browser: bool) -> None:
        """Serve the page and what it shows."""
        self._rerun.serve_web(
            open_browser=open_browser,
            web_port=web_port,
            ws_port=data_port,
        )
        self._rerun.send_blueprint(self._layout())

    def show(self, topic: str, received: int, message: Any) -> None:  # noqa: ANN401 - of ROS or a bag
        """Show a message of one of the ``VIEWED`` topics that came in at ``received`` ns."""
        self._rerun.set_time_nanos('time', received)
        self._handlers[topic](received, message)

    def _layout(self) -> Any:  # noqa: ANN401 - rerun's
        b = self._blueprint
        return b.Blueprint(
            b.Horizontal(
                b.Spatial3DView(origin='/world', name='Map, plans and path'),
                b.Vertical(
                    b.Spatial2DView(origin='/value_map', name='Value map'),
                    b.Spatial2DView(origin='/camera/color', name='Camera'),
                    b.TimeSeriesView(origin='/numbers', name='Seen (%) and planning (ms)'),
                ),
                column_shares=(3, 2),
            ),
            collapse_panels=True,
        )

    def _log(self, entity: str, *what: Any) -> None:  # noqa: ANN401
        self._rerun.log(entity, *what)

    def _lines(
        self,
        entity: str,
        strips: Sequence[NDArray[np.float64]],
        colors: Sequence[Sequence[int]],
        width: float,
    ) -> None:
        height = HEIGHTS[entity.rsplit('/', 1)[-1]] * self._cell
        raised = [np.column_stack([strip, np.full(len(strip), height)]) for strip in strips]
        self._log(
            entity, self._rerun.LineStrips3D(raised, colors=colors, radii=width * self._cell)
        )

    def _show_map(self, received: int, message: Any) -> None:  # noqa: ANN401
        grid = to_grid(message)
        g = grid.geometry
        self._cell = g.resolution
        self._mapped.setdefault(stamp_of(message), received)
        unseen, free, wall = (_rgb(color) for color in CELL_COLORS)
        picture = np.empty((*grid.cells.shape, 3), dtype=np.uint8)
        picture[:] = unseen
        picture[grid.cells == FREE_VALUE] = free
        picture[grid.cells == OCCUPIED_VALUE] = wall
        left, bottom = g.origin_x, g.origin_y
        right, top = left + g.cols * g.resolution, bottom + g.rows * g.resolution
        corners = [(left, bottom, 0), (right, bottom, 0), (right, top, 0), (left, top, 0)]
        self._log(
            'world/map',
            self._rerun.Mesh3D(
                vertex_positions=corners,
                triangle_indices=[(0, 1, 2), (0, 2, 3)],
                vertex_texcoords=[(0, 0), (1, 0), (1, 1), (0, 1)],
                # Larger than one pixel a cell, as textures are smoothed.
                albedo_texture=_enlarged(picture),
            ),
        )
        seen = 100.0 * float(np.mean(grid.cells != UNKNOWN_VALUE))
        self._log('numbers/seen', self._rerun.Scalar(seen))

    def _show_values(self, _: int, message: Any) -> None:  # noqa: ANN401
        cells = to_grid(message).cells
        picture = (255 * colormaps[VALUE_COLORS](cells / 100.0)[:, :, :3]).astype(np.uint8)
        picture[cells < 0] = _rgb(CELL_COLORS[0])
        self._log('value_map', self._rerun.Image(_enlarged(np.flipud(picture))))

    def _show_odom(self, _: int, message: Any) -> None:  # noqa: ANN401
        stamp = stamp_of(message)
        if stamp <= self._path_stamp or message.child_frame_id.endswith(VIEW_SUFFIX):
            return
        self._path_stamp = stamp
        position = message.pose.pose.position
        self._path.append((position.x, position.y))
        self._lines('world/path', [np.array(self._path)], [_rgb(PATH)], 0.08)
        robot = (position.x, position.y, HEIGHTS['robot'] * self._cell)
        self._log(
            'world/robot',
            self._rerun.Points3D([robot], colors=[_rgb(ROBOT)], radii=0.3 * self._cell),
        )

    def _show_goal(self, _: int, message: Any) -> None:  # noqa: ANN401
        position = message.pose.position
        goal = (position.x, position.y, HEIGHTS['robot'] * self._cell)
        self._log(
            'world/goal',
            self._rerun.Points3D(
                [goal], colors=[_rgb(GOAL)], radii=0.35 * self._cell, labels=['goal']
            ),
        )

    def _show_plan(self, received: int, message: Any) -> None:  # noqa: ANN401
        points = [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]
        self._lines('world/plan', [np.array(points)] if points else [], [_rgb(PLAN)], 0.12)
        mapped = self._mapped.pop(stamp_of(message), None)
        if mapped is not None:
            milliseconds = 1000 * (received - mapped) / NANOSECONDS
            self._log('numbers/planning', self._rerun.Scalar(milliseconds))

    def _show_candidates(self, _: int, message: Any) -> None:  # noqa: ANN401
        lines = [marker for marker in message.markers if marker.type == LINE_STRIP]
        strips = [np.array([(point.x, point.y) for point in line.points]) for line in lines]
        colors = [
            [round(255 * share) for share in (line.color.r, line.color.g, line.color.b)]
            for line in lines
        ]
        self._lines('world/candidates', strips, colors, 0.04)

    def _show_episode(self, _: int, message: Any) -> None:  # noqa: ANN401
        if message.message == 'running':
            self._path.clear()
            self._log('world', self._rerun.Clear(recursive=True))
        self._log('episode', self._rerun.TextLog(f'{message.name}: {message.message}'))

    def _show_color(self, received: int, message: Any) -> None:  # noqa: ANN401
        order = COLOR_ORDERS.get(message.encoding)
        if order is not None and self._is_due('color', received):
            pixels = _pixels(message, np.dtype(np.uint8), len(message.encoding.rstrip('8')))
            self._log('camera/color', self._rerun.Image(pixels[:, :, order]).compress())

    def _show_depth(self, received: int, message: Any) -> None:  # noqa: ANN401
        meter = DEPTH_METERS.get(message.encoding)
        if meter is not None and self._is_due('depth', received):
            kind = np.dtype(np.uint16 if message.encoding == '16UC1' else np.float32)
            pixels = _pixels(message, kind, 1)[:, :, 0]
            self._log('camera/depth', self._rerun.DepthImage(pixels, meter=meter))

    def _is_due(self, name: str, received: int) -> bool:
        last = self._last_image.get(name, -NANOSECONDS)
        if abs(received - last) < CAMERA_PERIOD_S * NANOSECONDS:
            return False
        self._last_image[name] = received
        return True

    def _show_points(self, _: int, message: Any) -> None:  # noqa: ANN401
        offsets = {field.name: field.offset for field in message.fields}
        if not {'x', 'y', 'z'} <= offsets.keys():
            return
        names = [name for name in ('x', 'y', 'z', 'rgb') if name in offsets]
        kinds = {'rgb': '<u4'}
        layout = np.dtype(
            {
                'names': names,
                'formats': [kinds.get(name, '<f4') for name in names],
                'offsets': [offsets[name] for name in names],
                'itemsize': message.point_step,
            }
        )
        points = np.frombuffer(bytes(message.data), layout)
        positions = np.column_stack([points[axis] for axis in 'xyz'])
        colors = None
        if 'rgb' in offsets:
            packed = points['rgb']
            colors = np.column_stack([packed >> 16 & 255, packed >> 8 & 255, packed & 255])
        self._log('world/points', self._rerun.Points3D(positions, colors=colors))


def _pixels(message: Any, kind: np.dtype[Any], channels: int) -> NDArray[Any]:  # noqa: ANN401
    """Return the pixels of an image message, (H, W, channels)."""
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    used = rows[:, : message.width * channels * kind.itemsize]
    order = kind.newbyteorder('>' if message.is_bigendian else '<')
    pixels = np.ascontiguousarray(used).view(order).astype(kind)
    return pixels.reshape(message.height, message.width, channels)


def _rgb(color: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * share) for share in to_rgb(color))
    return red, green, blue


def _enlarged(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture with pixels of their own for each cell, if it is small."""
    times = max(1, 600 // max(picture.shape[:2]))
    return np.ascontiguousarray(picture.repeat(times, axis=0).repeat(times, axis=1))
