"""The base class of every node."""

from __future__ import annotations

import time
import traceback
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind
from std_srvs.srv import Trigger

from gridnav.ros.diagnostics import Diagnostics
from gridnav.ros.parameters import declare_parameters
from gridnav.ros.validation import InvalidMessage

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile

P = TypeVar('P')
M = TypeVar('M')

WARNING_PERIOD_S = 5.0
"""The same warning is not repeated sooner than this."""


class BaseNode(Node, Generic[P]):
    """A node that lives on whatever it receives.

    Attributes:
        parameters: The values of its parameters; changes at run time appear in it.
        diagnostics: What it publishes about itself once a second.
    """

    def __init__(self, name: str, table: type[P]) -> None:
        """Declare the parameters and start the diagnostics.

        Args:
            name: Name of the node.
            table: Dataclass of its parameters (``gridnav.ros.parameters``).

        Raises:
            ParameterError: If a parameter that was given can't be used.
        """
        super().__init__(name)
        self._warned: dict[str, float] = {}
        self.parameters = declare_parameters(self, table)
        self.diagnostics = Diagnostics(self, self.parameters)

    def subscribe(
        self,
        message_type: type[M],
        topic: str,
        callback: Callable[[M], None],
        qos: QoSProfile,
        *,
        validate: Callable[[M], None] | None = None,
        single_source: bool = True,
    ) -> None:
        """Subscribe to a topic.

        A message that ``validate`` or the callback refuses by ``InvalidMessage`` is counted and
        named in a warning; any other exception is logged as an error. The node lives on.

        Args:
            message_type: Type of the messages.
            topic: Relative name of the topic.
            callback: Called with each valid message.
            qos: A profile of ``gridnav.ros.qos``.
            validate: Raises ``InvalidMessage`` for what must not reach the callback.
            single_source: Whether to warn when there is more than one publisher.
        """
        full_name = self.resolve_topic_name(topic)

        def receive(message: M) -> None:
            self.diagnostics.received(topic)
            try:
                if validate is not None:
                    validate(message)
                callback(message)
            except InvalidMessage as error:
                self.diagnostics.count(f'refused: {topic}')
                self.warn(f'refused {topic}', f'Refused a message on {full_name}: {error}')
            except Exception as error:  # noqa: BLE001 - no message may end a node
                self.diagnostics.count(f'failed: {topic}')
                self.log_exception(f'A message on {full_name} could not be used', error)

        def matched(status: Any) -> None:  # noqa: ANN401 - a type of rclpy's C++ part
            if status.current_count > 1:
                self.warn(
                    f'sources of {topic}',
                    f'{full_name} has {status.current_count} publishers, one is expected (one '
                    f'that was killed counts for some seconds).',
                )

        def incompatible(status: Any) -> None:  # noqa: ANN401 - a type of rclpy's C++ part
            self._warn_incompatible(topic, full_name, 'publisher', status)

        events = SubscriptionEventCallbacks(
            matched=matched if single_source else None, incompatible_qos=incompatible
        )
        self.create_subscription(message_type, topic, receive, qos, event_callbacks=events)

    def advertise(self, message_type: type[Any], topic: str, qos: QoSProfile) -> Publisher:
        """Create a publisher that warns of subscribers that its QoS can't serve."""
        full_name = self.resolve_topic_name(topic)

        def incompatible(status: Any) -> None:  # noqa: ANN401 - a type of rclpy's C++ part
            self._warn_incompatible(topic, full_name, 'subscriber', status)

        events = PublisherEventCallbacks(incompatible_qos=incompatible)
        return self.create_publisher(message_type, topic, qos, event_callbacks=events)

    def provide_reset(self, reset: Callable[[], str]) -> None:
        """Offer the service ``~/reset``.

        Args:
            reset: Does it and returns one sentence that says what it did.
        """

        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message = reset()
                response.success = True
            except Exception as error:  # noqa: BLE001 - the caller gets the reason
                self.log_exception('The reset failed', error)
                response.message = str(error)
                response.success = False
            return response

        self.create_service(Trigger, '~/reset', serve)

    def warn(self, key: str, sentence: str) -> None:
        """Log a warning, unless one with the same key was logged within five seconds."""
        now = time.monotonic()
        if now - self._warned.get(key, -WARNING_PERIOD_S) >= WARNING_PERIOD_S:
            self._warned[key] = now
            self.get_logger().warning(sentence)

    def log_exception(self, what: str, error: BaseException) -> None:
        """Log an error as one sentence; the traceback goes to the debug log."""
        self.get_logger().error(f'{what}: {type(error).__name__}: {error}')
        self.get_logger().debug(''.join(traceback.format_exception(error)))

    def _warn_incompatible(self, topic: str, full_name: str, who: str, status: Any) -> None:  # noqa: ANN401
        self.diagnostics.count(f'incompatible QoS: {topic}')
        policy = qos_policy_name_from_kind(status.last_policy_kind)
        self.warn(
            f'qos of {topic}',
            f'A {who} of {full_name} has an incompatible QoS ({policy}), nothing gets through.',
        )
