"""A whole way from here to there, planned on a map that stands still."""

from __future__ import annotations

import copy
import time
from typing import TYPE_CHECKING

import numpy as np

from gridnav import DONE, FREE, OBSTACLE, STEPS, valid_moves

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from vgdp_planner.planner import Plan, ValueGuidedPlanner
    from vgdp_planner.planning_grid import Cell, PlanningGrid


class NoRouteError(Exception):
    """No way leads from here to there."""


class RouteTimeoutError(Exception):
    """The time was over before the way was found."""


def known_way(partial_map: NDArray[np.float32], cell: Cell, actions: Sequence[int]) -> list[Cell]:
    """Return the cells that a plan goes through, up to Done or a step into a known obstacle.

    Args:
        partial_map: (3, H, W).
        cell: Where the robot is, (row, col); the first one returned.
        actions: The plan.
    """
    valid = valid_moves(partial_map[OBSTACLE] > 0)
    cells = [cell]
    for action in actions:
        row, col = cells[-1]
        if action == DONE or not valid[action, row, col]:
            break
        row_step, col_step = STEPS[action].tolist()
        cells.append((row + row_step, col + col_step))
    return cells


def plan_blocks(grid: PlanningGrid, plan: Plan) -> tuple[list[Cell], int]:
    """Return the blocks that a plan goes through, and the index of that which is committed to.

    Both are those of the robot where the planner gave up.
    """
    going = plan.status == 'ok'
    blocks = known_way(grid.partial_map, grid.start, plan.actions.tolist() if going else [])
    return blocks, min(sum(action != DONE for action in plan.committed), len(blocks) - 1)


def seen_way(partial_map: NDArray[np.float32], cells: Sequence[Cell]) -> list[Cell]:
    """Return the cells of a plan up to the first one that has not been seen, which is included.

    The value of a plan ends there: what it would do after looking around is anybody's guess.

    Args:
        partial_map: (3, H, W).
        cells: The plan; the first one is where the robot is.
    """
    for index, cell in enumerate(cells[1:], start=1):
        if partial_map[(FREE, *cell)] == 0:
            return list(cells[: index + 1])
    return list(cells)


def onward_way(cells: Sequence[Cell], committed: int) -> list[Cell]:
    """Return the cells of a plan up to where it comes back after the committed steps.

    By then there is another plan, and who follows the path would cut off its turn.

    Args:
        cells: The plan; the first one is where the robot is.
        committed: How many steps are committed.
    """
    begun = np.array(cells[:committed]).reshape(-1, 2)
    for index in range(committed + 1, len(cells)):
        if (np.abs(begun - cells[index]).max(axis=1) <= 1).any():
            return list(cells[:index])
    return list(cells)


def find_route(
    planner: ValueGuidedPlanner, grid: PlanningGrid, seed: int, time_limit: float
) -> NDArray[np.float64]:
    """Return the way to the goal of a grid, as if all that is unseen on it were free.

    The planner plans, its plan is taken to the end, and so on until it says Done. Its own episode
    is left alone.

    Args:
        planner: Which plans.
        grid: With the robot and the goal.
        seed: Of the planner's random numbers.
        time_limit: In seconds.

    Returns:
        (x, y) in metres, (N, 2).

    Raises:
        NoRouteError: If no way leads there.
        RouteTimeoutError: If it takes longer than that.
    """
    ends = time.monotonic() + time_limit
    # Networks are shared, memory and random numbers are not.
    planner = copy.copy(planner)
    partial_map = grid.partial_map.copy()
    cells, begun = [grid.start], set()
    while True:
        planner.reset(seed)
        plan = planner.plan(partial_map, cells[-1])
        if plan.status != 'ok' or not plan.committed:
            msg = 'The goal can not be reached on this map.'
            raise NoRouteError(msg)
        if plan.committed[0] == DONE:
            return grid.way(cells)
        # From where a whole plan led back to, what is committed makes progress.
        actions = plan.committed if cells[-1] in begun else plan.actions.tolist()
        begun.add(cells[-1])
        cells += seen_way(partial_map, known_way(partial_map, cells[-1], actions))[1:]
        for cell in cells:
            partial_map[(FREE, *cell)] = 1.0
        if time.monotonic() > ends:
            msg = f'No way to the goal was found within {time_limit} s.'
            raise RouteTimeoutError(msg)
