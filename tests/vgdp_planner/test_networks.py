"""Shapes of the networks, and that they learn."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from vgdp_planner import PRESETS, preset
from vgdp_planner.map_encoder import BeliefMapEncoder, MapTrunk
from vgdp_planner.policy import DiffusionPolicy


def test_paper_map_encoder() -> None:
    """Three convolutions of 128, 256, 256 channels, eight groups, pooling, two linear layers."""
    encoder = DiffusionPolicy(preset('paper').policy).encoder
    convolutions = [layer for layer in encoder.modules() if isinstance(layer, nn.Conv2d)]
    assert [layer.out_channels for layer in convolutions] == [128, 256, 256]
    assert all(
        (layer.kernel_size, layer.stride, layer.padding) == ((3, 3), (1, 1), (1, 1))
        for layer in convolutions
    )
    norms = [layer for layer in encoder.modules() if isinstance(layer, nn.GroupNorm)]
    assert [layer.num_groups for layer in norms] == [8, 8, 8]
    linear = [layer for layer in encoder.modules() if isinstance(layer, nn.Linear)]
    assert [(layer.in_features, layer.out_features) for layer in linear] == [(256, 256)] * 2
    assert encoder(torch.zeros(2, 3, 15, 15), torch.zeros(2, 15, 15)).shape == (2, 256)


@pytest.mark.parametrize('name', ['default', 'paper'])
def test_training_step_lowers_the_loss(name: str) -> None:
    """A few steps on one batch lower the denoising loss of either preset."""
    config = preset(name).policy
    torch.manual_seed(0)
    policy = DiffusionPolicy(config)
    optimizer = torch.optim.RAdam(policy.parameters(), lr=2e-4 if name == 'paper' else 3e-3)
    maps, beliefs = torch.zeros(2, 3, 9, 9), torch.zeros(2, 9, 9)
    beliefs[:, 4, 4] = 1
    actions = torch.tensor([[0] * config.horizon, [5] * config.horizon])
    noise = torch.randn(4, 4, config.horizon)
    step = torch.tensor([3, 9, 17, 30])
    losses = []
    for _ in range(3 if name == 'paper' else 40):
        loss = policy.loss(maps, beliefs, actions, noise, step)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.9 * losses[0]


@pytest.mark.parametrize('shape', [(5, 7), (15, 15), (30, 30), (1, 200)])
def test_trunk_takes_any_size(shape: tuple[int, int]) -> None:
    """The trunk keeps the size of the map, whatever it is."""
    trunk = MapTrunk(4, (8, 8, 8))
    assert trunk(torch.zeros(2, 4, *shape)).shape == (2, 8, *shape)


def test_belief_encoder_is_linear_up_to_the_last_layer() -> None:
    """With the belief hidden from the trunk, two half beliefs give the mean of the features."""
    torch.manual_seed(0)
    encoder = BeliefMapEncoder((8, 8, 8), 16)
    encoder.fully_connected = nn.Sequential()
    weight = encoder.trunk.stem.weight
    with torch.no_grad():
        weight[:, 4] = 0
    maps = torch.rand(1, 3, 9, 9)
    here, there = torch.zeros(1, 9, 9), torch.zeros(1, 9, 9)
    here[0, 2, 3], there[0, 7, 7] = 1, 1
    mean = (encoder(maps, here) + encoder(maps, there)) / 2
    torch.testing.assert_close(encoder(maps, (here + there) / 2), mean)


@torch.no_grad()
def test_what_is_far_away_costs_nothing() -> None:
    """The encoder says the same whether it reads all of large maps or what is near the robots."""
    torch.manual_seed(0)
    encoder = BeliefMapEncoder((8, 8, 8), 16)
    maps = torch.rand(3, 3, 93, 130)
    beliefs = torch.zeros(3, 93, 130)
    beliefs[0, 0, 129], beliefs[1, 46, 63], beliefs[2, 50:53, 67] = 1, 1, 1 / 3
    sizes = []
    encoder.trunk.register_forward_pre_hook(lambda _trunk, inputs: sizes.append(inputs[0].shape))
    near = encoder(maps, beliefs)
    # A robot that may be anywhere makes all windows as large as the map.
    everywhere = torch.full((1, 93, 130), 1 / (93 * 130))
    whole = encoder(torch.cat([maps, maps[:1]]), torch.cat([beliefs, everywhere]))
    assert [size[-2:] for size in sizes] == [(72, 68), (96, 132)]
    torch.testing.assert_close(near, whole[:3])


def test_sampling_is_repeatable_and_batch_free() -> None:
    """The same noise gives the same plans, alone or in a batch."""
    torch.manual_seed(0)
    policy = DiffusionPolicy(preset('default').policy).eval()
    rng = np.random.default_rng(0)
    noise = torch.from_numpy(rng.standard_normal((3, 5, 1, 4, 8), dtype=np.float32))
    maps = torch.from_numpy(rng.integers(0, 2, (3, 3, 11, 11)).astype(np.float32))
    beliefs = torch.zeros(3, 11, 11)
    beliefs[:, 5, 5] = 1
    together = policy.sample(maps, beliefs, noise, 4)
    assert together.shape == (3, 5, 8)
    alone = policy.sample(maps[1:2], beliefs[1:2], noise[1:2], 4)
    assert torch.equal(together[1:2], alone)


def test_presets_are_the_papers_numbers() -> None:
    """The hyperparameters that the paper states are those of its preset."""
    config = PRESETS['paper']
    assert config.policy.horizon == 4
    assert config.planner.execute == 2
    assert config.policy.time_embedding == 256
    assert config.policy.diffusion_steps == 32
    assert config.planner.candidates == 24
    assert (config.value.rounds, config.value.gamma) == (60, 0.99)
