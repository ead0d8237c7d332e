"""The nodes of a run as separate processes: start them, notice a crash, stop them well."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path
    from types import TracebackType
    from typing import Self

STOP_TIMEOUT_S = 5.0
"""How long a node may take to end after SIGINT; it is killed after that."""

FIRST_PORT, PORTS_PER_DOMAIN, UNICAST_OFFSET = 7400, 250, 10
"""How DDS turns a domain id into UDP ports: of discovery, and of its first participant."""

DOMAIN_IDS = range(1, 101)
"""Those whose ports lie below the ephemeral ones of Linux, without the default 0."""


class NodeFailure(RuntimeError):  # noqa: N818 - it is the node that fails
    """A node ended that should not have; the text is one sentence that names it and its log."""


@dataclass(frozen=True)
class NodeProcess:
    """A node that was started."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path


class NodeProcesses:
    """Nodes that end with this context, the last one started first."""

    def __init__(self, logs: Path, domain_id: int) -> None:
        """Prepare to start nodes.

        Args:
            logs: Folder for the output of the nodes, one file each.
            domain_id: ``ROS_DOMAIN_ID`` of the nodes; they talk on this machine only.
        """
        self._logs = logs
        self._nodes: list[NodeProcess] = []
        self._environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(domain_id),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        }

    def __enter__(self) -> Self:
        """Make the folder for the logs."""
        self._logs.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop what still runs."""
        for node in reversed(self._nodes):
            _stop(node)

    def start(self, name: str, command: Sequence[str], parameters: Mapping[str, object]) -> None:
        """Start a node by a command in a process group of its own, with ROS parameters."""
        arguments = ['--ros-args', '--disable-external-lib-logs']
        for key, value in parameters.items():
            arguments += ['-p', f'{key}:={value}']
        path = self._logs / f'{name}.log'
        with path.open('wb') as log:
            process = subprocess.Popen(  # noqa: S603 - our own programs
                [*command, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                process_group=0,
            )
        self._nodes.append(NodeProcess(name, process, path))

    def check(self) -> None:
        """Notice a node that has ended.

        Raises:
            NodeFailure: If there is one.
        """
        for node in self._nodes:
            code = node.process.poll()
            if code is not None:
                msg = f'{node.name} ended by itself with {_describe(code, node.log)}'
                raise NodeFailure(msg)

    def stop(self) -> None:
        """Stop all nodes by SIGINT, the last one started first.

        Raises:
            NodeFailure: If one had ended before, hung, or did not end with exit code 0.
        """
        self.check()
        while self._nodes:
            node = self._nodes.pop()
            code = _stop(node)
            if code != 0:
                msg = f'{node.name} stopped with {_describe(code, node.log)}'
                raise NodeFailure(msg)


def _stop(node: NodeProcess) -> int:
    """Interrupt a node's process group, kill it if that does not help; return the exit code."""
    for number in (signal.SIGINT, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(node.process.pid, number)
        with suppress(subprocess.TimeoutExpired):
            return node.process.wait(STOP_TIMEOUT_S)
    return node.process.wait()


def _describe(code: int, log: Path) -> str:
    """Say how a process ended and what it said last."""
    how = f'exit code {code}' if code >= 0 else f'signal {signal.Signals(-code).name}'
    lines = log.read_text(errors='replace').splitlines()
    said = f' after saying {lines[-1]!r}' if lines else ''
    return f'{how}{said}, see {log}.'


def free_domain_id() -> int:
    """Return a ROS domain id that nobody on this machine uses now.

    Raises:
        NodeFailure: If all are in use.
    """
    # In random order, lest two runs that start at the same time choose the same one.
    for domain_id in random.sample(DOMAIN_IDS, len(DOMAIN_IDS)):
        first = FIRST_PORT + PORTS_PER_DOMAIN * domain_id
        with ExitStack() as stack, suppress(OSError):
            for port in (first, first + UNICAST_OFFSET):
                udp = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                udp.bind(('', port))
            return domain_id
    msg = f'All ROS domain ids from {DOMAIN_IDS.start} to {DOMAIN_IDS.stop - 1} are in use.'
    raise NodeFailure(msg)
