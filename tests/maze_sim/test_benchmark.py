"""The benchmark command, and that stepping together pays."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from gymnasium.vector import SyncVectorEnv

from maze_sim.benchmark import main, step_rate
from maze_sim.env import GridMaze2DEnv
from maze_sim.vector_env import GridMaze2DVectorEnv

if TYPE_CHECKING:
    import pytest


def test_benchmark_prints_four_rates(capsys: pytest.CaptureFixture[str]) -> None:
    """Each part has a line with its rate."""
    assert main(['--seconds', '0.05', '--num-envs', '8', '--size', '20']) == 0
    rates = re.findall(r'([\d,]+) (mazes/s|steps/s)\n', capsys.readouterr().out)
    assert [unit for _, unit in rates] == ['mazes/s', 'mazes/s', 'steps/s', 'steps/s']
    assert all(int(rate.replace(',', '')) > 0 for rate, _ in rates)


def test_array_code_is_much_faster_than_single_environments() -> None:
    """Many mazes at once are stepped at least ten times as fast as one by one."""
    alone = step_rate(SyncVectorEnv([GridMaze2DEnv]), seconds=0.3)
    together = step_rate(GridMaze2DVectorEnv(512), seconds=0.3)
    assert together > 10 * alone
