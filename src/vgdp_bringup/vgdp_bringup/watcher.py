"""Follow a run over ROS, for the live views."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from gridnav.rgbd import VIEW_SUFFIX
from gridnav.ros.conversions import from_occupancy_grid, to_nanoseconds
from gridnav.ros.episode import EpisodeStatus
from vgdp_bringup.bags import WORLDS
from vgdp_bringup.node import message_class, qos_of
from vgdp_bringup.progress import Progress
from vgdp_bringup.topics import TOPICS

if TYPE_CHECKING:
    from collections.abc import Callable, Collection
    from types import TracebackType
    from typing import Self

    from diagnostic_msgs.msg import DiagnosticStatus
    from geometry_msgs.msg import PoseStamped
    from nav_msgs.msg import OccupancyGrid, Odometry, Path
    from visualization_msgs.msg import MarkerArray


class TopicListener:
    """Hands on the messages of some topics of the stack, in a ROS context of its own."""

    def __init__(
        self,
        topics: Collection[str],
        receive: Callable[[str, int, Any], None],
        namespace: str = '/',
        domain_id: int | None = None,
    ) -> None:
        """Prepare to listen.

        Args:
            topics: Their names, as in ``TOPICS``.
            receive: Called with the name, the time of arrival in nanoseconds and the message.
            namespace: Where the robot has its topics.
            domain_id: ROS domain; that of the environment if None.
        """
        self._topics, self._receive = topics, receive
        self._namespace, self._domain_id = namespace, domain_id
        self._context = Context()

    def __enter__(self) -> Self:
        """Subscribe."""
        rclpy.init(
            args=[],
            context=self._context,
            domain_id=self._domain_id,
            # Ctrl-C belongs to the program, which may have more to end.
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self._node = rclpy.create_node(
            'topic_listener', namespace=self._namespace, context=self._context
        )
        for topic in TOPICS:
            if topic.name in self._topics:
                self._node.create_subscription(
                    message_class(topic),
                    topic.name,
                    partial(self._hand_on, topic.name),
                    qos_of(topic),
                )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Take in messages for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def node_names(self) -> set[str]:
        """Return the names of the nodes that have been discovered."""
        return set(self._node.get_node_names())

    def _hand_on(self, name: str, message: Any) -> None:  # noqa: ANN401 - any message
        self._receive(name, time.time_ns(), message)


class RunWatcher(TopicListener):
    """Keeps a ``Progress`` up to date from the topics."""

    def __init__(self, domain_id: int) -> None:
        """Prepare to watch a ROS domain."""
        self.progress = Progress()
        self._odom_stamp = -1
        self._map_received: dict[int, float] = {}
        callbacks: dict[str, Callable[[Any], None]] = {
            'odom': self._on_odom,
            'map': self._on_map,
            'goal_pose': self._on_goal,
            'plan': self._on_plan,
            'plan_candidates': self._on_candidates,
            'episode': self._on_episode,
        }
        super().__init__(
            callbacks, lambda name, _, message: callbacks[name](message), domain_id=domain_id
        )

    def _on_odom(self, message: Odometry) -> None:
        stamp = to_nanoseconds(message.header.stamp)
        if stamp > self._odom_stamp and not message.child_frame_id.endswith(VIEW_SUFFIX):
            self._odom_stamp = stamp
            position = message.pose.pose.position
            self.progress.path.append((position.x, position.y))

    def _on_map(self, message: OccupancyGrid) -> None:
        self._map_received.setdefault(to_nanoseconds(message.header.stamp), time.perf_counter())
        self.progress.occupancy, self.progress.geometry = from_occupancy_grid(message)

    def _on_goal(self, message: PoseStamped) -> None:
        self.progress.goal = (message.pose.position.x, message.pose.position.y)

    def _on_plan(self, message: Path) -> None:
        received = self._map_received.get(to_nanoseconds(message.header.stamp))
        if received is not None:
            self.progress.latencies.append(time.perf_counter() - received)
        self.progress.plan = [
            (pose.pose.position.x, pose.pose.position.y) for pose in message.poses
        ]

    def _on_candidates(self, message: MarkerArray) -> None:
        """Find the score of the chosen plan: it is the candidate with the same points."""
        for marker in message.markers:
            points = [(point.x, point.y) for point in marker.points]
            if marker.text and points == self.progress.plan:
                self.progress.value = float(marker.text)

    def _on_episode(self, message: DiagnosticStatus) -> None:
        status = EpisodeStatus.from_message(message)
        if status.source in WORLDS:
            self.progress.outcome = status.message
            self.progress.episode = status.values
