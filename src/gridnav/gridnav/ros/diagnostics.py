"""How a node is doing, once a second on ``/diagnostics``."""

from __future__ import annotations

import json
import time
from collections import Counter, deque
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from gridnav.ros.qos import RELIABLE_QOS

if TYPE_CHECKING:
    from rclpy.node import Node

PERIOD_S = 1.0
LATENCIES_KEPT = 256
"""The percentiles are those of this many last measurements."""

PARAMETERS = 'parameters'
"""Key of the node's parameters, as JSON: whoever records the diagnostics has them, too."""


class Diagnostics:
    """Counters, ages and latencies of one node, published once a second.

    The topic name is absolute: tools look for ``/diagnostics`` whatever the namespace; the status
    carries the full name of the node.
    """

    def __init__(self, node: Node, parameters: object = None) -> None:
        """Start publishing for a node.

        Args:
            node: The node.
            parameters: What holds its parameters (``gridnav.ros.parameters``); None for none.
        """
        self._node = node
        self._parameters = parameters
        self._level: bytes = DiagnosticStatus.OK
        self._message = 'running'
        self._counts: Counter[str] = Counter()
        self._values: dict[str, str] = {}
        self._latencies: dict[str, deque[float]] = {}
        self._received: dict[str, int] = {}
        self._received_before: dict[str, int] = {}
        self._last_received: dict[str, float] = {}
        self._published = time.monotonic()
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE_QOS)
        node.create_timer(PERIOD_S, self.publish)

    def count(self, key: str) -> None:
        """Count one more of something, such as ``'dropped: old local_map'``."""
        self._counts[key] += 1

    def received(self, topic: str) -> None:
        """Note that a message came in on a topic."""
        self._received[topic] = self._received.get(topic, 0) + 1
        self._last_received[topic] = time.monotonic()

    def latency(self, seconds: float, name: str = 'latency') -> None:
        """Note how long something took."""
        self._latencies.setdefault(name, deque(maxlen=LATENCIES_KEPT)).append(seconds)

    def value(self, key: str, value: object) -> None:
        """Show a value until it is set again."""
        self._values[key] = str(value)

    def report(self, level: bytes, message: str) -> None:
        """Set level (``DiagnosticStatus.OK``, ``WARN``, ``ERROR``) and message until set again."""
        self._level, self._message = level, message

    def status(self) -> DiagnosticStatus:
        """Build the status as of now."""
        now = time.monotonic()
        elapsed = max(now - self._published, 1e-3)
        values = dict(self._values)
        for topic, count in self._received.items():
            fresh = count - self._received_before.get(topic, 0)
            values[f'{topic}: received'] = str(count)
            values[f'{topic}: rate (Hz)'] = f'{fresh / elapsed:.1f}'
            values[f'{topic}: age (s)'] = f'{now - self._last_received[topic]:.3f}'
        for name, seconds in self._latencies.items():
            median, p95 = np.percentile(list(seconds), [50, 95])
            values[f'{name}: p50 (ms)'] = f'{1000 * median:.3f}'
            values[f'{name}: p95 (ms)'] = f'{1000 * p95:.3f}'
        values.update({key: str(count) for key, count in self._counts.items()})
        if self._parameters is not None:
            values[PARAMETERS] = json.dumps(vars(self._parameters))
        return DiagnosticStatus(
            level=self._level,
            name=self._node.get_fully_qualified_name(),
            message=self._message,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    def publish(self) -> None:
        """Publish the status; the node's timer calls this."""
        message = DiagnosticArray(status=[self.status()])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
        self._received_before = dict(self._received)
        self._published = time.monotonic()
