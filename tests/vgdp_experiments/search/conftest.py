"""The scene that the tests of this folder search."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from tests.avd_player.tiny_scene import TARGET, TinyScene, write_scene

from avd_player.scene import Scene
from avd_player.simulation import DEFAULT_TARGET, SearchRules

if TYPE_CHECKING:
    from pathlib import Path

CELLS = [(col, row) for row in (1, 2) for col in range(-5, 4)]
"""A strip through the room, from one end of it to the bottle."""


@pytest.fixture(scope='session')
def home(tmp_path_factory: pytest.TempPathFactory) -> TinyScene:
    """Return a scene with few positions; not to be changed."""
    folder = tmp_path_factory.mktemp('homes') / 'Home_113_1'
    (folder.parent / 'instance_id_map.txt').write_text(f'{DEFAULT_TARGET} {TARGET}\n')
    return write_scene(folder, cells=CELLS)


@pytest.fixture
def scene(home: TinyScene) -> Scene:
    """Return it opened anew."""
    return Scene.open(home.folder)


@pytest.fixture
def rules() -> SearchRules:
    """Return rules under which the bottle is seen from near alone."""
    return SearchRules(min_expert_steps=2, max_range=1.8, max_steps=40)


@pytest.fixture
def data(home: TinyScene) -> Path:
    """Return the folder that the scene is in."""
    return home.folder.parent
