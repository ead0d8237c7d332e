"""How an episode ended, and what many of them say together."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence


class Outcome(StrEnum):
    """How an episode ended, or that it has not."""

    RUNNING = 'running'
    SUCCESS = 'success'
    """Done on the goal."""
    COLLISION = 'collision'
    """A step into an obstacle or off the map."""
    FALSE_DONE = 'false_done'
    """Done somewhere else."""
    TIMEOUT = 'timeout'
    """The step budget ran out."""
    REPEAT = 'repeat'
    """An exact loop, where the environment was asked to look for one."""
    GAVE_UP = 'gave_up'
    """The planner said that nothing reachable is left to explore, or no way leads to the goal."""


@dataclass(frozen=True)
class EpisodeResult:
    """One finished episode.

    Attributes:
        outcome: How it ended.
        steps: Actions taken, Done included.
        path_cost: Length of the way in cells, √2 for a diagonal step.
        expert_steps: Steps of the full-knowledge expert, without its Done.
        expert_cost: Length of the expert's way in cells.
    """

    outcome: Outcome
    steps: int
    path_cost: float
    expert_steps: int
    expert_cost: float

    @property
    def success(self) -> bool:
        """Whether the robot stood on the goal and said Done."""
        return self.outcome is Outcome.SUCCESS

    @property
    def spl(self) -> float:
        """Success weighted by path length (Anderson et al. 2018), by path cost."""
        if not self.success:
            return 0.0
        return self.expert_cost / max(self.path_cost, self.expert_cost, 1e-9)

    @property
    def spl_steps(self) -> float:
        """Success weighted by path length, counted in moves (Done is no move)."""
        if not self.success:
            return 0.0
        return self.expert_steps / max(self.steps - 1, self.expert_steps, 1)


@dataclass(frozen=True)
class Summary:
    """What a set of episodes says together.

    Attributes:
        episodes: How many there were.
        success: Success rate.
        success_low: Lower end of its 95 % Wilson interval.
        success_high: Upper end of its 95 % Wilson interval.
        spl: Mean SPL by path cost.
        spl_steps: Mean SPL by steps.
        steps: Mean number of actions.
        failures: How many episodes ended for each reason other than success.
    """

    episodes: int
    success: float
    success_low: float
    success_high: float
    spl: float
    spl_steps: float
    steps: float
    failures: dict[str, int] = field(default_factory=dict)


def summarize(results: Sequence[EpisodeResult]) -> Summary:
    """Sum up finished episodes.

    Raises:
        ValueError: If there are none.
    """
    # Here, as it would more than double the time that each node takes to start.
    from scipy.stats import binomtest  # noqa: PLC0415

    if not results:
        msg = 'There are no episodes to sum up.'
        raise ValueError(msg)
    successes = sum(result.success for result in results)
    interval = binomtest(successes, len(results)).proportion_ci(method='wilson')
    return Summary(
        episodes=len(results),
        success=successes / len(results),
        success_low=float(interval.low),
        success_high=float(interval.high),
        spl=float(np.mean([result.spl for result in results])),
        spl_steps=float(np.mean([result.spl_steps for result in results])),
        steps=float(np.mean([result.steps for result in results])),
        failures=dict(
            Counter(str(result.outcome) for result in results if not result.success).most_common()
        ),
    )
