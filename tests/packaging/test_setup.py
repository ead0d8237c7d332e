"""What ``make setup`` says where it can't go on."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]


def program(folder: Path, name: str, body: str) -> Path:
    """Write a shell script that stands in for a program."""
    path = folder / name
    path.write_text(f'#!/bin/sh\n{body}\n')
    path.chmod(0o755)
    return path


def setup(tmp_path: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the script in an empty tree, with the programs of ``tmp_path`` before all others."""
    scripts = tmp_path / 'tree' / 'scripts'
    scripts.mkdir(parents=True)
    script = scripts / 'setup.sh'
    script.write_bytes((ROOT / 'scripts' / 'setup.sh').read_bytes())
    path = f'{tmp_path}:{os.environ["PATH"]}'
    inherited = {key: value for key, value in os.environ.items() if key != 'ROS_DISTRO'}
    return subprocess.run(
        ['bash', str(script), '.venv/.ready'],  # noqa: S607 - any bash
        env={**inherited, 'PATH': path, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def assert_one_sentence(result: subprocess.CompletedProcess[str], *words: str) -> None:
    """Check that a run failed with one line that has the words in it."""
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert result.stdout == ''
    assert all(word in result.stderr for word in words), result.stderr


def test_another_ros_is_refused(tmp_path: Path) -> None:
    """A sourced ROS that is not Jazzy would shadow the wheels."""
    assert_one_sentence(setup(tmp_path, ROS_DISTRO='humble'), "'humble'", 'jazzy')


def test_an_old_python_is_refused(tmp_path: Path) -> None:
    """Python 3.11 is needed; the sentence names what was found and the way out."""
    python = program(tmp_path, 'old', '[ "$1" = -V ] && echo Python 3.9.2; exit 1')
    assert_one_sentence(setup(tmp_path, PYTHON=str(python)), '3.11', 'Python 3.9.2', 'PYTHON=')


def test_a_missing_system_package_is_named(tmp_path: Path) -> None:
    """Who may not install it is told the command that does."""
    python = program(tmp_path, 'new', 'case "$2" in *ensurepip*) exit 1;; esac')
    program(tmp_path, 'id', 'echo 1000')
    program(tmp_path, 'sudo', 'exit 1')
    result = setup(tmp_path, PYTHON=str(python))
    assert_one_sentence(result, "'sudo apt-get install python3-venv'")


def test_a_missing_system_package_is_installed_by_root(tmp_path: Path) -> None:
    """Who may install it gets it, and the run goes on."""
    done = tmp_path / 'installed'
    python = program(
        tmp_path,
        'new',
        f'case "$2" in *ensurepip*) [ -e {done} ];; venv) echo venv; exit 7;; esac',
    )
    program(tmp_path, 'id', 'echo 0')
    program(tmp_path, 'apt-get', f'case "$*" in *install*python3-venv*) touch {done};; esac')
    result = setup(tmp_path, PYTHON=str(python))
    assert result.returncode == 7, result.stderr
    assert done.exists()
    assert result.stdout.splitlines()[-1] == 'venv'
