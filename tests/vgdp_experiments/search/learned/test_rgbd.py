"""The planner that reads images: where embeddings lie, and that it begins as the one without."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch

from avd_player.scene import Scene
from vgdp_experiments.search.learned.image_encoder import laid_out
from vgdp_experiments.search.learned.rgbd import RgbdNetworks, RgbdPlanner
from vgdp_experiments.search.views import SmallViews, small_views
from vgdp_planner import ValueGuidedPlanner
from vgdp_planner.weights import WeightsError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


@pytest.fixture(scope='module')
def seen(home: Path) -> SmallViews:
    """Return what there is to see at a position."""
    scene = Scene.open(home, 96)
    return small_views([scene.frame(name) for name in scene.views[0][:6]])


def explored(seed: int) -> NDArray[np.float32]:
    """Return a partial map with a free patch in it."""
    rng = np.random.default_rng(seed)
    partial_map = np.zeros((3, 15, 18), dtype=np.float32)
    partial_map[1, 4:11, 4:12] = 1.0
    walls = (rng.random((15, 18)) < 0.2) & (partial_map[1] > 0)
    walls[7, 7] = False
    partial_map[0], partial_map[1] = walls, partial_map[1] * ~walls
    return partial_map


def test_small_views_keep_where_things_are(home: Path, seen: SmallViews) -> None:
    """Points of small views lie on the surfaces that the large ones show: the floor and walls."""
    assert seen.color.shape == (6, 36, 64, 3)
    assert seen.points.shape == (6, 9, 16, 3)
    points = seen.points[np.isfinite(seen.points).all(axis=-1)]
    assert len(points) > 400
    low, high = points.min(axis=0), points.max(axis=0)
    assert abs(low[2]) < 0.1
    assert high[2] < 2.6
    scene = Scene.open(home, 96)
    assert np.allclose(np.sort(np.diff(np.unwrap(seen.bearings))), math.pi / 6, atol=0.05)
    assert np.allclose(seen.bearings, scene.headings[0][:6], atol=1e-5)


def test_cells_get_the_view_that_looks_their_way() -> None:
    """East of the robot lies what the view to the east says, and nothing where none looks."""
    embeddings = torch.tensor([[[1.0], [2.0], [3.0]]])
    bearings = torch.tensor([[0.0, math.pi / 2, math.nan]])
    laid = laid_out(embeddings, bearings, torch.tensor([[2, 3]]), (6, 8))[0, 0]
    assert laid[2].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    assert laid[:, 3].tolist() == [0.0, 0.0, 0.0, 2.0, 2.0, 2.0]
    assert laid[0, 0] == 0.0


def test_untrained_it_decides_as_the_planner_without_images(seen: SmallViews) -> None:
    """The weights that read images begin at zero."""
    blind = ValueGuidedPlanner.from_pretrained()
    planner = RgbdPlanner(RgbdNetworks.from_planner())
    for seed in range(3):
        partial_map = explored(seed)
        blind.reset(seed)
        planner.reset(seed)
        planner.look(seen, (7, 7), (15, 18))
        expected = blind.plan(partial_map, (7, 7))
        plan = planner.plan(partial_map, (7, 7))
        assert plan.committed == expected.committed
        assert math.isclose(plan.value, expected.value, rel_tol=1e-4)
        assert np.array_equal(plan.candidates, expected.candidates)


def test_what_is_seen_counts_once_it_is_learned(seen: SmallViews, tmp_path: Path) -> None:
    """With weights that read images values depend on them, and those weights come back."""
    torch.manual_seed(0)
    networks = RgbdNetworks.from_planner(embedding=4)
    torch.nn.init.normal_(networks.value.trunk.stem.weight, std=0.5)
    networks.save(tmp_path, {'seed': 3})
    planner = RgbdPlanner(RgbdNetworks.load(tmp_path))
    planner.look(seen, (7, 7), (15, 18))
    first = planner.plan(explored(0), (7, 7)).value_map
    planner.look(seen._replace(bearings=seen.bearings + 2), (7, 7), (15, 18))
    second = planner.plan(explored(0), (7, 7)).value_map
    assert np.nanmax(np.abs(first - second)) > 0.1
    (tmp_path / 'config.json').write_text('{"config": {"embedding": 5}}')
    with pytest.raises(WeightsError, match='none of a planner that reads images'):
        RgbdNetworks.load(tmp_path)
