"""Nodes as processes, with small programs in their place."""

from __future__ import annotations

import os
import socket
import sys
import time
from typing import TYPE_CHECKING

import pytest

from vgdp_bringup import processes
from vgdp_bringup.processes import DOMAIN_IDS, NodeFailure, NodeProcesses, free_domain_id

if TYPE_CHECKING:
    from pathlib import Path

QUIET = """
import signal, sys
signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
print('up', flush=True)
while True: signal.pause()
"""
"""Ends with 0 when it is interrupted."""


def python(program: str) -> list[str]:
    """Return the command that runs a program."""
    return [sys.executable, '-c', program]


def wait_for(log: Path, text: str) -> None:
    """Wait until a log holds a text."""
    end = time.monotonic() + 10
    while text not in log.read_text():
        assert time.monotonic() < end
        time.sleep(0.01)


def check_until_failure(nodes: NodeProcesses) -> None:
    """Look after nodes for some seconds, as long as all goes well."""
    for _ in range(1000):
        nodes.check()
        time.sleep(0.01)


def test_nodes_get_their_parameters_and_their_domain(tmp_path: Path) -> None:
    """The command line is that of ROS, the environment keeps the run to itself."""
    program = f'import os, sys; print(sys.argv[1:], os.environ["ROS_DOMAIN_ID"]){QUIET}'
    with NodeProcesses(tmp_path / 'logs', 77) as nodes:
        nodes.start('one', python(program), {'size': 15, 'bag': tmp_path})
        log = tmp_path / 'logs' / 'one.log'
        wait_for(log, 'up')
        nodes.check()
        nodes.stop()
    arguments = ['--ros-args', '--disable-external-lib-logs', '-p', 'size:=15']
    assert log.read_text().startswith(f'{[*arguments, "-p", f"bag:={tmp_path}"]} 77\n')


def test_a_crash_is_named(tmp_path: Path) -> None:
    """With the node, what it said last, and where its log is."""
    with NodeProcesses(tmp_path, 77) as nodes:
        nodes.start('bad', python('import sys; print("No weights."); sys.exit(3)'), {})
        with pytest.raises(NodeFailure) as failure:
            check_until_failure(nodes)
    assert str(failure.value) == (
        f"bad ended by itself with exit code 3 after saying 'No weights.', see {tmp_path}/bad.log."
    )


def test_a_bad_end_is_named(tmp_path: Path) -> None:
    """A node that does not end with 0 when it is interrupted has a fault."""
    program = QUIET.replace('sys.exit(0)', 'sys.exit(5)')
    with NodeProcesses(tmp_path, 77) as nodes:
        nodes.start('bad', python(program), {})
        wait_for(tmp_path / 'bad.log', 'up')
        with pytest.raises(NodeFailure, match=r"bad stopped with exit code 5 after saying 'up'"):
            nodes.stop()


def test_a_node_that_hangs_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing outlives the run."""
    monkeypatch.setattr(processes, 'STOP_TIMEOUT_S', 0.3)
    program = QUIET.replace('sys.exit(0)', 'None')
    with NodeProcesses(tmp_path, 77) as nodes:
        nodes.start('deaf', python(program), {})
        wait_for(tmp_path / 'deaf.log', 'up')
        with pytest.raises(NodeFailure, match='deaf stopped with signal SIGKILL'):
            nodes.stop()


def test_an_error_stops_the_nodes(tmp_path: Path) -> None:
    """Also when the run ends early."""
    log = tmp_path / 'one.log'

    def run() -> None:
        with NodeProcesses(tmp_path, 77) as nodes:
            nodes.start('one', python(f'import os; print(os.getpid()){QUIET}'), {})
            wait_for(log, 'up')
            raise TimeoutError

    with pytest.raises(TimeoutError):
        run()
    pid = int(log.read_text().split()[0])
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_domain_in_use_is_not_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its discovery port is taken."""
    monkeypatch.setattr(processes, 'DOMAIN_IDS', range(90, 92))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(('', 7400 + 250 * 90))
        assert {free_domain_id() for _ in range(20)} == {91}
    assert 90 in DOMAIN_IDS
    monkeypatch.setattr(processes, 'DOMAIN_IDS', range(0))
    with pytest.raises(NodeFailure, match='in use'):
        free_domain_id()
