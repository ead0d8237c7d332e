"""The paper's U-Net against the appendix's table, stage by stage."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import torch
from torch import nn

from vgdp_planner import preset
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.unet import ConditionalUNet

if TYPE_CHECKING:
    from collections.abc import Iterable

# The U-Net's table: [kernel, stride, channels] of each convolution, stage by stage.
UNET = {
    'down 1': [[3, 1, 256], [3, 1, 256], [3, 1, 256]],
    'downsample 1': [[3, 2, 1024]],
    'down 2': [[3, 1, 1024], [3, 1, 1024], [3, 1, 1024]],
    'downsample 2': [[3, 2, 2048]],
    'down 3': [[3, 1, 2048], [3, 1, 2048], [3, 1, 2048]],
    'middle 1': [[3, 1, 2048], [3, 1, 2048], [3, 1, 2048]],
    'middle 2': [[3, 1, 2048], [3, 1, 2048], [3, 1, 2048]],
    'up 1': [[3, 1, 1024], [3, 1, 1024], [3, 1, 1024]],
    'upsample 1': [[4, 2, 1024]],
    'up 2': [[3, 1, 256], [3, 1, 256], [3, 1, 256]],
    'upsample 2': [[4, 2, 256]],
    'final': [[3, 1, 256], [1, 1, 4]],
}

# Length x channels of what goes into each stage and comes out of the network, for plans of 8.
UNET_INPUTS = {
    'down 1': (8, 4),
    'down 2': (4, 1024),
    'down 3': (2, 2048),
    'middle 1': (2, 2048),
    'middle 2': (2, 2048),
    'up 1': (2, 4096),
    'up 2': (4, 2048),
    'final': (8, 256),
}

PARAMETERS = 175_793_924


@pytest.fixture(scope='module')
def unet() -> ConditionalUNet:
    """Return the paper's U-Net without values in its parameters: the shapes are what counts."""
    with torch.device('meta'):
        denoiser = DiffusionPolicy(preset('paper').policy).denoiser
    assert isinstance(denoiser, ConditionalUNet)
    return denoiser


def stages(unet: ConditionalUNet) -> dict[str, nn.Module]:
    """Return the stages of the U-Net under the table's names."""
    return {
        f'{name} {number}': stage
        for name, part in (
            ('down', unet.down),
            ('downsample', unet.downsample),
            ('middle', unet.middle),
            ('up', unet.up),
            ('upsample', unet.upsample),
        )
        for number, stage in enumerate(part, 1)
    } | {'final': unet.final}


def test_unet_table(unet: ConditionalUNet) -> None:
    """The U-Net has the table's convolutions, stage by stage, and no others."""

    def convolutions(stage: nn.Module) -> Iterable[nn.Conv1d | nn.ConvTranspose1d]:
        for layer in stage.modules():
            if isinstance(layer, nn.Conv1d | nn.ConvTranspose1d):
                assert isinstance(layer, nn.ConvTranspose1d) == (stage in unet.upsample)
                yield layer

    found = {
        name: [
            [*layer.kernel_size, *layer.stride, layer.out_channels]
            for layer in convolutions(stage)
        ]
        for name, stage in stages(unet).items()
    }
    assert found == UNET


def test_unet_lengths_and_channels(unet: ConditionalUNet) -> None:
    """What goes from stage to stage has the table's sizes for plans of eight steps."""
    found: dict[str, tuple[int, int]] = {}
    for name, stage in stages(unet).items():
        first = next(iter(stage.children())) if name.startswith(('down ', 'up ')) else stage
        first.register_forward_pre_hook(
            lambda _, inputs, name=name: found.update({name: tuple(inputs[0].shape[:0:-1])})
        )
    with torch.device('meta'):
        output = unet(torch.zeros(1, 4, 8), torch.zeros(1).long(), torch.zeros(1, 256))
    assert output.shape == (1, 4, 8)
    assert {name: found[name] for name in UNET_INPUTS} == UNET_INPUTS


def test_film_scales_and_shifts(unet: ConditionalUNet) -> None:
    """The condition, step and map together, gives each block twice its channels."""
    for name, channels in (('down 2', 1024), ('middle 1', 2048), ('up 2', 256)):
        stage = stages(unet)[name]
        linear = [layer for layer in stage.modules() if isinstance(layer, nn.Linear)]
        assert [(layer.in_features, layer.out_features) for layer in linear] == [
            (256 + 256, 2 * channels)
        ]


def test_parameter_count(unet: ConditionalUNet) -> None:
    """The table makes so many, FiLM and the embedding of the diffusion step included."""
    assert sum(parameter.numel() for parameter in unet.parameters()) == PARAMETERS
