"""Joining trained parts: what the model card says, and what does not belong together."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import asdict
from pathlib import Path

import pytest
import torch

from vgdp_experiments import join
from vgdp_experiments.data import SETTINGS as DATA_SETTINGS
from vgdp_experiments.train_policy import SETTINGS
from vgdp_experiments.train_value_paper import PaperValueTraining
from vgdp_experiments.training import ValueParts
from vgdp_planner import preset
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.value import ValueNetwork
from vgdp_planner.weights import WeightsError, load_part, save_weights


def test_parts_of_two_presets_are_refused(tmp_path: Path) -> None:
    """A policy of one preset and a value function of another make no planner."""
    torch.manual_seed(0)
    value, policy = tmp_path / 'value', tmp_path / 'policy'
    paper, default = preset('paper'), preset('default')
    both = ValueParts(ValueNetwork(paper.value), BeliefFilter())
    save_weights(value, paper, both.state_dict(), {'value': {'losses': {}}})
    tensors = DiffusionPolicy(default.policy).state_dict()
    save_weights(
        policy,
        default,
        {f'policy.{name}': tensor for name, tensor in tensors.items()},
        {'policy': {'preset': 'default', 'losses': {}}},
    )
    arguments = Namespace(value=value, policy=policy, out=tmp_path / 'out', results=None)
    with pytest.raises(ValueError, match=r"policy of the preset 'default'.*value .*of another"):
        join.run(arguments)
    assert not (tmp_path / 'out').exists()
    _, found = load_part(value, 'value')
    assert found.keys() == both.value.state_dict().keys()
    with pytest.raises(WeightsError, match="no part named 'policy'"):
        load_part(value, 'policy')


def test_the_paper_presets_card() -> None:
    """The card names the commands that trained the paper's networks, and on what."""
    demonstrations = asdict(DATA_SETTINGS['paper'])
    training = {
        'value': {**asdict(PaperValueTraining()), 'losses': {}},
        'policy': {**asdict(SETTINGS['paper']), 'demonstrations': demonstrations, 'losses': {}},
    }
    arguments = Namespace(value=Path('v'), policy=Path('p'), out=Path('o'))
    value, data, policy, _ = join.commands(training, arguments)
    assert value.startswith('vgdp train value-paper --data runs/demonstrations-paper.npz')
    assert data.startswith('vgdp data expert --preset paper')
    assert policy.startswith('vgdp train policy --preset paper')
    sentence = join.trained_on('paper', demonstrations)
    assert sentence == 'Trained on Wilson mazes of 15 x 15 with view range 2.'
    demonstrations = asdict(DATA_SETTINGS['default'])
    assert 'view ranges 1 to 3' in join.trained_on('default', demonstrations)
    sentence = join.trained_on('default', demonstrations, 'maze-15-view1,rooms-20-view2')
    assert 'of 15 to 20 cells a side with\nview ranges 1 to 2 (maze, rooms), the' in sentence
