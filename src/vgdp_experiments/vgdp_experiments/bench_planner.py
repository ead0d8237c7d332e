"""How long one decision of the planner takes, by the size of the map."""

from __future__ import annotations

import time
from itertools import count, islice
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

from maze_sim import MazeSimulation, make_mazes
from vgdp_experiments.options import refuse, whole_number
from vgdp_experiments.planner_options import add_planner_arguments, load_planner

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from vgdp_planner import ValueGuidedPlanner

SMALLEST = 15
"""Smaller mazes may have no start and goal far enough apart."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp bench planner``."""
    parser.add_argument(
        '--sides',
        nargs='+',
        type=whole_number(SMALLEST),
        default=[15, 30, 60, 100],
        metavar='SIDE',
        help='sides of the mazes in cells (15 30 60 100)',
    )
    parser.add_argument(
        '--decisions',
        type=whole_number(1),
        default=100,
        help='decisions to time for each side (%(default)s)',
    )
    parser.add_argument(
        '--view-range',
        type=whole_number(1),
        default=2,
        help='cells that the robot sees to each side (%(default)s)',
    )
    add_planner_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Time decisions on mazes of each size and print their median and 95th percentile."""
    try:
        planner = load_planner(args)
    except ValueError as error:
        return refuse(error)
    table = Table(title='One decision in milliseconds')
    for heading in ('map', 'decisions', 'median', '95th percentile'):
        table.add_column(heading, justify='right')
    for side in args.sides:
        decisions = decision_times(planner, side, args.view_range)
        next(decisions)  # the first one warms up
        times = np.fromiter(islice(decisions, args.decisions), dtype=np.float64)
        median, high = 1e3 * np.percentile(times, [50, 95])
        table.add_row(f'{side} x {side}', str(len(times)), f'{median:.1f}', f'{high:.1f}')
    Console().print(table)
    return 0


def decision_times(planner: ValueGuidedPlanner, side: int, view_range: int) -> Iterator[float]:
    """Let the planner walk through one maze after the other and yield each decision's seconds."""
    for seed in count():
        simulation = MazeSimulation(make_mazes(1, side, seed), view_range, max_steps=side * side)
        planner.reset(seed)
        while simulation.active[0]:
            cell = (int(simulation.cells[0, 0]), int(simulation.cells[0, 1]))
            begin = time.perf_counter()
            plan = planner.plan(simulation.partial_maps[0], cell)
            yield time.perf_counter() - begin
            for action in plan.committed:
                simulation.step(np.array([action]))
            if not plan.committed:
                simulation.give_up(np.array([0]))
