"""The planner: map and belief in, the steps to execute out. Algorithm 1 of the paper."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch

from gridnav import DONE, FREE, OBSTACLE
from gridnav.partial_map import as_partial_maps
from vgdp_planner.analog_bits import NUM_BITS
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.guidance import ValueGuide
from vgdp_planner.lookout import Lookout
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.safety import SafetyCheck, Status
from vgdp_planner.selection import (
    NO_ACTION,
    Surroundings,
    agreement,
    gain,
    greedy_plan,
    score_plans,
)
from vgdp_planner.value import ValueNetwork
from vgdp_planner.weights import WeightsError, load_weights

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray
    from torch import Tensor

    from vgdp_planner.config import Config, PlannerConfig

SINGLE_NDIM = 3

LEAST_PROGRESS = 0.5
"""Cells by which the committed steps must bring the goal closer, lest the robot walks in circles:
while nothing new is seen the values stand still, so they can't rise for ever."""

PlanStatus = Status | Literal['stuck']

Stage = Literal['sampling', 'value', 'scoring', 'rest']

Source = Literal['sampled', 'memory', 'greedy', 'none']
"""Where a plan came from: a sample, the best-plan memory, greedy steps on the values."""


@dataclass(frozen=True)
class Plan:
    """What the planner decided.

    Attributes:
        actions: The best plan, T_h action indices; what follows a plan's end is Done.
        committed: The steps to execute before planning again, ending with the first Done. Empty
            if there is nothing to do (see `status`).
        value: The best plan's score: minus the cost still to come, in cells, for 'mean_return';
            for 'vote' how many samples begin like it.
        candidates: All plans that competed, int64 (N, T_h): the samples first, then the rest of
            the last best plan and the greedy plan where they took part.
        candidate_values: Their scores, (N,); −inf for a plan whose first step is not safe.
        status: 'ok'; 'exhausted' when nothing reachable is left to see and no goal was seen;
            'unreachable' when the goal was seen and no way leads there; 'stuck' when no
            candidate has a safe first step and no greedy plan may take over.
        source: Where the best plan came from.
        value_map: V(s), (H, W); NaN where nothing worth going to can be reached.
    """

    actions: NDArray[np.int64]
    committed: list[int]
    value: float
    candidates: NDArray[np.int64]
    candidate_values: NDArray[np.float32]
    status: PlanStatus
    source: Source
    value_map: NDArray[np.float32]


@dataclass
class _Episode:
    """What the planner keeps of an episode.

    Attributes:
        decisions: Made so far.
        memory: The rest of the last best plan.
        lookout: Knows how far the robot sees.
        partial_map: That of the last decision, (3, H, W); empty before the first.
        worth: Of what was unseen on it, (H, W).
    """

    decisions: int = 0
    memory: list[int] = field(default_factory=list)
    lookout: Lookout = field(default_factory=Lookout)
    partial_map: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))
    worth: Tensor = field(default_factory=lambda: torch.empty(0))


@dataclass(frozen=True)
class _Robot:
    """One row of a batch.

    Attributes:
        partial_map: (3, H, W), free where the robot stands.
        cell: The most likely one, (row, col).
        check: Of what may be executed.
        episode: That it is in.
    """

    partial_map: NDArray[np.float32]
    cell: tuple[int, int]
    check: SafetyCheck
    episode: _Episode

    def commit(self, plan: NDArray[np.int64], config: PlannerConfig) -> list[int]:
        """Return the steps of a plan that may be executed before planning again."""
        actions = [int(action) for action in plan if action != NO_ACTION]
        steps = self.check.committed_steps(actions, config.execute)
        if not config.look_first:
            return steps
        return self.episode.lookout.before_looking(self.partial_map, self.cell, steps)


class _Stopwatch:
    """Measures what the stages of a decision take."""

    def __init__(self, device: torch.device) -> None:
        self.seconds: dict[Stage, float] = dict.fromkeys(
            ('sampling', 'value', 'scoring', 'rest'), 0.0
        )
        self._device = device
        self._since = time.perf_counter()

    def lap(self, stage: Stage) -> None:
        """Add the time since the last call to a stage."""
        if self._device.type == 'cuda':
            torch.cuda.synchronize(self._device)
        now = time.perf_counter()
        self.seconds[stage] += now - self._since
        self._since = now


class ValueGuidedPlanner:
    """Samples plans from the diffusion policy and keeps the one the value function likes best.

    The planner sees the partial map and the belief, nothing else. Its memory holds the rest of
    the last best plan of each episode.

    Args:
        config: Sizes and hyperparameters.
        device: Where the networks run.

    Attributes:
        last_timings: Seconds that each stage of the last decisions took.
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
        cls,
        folder: str | Path | None = None,
        device: str = 'cpu',
        settings: Mapping[str, Any] | None = None,
    ) -> ValueGuidedPlanner:
        """Load a planner with trained weights.

        Args:
            folder: Holds `config.json` and `model.safetensors`; the shipped weights if None.
            device: Where the networks run.
            settings: Fields of `PlannerConfig` that replace those the weights come with.

        Raises:
            WeightsError: If the folder does not hold a planner, with one sentence that says why.
            ValueError: If a setting is unknown or out of range.
        """
        config, tensors = load_weights(folder)
        planner = cls(config.with_planner(settings or {}), device)
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
        self._episodes: dict[int, _Episode] = {}
        self.last_timings: dict[Stage, float] = {}

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
        watch = _Stopwatch(self.device)
        beliefs = _as_beliefs(np.asarray(cells), maps)
        names = list(range(len(maps))) if episodes is None else list(episodes)
        maps = _standing_free(maps, beliefs)
        robots = self._robots(maps, beliefs, names)
        map_tensor = torch.from_numpy(maps).to(self.device)
        belief_tensor = torch.from_numpy(beliefs).to(self.device)
        watch.lap('rest')
        values = self.value_network(map_tensor, self._worth(map_tensor, robots))
        watch.lap('value')
        around = Surroundings.cut_out(values, belief_tensor, self.config.policy.horizon)
        watch.lap('scoring')
        samples = self._sample(map_tensor, belief_tensor, around, names)
        watch.lap('sampling')
        candidates = self._with_others(samples, around, robots)
        scores, competing = self._score(around, candidates, robots)
        watch.lap('scoring')
        best, committed = self._choose(around, candidates, scores, competing, robots)
        if self.config.planner.selection == 'value':
            scores = values.without_offsets(scores)
        shown = [values.shown(row) for row in range(len(robots))]
        plans = self._decide(robots, candidates, scores, best, committed, shown)
        watch.lap('rest')
        self.last_timings = watch.seconds
        return plans

    def _robots(
        self, maps: NDArray[np.float32], beliefs: NDArray[np.float32], names: Sequence[int]
    ) -> list[_Robot]:
        """Check where each robot may go and take in what it has seen."""
        robots = []
        for partial_map, belief, name in zip(maps, beliefs, names, strict=True):
            row, col = np.unravel_index(belief.argmax(), belief.shape)
            check = SafetyCheck(partial_map, belief, self.config.planner.collision_tolerance)
            episode = self._episodes.setdefault(name, _Episode())
            robot = _Robot(partial_map, (int(row), int(col)), check, episode)
            episode.lookout.look(partial_map, robot.cell)
            robots.append(robot)
        return robots

    def _worth(self, maps: Tensor, robots: Sequence[_Robot]) -> Tensor | None:
        """Return the worth of the unseen, (B, H, W); None if it can't be kept from map to map.

        That is most of the work on large maps, and it depends on the map alone: the network is
        asked only where the map is not the one of the last decision.
        """
        if self.config.value.unseen != 'boundary' or not self.value_network.reads_map_alone:
            return None
        new = [
            row
            for row, robot in enumerate(robots)
            if not np.array_equal(robot.partial_map, robot.episode.partial_map)
        ]
        if new:
            for row, worth in zip(new, self.value_network.worth_of_unseen(maps[new]), strict=True):
                # Copies, lest one row keep the whole batch in memory.
                robots[row].episode.partial_map = robots[row].partial_map.copy()
                robots[row].episode.worth = worth.clone()
        return torch.stack([robot.episode.worth for robot in robots])

    def _sample(
        self, maps: Tensor, beliefs: Tensor, around: Surroundings, names: Sequence[int]
    ) -> Tensor:
        """Sample L plans for each map, (B, L, T_h)."""
        config = self.config.planner
        horizon = self.config.policy.horizon
        if config.candidates == 0:
            return torch.empty(len(names), 0, horizon, dtype=torch.int64, device=self.device)
        draws = config.sampling_steps if config.sampler == 'ddpm' else 1
        shape = (config.candidates, draws, NUM_BITS, horizon)
        noise = np.stack(
            [
                np.random.default_rng(
                    [self._seed, name, self._episodes[name].decisions]
                ).standard_normal(shape, dtype=np.float32)
                for name in names
            ]
        )
        guide = None
        if config.guidance:
            guide = ValueGuide(around, self.belief_filter, config.score, config.guidance)
        return self.policy.sample(
            maps,
            beliefs,
            torch.from_numpy(noise).to(self.device),
            config.sampling_steps,
            config.sampler,
            guide,
        )

    def _with_others(
        self, samples: Tensor, around: Surroundings, robots: Sequence[_Robot]
    ) -> Tensor:
        """Add the rest of the last best plan and the greedy plan, (B, L + 2, T_h).

        Where there is none, its place is filled with `NO_ACTION`.
        """
        others = np.full((2, len(robots), samples.shape[2]), NO_ACTION)
        if self.config.planner.memory:
            for row, robot in enumerate(robots):
                rest = robot.episode.memory
                others[0, row, : len(rest)] = rest
        remembered, greedy = torch.from_numpy(others).to(self.device)
        if self.config.planner.greedy_fallback:
            greedy = greedy_plan(around, self.belief_filter, ~self._allowed_first(robots))
        return torch.cat([samples, remembered[:, None], greedy[:, None]], dim=1)

    def _allowed_first(self, robots: Sequence[_Robot]) -> Tensor:
        allowed = np.stack([robot.check.allowed_first for robot in robots])
        return torch.from_numpy(allowed).to(self.device)

    def _score(
        self, around: Surroundings, candidates: Tensor, robots: Sequence[_Robot]
    ) -> tuple[Tensor, Tensor]:
        """Score the candidates and tell which of them compete, (B, L + 2) each.

        A score is −inf where the first step may not be executed. The greedy plan does not
        compete, but those compete whose committed steps lose little against it.
        """
        config = self.config.planner
        scores, begins = score_plans(
            around, self.belief_filter, candidates, config.score, config.execute
        )
        count = config.candidates
        if config.selection == 'vote' or config.agreement:
            begin_alike, alike = agreement(candidates, count, config.execute)
            if config.selection == 'vote':
                # Whole plans break ties: all of them together count less than one beginning.
                scores = begin_alike + alike / (count + 1)
            else:
                # The remembered plan may be like none of the samples; one more avoids log 0.
                share = (begin_alike + 1) / (count + 1)
                scores = scores + config.agreement * share.log()
        first = candidates[:, :, 0]
        safe = self._allowed_first(robots).gather(1, first.clamp_min(0)) & (first != NO_ACTION)
        competing = safe.clone()
        competing[:, -1] = False
        if config.greedy_fallback:
            competing &= begins[:, -1:] - begins <= config.tolerated_loss
        return scores.masked_fill(~safe, -torch.inf), competing

    def _choose(
        self,
        around: Surroundings,
        candidates: Tensor,
        scores: Tensor,
        competing: Tensor,
        robots: Sequence[_Robot],
    ) -> tuple[list[int], list[list[int]]]:
        """Return each robot's best candidate and the steps of it to execute."""
        config = self.config.planner
        best = scores.masked_fill(~competing, -torch.inf).argmax(dim=1).tolist()
        plans = candidates.cpu().numpy()
        committed = [
            robot.commit(of_robot[index], config)
            for robot, of_robot, index in zip(robots, plans, best, strict=True)
        ]
        stands = competing.any(dim=1)
        if config.greedy_fallback:
            stands &= self._progresses(around, committed)
        for row in torch.nonzero(~stands)[:, 0].tolist():
            best[row] = plans.shape[1] - 1
            committed[row] = robots[row].commit(plans[row, -1], config)
        return best, committed

    def _progresses(self, around: Surroundings, committed: Sequence[Sequence[int]]) -> Tensor:
        """Tell which commitments bring the goal closer, in value, or end with Done."""
        padded = np.full((len(committed), self.config.planner.execute), DONE)
        for row, steps in enumerate(committed):
            padded[row, : len(steps)] = steps
        risen = gain(around, self.belief_filter, torch.from_numpy(padded).to(self.device))
        done = torch.tensor([DONE in steps for steps in committed], device=self.device)
        return done | (risen > LEAST_PROGRESS)

    def _decide(
        self,
        robots: Sequence[_Robot],
        candidates: Tensor,
        scores: Tensor,
        best: Sequence[int],
        committed: Sequence[list[int]],
        value_maps: Sequence[NDArray[np.float32]],
    ) -> list[Plan]:
        """Put the plans together and note what the next decisions need."""
        decided = []
        greedy = candidates.shape[1] - 1
        all_plans, all_scores = candidates.cpu().numpy(), scores.cpu().numpy()
        for robot, plans, of_plans, index, steps, value_map in zip(
            robots, all_plans, all_scores, best, committed, value_maps, strict=True
        ):
            status: PlanStatus = robot.check.status
            if status == 'ok' and not steps:
                status = 'stuck'
            going = status == 'ok'
            rest = plans[index, len(steps) :]
            ends = not going or DONE in steps
            robot.episode.memory = [] if ends else [int(a) for a in rest if a != NO_ACTION]
            robot.episode.decisions += 1
            # The places of an empty memory and of a greedy plan that was not needed.
            present = plans[:, 0] != NO_ACTION
            present[greedy] &= index == greedy
            decided.append(
                Plan(
                    actions=_end_with_done(plans[index]),
                    committed=steps if going else [],
                    value=float(of_plans[index]),
                    candidates=_end_with_done(plans[present]),
                    candidate_values=of_plans[present],
                    status=status,
                    source=self._source(index) if going else 'none',
                    value_map=value_map,
                )
            )
        return decided

    def _source(self, index: int) -> Source:
        count = self.config.planner.candidates
        if index < count:
            return 'sampled'
        return 'memory' if index == count else 'greedy'


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
