"""A robot that looks for a thing in a scene: what the environment and the node share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from avd_player.scene import TargetSightings
from gridnav.actions import DONE, NUM_ACTIONS, STEPS
from gridnav.metrics import EpisodeResult, Outcome

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from avd_player.scene import Scene

VIEWS = ('all', 'heading')
"""What the robot sees at a position: all around, or where it looks."""

GOAL_MOVED_M = 0.15
"""The target is where it was until later looks put it as far away as this."""

DEFAULT_TARGET = 'coca_cola_glass_bottle'


@dataclass(frozen=True)
class SearchRules:
    """When a search has succeeded, and what the robot sees.

    Attributes:
        target: Name of the instance to look for.
        reach: Horizontal distance from the target within which Done succeeds, in metres. Of the
            positions that lead to each other, the nearest to the target always does.
        max_difficulty: Boxes of the target count as seen up to this difficulty, 1 to 5 by their
            size: 4 is 50 x 30 pixels of 1920 x 1080, and smaller ones are not labelled reliably.
        max_range: The target is not seen from further away, in metres.
        max_steps: Actions after which the search ends.
        min_expert_steps: Moves from the start to where Done succeeds, at least.
        views: ``'all'`` images of a position, or that of the ``'heading'`` alone.
    """

    target: str = DEFAULT_TARGET
    reach: float = 1.0
    max_difficulty: int = 4
    max_range: float = 6.0
    max_steps: int = 500
    min_expert_steps: int = 10
    views: str = 'all'

    def __post_init__(self) -> None:
        """Refuse what can't be."""
        if self.views not in VIEWS:
            msg = f"The views must be 'all' or 'heading', got {self.views!r}."
            raise ValueError(msg)
        if not (self.reach >= 0 and self.max_range > 0):
            msg = f'Reach and range must be above 0 m, got {self.reach} and {self.max_range}.'
            raise ValueError(msg)
        if self.max_steps < 1 or self.min_expert_steps < 0:
            msg = (
                f'At least one action is needed and no fewer than 0 moves, got {self.max_steps} '
                f'and {self.min_expert_steps}.'
            )
            raise ValueError(msg)


class Finder(Protocol):
    """Finds the target in images, maybe not always, and maybe where it is not.

    Attributes:
        sure: So many sightings at one place are no mistake.
    """

    sure: int

    def sightings(self, name: str) -> Sequence[NDArray[np.float64]]:
        """Return where the target seems to be in an image, metres in the map, (3,) each."""

    def shows(self, name: str, place: NDArray[np.float64]) -> bool:
        """Tell whether an image would show the target well if it were at a place (3,)."""


class Labels:
    """Finds the target where the boxes of the dataset say that it is; they need no second look.

    Args:
        visible: Where the target is, by image, (3,) each.
    """

    sure = 1

    def __init__(self, visible: Mapping[str, NDArray[np.float64]]) -> None:
        self._visible = visible

    def sightings(self, name: str) -> Sequence[NDArray[np.float64]]:
        """See `Finder`."""
        return [self._visible[name]] if name in self._visible else []

    def shows(self, name: str, place: NDArray[np.float64]) -> bool:  # noqa: ARG002
        """See `Finder`; where there is no box, the target may still be."""
        return False


class Expert(NamedTuple):
    """The shortest ways to where Done succeeds, for one who knows the scene.

    Attributes:
        costs: Length of the way from each position in steps of 0.30 m, infinite for none, (P,).
        steps: Its moves, (P,).
        after: Length of the way for one who has seen the target already, (P,).
    """

    costs: NDArray[np.float64]
    steps: NDArray[np.int64]
    after: NDArray[np.float64]


class ActiveVisionSimulation:
    """One robot in one scene.

    A move leads to the next position in its direction; where there is none the robot stays. The
    robot looks where it last moved, moved or not. A search ends with Done, or when the budget is
    spent.

    Attributes:
        scene: Where it moves.
        rules: What it looks for.
        goals: Which positions Done succeeds at once the target was seen, (P,) bool.
        position: The index of the robot's position.
        view: The index of the image, among those of the position, that looks where it looks.
        outcome: How the search ended, or that it runs.
        steps: Actions taken.
        bumps: Moves that led nowhere.
        path_cost: Length of the way in steps of 0.30 m.
        sightings: What it saw of the target, or took for it.
        target_seen: Whether it truly was in sight, without which Done does not succeed.
    """

    def __init__(
        self, scene: Scene, rules: SearchRules | None = None, finder: Finder | None = None
    ) -> None:
        """Find the target's sightings and the positions to start from.

        Args:
            scene: Where the robot moves.
            rules: What it looks for.
            finder: What tells the robot where the target is, the labels of the scene if None.

        Raises:
            ValueError: If there is no such target in the scene, or no position to start from.
        """
        self.scene = scene
        self.rules = rules = rules or SearchRules()
        instance = scene.instance_id(rules.target)
        self._visible = scene.sightings(instance, rules.max_difficulty, rules.max_range)
        if not self._visible:
            msg = (
                f'{rules.target} is nowhere to be seen in {scene.name}, with boxes of difficulty '
                f'{rules.max_difficulty} at most and depth up to {rules.max_range:g} m.'
            )
            raise ValueError(msg)
        self._finder: Finder = finder or Labels(self._visible)
        true_sightings = TargetSightings()
        for name, point in self._visible.items():
            true_sightings.add(name, point)
        self.targets = true_sightings.things
        self.goals = self._goals()
        self.starts = np.flatnonzero(
            np.isfinite(self.expert.costs) & (self.expert.steps >= rules.min_expert_steps)
        )
        if not len(self.starts):
            reachable = self.expert.steps[np.isfinite(self.expert.costs)]
            msg = (
                f'{scene.name} has no position {rules.min_expert_steps} moves from where '
                f'{rules.target} is; the furthest is {reachable.max(initial=0)}.'
            )
            raise ValueError(msg)
        self.restart(0)

    def restart(self, seed: int | Sequence[int] = 0, start: int | None = None) -> None:
        """Begin a new search.

        Args:
            seed: Of the start.
            start: Index of the position to start from; drawn if None.

        Raises:
            ValueError: If there is no such position.
        """
        if start is not None and not 0 <= start < len(self.scene.views):
            msg = f'A start is a position from 0 to {len(self.scene.views) - 1}, got {start}.'
            raise ValueError(msg)
        drawn = int(np.random.default_rng(seed).choice(self.starts))
        self.position = self.start = drawn if start is None else start
        self._yaw = 0.0
        self.outcome = Outcome.RUNNING
        self.steps = self.bumps = 0
        self.path_cost = 0.0
        self.sightings = TargetSightings(self._finder.sure)
        self.target_seen = False
        self._goal: tuple[float, float, float] | None = None
        self._look()

    def step(self, action: int) -> None:
        """Take one action and look around; nothing happens once the search has ended.

        Raises:
            ValueError: If the action is not an index from 0 to 8.
        """
        if not 0 <= action < NUM_ACTIONS:
            msg = f'An action is an index from 0 to {DONE}, got {action}.'
            raise ValueError(msg)
        if self.outcome is not Outcome.RUNNING:
            return
        self.steps += 1
        if action == DONE:
            succeeds = self.target_seen and self.goals[self.position]
            self.outcome = Outcome.SUCCESS if succeeds else Outcome.FALSE_DONE
            return
        target = int(self.scene.moves[self.position, action])
        if target < 0:
            self.bumps += 1
        else:
            self.path_cost += float(self.scene.costs[self.position, action])
            self.position = target
        row_step, col_step = STEPS[action].tolist()
        self._yaw = float(np.arctan2(row_step, col_step))
        self._look()
        if self.steps >= self.rules.max_steps:
            self.outcome = Outcome.TIMEOUT

    def give_up(self) -> None:
        """End the search as given up, if it runs."""
        if self.outcome is Outcome.RUNNING:
            self.outcome = Outcome.GAVE_UP

    def doubt(self) -> None:
        """Give up the goal as a mistake, until it is seen again."""
        self.sightings.doubt()
        self._note_goal()

    @property
    def seen_names(self) -> list[str]:
        """File names of the images that the robot sees now."""
        names = self.scene.views[self.position]
        return list(names) if self.rules.views == 'all' else [names[self.view]]

    @property
    def looked_at(self) -> list[str]:
        """File names of the images that the robot sees now, the one of its heading last."""
        names = self.seen_names
        ahead = names.index(self.heading_name)
        return names[ahead + 1 :] + names[: ahead + 1]

    @property
    def heading_name(self) -> str:
        """File name of the image that looks where the robot looks."""
        return self.scene.views[self.position][self.view]

    @property
    def goal(self) -> tuple[float, float, float] | None:
        """Where the target is, as far as the robot saw it: metres in the map.

        Later looks count when they put it somewhere else by 0.15 m at least.
        """
        return self._goal

    def result(self) -> EpisodeResult:
        """Return what the search came to so far."""
        return EpisodeResult(
            self.outcome,
            self.steps,
            self.path_cost,
            int(self.expert.steps[self.start]),
            float(self.expert.costs[self.start]),
        )

    @cached_property
    def expert(self) -> Expert:
        """The shortest ways on which the target is seen, before or on arrival."""
        scene = self.scene
        count = len(scene.views)
        sees = np.array([any(n in self._visible for n in names) for names in scene.views])
        here, move = np.nonzero(scene.moves >= 0)
        # Two moves may lead to one position, and a sparse matrix would add them up.
        edges = {
            (p, int(scene.moves[p, m])): scene.costs[p, m]
            for p, m in zip(here.tolist(), move.tolist(), strict=True)
        }
        here, there = np.array(list(edges), dtype=np.int64).reshape(-1, 2).T
        lengths = np.array(list(edges.values()))
        # State p has not seen the target yet, state p + count has. Edges are turned round.
        before = there + count * sees[there]
        graph = csr_matrix(
            (
                np.concatenate([lengths, lengths]),
                (np.concatenate([before, there + count]), np.concatenate([here, here + count])),
            ),
            (2 * count, 2 * count),
        )
        ends = np.flatnonzero(self.goals) + count
        costs, previous, _ = dijkstra(graph, indices=ends, min_only=True, return_predecessors=True)
        steps = np.zeros(2 * count, dtype=np.int64)
        for state in np.argsort(costs):
            if previous[state] >= 0:
                steps[state] = steps[previous[state]] + 1
        first = np.arange(count) + count * sees
        return Expert(costs[first], steps[first], costs[count:])

    def _goals(self) -> NDArray[np.bool_]:
        """Tell at which positions Done succeeds, (P,)."""
        positions, components = self.scene.positions, self.scene.components
        goals = np.zeros(len(positions), dtype=np.bool_)
        connected = np.flatnonzero(components == np.bincount(components).argmax())
        for target in self.targets:
            distances = np.hypot(*(positions - target[:2]).T)
            goals |= distances <= self.rules.reach
            goals[connected[distances[connected].argmin()]] = True
        return goals

    def _look(self) -> None:
        """Turn to where the robot looks and note whether the target is seen."""
        off = np.angle(np.exp(1j * (self.scene.headings[self.position] - self._yaw)))
        self.view = int(np.abs(off).argmin())
        for name in self.seen_names:
            found = self._finder.sightings(name)
            self.target_seen |= name in self._visible or self._are_true(found)
            self.sightings.look(name, found, partial(self._finder.shows, name))
        self._note_goal()

    def _are_true(self, found: Sequence[NDArray[np.float64]]) -> bool:
        """Tell whether one of the sightings is of the target: what was seen was in sight."""
        return any(
            np.linalg.norm(place - target) <= self.rules.reach
            for place in found
            for target in self.targets
        )

    def _note_goal(self) -> None:
        position = self.sightings.position
        if position is None:
            self._goal = None
            return
        known = self._goal
        if known is None or np.linalg.norm(position - known) >= GOAL_MOVED_M:
            x, y, z = position.tolist()
            self._goal = (x, y, z)
