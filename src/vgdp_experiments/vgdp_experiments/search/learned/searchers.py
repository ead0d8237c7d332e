"""The learned methods as searchers: they see planning grids, and views from where they stand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from gridnav import DONE, GOAL, NUM_ACTIONS
from vgdp_experiments.calvin import load_calvin
from vgdp_experiments.search.learned.calvin_3d import Calvin3D
from vgdp_experiments.search.learned.lattice import LatticeMemory, heading_of
from vgdp_experiments.search.learned.no_projector import NoProjectorNetworks, NoProjectorPlanner
from vgdp_experiments.search.learned.object_value import (
    HeightMemory,
    ObjectSearchPlanner,
    load_value,
)
from vgdp_experiments.search.learned.records import WEIGHTS
from vgdp_experiments.search.learned.rgbd import RgbdNetworks, RgbdPlanner
from vgdp_planner.safety import SafetyCheck

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray
    from torch import Tensor

    from vgdp_experiments.search.searchers import Sight
    from vgdp_planner.planning_grid import PlanningGrid


class Calvin2DSearcher:
    """Takes the step of the highest Q that CALVIN finds on the projected map.

    Args:
        folder: Of its weights; those that come with the package if None.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._model = load_calvin(folder or WEIGHTS / 'calvin_2d')

    def reset(self, seed: int) -> None:
        """Begin an episode; nothing is random."""

    @torch.no_grad()
    def decide(self, sight: Sight) -> list[int]:
        """Return one step."""
        grid = sight.grid
        found = self._model(torch.from_numpy(grid.partial_map[None]))
        return safe_step(found.q_values[0, :, *grid.start].numpy(), grid)


class Calvin3DSearcher:
    """Takes the step of the highest Q that CALVIN-3D finds on its learned lattice.

    Args:
        folder: Of its weights; those that come with the package if None.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._model = Calvin3D.load(folder)
        self._memory = LatticeMemory(self._model.lattice)
        self._allowed: list[Tensor] = []

    def reset(self, seed: int) -> None:  # noqa: ARG002 - nothing is random
        """Begin an episode."""
        self._memory.begin()
        self._allowed = []

    @torch.no_grad()
    def decide(self, sight: Sight) -> list[int]:
        """Return one step. The robot looks where the last of its views does.

        Value iteration is told what was refused where the robot stood. Otherwise nothing in its
        values would change when a step is refused, and the robot would go to and fro beside a
        cell where it wants to do what it may not.
        """
        grid = sight.grid
        views = sight.views()
        lattice = self._memory.look(views, grid)
        check = _safety(grid)
        self._allowed.append(torch.from_numpy(check.allowed_first).float())
        allowed = lattice.new_ones(1, NUM_ACTIONS, *lattice.shape[2:])
        for (row, col), here in zip(self._memory.stood(grid).tolist(), self._allowed, strict=True):
            allowed[0, :, row, col] = here
        goal = torch.from_numpy(grid.partial_map[GOAL])
        allowed[0, DONE] = torch.maximum(allowed[0, DONE], goal)
        found = self._model(lattice, allowed)
        heading = int(heading_of(views.bearings[-1:])[0])
        return _best_step(found.q_values[0, heading, :, *grid.start].numpy(), check)


class NoProjectorSearcher:
    """Lets the planner decide that has a learned lattice in place of the projected map.

    Args:
        folder: Of its weights; those that come with the package if None.
    """

    def __init__(self, folder: Path | None = None) -> None:
        networks = NoProjectorNetworks.load(folder)
        self._planner = NoProjectorPlanner(networks)
        self._memory = LatticeMemory(networks.lattice)

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._planner.reset(seed)
        self._memory.begin()

    def decide(self, sight: Sight) -> list[int]:
        """Return the step that the planner commits, or the best one if no plan may be begun."""
        grid = sight.grid
        lattice = self._memory.look(sight.views(), grid)
        q_values = self._planner.look(lattice)
        plan = self._planner.plan(grid.partial_map, grid.start)
        if plan.status == 'stuck':
            return safe_step(q_values[:, *grid.start].numpy(), grid)
        return plan.committed


def safe_step(q_values: NDArray[np.float32], grid: PlanningGrid) -> list[int]:
    """Return the action of the highest Q (A,) that does not run into a known obstacle.

    Returns:
        None, to give up, where nothing worth going to is in reach.
    """
    return _best_step(q_values, _safety(grid))


def _best_step(q_values: NDArray[np.float32], check: SafetyCheck) -> list[int]:
    if check.status != 'ok':
        return []
    return [int(np.where(check.allowed_first, q_values, -np.inf).argmax())]


def _safety(grid: PlanningGrid) -> SafetyCheck:
    belief = np.zeros(grid.partial_map.shape[1:], dtype=np.float32)
    belief[grid.start] = 1.0
    return SafetyCheck(grid.partial_map, belief, 0.0)


class RgbdSearcher:
    """Lets the planner decide that reads images besides its map.

    Args:
        folder: Of its weights; those that come with the package if None.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._planner = RgbdPlanner(RgbdNetworks.load(folder))

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._planner.reset(seed)

    def decide(self, sight: Sight) -> list[int]:
        """Return what the planner commits."""
        grid = sight.grid
        rows, cols = grid.partial_map.shape[1:]
        self._planner.look(sight.views(), grid.start, (rows, cols))
        return self._planner.plan(grid.partial_map, grid.start).committed


class ObjectValueSearcher:
    """Lets the planner decide that has the object-search value.

    Args:
        folder: Of its weights; those that come with the package if None.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._planner = ObjectSearchPlanner(load_value(folder))
        self._memory = HeightMemory()

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._planner.reset(seed)
        self._memory.begin()

    def decide(self, sight: Sight) -> list[int]:
        """Return what the planner commits."""
        grid = sight.grid
        points = sight.views().points
        self._planner.look(self._memory.look(points, grid.start, grid.geometry))
        return self._planner.plan(grid.partial_map, grid.start).committed
