"""The README says what the code does."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')


def test_tables_are_up_to_date() -> None:
    """The tables of topics, parameters and results are those that the code writes."""
    script = runpy.run_path(str(ROOT / 'scripts' / 'write_readme.py'))
    assert script['render'](README) == README, 'run scripts/write_readme.py'


def test_python_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """The Python example runs as it stands and reaches the goal."""
    [example] = re.findall(r'```python\n(.*?)```', README, flags=re.DOTALL)
    exec(compile(example, 'README.md', 'exec'), {})  # noqa: S102 - our own example
    assert "outcome=<Outcome.SUCCESS: 'success'>" in capsys.readouterr().out


def test_commands_exist() -> None:
    """Every `vgdp` command of the README is one that the program knows, with its options."""
    from vgdp_bringup.cli import main  # noqa: PLC0415

    commands = set(re.findall(r'^vgdp ((?:[a-z]+ ?){2})', README, flags=re.MULTILINE))
    assert len(commands) >= 5
    for command in commands:
        with pytest.raises(SystemExit) as ended:
            main([*command.split(), '--help'])
        assert ended.value.code == 0, command


def test_linked_files_exist() -> None:
    """Every relative link leads to a file."""
    links = re.findall(r'\]\(([^)#:]+)\)', README)
    assert links
    for link in links:
        assert (ROOT / link).exists(), link
