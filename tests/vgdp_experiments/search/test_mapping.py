"""Maps of scenes that are searched again and again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bev_mapper.rgbd_mapper import RgbdMapper
from bev_mapper.segmentation import GeometricSegmenter
from vgdp_experiments.search.mapping import SceneMapper, mapper_config
from vgdp_experiments.search.noise import Noise, Sensors

if TYPE_CHECKING:
    from avd_player.scene import Scene

pytestmark = pytest.mark.filterwarnings('ignore:Home_113_1')


@pytest.mark.parametrize(
    'noise', [Noise(), Noise(depth=30.0, missing=0.2, position=50.0, heading=2.0, labels=0.1)]
)
def test_the_grid_is_that_of_the_mapper(scene: Scene, noise: Noise) -> None:
    """To the last bit, with positions seen again, after a clear, and where it had to grow."""
    sensors = Sensors(scene, noise, seed=7)
    small = replace(mapper_config().geometry, rows=10, cols=10)
    config = replace(mapper_config(), geometry=small)
    kept = SceneMapper(sensors, config=config)
    for way in ([0, 1, 2, 1, 0], [4, 3, 8]):
        mapper = RgbdMapper(config, sensors.segmenter(GeometricSegmenter()))
        kept.clear()
        for position in way:
            names = scene.views[position]
            kept.look(names)
            for name in names:
                frame = sensors.frame(name)
                assert frame is not None
                mapper.add(frame)
            assert kept.grid.geometry == mapper.grid.geometry
            np.testing.assert_array_equal(kept.grid.occupancy, mapper.grid.occupancy)
            np.testing.assert_array_equal(kept.grid.probability, mapper.grid.probability)
    assert kept.grid.geometry.rows > small.rows
    assert {-1, 0, 100} == set(np.unique(kept.grid.occupancy).tolist())


def test_an_image_is_read_once(scene: Scene) -> None:
    """What it changes is kept for the searches that follow."""
    mapper = SceneMapper(Sensors(scene))
    names = scene.views[0]
    mapper.look(names)
    first = mapper.grid.occupancy.copy()
    reads = scene._read.cache_info().misses
    scene._read.cache_clear()
    mapper.clear()
    mapper.look(names)
    assert reads == len(names)
    assert scene._read.cache_info().misses == 0
    np.testing.assert_array_equal(mapper.grid.occupancy, first)


def test_what_depends_on_other_frames_is_refused(scene: Scene) -> None:
    """A floor that is looked for, and a projection of all points."""
    for change in ({'fit_floor': True}, {'mode': 'majority'}):
        config = replace(mapper_config(), **change)
        with pytest.raises(ValueError, match='can be kept only with fit_floor=False'):
            SceneMapper(Sensors(scene), config=config)
