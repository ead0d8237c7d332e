"""Weights on disk."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
import torch

from vgdp_planner import Config, ValueGuidedPlanner, WeightsError
from vgdp_planner.weights import CONFIG_FILE, MODEL_FILE, SHIPPED, load_weights, save_weights

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the weights of an untrained planner."""
    torch.manual_seed(0)
    planner = ValueGuidedPlanner(Config())
    tensors = {
        f'{part}.{name}': value
        for part, module in planner.modules().items()
        for name, value in module.state_dict().items()
    }
    save_weights(tmp_path, planner.config, tensors, {'command': 'none'})
    return tmp_path


def test_round_trip_is_exact(folder: Path) -> None:
    """What is loaded equals what was saved, bit for bit."""
    config, tensors = load_weights(folder)
    planner = ValueGuidedPlanner.from_pretrained(folder)
    assert planner.config == config == Config()
    for part, module in planner.modules().items():
        for name, value in module.state_dict().items():
            assert torch.equal(value, tensors[f'{part}.{name}'])


def test_shipped_weights_are_safetensors_and_small() -> None:
    """The package ships one safetensors file of at most 25 MB, JSON and a card, nothing else."""
    names = {path.name for path in SHIPPED.iterdir()}
    assert names == {MODEL_FILE, CONFIG_FILE, 'README.md'}
    assert (SHIPPED / MODEL_FILE).stat().st_size < 25e6


@pytest.mark.parametrize('name', [CONFIG_FILE, MODEL_FILE])
def test_missing_file(folder: Path, name: str) -> None:
    """A missing file is named."""
    (folder / name).unlink()
    with pytest.raises(WeightsError, match=name):
        ValueGuidedPlanner.from_pretrained(folder)


def test_cut_files(folder: Path) -> None:
    """A file that was cut anywhere gives one sentence that names it."""
    for name in (CONFIG_FILE, MODEL_FILE):
        whole = (folder / name).read_bytes()
        for length in (0, 5, 100, len(whole) // 2, len(whole) - 3):
            (folder / name).write_bytes(whole[:length])
            with pytest.raises(WeightsError, match=name.split('.')[0]) as caught:
                ValueGuidedPlanner.from_pretrained(folder)
            assert '\n' not in str(caught.value)
        (folder / name).write_bytes(whole)


def test_tensors_that_do_not_fit(folder: Path) -> None:
    """Weights of another size than the configuration says give one sentence."""
    record = json.loads((folder / CONFIG_FILE).read_text())
    record['config']['policy']['embedding'] = 64
    (folder / CONFIG_FILE).write_text(json.dumps(record))
    with pytest.raises(WeightsError, match='do not fit'):
        ValueGuidedPlanner.from_pretrained(folder)


def test_unknown_setting(folder: Path) -> None:
    """An unknown setting in the configuration is named."""
    record = json.loads((folder / CONFIG_FILE).read_text())
    record['config']['policy']['nonsense'] = 64
    (folder / CONFIG_FILE).write_text(json.dumps(record))
    with pytest.raises(WeightsError, match='nonsense'):
        ValueGuidedPlanner.from_pretrained(folder)
