"""Timing the planner: where robots stand when they are timed, and what is printed and written."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from gridnav import FREE
from vgdp_experiments import bench_planner
from vgdp_experiments.bench_planner import STAGES, growth, half_way, lead
from vgdp_planner import ValueGuidedPlanner

if TYPE_CHECKING:
    from pathlib import Path


def test_robots_are_half_way() -> None:
    """Half of the free cells have been seen and the goal has not, or it just has."""
    for seed in range(4):
        simulation = half_way(15, 2, seed)
        share = simulation.partial_maps[0, FREE].sum() / (~simulation.mazes[0].blocked).sum()
        assert simulation.active[0]
        assert simulation.goal_seen[0] or 0.5 <= share < 0.7
        assert simulation.steps[0] > 5


def test_the_planner_leads_on() -> None:
    """Decisions come until the episode ends, each with its maps and with all stages timed."""
    planner = ValueGuidedPlanner.from_pretrained()
    simulation = half_way(15, 2, 1)
    seen = simulation.partial_maps[0, FREE].sum()
    decisions = list(lead(planner, simulation))
    assert not simulation.active[0]
    assert decisions[0].partial_maps[0, FREE].sum() == seen
    for made in decisions:
        assert made.count == 1
        assert set(made.stages) == set(STAGES)
        assert 0 < sum(made.stages.values()) <= made.seconds


def test_growth_is_the_exponent() -> None:
    """Times that grow with the area of the map have the exponent 2; one side has none."""
    assert growth([(15, 3 * 15**2), (30, 3 * 30**2), (100, 3 * 100**2)]) == pytest.approx(2)
    assert growth([(15, 40.0), (15, 41.0)]) is None


def test_tables_and_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A row for each side and number of candidates, with targets, and the same as JSON."""
    path = tmp_path / 'new' / 'bench.json'
    options = '--sides 21 15 --candidates 1 4 --decisions 2 --episodes 1 --threads 1'
    parser = argparse.ArgumentParser()
    bench_planner.add_arguments(parser)
    assert bench_planner.run(parser.parse_args([*options.split(), '--json', str(path)])) == 0
    output = capsys.readouterr().out
    for words in ('15 x 15', '21 x 21', '≤ 40', 'sampling', 'decisions a second', 'side^'):
        assert words in output
    record = json.loads(path.read_text())
    assert [row['side'] for row in record['sides']] == [15, 21]
    assert set(record['candidates']) == {'1', '4'}
    assert record['batched']['decisions_per_second'] > 0
    for row in record['sides']:
        assert sum(row['shares'].values()) == pytest.approx(1)
        assert 0 < row['median_ms'] <= row['p95_ms']
        assert row['rounds'] >= 1
    assert np.isfinite(record['exponent'])
