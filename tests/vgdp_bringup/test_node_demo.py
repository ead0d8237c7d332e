"""The demo as a user starts it."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from PIL import Image

from gridnav.metrics import Outcome
from vgdp_bringup.bags import read_episodes
from vgdp_bringup.replay import replay_map, replay_plan

if TYPE_CHECKING:
    from collections.abc import Iterator

VGDP = Path(sys.executable).with_name('vgdp')
NODES = ('recorder', 'bev_mapper', 'vgdp_planner', 'maze_sim')


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[list[str]]:
    """Return the demo's command, and check afterwards that none of its nodes lives on."""
    yield [str(VGDP), 'demo', '--out', str(tmp_path / 'out')]
    left = [
        path.parent.name
        for path in Path('/proc').glob('[0-9]*/environ')
        if str(tmp_path) in _read(path.with_name('cmdline'))
    ]
    assert left == []


def _read(path: Path) -> str:
    try:
        return path.read_text(errors='replace')
    except OSError:
        return ''


def test_the_demo(demo: list[str], tmp_path: Path) -> None:
    """Exit code 0, one line that sums it up, and a bag and pictures that say the same."""
    result = subprocess.run(
        [*demo, '--rate', '0'], capture_output=True, text=True, check=False, timeout=110
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stderr == ''
    out = tmp_path / 'out'
    bag, report, gif, still = result.stdout.splitlines()[-5:-1]
    assert bag.split() == ['bag', str(out / 'bag')]
    assert report.split() == ['report', str(out / 'report.html')]
    assert gif.split() == ['movie', str(out / 'run.gif')]
    assert still.split() == ['still', str(out / 'still.png')]
    (episode,) = read_episodes(out / 'bag')
    assert episode.outcome is Outcome.SUCCESS
    steps, spl = episode.values['steps'], float(episode.values['spl'])
    assert re.fullmatch(
        rf'success after {steps} steps, SPL {spl:.2f}, median planning latency \d+ ms',
        result.stdout.splitlines()[-1],
    )
    assert len(episode.steps) == int(steps) + 1
    with Image.open(out / 'run.gif') as image:
        assert getattr(image, 'n_frames', 0) == len(episode.steps)
    # What the nodes made online comes out of the bag again.
    for comparison in (replay_map(out / 'bag', '/'), replay_plan(out / 'bag', '/')):
        assert comparison.compared > 10
        assert comparison.differences == []
    said = json.loads((out / 'report.json').read_text())
    (figures,) = said['bags'][0]['episodes']
    assert (figures['outcome'], figures['steps']) == ('success', int(steps))
    # The planner counts once a second, the last plans may come after that.
    assert 0 < sum(figures['sources'].values()) <= len(figures['plans'])
    for name in NODES:
        assert 'Traceback' not in (out / 'logs' / f'{name}.log').read_text()


def test_a_node_that_refuses_to_start_is_named(demo: list[str]) -> None:
    """With what it said, in one sentence."""
    result = subprocess.run(
        [*demo, '--size', '5'], capture_output=True, text=True, check=False, timeout=110
    )
    assert result.returncode == 1
    assert 'Traceback' not in result.stdout + result.stderr
    last = result.stdout.splitlines()[-1]
    assert last.startswith('The demo failed: maze_sim ended by itself with exit code 1')
    assert "Parameter 'size' must be" in last


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_the_demo_can_be_stopped(demo: list[str], tmp_path: Path, number: int) -> None:
    """The nodes end, the bag is readable, and the exit code says that it was stopped."""
    process = subprocess.Popen(
        [*demo, '--rate', '1'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    log = tmp_path / 'out' / 'logs' / 'maze_sim.log'
    end = time.monotonic() + 60
    while not (log.exists() and 'Episode with seed' in log.read_text()):
        assert time.monotonic() < end
        time.sleep(0.05)
    time.sleep(1.0)
    os.kill(process.pid, number)
    output, _ = process.communicate(timeout=20)
    assert process.returncode == 130, output
    assert output.splitlines()[-1] == 'Stopped before the end.'
    (episode,) = read_episodes(tmp_path / 'out' / 'bag')
    assert episode.outcome is Outcome.RUNNING


@pytest.mark.slow
@pytest.mark.timeout(1500)
@pytest.mark.parametrize('seed', range(20))
def test_the_demo_succeeds_for_many_seeds(demo: list[str], seed: int) -> None:
    """20 of 20."""
    result = subprocess.run(
        [*demo, '--rate', '0', '--seed', str(seed)], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
