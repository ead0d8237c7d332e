"""The planner without the projector: a learned lattice in place of labelled points on a map.

The paper's ablation "w/o PC to BEV projector". The lattice point net, trained end to end, says of
each cell how likely it is an obstacle, free, or not seen; nobody tells it which is which. What it
says goes in the place of the partial map into the diffusion policy and into the value function,
which is the paper's: CALVIN's, whose Q scores the plans (equation 9).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import torch
from torch import Tensor, nn

from gridnav import GOAL, NUM_MOVES
from vgdp_experiments.calvin import Calvin, CalvinConfig
from vgdp_experiments.search.learned.lattice import LatticePointNet
from vgdp_experiments.search.learned.records import load_networks
from vgdp_planner import Config, ValueGuidedPlanner
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.map_encoder import BeliefMapEncoder
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.value import Values
from vgdp_planner.weights import load_weights, save_record

if TYPE_CHECKING:
    from pathlib import Path

    from vgdp_planner.value import ValueNetwork

FEATURES = 16

KINDS = 3
"""Obstacle, free, not seen."""

SETTINGS = {'execute': 1, 'look_first': False, 'score': 'mean_q', 'greedy_fallback': False}
"""Of the planner: the paper's, but for one step at a time, so that each position is looked at."""


class LatticeEncoder(BeliefMapEncoder):
    """The policy's map encoder, which reads the learned map in place of the projected one.

    Attributes:
        learned: (B, 3, H, W).
    """

    learned = torch.empty(0)

    def forward(self, partial_maps: Tensor, beliefs: Tensor) -> Tensor:  # noqa: ARG002
        """Encode the learned map and beliefs (B, H, W) as (B, embedding)."""
        return super().forward(self.learned, beliefs)


class LatticeValue(Calvin):
    """CALVIN as the value function of the planner, on the learned map."""

    def values(self, learned: Tensor) -> Values:
        """Return what value iteration on learned maps (B, 3, H, W) finds."""
        found = self(learned)
        values = found.q_values.amax(dim=1)
        return Values(
            values=values,
            q_values=found.q_values,
            reached=torch.ones_like(values, dtype=torch.bool),
            mask=found.available[:, :NUM_MOVES],
            step_rewards=self.rewards(found.available),
            rounds=self.config.rounds * max(values.shape[1:]),
            residual=0.0,
            offsets=values.new_zeros(len(values)),
        )


class NoProjectorNetworks(nn.Module):
    """All networks of the planner without the projector."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.config = config
        self.lattice = LatticePointNet(FEATURES)
        # With where the robot stood, and where the map ends.
        self.kinds = nn.Conv2d(FEATURES + 2, KINDS, 3, padding=1)
        self.policy = DiffusionPolicy(config.policy)
        self.policy.encoder = LatticeEncoder(
            config.policy.encoder_channels, config.policy.embedding
        )
        self.value = LatticeValue(CalvinConfig())
        self.belief = BeliefFilter()

    @classmethod
    def from_planner(cls, calvin: Calvin, folder: Path | None = None) -> NoProjectorNetworks:
        """Begin with the policy of a planner, the shipped one's if None, and with CALVIN.

        Raises:
            WeightsError: If the folder does not hold them, with one sentence that says why.
        """
        config, tensors = load_weights(folder)
        networks = cls(config.with_planner(SETTINGS))
        of_value = {f'value.{name}': tensor for name, tensor in calvin.state_dict().items()}
        kept = {n: t for n, t in tensors.items() if n.startswith(('policy.', 'belief.'))}
        networks.load_state_dict({**networks.state_dict(), **kept, **of_value})
        return networks

    def learned_maps(self, lattices: Tensor) -> Tensor:
        """Return learned maps: shares of obstacle and free, and the goal, (B, 3, H, W).

        Args:
            lattices: With the goal and where the robot stood as the last channels,
                (B, C + 2, H, W).
        """
        goals, stood = lattices[:, FEATURES : FEATURES + 1], lattices[:, FEATURES + 1 :]
        seen = torch.cat([lattices[:, :FEATURES], stood, torch.ones_like(stood)], dim=1)
        shares = self.kinds(seen).softmax(dim=1)
        return torch.cat([shares[:, :GOAL], goals], dim=1)

    def read(self, learned: Tensor) -> None:
        """Let the policy read learned maps (B, 3, H, W)."""
        self.policy.encoder.learned = learned

    def save(self, folder: Path, training: dict[str, Any]) -> None:
        """Write weights, configuration and how they came about into a folder, creating it."""
        save_record(folder, self.config.to_dict(), self.state_dict(), training)

    @classmethod
    def load(cls, folder: Path | None = None) -> NoProjectorNetworks:
        """Read what `save` wrote; the weights that come with the package if None.

        Raises:
            WeightsError: If the folder does not hold it, with one sentence that says why.
        """
        return load_networks(
            folder,
            'no_projector',
            'the planner without projector',
            lambda config: cls(Config.from_dict(config)),
        )


class _FoundValues(nn.Module):
    """What the planner asks for values: those that were found on the learned map.

    Attributes:
        found: For the decision that is due.
    """

    reads_map_alone = False
    found: Values

    def forward(self, partial_maps: Tensor, worth: None = None) -> Values:  # noqa: ARG002
        """Return them, in which nothing is told of the unseen."""
        return self.found


class NoProjectorPlanner(ValueGuidedPlanner):
    """The planner on a learned lattice. Before each decision it has to be told of it, by `look`.

    What may be executed is decided by the projected map, as ever.

    Args:
        networks: With trained weights.
    """

    def __init__(self, networks: NoProjectorNetworks) -> None:
        super().__init__(networks.config)
        self._networks = networks.eval()
        self.policy, self.belief_filter = networks.policy, networks.belief
        self._values = _FoundValues()
        self.value_network = cast('ValueNetwork', self._values)

    @torch.no_grad()
    def look(self, lattices: Tensor) -> Tensor:
        """Take in a lattice (1, C + 2, H, W); returns Q(s, a) of it, (A, H, W)."""
        learned = self._networks.learned_maps(lattices)
        self._networks.read(learned)
        self._values.found = self._networks.value.values(learned)
        return self._values.found.q_values[0]
