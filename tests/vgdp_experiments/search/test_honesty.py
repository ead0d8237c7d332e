"""Searchers see nothing but what the robot sensed: neither the scene nor the unseen bottle."""

from __future__ import annotations

import argparse
import ast
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import vgdp_experiments.search
from avd_player.simulation import ActiveVisionSimulation
from gridnav import GOAL
from vgdp_experiments.search.loop import search
from vgdp_experiments.search.mapping import SceneMapper
from vgdp_experiments.search.noise import Sensors
from vgdp_experiments.search.registry import SEARCHERS
from vgdp_experiments.search.searchers import Sight
from vgdp_experiments.search.views import small_views

if TYPE_CHECKING:
    from avd_player.scene import Scene
    from avd_player.simulation import SearchRules
    from gridnav.rgbd import RgbdFrame
    from vgdp_experiments.search.searchers import Searcher

pytestmark = pytest.mark.filterwarnings('ignore:Home_113_1')

METHODS = ('vgdp', 'greedy', 'vgdp_object', 'vgdp_rgbd', 'calvin_2d', 'calvin_3d', 'frontier')


class Watched:
    """A searcher, and what it was shown."""

    def __init__(self, searcher: Searcher) -> None:
        self._searcher = searcher
        self.sights: list[Sight] = []
        self.decisions: list[list[int]] = []

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._searcher.reset(seed)

    def decide(self, sight: Sight) -> list[int]:
        """Return what is decided."""
        self.sights.append(sight)
        self.decisions.append(self._searcher.decide(sight))
        return self.decisions[-1]


def searched(scene: Scene, rules: SearchRules, name: str, options: argparse.Namespace) -> Watched:
    """Search from one end, far from the bottle."""
    watched = Watched(SEARCHERS[name](options))
    search(ActiveVisionSimulation(scene, rules), watched, 0, start=0)
    return watched


@pytest.fixture(scope='module')
def options() -> argparse.Namespace:
    """Return the options for the shipped weights."""
    return argparse.Namespace(
        weights=None, device='cpu', threads=None, settings=[], learned_weights=None
    )


@pytest.mark.parametrize('name', METHODS)
def test_the_bottle_plays_no_part_before_it_is_seen(
    scene: Scene, rules: SearchRules, options: argparse.Namespace, name: str
) -> None:
    """With a bottle that comes in sight from nearer alone, all goes the same way until then."""
    near, far = (
        searched(scene, replace(rules, max_range=reach), name, options) for reach in (1.2, 1.8)
    )
    unseen = [not sight.grid.partial_map[GOAL].any() for sight in far.sights].index(False)
    assert unseen > 1
    assert near.decisions[:unseen] == far.decisions[:unseen]
    assert all(near.decisions[:unseen])
    for one, other in zip(near.sights[:unseen], far.sights[:unseen], strict=True):
        np.testing.assert_array_equal(one.grid.partial_map, other.grid.partial_map)


def test_images_are_read_where_the_robot_was(
    scene: Scene, rules: SearchRules, options: argparse.Namespace
) -> None:
    """And nowhere else; a searcher that asks for views gets those of where it is."""
    read: set[str] = set()

    class Recorded(Sensors):
        def frame(self, name: str) -> RgbdFrame | None:
            read.add(name)
            return super().frame(name)

    sensors = Recorded(scene)
    simulation = ActiveVisionSimulation(scene, replace(rules, max_steps=6))
    visited: set[int] = set()

    class Looking(Watched):
        def decide(self, sight: Sight) -> list[int]:
            assert set(simulation.looked_at) == set(simulation.seen_names)
            frames = [Sensors(scene).frame(name) for name in simulation.looked_at]
            expected = small_views([frame for frame in frames if frame is not None])
            for seen, there in zip(sight.views(), expected, strict=True):
                np.testing.assert_array_equal(seen, there)
            visited.add(simulation.position)
            return super().decide(sight)

    watched = Looking(SEARCHERS['frontier'](options))
    way: list[int] = []
    search(
        simulation,
        watched,
        0,
        mapper=SceneMapper(sensors),
        start=0,
        on_step=lambda _step: way.append(simulation.position),
    )
    visited |= {*way, simulation.position}
    assert read == {name for place in visited for name in scene.views[place]}
    assert len(visited) < len(scene.views)


def test_a_sight_holds_no_more_than_map_and_views() -> None:
    """What else could tell of the scene would be a field."""
    assert [field.name for field in fields(Sight)] == ['grid', 'views']


def test_searchers_can_not_know_a_scene() -> None:
    """The file that says what they get imports nothing of the player's."""
    folder = Path(vgdp_experiments.search.__file__).parent
    for file in (folder / 'searchers.py', *folder.glob('learned/networks*.py')):
        for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
            if isinstance(node, ast.ImportFrom):
                assert not str(node.module).startswith('avd_player')
