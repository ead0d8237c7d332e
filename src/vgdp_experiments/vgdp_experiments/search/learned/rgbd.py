"""The planner that reads the robot's images besides its map: the paper's "retrained with RGB-D".

The embedding of what the robot sees is concatenated with the partial map (section 4.1, AVD), at
the input of both networks that read maps: the policy's encoder and the worth of the unseen. The
weights that read the new channels begin at zero, so before any training it decides just as the
planner without images does.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import torch
from torch import Tensor, nn

from gridnav.partial_map import CHANNELS as MAP_CHANNELS
from vgdp_experiments.search.learned.image_encoder import ViewEncoder, laid_out
from vgdp_experiments.search.learned.records import load_networks
from vgdp_experiments.search.views import network_input
from vgdp_planner import Config, ValueGuidedPlanner
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.map_encoder import BeliefMapEncoder, MapTrunk
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.value import ValueNetwork
from vgdp_planner.weights import load_weights, save_record

if TYPE_CHECKING:
    from pathlib import Path

    from vgdp_experiments.search.views import SmallViews
    from vgdp_planner.config import PolicyConfig, ValueConfig

STEMS = ('policy.encoder.trunk.stem.weight', 'value.trunk.stem.weight')
"""The weights that read the map, and the embeddings of views beside it."""


def with_blind_channels(weight: Tensor, count: int) -> Tensor:
    """Return weights (out, in, k, k) of a convolution that reads more channels after the map's.

    The new ones are zero, so they change nothing before training.
    """
    blind = torch.zeros(len(weight), count, *weight.shape[2:])
    return torch.cat([weight[:, :MAP_CHANNELS], blind, weight[:, MAP_CHANNELS:]], dim=1)


@dataclass(frozen=True)
class RgbdConfig:
    """Sizes.

    Attributes:
        planner: Those of the planner.
        embedding: Length of the embedding of a view.
    """

    planner: Config = field(default_factory=Config)
    embedding: int = 12


class SeeingEncoder(BeliefMapEncoder):
    """The policy's map encoder, which reads the embeddings of views, too.

    Attributes:
        seen: The embeddings laid over the map, (B, E, H, W).
    """

    def __init__(self, config: PolicyConfig, embedding: int) -> None:
        super().__init__(config.encoder_channels, config.embedding)
        self.trunk = MapTrunk(MAP_CHANNELS + embedding + 2, config.encoder_channels)
        self.seen = torch.empty(0)

    def forward(self, partial_maps: Tensor, beliefs: Tensor) -> Tensor:
        """Encode partial maps (B, 3, H, W), beliefs (B, H, W) and what is seen, (B, embedding)."""
        return super().forward(torch.cat([partial_maps, self.seen], dim=1), beliefs)


class SeeingValue(ValueNetwork):
    """The value function, whose worth of the unseen reads what is seen besides the map, too.

    Attributes:
        seen: More channels of the map, such as the embeddings laid over it, (B, C, H, W).
    """

    reads_map_alone = False

    def __init__(self, config: ValueConfig, channels: int) -> None:
        super().__init__(config)
        self.trunk = MapTrunk(MAP_CHANNELS + channels + 1, config.trunk_channels)
        self.seen = torch.empty(0)

    def worth_of_unseen(self, partial_maps: Tensor) -> Tensor:
        """Return the worth of being able to look at each cell, (B, H, W), by what is seen, too."""
        return super().worth_of_unseen(self.with_seen(partial_maps))

    def with_seen(self, partial_maps: Tensor) -> Tensor:
        """Return partial maps (B, 3, H, W) with the channels of what is seen."""
        return torch.cat([partial_maps, self.seen], dim=1)


class RgbdNetworks(nn.Module):
    """All networks of the planner that reads images."""

    def __init__(self, config: RgbdConfig) -> None:
        super().__init__()
        self.config = config
        self.views = ViewEncoder(config.embedding)
        self.policy = DiffusionPolicy(config.planner.policy)
        self.policy.encoder = SeeingEncoder(config.planner.policy, config.embedding)
        self.value = SeeingValue(config.planner.value, config.embedding)
        self.belief = BeliefFilter()

    @classmethod
    def from_planner(cls, folder: Path | None = None, embedding: int = 12) -> RgbdNetworks:
        """Begin with the weights of a planner without images; the shipped ones if None.

        Raises:
            WeightsError: If the folder does not hold them, with one sentence that says why.
        """
        config, tensors = load_weights(folder)
        networks = cls(RgbdConfig(config, embedding))
        state = networks.state_dict()
        for name, tensor in tensors.items():
            state[name] = tensor
            if name in STEMS:
                state[name] = with_blind_channels(tensor, embedding)
        networks.load_state_dict(state)
        return networks

    def see(self, views: Tensor, bearings: Tensor, cells: Tensor, shape: tuple[int, int]) -> None:
        """Let the networks read what robots see.

        Args:
            views: (B, V, 5, 36, 64).
            bearings: NaN for views that are not there, (B, V).
            cells: Of the robots, (B, 2).
            shape: Rows and columns of the maps.
        """
        embeddings = self.views(views.flatten(0, 1)).view(*views.shape[:2], -1)
        seen = laid_out(embeddings, bearings, cells, shape)
        self.value.seen = seen
        cast('SeeingEncoder', self.policy.encoder).seen = seen

    def save(self, folder: Path, training: dict[str, Any]) -> None:
        """Write weights, configuration and how they came about into a folder, creating it."""
        config = {**self.config.planner.to_dict(), 'embedding': self.config.embedding}
        save_record(folder, config, self.state_dict(), training)

    @classmethod
    def load(cls, folder: Path | None = None) -> RgbdNetworks:
        """Read what `save` wrote; the weights that come with the package if None.

        Raises:
            WeightsError: If the folder does not hold it, with one sentence that says why.
        """

        def build(config: dict[str, Any]) -> RgbdNetworks:
            sizes = {name: value for name, value in config.items() if name != 'embedding'}
            return cls(RgbdConfig(Config.from_dict(sizes), config['embedding']))

        return load_networks(folder, 'vgdp_rgbd', 'a planner that reads images', build)


class RgbdPlanner(ValueGuidedPlanner):
    """The planner on networks that read images. Before each decision it has to `look`.

    Args:
        networks: With trained weights.
    """

    def __init__(self, networks: RgbdNetworks) -> None:
        super().__init__(networks.config.planner)
        self._networks = networks.eval()
        self.policy, self.value_network = networks.policy, networks.value
        self.belief_filter = networks.belief

    @torch.no_grad()
    def look(self, views: SmallViews, cell: tuple[int, int], shape: tuple[int, int]) -> None:
        """Take in what the robot sees from a cell of a map."""
        self._networks.see(
            network_input(views.color, views.depth)[None],
            torch.from_numpy(views.bearings)[None],
            torch.tensor([cell]),
            shape,
        )
