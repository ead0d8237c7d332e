"""The pictures of a run, from its bag."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from tests.vgdp_bringup.synthetic import SECOND, SyntheticBag

from vgdp_bringup.bags import BagError, Episode, read_episodes
from vgdp_bringup.pictures import (
    CELL_COLORS,
    GOAL,
    PATH,
    PLAN,
    ROBOT,
    describe_world,
    save_pictures,
)

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope='module')
def pictures(tmp_path_factory: pytest.TempPathFactory) -> tuple[Episode, Path, Path]:
    """Return an episode and its pictures."""
    folder = tmp_path_factory.mktemp('pictures')
    bag = SyntheticBag(folder / 'bag')
    bag.add_episode(seed=4, start=SECOND)
    bag.close()
    (episode,) = read_episodes(folder / 'bag')
    return episode, *save_pictures(episode, folder)


def count(image: Image.Image, color: str) -> int:
    """Return how many pixels have exactly a colour."""
    wanted = np.round(255 * np.array(to_rgb(color)))
    return int(np.count_nonzero((np.asarray(image.convert('RGB')) == wanted).all(axis=2)))


def frame(path: Path, index: int) -> Image.Image:
    """Return one picture of an animation."""
    with Image.open(path) as image:
        image.seek(index)
        return image.convert('RGB')


def test_the_animation_shows_the_map_growing(pictures: tuple[Episode, Path, Path]) -> None:
    """One frame a step; what is unseen becomes less, free cells and the path more."""
    episode, gif, _ = pictures
    last = len(episode.steps) - 1
    with Image.open(gif) as image:
        assert getattr(image, 'n_frames', 0) == last + 1
    unseen, free, _ = CELL_COLORS
    first_frame, last_frame = frame(gif, 0), frame(gif, last)
    assert count(last_frame, unseen) < 0.8 * count(first_frame, unseen)
    assert count(last_frame, free) > 1.2 * count(first_frame, free)
    assert count(last_frame, PATH) > count(first_frame, PATH) + 500
    assert count(frame(gif, 1), ROBOT) > 300


def test_the_goal_appears_when_it_is_seen(pictures: tuple[Episode, Path, Path]) -> None:
    """Not before; the legend alone shows it then."""
    episode, gif, _ = pictures
    stamps = [step.stamp for step in episode.steps]
    seen = stamps.index(episode.goal_stamp)
    assert count(frame(gif, seen), GOAL) > 1.5 * count(frame(gif, seen - 1), GOAL)


def test_the_plan_is_shown_exactly(pictures: tuple[Episode, Path, Path]) -> None:
    """Its colour is not lost among those of the palette."""
    _, gif, _ = pictures
    assert count(frame(gif, 0), PLAN) > 50


def test_the_still_shows_everything(pictures: tuple[Episode, Path, Path]) -> None:
    """Map, path, goal and robot are all there."""
    _, _, still = pictures
    with Image.open(still) as image:
        assert image.width > 2.5 * image.height
        for color in (*CELL_COLORS, PATH, ROBOT, GOAL):
            assert count(image, color) > 100, color


@pytest.mark.parametrize('left_out', ['candidates', 'value_map'])
def test_the_still_shows_values(
    pictures: tuple[Episode, Path, Path], left_out: str, tmp_path: Path
) -> None:
    """Candidates and values of cells bring hundreds of pixels of the scale's ends with them."""
    episode, _, still = pictures
    nothing: dict[str, Any] = {left_out: [] if left_out == 'candidates' else None}
    steps = [replace(step, **nothing) for step in episode.steps]
    _, poorer = save_pictures(replace(episode, steps=steps), tmp_path)
    scale = ('#440154', '#fde725')
    with Image.open(still) as full, Image.open(poorer) as less:
        assert sum(count(full, c) for c in scale) > 100 + sum(count(less, c) for c in scale)


def test_without_a_map_there_is_nothing_to_draw(tmp_path: Path) -> None:
    """One sentence instead of an empty picture."""
    with pytest.raises(BagError, match='No map was recorded'):
        save_pictures(Episode(start=0), tmp_path)


def test_a_world_that_says_little_has_a_title() -> None:
    """A robot in a real place knows neither size nor seed."""
    assert describe_world(Episode(start=0)) == 'An unknown place'
