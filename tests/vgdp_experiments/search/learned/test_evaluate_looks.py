"""Comparing what values of the unseen make of the same choices."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from tests.vgdp_experiments.test_commands import vgdp

from vgdp_experiments.search.learned.batches import HomeBatches
from vgdp_experiments.search.learned.demonstrations import load_homes
from vgdp_experiments.search.learned.evaluate_looks import (
    HOMES,
    MAZES,
    NEAREST,
    lost_by_looks,
    score,
)
from vgdp_experiments.search.learned.object_value import begin_value

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor


def test_the_command(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Prints a row for each who chooses, and writes them with what they were made with."""
    options = ['--homes', 'Home_102_1', '--decisions', '6', '--threads', '1', '--data', str(data)]
    files = [tmp_path / 'first.json', tmp_path / 'again.json']
    for file in files:
        assert vgdp('eval', 'looks', *options, '--json', str(file)) == 0
    table = capsys.readouterr().out
    assert all(f'| {name} |' in table for name in (NEAREST, MAZES, HOMES))
    first, again = (file.read_text() for file in files)
    assert first == again
    found = json.loads(first)
    assert found['settings']['homes'] == 'Home_102_1'
    assert all(each['mean'] >= 0 for each in found['scores'].values())
    assert len(set(found['weights'].values())) == len(found['weights']) == 2


def test_who_chooses_by_distance_alone(data: Path) -> None:
    """A value that says the same of all cells takes the nearest; one can do worse."""

    class Same(torch.nn.Module):
        seen = torch.empty(0)

        def worth_of_unseen(self, maps: Tensor) -> Tensor:
            return torch.full_like(maps[:, 0], -7.0)

    class FirstRow(Same):
        def worth_of_unseen(self, maps: Tensor) -> Tensor:
            worth = super().worth_of_unseen(maps)
            return worth - 100.0 * torch.arange(worth.shape[1])[:, None]

    values = {'same': Same(), 'first row': FirstRow(), MAZES: begin_value().eval()}
    lost = lost_by_looks(HomeBatches(load_homes(data)), values, 20, seed=0)  # type: ignore[arg-type]
    np.testing.assert_array_equal(lost['same'], lost[NEAREST])
    assert lost['first row'].mean() > lost[NEAREST].mean()
    assert all((each >= 0).all() for each in lost.values())


def test_scores() -> None:
    """The mean, its interval, and how many choices went far astray."""
    found = score(np.array([0.0, 2.0, 10.0, 0.0]))
    assert found['mean'] == 3.0
    assert found['far'] == 0.25
    assert found['interval'] == pytest.approx(1.96 * 4.1231 / 2, rel=1e-3)
