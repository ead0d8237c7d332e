"""What may be executed, decided by the observed map alone, whatever the networks say."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy import ndimage

from gridnav import DONE, FREE, GOAL, NUM_ACTIONS, OBSTACLE, STEPS, valid_moves

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Status = Literal['ok', 'exhausted', 'unreachable']

FOUR_NEIGHBOURS = ndimage.generate_binary_structure(2, 1)


class SafetyCheck:
    """Checks plans against what has been observed.

    Args:
        partial_map: (3, H, W).
        belief: Where the robot may be, summing to 1, (H, W).
        tolerance: A step may run into a known obstacle from this share of the belief at most;
            never from the most likely cell. Where no step is that safe, the safest one is.

    Attributes:
        status: Whether anything worth going to is in reach.
        allowed_first: Which actions may come first, bool (A,).
    """

    def __init__(
        self, partial_map: NDArray[np.float32], belief: NDArray[np.float32], tolerance: float
    ) -> None:
        self._goal = partial_map[GOAL] > 0
        self._unseen = (partial_map[OBSTACLE] == 0) & (partial_map[FREE] == 0)
        self._collides = ~valid_moves(partial_map[OBSTACLE] > 0)
        self._cells = np.argwhere(belief > 0)
        self._weights = belief[tuple(self._cells.T)]
        self._likeliest = int(self._weights.argmax())
        start = tuple(self._cells[self._likeliest])
        self.status: Status = self._reachability(partial_map[OBSTACLE] == 0, start)

        risks = np.array([self._risk(action, self._cells) for action in range(len(STEPS))])
        self._tolerance = max(tolerance, min(risks.min(), 1.0))
        self.allowed_first = np.zeros(NUM_ACTIONS, dtype=np.bool_)
        self.allowed_first[: len(STEPS)] = risks <= self._tolerance
        self.allowed_first[DONE] = self._goal[start]

    def _reachability(self, can_be_entered: NDArray[np.bool_], start: tuple[int, ...]) -> Status:
        """Tell whether the goal or anything unseen is in reach.

        A diagonal step needs an open cell beside it, so what can be reached at all can be
        reached by orthogonal steps.
        """
        components, _ = ndimage.label(can_be_entered, structure=FOUR_NEIGHBOURS)
        around = (components == components[start]) & can_be_entered
        if (around & (self._goal | self._unseen)).any():
            return 'ok'
        return 'unreachable' if self._goal.any() else 'exhausted'

    def _risk(self, action: int, cells: NDArray[np.int64]) -> float:
        """Return the share of the belief, now on these cells, that a step makes collide.

        Infinite if the most likely cell is among them.
        """
        colliding = self._collides[action][tuple(cells.T)]
        return float('inf') if colliding[self._likeliest] else float(self._weights @ colliding)

    def committed_steps(self, actions: Sequence[int], limit: int) -> list[int]:
        """Return the first steps of a plan that may be executed before looking again.

        Only the first step may enter a cell that has not been seen, and nothing follows it.
        Done is in only on the observed goal, and nothing follows it.

        Args:
            actions: The plan.
            limit: Most steps T_a to commit.

        Returns:
            The committed actions; none if the first one may not be executed.
        """
        cells = self._cells
        committed: list[int] = []
        for action in actions[:limit]:
            if action == DONE:
                if self._goal[tuple(cells[self._likeliest])]:
                    committed.append(DONE)
                break
            if self._risk(action, cells) > self._tolerance:
                break
            stays = self._collides[action][tuple(cells.T)]
            cells = np.where(stays[:, None], cells, cells + STEPS[action])
            enters_unseen = self._unseen[tuple(cells[self._likeliest])]
            if enters_unseen and committed:
                break
            committed.append(action)
            if enters_unseen:
                break
        return committed
