"""What the steps of an exploration are labelled with: how good it was to go there.

An explorer that looks everywhere finds every goal at some cost. The label of a step is a mean over
the goals that had not been seen by then, of what each brings:

- ``success``: γ^cost, a success that counts less the longer it takes from there on, with
  γ = exp(-1 / τ). What is found late hardly counts, so it is good to look first where most of the
  goals may be, as SPL rewards it, and to leave the odd corner for later. The patience τ grows with
  the map's side: on large maps all goals take long. With a very large τ this is the mean cost.
- ``spl``: the SPL itself, the shortest way from the start over the cost of reaching the goal. Its
  patience is the cost after which it falls e times, were it to fall on as it does there: short at
  first, when a detour of ten cells may halve the SPL, and longer the more was spent.
- ``expert``: γ^cost, but the cost of one who knows the world from there on. That is what QMDP
  believes: that all will be seen after one step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

OBJECTIVES = ('success', 'spl', 'expert')


@dataclass(frozen=True)
class Labels:
    """What steps are labelled with.

    Attributes:
        objective: One of `OBJECTIVES`.
        patience: After so many sides of the map a success counts e times less; not for ``spl``.

    Raises:
        ValueError: If there is no such objective, or the patience is not above 0.
    """

    objective: str = 'success'
    patience: float = 2.0

    def __post_init__(self) -> None:
        """Check the values."""
        if self.objective not in OBJECTIVES:
            msg = f'There is no objective {self.objective!r}; there are {", ".join(OBJECTIVES)}.'
            raise ValueError(msg)
        if not self.patience > 0:
            msg = f'A patience of {self.patience} sides of the map is not above 0.'
            raise ValueError(msg)

    def of(
        self,
        goals: NDArray[np.bool_],
        to_come: NDArray[np.float64],
        spent: NDArray[np.float64],
        ways: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Label steps.

        Args:
            goals: Which are possible, (N, H, W).
            to_come: What is still to come until each is reached, (N, H, W), in cells.
            spent: What was spent before, (N,).
            ways: Shortest ways from the start, (N, H, W).

        Returns:
            What the goals bring on average, as a share of what they would with nothing to come,
            the patience in cells, and what they would bring, summed over the goals; each (N,).
        """
        if self.objective == 'spl':
            return expected_spl(goals, to_come, spent, ways)
        patience = self.patience * max(goals.shape[1:])
        number = goals.sum(axis=(1, 2)).astype(np.float64)
        total = np.where(goals, np.exp(-to_come / patience), 0.0).sum(axis=(1, 2))
        return total / np.maximum(number, 1), np.full(len(goals), patience), number


def expected_spl(
    goals: NDArray[np.bool_],
    to_come: NDArray[np.float64],
    spent: NDArray[np.float64],
    ways: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return what `Labels.of` does, for the SPL.

    A goal brings d / max(c, d): its shortest way over what reaching it has cost by then. The
    patience is -(∂ log SPL / ∂ cost)^-1.
    """
    spent = spent[:, None, None]

    def summed(terms: NDArray[np.float64]) -> NDArray[np.float64]:
        total: NDArray[np.float64] = np.where(goals, terms, 0.0).sum(axis=(1, 2))
        return total

    ways = np.where(goals, ways, 1.0)
    costs = np.maximum(spent + np.where(goals, to_come, 0.0), ways)
    spl, at_once = summed(ways / costs), summed(ways / np.maximum(spent, ways))
    some = goals.any(axis=(1, 2))
    share = np.divide(spl, at_once, out=np.zeros_like(spl), where=some)
    patience = np.divide(spl, summed(ways / costs**2), out=np.ones_like(spl), where=some)
    return share, patience, at_once
