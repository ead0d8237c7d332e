"""The view in the browser."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
import urllib.request
from typing import TYPE_CHECKING

import pytest
from tests.vgdp_bringup.synthetic import SECOND, SyntheticBag

from vgdp_bringup.cli import main
from vgdp_bringup.topics import TOPICS
from vgdp_bringup.view import VIEWED

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def free_port() -> int:
    """Return a TCP port that nobody uses now."""
    with socket.socket() as made:
        made.bind(('localhost', 0))
        port: int = made.getsockname()[1]
        return port


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Return a process that shows a bag, and the port of its page."""
    pytest.importorskip('rerun', reason='pip install -r requirements-view.txt')
    bag = SyntheticBag(tmp_path / 'bag')
    bag.add_episode(seed=4, start=SECOND)
    bag.close()
    port = free_port()
    process = subprocess.Popen(
        [
            *(sys.executable, '-m', 'vgdp_bringup.cli', 'view', str(tmp_path / 'bag')),
            *('--no-open', '--port', str(port), '--data-port', str(free_port())),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    yield process, port
    process.kill()
    process.communicate()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_bag_is_served(viewer: tuple[subprocess.Popen[str], int], number: int) -> None:
    """The page is there, all messages are sent, and it ends quietly on a signal."""
    process, port = viewer
    assert process.stdout is not None
    assert f'http://localhost:{port}' in process.stdout.readline()
    assert 'messages of' in process.stdout.readline()
    with urllib.request.urlopen(f'http://localhost:{port}') as page:
        assert b'rerun' in page.read().lower()
    began = time.monotonic()
    process.send_signal(number)
    assert process.wait(20) == 0
    assert time.monotonic() - began < 10
    assert 'Traceback' not in process.stdout.read()


def test_without_the_viewer_it_says_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one sentence, with exit status 2."""
    monkeypatch.setitem(sys.modules, 'rerun', None)
    assert main(['view']) == 2
    assert 'pip install -r requirements-view.txt' in capsys.readouterr().err


def test_everything_shown_is_a_topic_of_the_stack() -> None:
    """And what every view has to show is among it."""
    assert set(VIEWED) <= {topic.name for topic in TOPICS}
