"""CALVIN: one step at a time, the one of the highest Q at the robot's cell."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from vgdp_experiments.calvin import SHIPPED, Calvin, load_calvin

if TYPE_CHECKING:
    import argparse

    from numpy.typing import NDArray


def add_calvin_arguments(parser: argparse.ArgumentParser) -> None:
    """Add which weights of CALVIN to load."""
    parser.add_argument(
        '--calvin-weights',
        type=Path,
        metavar='FOLDER',
        help='weights of CALVIN to load instead of those shipped',
    )


class AutoregressiveCalvin:
    """Takes argmax_a Q(s, a), whatever that is: it may run into a wall or in a circle for ever."""

    def __init__(self, model: Calvin) -> None:
        """Take the trained network."""
        self.settings: dict[str, Any] = asdict(model.config)
        self._model = model.eval()
        self._device = next(model.parameters()).device
        self._planned_on = np.empty((0, 3, 0, 0), dtype=np.float32)
        self._actions_at = np.empty((0, 0, 0), dtype=np.int64)

    @classmethod
    def from_options(cls, args: argparse.Namespace) -> AutoregressiveCalvin:
        """Load the weights that the options name.

        Raises:
            WeightsError: If the folder does not hold them, with one sentence that says why.
        """
        if args.threads is not None:
            torch.set_num_threads(args.threads)
        return cls(load_calvin(args.calvin_weights or SHIPPED).to(args.device))

    def reset(self, episodes: range, seed: int) -> None:  # noqa: ARG002
        """Begin new episodes; nothing is random."""
        self._planned_on = np.empty((0, 3, 0, 0), dtype=np.float32)

    def act(
        self,
        partial_maps: NDArray[np.float32],
        cells: NDArray[np.int64],
        active: NDArray[np.bool_],
    ) -> list[list[int]]:
        """Commit to one step each. Maps that are still the same are not planned on again."""
        if self._planned_on.shape != partial_maps.shape:
            self._planned_on = np.full_like(partial_maps, np.nan)
            self._actions_at = np.zeros(partial_maps[:, 0].shape, dtype=np.int64)
        changed = (self._planned_on != partial_maps).any(axis=(1, 2, 3))
        rows = np.flatnonzero(active & changed)
        if len(rows):
            self._planned_on[rows] = partial_maps[rows]
            with torch.inference_mode():
                maps = torch.from_numpy(partial_maps[rows]).to(self._device)
                self._actions_at[rows] = self._model(maps).q_values.argmax(dim=1).cpu().numpy()
        actions = self._actions_at[np.arange(len(cells)), cells[:, 0], cells[:, 1]]
        return [
            [action] if asking else []
            for action, asking in zip(actions.tolist(), active.tolist(), strict=True)
        ]
