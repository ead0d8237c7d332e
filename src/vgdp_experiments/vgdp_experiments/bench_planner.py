"""How long one decision of the planner takes: by the map's size, stage, and the candidates."""

from __future__ import annotations

import json
import os
import platform
import time
from collections import deque
from dataclasses import asdict, dataclass
from itertools import count, islice
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np
import torch
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from gridnav import DONE, FREE
from maze_sim import MazeSimulation, make_mazes
from vgdp_experiments.files import write_whole
from vgdp_experiments.methods.frontier import NearestFrontier
from vgdp_experiments.options import refuse, whole_number
from vgdp_experiments.planner_options import add_planner_arguments, load_planner
from vgdp_planner.planner import Stage

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from vgdp_planner import ValueGuidedPlanner

SMALLEST = 15
"""Smaller mazes may have no start and goal far enough apart."""

EXPLORED = 0.5
"""Share of the free cells that has been seen when the decisions begin to be timed."""

STAGES: tuple[Stage, ...] = get_args(Stage)

TARGETS_MS = {15: 40.0, 30: 100.0, 100: 300.0}
"""What a decision may take at most on two CPU cores, by the map's side."""

BATCHED_TARGET = 200.0
"""Decisions a second that 100 episodes at once should make at least, on maps of 15 x 15."""


@dataclass(frozen=True)
class Decisions:
    """Decisions that were made at once.

    Attributes:
        count: How many.
        seconds: What they took together.
        processor: Of these, seconds of the processors, those of all threads.
        stages: What each stage of it took, in seconds.
        partial_maps: What was known, (count, 3, H, W).
    """

    count: int
    seconds: float
    processor: float
    stages: dict[Stage, float]
    partial_maps: NDArray[np.float32]


@dataclass(frozen=True)
class SideResult:
    """What decisions on maps of one size took.

    Attributes:
        side: Of the map, in cells.
        decisions: How many were timed, after one that warmed up.
        median_ms: Median of a decision.
        p95_ms: 95th percentile.
        processor_ms: Median of the processors' time, which other programs disturb little.
        shares: Share of each stage in the whole time.
        rounds: Most rounds of value iteration that a decision took.
        residual: Largest residual that one was left with.
        target_ms: What the median should be at most, if there is a target for this side.
    """

    side: int
    decisions: int
    median_ms: float
    p95_ms: float
    processor_ms: float
    shares: dict[str, float]
    rounds: int
    residual: float
    target_ms: float | None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp bench planner``."""
    parser.add_argument(
        '--sides',
        nargs='+',
        type=whole_number(SMALLEST),
        default=[15, 30, 50, 100],
        metavar='SIDE',
        help='sides of the mazes in cells (15 30 50 100)',
    )
    parser.add_argument(
        '--candidates',
        nargs='+',
        type=whole_number(1),
        default=[1, 8, 24, 64],
        metavar='N',
        help='numbers of sampled plans to compare, on the first side (1 8 24 64)',
    )
    parser.add_argument(
        '--decisions',
        type=whole_number(2),
        default=50,
        help='decisions to time for each row of a table (%(default)s)',
    )
    parser.add_argument(
        '--episodes',
        type=whole_number(1),
        default=100,
        help='episodes that ask at once, on the first side (%(default)s)',
    )
    parser.add_argument(
        '--view-range',
        type=whole_number(1),
        default=2,
        help='cells that the robot sees to each side (%(default)s)',
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='file to write the numbers to')
    add_planner_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Time decisions, print the tables and write the numbers; returns the exit status."""
    try:
        planner = load_planner(args)
    except ValueError as error:
        return refuse(error)
    sides = [
        time_side(planner, side, args.decisions, args.view_range) for side in sorted(args.sides)
    ]
    first = sides[0].side
    by_candidates = {
        number: time_side(
            load_planner(args, {'candidates': number}), first, args.decisions, args.view_range
        )
        for number in args.candidates
    }
    per_second = batched_rate(planner, first, args.episodes, args.view_range)
    exponent = growth([(result.side, result.median_ms) for result in sides])
    print_results(planner, sides, by_candidates, exponent, (args.episodes, per_second))
    if args.json is not None:
        record = {
            'machine': machine(),
            'planner': asdict(planner.config.planner),
            'view_range': args.view_range,
            'sides': [asdict(result) for result in sides],
            'exponent': exponent,
            'candidates': {number: asdict(result) for number, result in by_candidates.items()},
            'batched': {
                'side': first,
                'episodes': args.episodes,
                'decisions_per_second': per_second,
                'target': BATCHED_TARGET,
            },
        }
        args.json.parent.mkdir(parents=True, exist_ok=True)
        write_whole(args.json, json.dumps(record, indent=2) + '\n')
    return 0


def time_side(
    planner: ValueGuidedPlanner, side: int, decisions: int, view_range: int
) -> SideResult:
    """Time single decisions of robots that are half-way through their mazes."""
    made = islice(single_decisions(planner, side, view_range), decisions + 1)
    progress = tqdm(made, desc=f'{side} x {side}', total=decisions + 1, unit='decision')
    _, *timed = progress  # The first one warms up.
    times = 1e3 * np.array([decision.seconds for decision in timed])
    spent = np.array([[decision.stages[stage] for stage in STAGES] for decision in timed]).sum(0)
    with torch.no_grad():
        values = [
            planner.value_network(torch.from_numpy(decision.partial_maps).to(planner.device))
            for decision in timed
        ]
    return SideResult(
        side=side,
        decisions=len(timed),
        median_ms=float(np.median(times)),
        p95_ms=float(np.percentile(times, 95)),
        processor_ms=1e3 * float(np.median([decision.processor for decision in timed])),
        shares=dict(zip(STAGES, (spent / spent.sum()).tolist(), strict=True)),
        rounds=max(found.rounds for found in values),
        residual=max(found.residual for found in values),
        target_ms=TARGETS_MS.get(side),
    )


def single_decisions(
    planner: ValueGuidedPlanner, side: int, view_range: int
) -> Iterator[Decisions]:
    """Yield endless decisions of one robot after the other, each from half-way on."""
    for seed in count():
        simulation = half_way(side, view_range, seed)
        planner.reset(seed)
        yield from lead(planner, simulation)


def half_way(side: int, view_range: int, seed: int) -> MazeSimulation:
    """Return a maze in which nearest-frontier exploration has seen half of the free cells.

    It stops before that where it sees the goal.
    """
    simulation = MazeSimulation(make_mazes(1, side, seed), view_range, max_steps=10 * side**2)
    explorer = NearestFrontier()
    explorer.reset(range(1), seed)
    enough = EXPLORED * (~simulation.mazes[0].blocked).sum()
    while simulation.partial_maps[0, FREE].sum() < enough and not simulation.goal_seen[0]:
        answer = explorer.act(simulation.partial_maps, simulation.cells, simulation.active)
        simulation.step(np.array([answer[0][0]]))
    return simulation


def lead(planner: ValueGuidedPlanner, simulation: MazeSimulation) -> Iterator[Decisions]:
    """Let a planner lead the robots to their ends; yields what each round of decisions took."""
    committed: list[deque[int]] = [deque() for _ in simulation.mazes]
    while simulation.active.any():
        idle = np.array([not actions for actions in committed])
        rows = np.flatnonzero(simulation.active & idle)
        if len(rows):
            maps = simulation.partial_maps[rows]
            begin, processor = time.perf_counter(), time.process_time()
            plans = planner.plan_batch(maps, simulation.cells[rows], rows.tolist())
            seconds, processor = time.perf_counter() - begin, time.process_time() - processor
            yield Decisions(len(rows), seconds, processor, dict(planner.last_timings), maps)
            for row, plan in zip(rows.tolist(), plans, strict=True):
                committed[row].extend(plan.committed)
            simulation.give_up(rows[[not plan.committed for plan in plans]])
        # Rows that are not active are ignored.
        simulation.step(
            np.array([actions.popleft() if actions else DONE for actions in committed])
        )


def batched_rate(planner: ValueGuidedPlanner, side: int, episodes: int, view_range: int) -> float:
    """Return the decisions a second of whole episodes that are run at once."""
    simulation = MazeSimulation(make_mazes(episodes, side, 0), view_range, max_steps=side**2)
    planner.reset(0)
    made, seconds = 0, 0.0
    with tqdm(desc=f'{episodes} episodes at once', unit='decision') as progress:
        for decisions in lead(planner, simulation):
            made += decisions.count
            seconds += decisions.seconds
            progress.update(decisions.count)
    return made / seconds


def growth(times: Sequence[tuple[int, float]]) -> float | None:
    """Return the exponent p of time ∝ side^p that fits best; None for fewer than two sides."""
    sides, milliseconds = np.log(np.array(times)).T
    if len(set(sides)) == 1:
        return None
    return float(np.polyfit(sides, milliseconds, 1)[0])


def machine() -> dict[str, object]:
    """Return what the numbers depend on beside the planner."""
    return {
        'processor': platform.machine(),
        'cores': os.cpu_count(),
        'load': os.getloadavg()[0],
        'threads': torch.get_num_threads(),
        'torch': torch.__version__,
    }


def print_results(
    planner: ValueGuidedPlanner,
    sides: Sequence[SideResult],
    by_candidates: dict[int, SideResult],
    exponent: float | None,
    batched: tuple[int, float],
) -> None:
    """Print the tables."""
    console = Console()
    candidates = planner.config.planner.candidates
    here = machine()
    first = sides[0].side
    times = Table(title=f'One decision with {candidates} candidates, in milliseconds')
    headings = ('map', 'decisions', 'median', '95 %', 'target', 'CPU', 'rounds', 'residual')
    for heading in headings:
        times.add_column(heading, justify='right')
    for result in sides:
        times.add_row(
            f'{result.side} x {result.side}',
            str(result.decisions),
            f'{result.median_ms:.1f}',
            f'{result.p95_ms:.1f}',
            '' if result.target_ms is None else f'≤ {result.target_ms:.0f}',
            f'{result.processor_ms:.1f}',
            str(result.rounds),
            f'{result.residual:.1g}',
        )
    shares = Table(title='Share of each stage')
    for heading in ('map', 'candidates', 'median', *STAGES):
        shares.add_column(heading, justify='right')
    rows = [(candidates, result) for result in sides] + list(by_candidates.items())
    for number, result in rows:
        shares.add_row(
            f'{result.side} x {result.side}',
            str(number),
            f'{result.median_ms:.1f}',
            *(f'{result.shares[stage]:.0%}' for stage in STAGES),
            end_section=result is sides[-1],
        )
    console.print(times, shares)
    episodes, per_second = batched
    if exponent is not None:
        console.print(f'The median grows like side^{exponent:.2f}.')
    console.print(
        f'{episodes} episodes at once, {first} x {first}: {per_second:.0f} decisions a second '
        f'(target: ≥ {BATCHED_TARGET:.0f}).',
        soft_wrap=True,
    )
    console.print(
        f'Robots half-way through Wilson mazes, {here["threads"]} threads on {here["cores"]} '
        f'cores of {here["processor"]}; the targets are for two cores. The load while this was '
        f'measured was {here["load"]:.1f}: what else runs counts in, least in the time of the '
        'processors (CPU), which is that of all threads together.',
        soft_wrap=True,
    )
