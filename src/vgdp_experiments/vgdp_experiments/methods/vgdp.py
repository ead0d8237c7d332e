"""The planner of this project."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vgdp_planner import ValueGuidedPlanner


class ValueGuidedDiffusion:
    """Asks a `ValueGuidedPlanner` for all robots that need a decision at once."""

    def __init__(self, planner: ValueGuidedPlanner) -> None:
        """Take the planner; its memory and random numbers belong to this method from now on."""
        self.settings: dict[str, Any] = planner.config.to_dict()
        self._planner = planner
        self._episodes = range(0)

    def reset(self, episodes: range, seed: int) -> None:
        """Begin new episodes with an empty best-plan memory."""
        self._planner.reset(seed)
        self._episodes = episodes

    def act(
        self,
        partial_maps: NDArray[np.float32],
        cells: NDArray[np.int64],
        active: NDArray[np.bool_],
    ) -> list[list[int]]:
        """Return the committed part of each plan."""
        rows = np.flatnonzero(active)
        plans = self._planner.plan_batch(
            partial_maps[rows], cells[rows], [self._episodes[row] for row in rows.tolist()]
        )
        committed: list[list[int]] = [[] for _ in active]
        for row, plan in zip(rows.tolist(), plans, strict=True):
            committed[row] = plan.committed
        return committed
