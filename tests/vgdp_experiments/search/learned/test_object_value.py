"""The object-search value: what it reads, and that it begins as the planner's own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from tests.vgdp_experiments.search.learned.test_rgbd import explored

from gridnav import GridGeometry
from vgdp_experiments.search.learned.choices import choice_loss
from vgdp_experiments.search.learned.object_value import (
    BANDS,
    CHANNELS,
    HeightMemory,
    ObjectSearchPlanner,
    begin_value,
    height_map,
    load_value,
    save_value,
)
from vgdp_planner import ValueGuidedPlanner
from vgdp_planner.weights import WeightsError

if TYPE_CHECKING:
    from pathlib import Path

TABLE = 2
"""Its top is in this band."""


def test_a_table_is_where_it_stands_and_as_high_as_it_is() -> None:
    """Floor, ceiling, what was not measured and what is off the map leave no mark."""
    points = np.array(
        [
            (0.4, 0.1, 0.72),
            (0.4, 0.1, 0.02),
            (0.7, 0.4, 2.4),
            (0.7, 0.4, np.nan),
            (9.0, 9.0, 0.72),
            (-0.1, 0.1, 0.72),
        ]
    )
    found = height_map(points, np.array([[0.75, 0.45]]), np.zeros(2), (2, 3))
    assert found.shape == (BANDS + 1, 2, 3)
    assert [tuple(index) for index in np.argwhere(found)] == [(TABLE, 0, 1), (BANDS, 1, 2)]


def test_what_was_seen_stays_although_the_map_grows() -> None:
    """A map with another corner holds the same things in the same places."""
    memory = HeightMemory()
    table = np.array([[[0.4, 0.1, 0.72]]])
    before = memory.look(table, (0, 0), GridGeometry(2, 3, 0.3))
    grown = GridGeometry(3, 5, 0.3, -0.6, -0.3)
    after = memory.look(np.full((1, 1, 3), np.nan), (1, 3), grown)
    assert after[TABLE, 1, 3] == before[TABLE, 0, 1] == 1.0
    assert after[TABLE].sum() == before[TABLE].sum() == 1.0
    assert after[BANDS].sum() == 2.0
    memory.begin()
    assert memory.look(np.empty((0, 3)), (0, 0), grown)[:BANDS].sum() == 0.0


def test_untrained_it_decides_as_the_planner() -> None:
    """The weights that read heights begin at zero."""
    blind = ValueGuidedPlanner.from_pretrained(settings={'execute': 1})
    planner = ObjectSearchPlanner(begin_value())
    heights = np.ones((CHANNELS, 15, 18), dtype=np.float32)
    for seed in range(3):
        blind.reset(seed)
        planner.reset(seed)
        planner.look(heights)
        expected = blind.plan(explored(seed), (7, 7))
        plan = planner.plan(explored(seed), (7, 7))
        assert plan.committed == expected.committed
        assert math.isclose(plan.value, expected.value, rel_tol=1e-4)


def test_heights_count_once_it_is_learned(tmp_path: Path) -> None:
    """With weights that read heights values depend on them, and those weights come back."""
    torch.manual_seed(0)
    value = begin_value()
    torch.nn.init.normal_(value.trunk.stem.weight, std=0.5)
    save_value(value, tmp_path, {'seed': 3})
    planner = ObjectSearchPlanner(load_value(tmp_path))
    maps = []
    for side in (slice(0, 9), slice(9, 18)):
        heights = np.zeros((CHANNELS, 15, 18), dtype=np.float32)
        heights[TABLE, :, side] = 1.0
        planner.look(heights)
        maps.append(planner.plan(explored(0), (7, 7)).value_map)
    assert np.nanmax(np.abs(maps[0] - maps[1])) > 0.1
    (tmp_path / 'config.json').write_text('{"config": {"gamma": 5}}')
    with pytest.raises(WeightsError, match='none of an object-search value'):
        load_value(tmp_path)


def test_choices_that_serve_more_things_are_worth_more() -> None:
    """The loss is least where the worth tells what the hidden things cost, and padding is none."""
    value = begin_value()
    value.seen = torch.zeros(1, CHANNELS, 15, 18)
    maps = torch.from_numpy(explored(0)[None])
    cells = torch.tensor([[[3, 5], [11, 6], [0, 0]]])
    distances = torch.tensor([[4.0, 4.0, math.inf]])
    costs = torch.tensor([[[2.0, 20.0, math.inf], [3.0, 30.0, math.inf], [math.inf] * 3]])
    features = torch.zeros(1, 1, 15, 18)
    losses = {}
    for worth in (-0.2, 0.0, 0.2, 0.4, 1.5):
        features[0, 0, 3, 5] = worth
        value.worth_and_level = lambda _maps, at=features: (50 * at[:, 0], torch.zeros(1))  # type: ignore[method-assign, misc]
        losses[worth] = float(choice_loss(value, maps, cells, distances, costs))
    assert min(losses, key=lambda worth: losses[worth]) == 0.4
    assert all(math.isfinite(loss) for loss in losses.values())
