"""The planner: map and belief in, the steps to execute out. Algorithm 1 of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch

from gridnav import DONE, FREE, OBSTACLE
from gridnav.partial_map import as_partial_maps
from vgdp_planner.analog_bits import NUM_BITS
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.safety import SafetyCheck
from vgdp_planner.selection import NO_ACTION, greedy_plan, score_plans
from vgdp_planner.value import ValueNetwork
from vgdp_planner.weights import WeightsError, load_weights

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from torch import Tensor

    from vgdp_planner.config import Config
    from vgdp_planner.safety import Status
    from vgdp_planner.value import Values

SINGLE_NDIM = 3

LEAST_PROGRESS = 0.5
"""Cells by which the committed steps must bring the goal closer, lest the robot walks in circles:
while nothing new is seen the values stand still, so they can't rise for ever."""

Source = Literal['sampled', 'memory', 'greedy', 'none']
"""Where a plan came from: a sample, the best-plan memory, greedy steps on the values."""


@dataclass(frozen=True)
class Plan:
    """What the planner decided.

    Attributes:
        actions: The best plan, T_h action indices; what follows a plan's end is Done.
        committed: The steps to execute before planning again, ending with the first Done. Empty
            if there is nothing to do (see `status`).
        value: The best plan's score: minus the cost still to come, in cells, for 'mean_return'.
        candidates: All plans that competed, int64 (N, T_h): the samples first, then the rest of
            the last best plan and the greedy plan where they took part.
        candidate_values: Their scores, (N,); −inf for a plan whose first step is not safe.
        status: 'ok'; 'exhausted' when nothing reachable is left to see and no goal was seen;
            'unreachable' when the goal was seen and no way leads there.
        source: Where the best plan came from.
        value_map: V(s), (H, W); NaN where nothing worth going to can be reached.
    """

    actions: NDArray[np.int64]
    committed: list[int]
    value: float
    candidates: NDArray[np.int64]
    candidate_values: NDArray[np.float32]
    status: Status
    source: Source
    value_map: NDArray[np.float32]


class ValueGuidedPlanner:
    """Samples plans from the diffusion policy and keeps the one the value function likes best.

    The planner sees the partial map and the belief, nothing else. Its memory holds the rest of
    the last best plan of each episode.

    Args:
        config: Sizes and hyperparameters.
        device: Where the networks run.
    """

    def __init__(self, config: Config, device: str = 'cpu') -> None:
        self.config = config
        self.device = torch.device(device)
        self.policy = DiffusionPolicy(config.policy).to(self.device).eval()
        self.value_network = ValueNetwork(config.value).to(self.device).eval()
        self.belief_filter = BeliefFilter().to(self.device).eval()
        self.reset()

    @classmethod
    def from_pretrained(
        cls, folder: str | Path | None = None, device: str = 'cpu'
    ) -> ValueGuidedPlanner:
        """Load a planner with trained weights.

        Args:
            folder: Holds `config.json` and `model.safetensors`; the shipped weights if None.
            device: Where the networks run.

        Raises:
            WeightsError: If the folder does not hold a planner, with one sentence that says why.
        """
        config, tensors = load_weights(folder)
        planner = cls(config, device)
        try:
            planner.load_tensors(tensors)
        except RuntimeError as error:
            first = str(error).split('\n', maxsplit=2)[1].strip()
            msg = f'The weights do not fit their configuration: {first}'
            raise WeightsError(msg) from error
        return planner

    def modules(self) -> dict[str, torch.nn.Module]:
        """Return the trained parts by the name under which their weights are kept."""
        return {
            'policy': self.policy,
            'value': self.value_network,
            'belief': self.belief_filter,
        }

    def load_tensors(self, tensors: dict[str, Tensor]) -> None:
        """Fill the networks from named tensors; the names start with the part's name."""
        for part, module in self.modules().items():
            prefix = f'{part}.'
            module.load_state_dict(
                {
                    name.removeprefix(prefix): tensor
                    for name, tensor in tensors.items()
                    if name.startswith(prefix)
                }
            )

    def reset(self, seed: int = 0) -> None:
        """Start new episodes: empties the best-plan memory and restarts the random numbers."""
        self._seed = seed
        self._memory: dict[int, list[int]] = {}
        self._decisions: dict[int, int] = {}

    def plan(
        self,
        partial_map: NDArray[Any],
        cell: tuple[int, int] | NDArray[Any],
    ) -> Plan:
        """Plan from a partial map and the robot's cell, or a belief about it.

        A second call assumes that exactly the committed actions of the first were tried in
        between; the new map and cell say what came of them.

        Args:
            partial_map: (3, H, W).
            cell: (row, col), or a belief (H, W) that sums to 1.

        Raises:
            ValueError: If the map or the cell is not valid, with one sentence that says why.
        """
        checked = as_partial_maps(np.asarray(partial_map))
        if checked.ndim != SINGLE_NDIM:
            msg = f'A partial map has the shape (3, H, W), got {checked.shape}.'
            raise ValueError(msg)
        return self.plan_batch(checked[None], np.asarray(cell)[None])[0]

    @torch.no_grad()
    def plan_batch(
        self,
        partial_maps: NDArray[Any],
        cells: NDArray[Any],
        episodes: Sequence[int] | None = None,
    ) -> list[Plan]:
        """Plan for many episodes at once; the maps have one size.

        Args:
            partial_maps: (B, 3, H, W).
            cells: (row, col) of each robot (B, 2), or beliefs (B, H, W).
            episodes: Which episode each row belongs to, for the memory and the random numbers;
                0 … B − 1 if None.

        Raises:
            ValueError: If a map or a cell is not valid, with one sentence that says why.
        """
        maps = as_partial_maps(np.asarray(partial_maps))
        if maps.ndim != SINGLE_NDIM + 1:
            msg = f'Partial maps of a batch have the shape (B, 3, H, W), got {maps.shape}.'
            raise ValueError(msg)
        beliefs = _as_beliefs(np.asarray(cells), maps)
        names = list(range(len(maps))) if episodes is None else list(episodes)
        maps = _standing_free(maps, beliefs)
        checks = [
            SafetyCheck(one_map, belief, self.config.planner.collision_tolerance)
            for one_map, belief in zip(maps, beliefs, strict=True)
        ]
        map_tensor = torch.from_numpy(maps).to(self.device)
        belief_tensor = torch.from_numpy(beliefs).to(self.device)
        values = self.value_network(map_tensor)
        candidates = self._candidates(map_tensor, belief_tensor, names)
        scores = self._score(values, belief_tensor, candidates, checks)

        best = scores.argmax(dim=1)
        chosen = candidates[torch.arange(len(maps), device=self.device), best].cpu().numpy()
        committed = self._commit(checks, chosen)
        replaced = ~self._acceptable(values, belief_tensor, committed)
        if replaced.any():
            greedy = self._greedy(values, belief_tensor, checks)
            candidates = torch.cat([candidates, greedy[:, None]], dim=1)
            greedy_scores = self._score(values, belief_tensor, greedy[:, None], checks)
            scores = torch.cat([scores, greedy_scores], dim=1)
            best = torch.where(replaced, candidates.shape[1] - 1, best)
            chosen = np.where(replaced.cpu().numpy()[:, None], greedy.cpu().numpy(), chosen)
            committed = self._commit(checks, chosen)

        scores = values.without_offsets(scores)
        plans = []
        for row, name in enumerate(names):
            self._decisions[name] = self._decisions.get(name, 0) + 1
            status = checks[row].status
            steps = committed[row] if status == 'ok' else []
            plan = [int(action) for action in chosen[row] if action != NO_ACTION]
            self._memory[name] = plan[len(steps) :] if DONE not in steps else []
            index = int(best[row])
            # The slots of an empty memory and of greedy plans that were not needed hold no plan.
            present = candidates[row, :, 0] != NO_ACTION
            if not replaced[row]:
                present[self.config.planner.candidates + 1 :] = False
            plans.append(
                Plan(
                    actions=_end_with_done(chosen[row]),
                    committed=steps,
                    value=float(scores[row, index]),
                    candidates=_end_with_done(candidates[row, present].cpu().numpy()),
                    candidate_values=scores[row, present].cpu().numpy(),
                    status=status,
                    source=self._source(index) if status == 'ok' else 'none',
                    value_map=values.shown(row),
                )
            )
        return plans

    def _source(self, index: int) -> Source:
        count = self.config.planner.candidates
        if index < count:
            return 'sampled'
        return 'memory' if index == count else 'greedy'

    def _candidates(self, maps: Tensor, beliefs: Tensor, names: Sequence[int]) -> Tensor:
        """Sample L plans for each map and add the rest of the last best one, (B, L + 1, T_h)."""
        config = self.config.planner
        horizon = self.config.policy.horizon
        draws = config.sampling_steps if config.sampler == 'ddpm' else 1
        shape = (config.candidates, draws, NUM_BITS, horizon)
        noise = np.stack(
            [
                np.random.default_rng(
                    [self._seed, name, self._decisions.get(name, 0)]
                ).standard_normal(shape, dtype=np.float32)
                for name in names
            ]
        )
        samples = self.policy.sample(
            maps,
            beliefs,
            torch.from_numpy(noise).to(self.device),
            config.sampling_steps,
            config.sampler,
        )
        remembered = np.full((len(names), 1, horizon), NO_ACTION)
        if config.memory:
            for row, name in enumerate(names):
                rest = self._memory.get(name, [])
                remembered[row, 0, : len(rest)] = rest
        return torch.cat([samples, torch.from_numpy(remembered).to(self.device)], dim=1)

    def _score(
        self, values: Values, beliefs: Tensor, plans: Tensor, checks: Sequence[SafetyCheck]
    ) -> Tensor:
        """Score plans (B, L, T_h); −inf where the first step may not be executed."""
        scores = score_plans(values, self.belief_filter, beliefs, plans, self.config.planner.score)
        allowed = torch.from_numpy(np.stack([check.allowed_first for check in checks]))
        first = plans[:, :, 0]
        safe = allowed.to(plans.device).gather(1, first.clamp_min(0)) & (first != NO_ACTION)
        return scores.masked_fill(~safe, -torch.inf)

    def _commit(self, checks: Sequence[SafetyCheck], plans: NDArray[np.int64]) -> list[list[int]]:
        return [
            check.committed_steps([int(a) for a in plan if a != NO_ACTION], self._execute)
            for check, plan in zip(checks, plans, strict=True)
        ]

    @property
    def _execute(self) -> int:
        return self.config.planner.execute

    def _acceptable(
        self, values: Values, beliefs: Tensor, committed: Sequence[Sequence[int]]
    ) -> Tensor:
        """Tell which commitments stand: there is one, and it makes progress if that is asked."""
        begun = torch.tensor([bool(steps) for steps in committed], device=self.device)
        if not self.config.planner.greedy_fallback:
            return begun
        padded = np.full((len(committed), self._execute), DONE)
        for row, steps in enumerate(committed):
            padded[row, : len(steps)] = steps
        after = beliefs
        for actions in torch.from_numpy(padded).to(self.device).T:
            after = self.belief_filter.predict(after, actions, values.mask)
        gain = ((after - beliefs) * values.values).sum(dim=(1, 2))
        done = torch.tensor([DONE in steps for steps in committed], device=self.device)
        return begun & (done | (gain > LEAST_PROGRESS))

    def _greedy(self, values: Values, beliefs: Tensor, checks: Sequence[SafetyCheck]) -> Tensor:
        allowed = torch.from_numpy(np.stack([check.allowed_first for check in checks]))
        return greedy_plan(
            values,
            self.belief_filter,
            beliefs,
            self.config.policy.horizon,
            ~allowed.to(self.device),
        )


def _end_with_done(plans: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.where(plans == NO_ACTION, DONE, plans)


def _standing_free(maps: NDArray[np.float32], beliefs: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the maps with the most likely cell of each robot marked as free: it stands there."""
    rows, cols = np.unravel_index(beliefs.reshape(len(maps), -1).argmax(axis=1), maps.shape[2:])
    maps = maps.copy()
    here = np.arange(len(maps))
    maps[here, OBSTACLE, rows, cols] = 0.0
    maps[here, FREE, rows, cols] = 1.0
    return maps


def _as_beliefs(cells: NDArray[Any], maps: NDArray[np.float32]) -> NDArray[np.float32]:
    """Turn cells (B, 2) or beliefs (B, H, W) into beliefs that sum to 1.

    Raises:
        ValueError: If they don't fit the maps (B, 3, H, W), with one sentence that says why.
    """
    batch, _, height, width = maps.shape
    if cells.shape == (batch, 2):
        rows, cols = np.asarray(cells, dtype=np.float64).T
        inside = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
        if not (inside & (rows == np.floor(rows)) & (cols == np.floor(cols))).all():
            bad = cells[~inside][0].tolist() if (~inside).any() else cells.tolist()
            msg = f'The cell {bad} is not on the map of {height} x {width} cells.'
            raise ValueError(msg)
        beliefs = np.zeros((batch, height, width), dtype=np.float32)
        beliefs[np.arange(batch), rows.astype(int), cols.astype(int)] = 1.0
        return beliefs
    if cells.shape != (batch, height, width):
        msg = (
            f'The robot is given by cells of shape ({batch}, 2) or beliefs of shape '
            f'({batch}, {height}, {width}), got {cells.shape}.'
        )
        raise ValueError(msg)
    beliefs = cells.astype(np.float32)
    total = beliefs.sum(axis=(1, 2), keepdims=True)
    if not (np.isfinite(beliefs).all() and (beliefs >= 0).all() and (total > 0).all()):
        msg = 'A belief must hold finite values of at least 0, not all of them 0.'
        raise ValueError(msg)
    return beliefs / total
