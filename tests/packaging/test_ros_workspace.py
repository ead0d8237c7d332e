"""The stack as colcon builds it: the whole loop from the executables in ``install``."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from gridnav.metrics import Outcome
from vgdp_bringup.bags import read_episodes
from vgdp_bringup.processes import NodeProcesses, free_domain_id
from vgdp_bringup.watcher import RunWatcher

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).parents[2]
EXECUTABLES = {
    'recorder': ('vgdp_bringup', 'recorder_node'),
    'bev_mapper': ('bev_mapper', 'bev_mapper_node'),
    'vgdp_planner': ('vgdp_planner', 'planner_node'),
    'maze_sim': ('maze_sim', 'maze_sim_node'),
}
PACKAGES = sorted(path.parent.name for path in ROOT.glob('src/*/package.xml'))


@pytest.fixture(scope='module')
def install(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the workspace and return its ``install`` folder."""
    folder = tmp_path_factory.mktemp('workspace')
    subprocess.run(
        [ROOT / 'scripts' / 'build_workspace.sh', folder], check=True, capture_output=True
    )
    return folder / 'install'


@pytest.fixture
def sourced(install: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the environment that ``source install/setup.bash`` makes."""
    output = subprocess.run(
        ['bash', '-c', 'source "$0"/setup.bash && env -0', install],  # noqa: S607 - any bash
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    for line in output.split('\0')[:-1]:
        name, value = line.split('=', maxsplit=1)
        if os.environ.get(name) != value:
            monkeypatch.setenv(name, value)


def command(install: Path, package: str, executable: str) -> list[str]:
    """Return the command that ``ros2 run`` would run."""
    return [str(install / package / 'lib' / package / executable)]


@pytest.mark.parametrize('package', PACKAGES)
def test_ament_finds_each_package(install: Path, package: str) -> None:
    """Marker and manifest are where ``ros2 pkg`` and ``ros2 run`` look."""
    share = install / package / 'share'
    assert (share / 'ament_index' / 'resource_index' / 'packages' / package).is_file()
    assert (share / package / 'package.xml').is_file()


def test_share_holds_what_is_launched(install: Path) -> None:
    """Launch file, view and parameters are installed."""
    share = install / 'vgdp_bringup' / 'share' / 'vgdp_bringup'
    for name in ('launch/maze.launch.py', 'rviz/maze.rviz', 'config/maze.yaml'):
        assert (share / name).is_file()


@pytest.mark.usefixtures('sourced')
def test_an_episode_from_the_executables(install: Path, tmp_path: Path) -> None:
    """Simulator, mapper, planner and recorder find the goal together."""
    bag = tmp_path / 'bag'
    parameters: dict[str, dict[str, object]] = {
        'recorder': {'bag': bag},
        'vgdp_planner': {'seed': 3},
        'maze_sim': {'size': 15, 'seed': 3},
    }
    domain_id = free_domain_id()
    with NodeProcesses(tmp_path / 'logs', domain_id) as nodes, RunWatcher(domain_id) as watcher:
        for name, executable in EXECUTABLES.items():
            nodes.start(name, command(install, *executable), parameters.get(name, {}))
        while watcher.progress.outcome in ('', Outcome.RUNNING):
            watcher.spin(0.1)
            nodes.check()
        watcher.spin(1.0)
        nodes.stop()
    assert watcher.progress.outcome == Outcome.SUCCESS
    (episode,) = read_episodes(bag)
    assert episode.outcome is Outcome.SUCCESS


@pytest.mark.usefixtures('sourced')
@pytest.mark.parametrize('arguments', [['--version'], ['info']])
def test_the_command_runs_from_the_workspace(install: Path, arguments: Sequence[str]) -> None:
    """And what it imports comes from the workspace, the weights too."""
    vgdp = command(install, 'vgdp_bringup', 'vgdp')
    result = subprocess.run([*vgdp, *arguments], check=True, capture_output=True, text=True)
    if 'info' in arguments:
        assert f'{install}/vgdp_planner/lib/' in result.stdout
        assert 'sha256' in result.stdout
