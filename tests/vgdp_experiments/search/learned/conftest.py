"""Demonstrations of a tiny home, which the tests of this folder share."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from tests.avd_player.tiny_scene import write_scene

from vgdp_experiments.search.learned.demonstrations import (
    DataSettings,
    HomeDemonstrations,
    demonstrate,
)

if TYPE_CHECKING:
    from pathlib import Path

CELLS = [*((col, 0) for col in range(-4, 3)), (-4, 1), (-4, 2)]
"""Positions of a room, around a corner."""

NEAR_STEPS = 1

TINY = DataSettings(episodes=3, width=96, min_expert_steps=3, max_steps=20)


@pytest.fixture(scope='session')
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a scene with many positions; not to be changed."""
    return write_scene(tmp_path_factory.mktemp('homes') / 'Home_101_1', cells=CELLS).folder


@pytest.fixture(scope='session')
def made(home: Path) -> HomeDemonstrations:
    """Return three searches of it: by the planner, by the nearest frontier, by the expert."""
    return demonstrate(home, TINY)


@pytest.fixture(scope='session')
def data(made: HomeDemonstrations, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the demonstrations of it, twice, as of two homes."""
    folder = tmp_path_factory.mktemp('demonstrations')
    # The thing is seen from everywhere in the room, which leaves nothing to search.
    near = replace(made, sees=made.sees & (made.after <= NEAR_STEPS))
    for name in ('Home_101_1', 'Home_102_1'):
        replace(near, settings={**made.settings, 'scene': name}).save(folder / f'{name}.npz')
    return folder
