"""The command ``vgdp``."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from vgdp_bringup.cli import main

VGDP = Path(sys.executable).with_name('vgdp')


def test_the_command_is_installed() -> None:
    """It stands beside the interpreter and knows its version."""
    result = subprocess.run([VGDP, '--version'], capture_output=True, text=True, check=True)
    assert result.stdout == f'{version("vgdp_bringup")}\n'


def test_nothing_heavy_is_loaded_to_print_the_help() -> None:
    """The help comes at once: neither PyTorch nor ROS nor matplotlib is needed for it."""
    program = (
        'import sys\n'
        'from vgdp_bringup.cli import main\n'
        'try: main(["--help"])\n'
        'except SystemExit: pass\n'
        'print([name for name in ("torch", "rclpy", "matplotlib") if name in sys.modules])'
    )
    result = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, check=True
    )
    assert result.stdout.splitlines()[-1] == '[]'
    for command in ('info', 'demo', 'bag', 'view', 'train', 'eval', 'bench'):
        assert f'    {command}' in result.stdout


def test_the_demo_says_its_options(capsys: pytest.CaptureFixture[str]) -> None:
    """Each with its default."""
    with pytest.raises(SystemExit) as end:
        main(['demo', '--help'])
    assert end.value.code == 0
    output = ' '.join(capsys.readouterr().out.split())
    for option, default in (('--size', '15'), ('--rate', '10.0'), ('--out', 'out/demo')):
        assert option in output
        assert f'(default: {default})' in output


def test_info(capsys: pytest.CaptureFixture[str]) -> None:
    """It names what a bug report needs."""
    assert main(['info']) == 0
    output = capsys.readouterr().out
    sections = [line for line in output.splitlines() if not line.startswith(' ')]
    assert sections == [
        'packages',
        'system',
        'ros',
        'torch',
        'libraries',
        'weights',
        'environment',
        'topics',
    ]
    lines = {tuple(line.split()[:2]) for line in output.splitlines()}
    assert ('vgdp_planner', version('vgdp_planner')) in lines
    assert ('numpy', version('numpy')) in lines
    assert ('map', 'nav_msgs/msg/OccupancyGrid,') in lines
    assert 'not installed' not in output


def test_info_of_the_weights(capsys: pytest.CaptureFixture[str]) -> None:
    """Folder, size and hash of the shipped weights are those of the file."""
    import hashlib  # noqa: PLC0415

    from vgdp_planner.weights import MODEL_FILE, SHIPPED  # noqa: PLC0415

    main(['info'])
    output = capsys.readouterr().out
    data = (SHIPPED / MODEL_FILE).read_bytes()
    assert str(SHIPPED) in output
    assert hashlib.sha256(data).hexdigest() in output
