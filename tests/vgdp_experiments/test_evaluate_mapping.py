"""Maps against true plans: which cells count, and for what."""

from __future__ import annotations

import argparse
import json
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest

from avd_player.homes.home import FREE, OCCUPIED, OUTSIDE, TruePlan
from avd_player.homes.plan import draw_home
from bev_mapper.rgbd_mapper import MapperConfig
from bev_mapper.room import render, walk
from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE
from gridnav.rgbd import Camera
from vgdp_experiments import evaluate_mapping
from vgdp_experiments.evaluate_mapping import Seen, counts, summary, truth_of

if TYPE_CHECKING:
    from pathlib import Path


def test_a_true_cell_is_occupied_where_any_of_it_is() -> None:
    """Two by two cells of the plan make one; what is partly outside does not count."""
    cells = np.full((4, 5), FREE, np.uint8)
    cells[0, 0] = OCCUPIED
    cells[3, 2] = OUTSIDE
    truth = truth_of(TruePlan(cells, -0.6, 1.2, 0.05))
    assert truth.cells.tolist() == [[OCCUPIED, FREE, OUTSIDE], [FREE, OUTSIDE, OUTSIDE]]
    assert (truth.geometry.origin_x, truth.geometry.origin_y) == (-0.6, 1.2)
    assert truth.geometry.resolution == pytest.approx(0.1)


def test_cells_that_count_are_compared() -> None:
    """A seen cell that the map does not know is a miss; one that was not seen plays no part."""
    truth = np.array([[OCCUPIED, OCCUPIED, FREE, FREE, FREE, OUTSIDE]], np.uint8)
    known = [OCCUPIED_VALUE, FREE_VALUE, FREE_VALUE, UNKNOWN_VALUE, OCCUPIED_VALUE, FREE_VALUE]
    occupancy = np.array([known], np.int8)
    everything = np.ones(truth.shape, np.bool_)
    assert counts(occupancy, truth, everything) == [[1, 3], [1, 4]]
    seen = everything.copy()
    seen[0, [1, 3]] = False
    assert counts(occupancy, truth, seen) == [[1, 2], [1, 2]]


def test_the_mean_is_over_homes() -> None:
    """Each home counts the same, whatever its size."""
    found = summary([[[1, 2], [10, 10]], [[100, 100], [0, 10]]])
    assert found['occupied'][0] == pytest.approx(0.75)
    assert found['free'][0] == pytest.approx(0.5)
    assert found['occupied'][1] == pytest.approx(0.5)
    assert found['occupied'][2] == pytest.approx(1.0)


def test_a_cell_is_seen_where_points_are() -> None:
    """Cells ahead of the camera are seen, those behind it and behind walls are not."""
    camera = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
    frame = render(camera, walk(0, 8))
    truth = truth_of(TruePlan(np.full((160, 160), FREE, np.uint8), -4.0, -4.0, 0.05))
    seen = Seen(truth.geometry, MapperConfig())
    seen.add(frame)
    cells = seen.cells()
    ahead = truth.geometry.cell_at(1.2, 0.0)
    assert cells[ahead[0] - 1 : ahead[0] + 2, ahead[1] - 1 : ahead[1] + 2].any()
    assert not cells[truth.geometry.cell_at(-1.5, 0.0)]
    assert not cells[:, truth.geometry.cell_at(3.3, 0.0)[1]].any()


def test_a_home_is_mapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With true labels and without noise, a map of a few looks is mostly right."""
    pytest.importorskip('open3d', exc_type=ImportError)
    monkeypatch.setattr(evaluate_mapping, 'SEGMENTERS', ('ground_truth',))
    monkeypatch.setattr(evaluate_mapping, 'SIGMAS_MM', (0.0,))
    monkeypatch.setattr(evaluate_mapping, 'draw_home', partial(draw_home, positions=120))
    small = evaluate_mapping.MappingEvaluation(stops=4, headings=6, width=160, height=120)
    found = evaluate_mapping.map_home((small, 1))
    (free, either), (occupied, both) = found['ground_truth']['0']
    assert free > 0.75 * either
    assert occupied > 0.75 * both
    # The command writes what it found, and draws it.
    scores = {'ground_truth': {'0': summary([found['ground_truth']['0']])}}
    evaluate_mapping.draw(scores).savefig(tmp_path / 'curve.png')
    assert (tmp_path / 'curve.png').stat().st_size > 1000
    assert 'ground_truth | occupied' in evaluate_mapping.table(scores)
    json.dumps(scores)


def test_settings_out_of_range_are_refused() -> None:
    """In one sentence that names the option."""
    parser = argparse.ArgumentParser()
    evaluate_mapping.add_arguments(parser)
    with pytest.raises(ValueError, match='--stops must be at least 1, got 0'):
        evaluate_mapping.run(parser.parse_args(['--stops', '0']))
