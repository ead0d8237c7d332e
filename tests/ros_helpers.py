"""Run nodes as processes and talk to them."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING, Any, Protocol

import rclpy
from rclpy.executors import SingleThreadedExecutor

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

TIMEOUT_S = 15.0

OUTPUT_TIMEOUT_S = 60.0
"""Importing PyTorch takes long on a busy machine."""

_probes = itertools.count()


def wait_for(condition: Callable[[], object], timeout: float = TIMEOUT_S) -> None:
    """Wait until a condition holds.

    Raises:
        TimeoutError: If it doesn't in time.
    """
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            msg = f'This did not come true within {timeout} s.'
            raise TimeoutError(msg)
        time.sleep(0.005)


class StartNode(Protocol):
    """What the fixture ``node_process`` gives."""

    def __call__(self, module: str, parameters: dict[str, object] | None = None) -> NodeProcess:
        """Start a node."""


class NodeProcess:
    """A node as a process of its own."""

    def __init__(
        self, module: str, parameters: Mapping[str, object], namespace: str, log: Path
    ) -> None:
        """Start it.

        Args:
            module: What ``python -m`` runs, or the path of a file.
            parameters: Its parameters, as ``-p name:=value``.
            namespace: Its ROS namespace.
            log: Where its output goes.
        """
        self._log = log
        target = [module] if module.endswith('.py') else ['-m', module]
        arguments = ['--ros-args', '-r', f'__ns:={namespace}']
        for name, value in parameters.items():
            arguments += ['-p', f'{name}:={value}']
        with log.open('w') as file:
            self.process = subprocess.Popen(
                [sys.executable, *target, *arguments], stdout=file, stderr=file
            )

    @property
    def output(self) -> str:
        """What it wrote so far."""
        return self._log.read_text()

    def wait_output(self, text: str) -> None:
        """Wait until it has written a text."""
        try:
            wait_for(
                lambda: text in self.output or self.process.poll() is not None, OUTPUT_TIMEOUT_S
            )
        finally:
            assert text in self.output, self.output

    def assert_alive(self) -> None:
        """Check that it runs and has raised nothing."""
        assert self.process.poll() is None, self.output
        assert 'Traceback' not in self.output, self.output

    def end(self, number: int = signal.SIGTERM) -> float:
        """Send a signal, check that it ends quietly with code 0, and return how long that took."""
        before = self.output
        began = time.monotonic()
        self.process.send_signal(number)
        code = self.process.wait(TIMEOUT_S)
        elapsed = time.monotonic() - began
        assert code == 0, self.output
        assert 'Traceback' not in self.output, self.output
        assert 'rror' not in self.output.removeprefix(before), self.output
        return elapsed

    def kill(self) -> None:
        """Kill it as ``kill -9`` does, if it still runs."""
        if self.process.poll() is None:
            os.kill(self.process.pid, signal.SIGKILL)
            self.process.wait()


class Probe:
    """A node on a background thread that sends and records messages."""

    def __init__(self, namespace: str) -> None:
        """Start it in a namespace."""
        self.node = rclpy.create_node(f'probe_{next(_probes)}', namespace=namespace)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self) -> None:
        while not self._closing.is_set():
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        """End it."""
        self._closing.set()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()

    def record(self, message_type: type[Any], topic: str, qos: object) -> list[Any]:
        """Subscribe and return the list that the messages are appended to."""
        messages: list[Any] = []
        self.node.create_subscription(message_type, topic, messages.append, qos)
        return messages

    def publisher(self, message_type: type[Any], topic: str, qos: object) -> Any:  # noqa: ANN401
        """Make a publisher and wait until somebody listens to it."""
        publisher = self.node.create_publisher(message_type, topic, qos)
        wait_for(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def call(self, service_type: type[Any], name: str, request: object) -> Any:  # noqa: ANN401
        """Call a service and return its response."""
        client = self.node.create_client(service_type, name)
        wait_for(client.service_is_ready)
        future = client.call_async(request)
        wait_for(future.done)
        self.node.destroy_client(client)
        return future.result()
