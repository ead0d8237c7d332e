"""Who decides where to go in a home: on planning grids and views of where the robot stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from vgdp_experiments.methods.frontier import NearestFrontier

if TYPE_CHECKING:
    from collections.abc import Callable

    from gridnav import GridGeometry
    from vgdp_experiments.search.views import SmallViews
    from vgdp_planner.planner import ValueGuidedPlanner
    from vgdp_planner.planning_grid import PlanningGrid


@dataclass(frozen=True)
class Sight:
    """What there is to decide by.

    Attributes:
        grid: The map, made ready for the planner.
        views: Reads what the robot sees from where it stands, image by image counter-clockwise,
            in the frame of the map; an image that can't be read is left out.
    """

    grid: PlanningGrid
    views: Callable[[], SmallViews]


class Searcher(Protocol):
    """Decides where to go."""

    def reset(self, seed: int) -> None:
        """Begin an episode."""

    def decide(self, sight: Sight) -> list[int]:
        """Return the steps to take before deciding again, none to give up."""


class PlannerSearcher:
    """Lets the planner decide.

    Args:
        planner: The planner.
    """

    def __init__(self, planner: ValueGuidedPlanner) -> None:
        self.settings: dict[str, Any] = planner.config.to_dict()
        self._planner = planner

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._planner.reset(seed)

    def decide(self, sight: Sight) -> list[int]:
        """Return what the planner commits."""
        grid = sight.grid
        return self._planner.plan(grid.partial_map, grid.start).committed


class FrontierSearcher:
    """Goes to the nearest frontier of the same grids until the target is seen."""

    def __init__(self) -> None:
        self._explorer = NearestFrontier()
        self._geometry: GridGeometry | None = None

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._geometry = None
        self._explorer.reset(range(1), seed)

    def decide(self, sight: Sight) -> list[int]:
        """Return one step to the nearest frontier, or to the goal."""
        grid = sight.grid
        if grid.geometry != self._geometry:
            # It knows its target by a cell, which is another place now.
            self._geometry = grid.geometry
            self._explorer.reset(range(1), 0)
        cells, active = np.array([grid.start]), np.ones(1, dtype=np.bool_)
        return self._explorer.act(grid.partial_map[None], cells, active)[0]
