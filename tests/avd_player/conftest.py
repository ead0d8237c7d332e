"""Scenes that the tests of this folder share."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from tests.avd_player.tiny_scene import TinyScene, write_scene

if TYPE_CHECKING:
    from collections.abc import Callable

KITCHEN = Path('/work/shared/data/redkitchen')


@pytest.fixture(scope='session')
def tiny(tmp_path_factory: pytest.TempPathFactory) -> TinyScene:
    """Return a scene of 2 x 3 positions; not to be changed."""
    return write_scene(tmp_path_factory.mktemp('tiny') / 'Home_001_1', labels=True)


@pytest.fixture(scope='session')
def small(tmp_path_factory: pytest.TempPathFactory) -> TinyScene:
    """Return a scene of two positions; not to be changed."""
    folder = tmp_path_factory.mktemp('small') / 'Home_001_1'
    return write_scene(folder, cells=[(0, 0), (1, 0)], labels=True)


@pytest.fixture
def damaged_small(small: TinyScene, tmp_path: Path) -> Path:
    """Return a copy of the scene of two positions, to be damaged."""
    folder = tmp_path / 'Home_001_1'
    shutil.copytree(small.folder, folder)
    return folder


@pytest.fixture
def damaged(tiny: TinyScene, tmp_path: Path) -> Callable[[], Path]:
    """Return a function that copies the scene, to be damaged."""

    def copy() -> Path:
        folder = tmp_path / 'Home_001_1'
        shutil.copytree(tiny.folder, folder)
        return folder

    return copy


@pytest.fixture
def kitchen() -> Path:
    """Return the folder of the kitchen's frames."""
    if not KITCHEN.is_dir():
        pytest.skip('The frames of the kitchen are not here')
    return KITCHEN
