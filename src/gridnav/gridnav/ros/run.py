"""Start a node, spin it, and end the process well."""

from __future__ import annotations

import os
import signal
import sys
import threading
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import TracebackType
    from typing import Self

    from gridnav.ros.node import BaseNode

GRACE_S = 1.5
"""How long a callback may go on after a signal before the process ends without it."""

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def run_node(make_node: Callable[[], BaseNode[Any]], args: Sequence[str] | None = None) -> int:
    """Run a node until SIGINT or SIGTERM; call this from the main thread, once a process.

    Exceptions of callbacks are logged and the node lives on. After a signal further ones are
    ignored, as the process is about to end; within ``GRACE_S`` it does so even in mid-callback.

    Args:
        make_node: The node's class, or a function that builds it.
        args: Command line, ``sys.argv`` unless given.

    Returns:
        The exit code: 0 after a signal or shutdown, 1 if the node can't start, 2 for a command
        line that can't be used.
    """
    argv = list(sys.argv if args is None else args)
    with _ShutdownSignals() as signals:
        try:
            rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
            strangers = remove_ros_args(argv)[1:]
        except Exception as error:  # noqa: BLE001 - whatever rcl finds wrong with it
            return _refuse(f'The command line can not be used: {_first_line(error)}', 2)
        if strangers:
            rclpy.shutdown()
            return _refuse(
                f'Unknown argument {strangers[0]!r}; parameters are given as '
                '--ros-args -p name:=value.',
                2,
            )
        try:
            return _spin(make_node, signals)
        finally:
            rclpy.try_shutdown()


def _spin(make_node: Callable[[], BaseNode[Any]], signals: _ShutdownSignals) -> int:
    """Build the node and execute its callbacks until a signal comes."""
    try:
        node = make_node()
    except Exception as error:  # noqa: BLE001 - one sentence instead of a traceback
        return _refuse(f'Can not start: {_first_line(error)}', 1)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    signals.wake_up(executor)
    try:
        while not signals.requested.is_set():
            try:
                executor.spin_once()
            except ExternalShutdownException:
                break
            except Exception as error:  # noqa: BLE001 - no callback may end a node
                node.log_exception('A callback failed', error)
    finally:
        signals.wake_up(None)
        executor.shutdown()
        node.destroy_node()
    return 0


def _refuse(sentence: str, code: int) -> int:
    sys.stderr.write(f'{sentence}\n')
    return code


def _first_line(error: Exception) -> str:
    return str(error).split('\n', maxsplit=1)[0] or type(error).__name__


class _ShutdownSignals:
    """Turns SIGINT and SIGTERM into an event and wakes the executor.

    Python runs its signal handlers only between two bytecodes of the main thread, which an idle
    executor doesn't reach. So a thread listens at the wake-up file descriptor instead.
    """

    def __init__(self) -> None:
        self.requested = threading.Event()
        self._finished = threading.Event()
        self._lock = threading.Lock()
        self._executor: SingleThreadedExecutor | None = None

    def __enter__(self) -> Self:
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        self._previous = {number: signal.signal(number, _pass) for number in _SIGNALS}
        self._previous_fd = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._finished.set()
        os.write(self._writer, b'\0')
        self._thread.join()
        for number, previous in self._previous.items():
            signal.signal(number, signal.SIG_IGN if self.requested.is_set() else previous)
        signal.set_wakeup_fd(self._previous_fd)
        os.close(self._reader)
        os.close(self._writer)

    def wake_up(self, executor: SingleThreadedExecutor | None) -> None:
        """Name the executor to wake when a signal comes, or none."""
        with self._lock:
            self._executor = executor

    def _listen(self) -> None:
        while True:
            number = os.read(self._reader, 1)[0]
            if number in _SIGNALS:
                break
            if self._finished.is_set():
                return
        self.requested.set()
        with self._lock:
            if self._executor is not None:
                # A task rather than wake(): the executor only returns to its caller with work.
                self._executor.create_task(_nothing)
        if not self._finished.wait(GRACE_S):
            sys.stderr.write('A callback did not end in time, leaving without it.\n')
            sys.stderr.flush()
            os._exit(0)


def _pass(number: int, frame: object) -> None:
    """Take a signal; the listening thread acts on it."""


def _nothing() -> None:
    """Give the executor something to do."""
