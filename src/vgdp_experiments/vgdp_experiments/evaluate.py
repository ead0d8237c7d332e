"""Evaluate methods on mazes, all on the same."""

from __future__ import annotations

import sys
import time
from collections import deque
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from tqdm import tqdm

from gridnav import DONE
from maze_sim import Maze, MazeSimulation, make_mazes
from maze_sim.mazes import MIN_SIZE
from vgdp_experiments.methods.clairvoyant import Clairvoyant
from vgdp_experiments.methods.frontier import NearestFrontier
from vgdp_experiments.methods.vgdp import ValueGuidedDiffusion
from vgdp_experiments.options import refuse, whole_number
from vgdp_experiments.planner_options import add_planner_arguments, load_planner
from vgdp_experiments.report import EvalConfig, MethodResults, Report, Trial

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from vgdp_experiments.methods import Method

PLANNERS: dict[str, Callable[[argparse.Namespace], Method]] = {
    'vgdp': lambda args: ValueGuidedDiffusion(load_planner(args)),
    'frontier': lambda _args: NearestFrontier(),
}
"""Methods that see partial maps alone, made from the options."""

REFERENCES: dict[str, Callable[[Sequence[Maze]], Method]] = {'clairvoyant': Clairvoyant}
"""Methods that know everything, made from the mazes of a trial."""

METHODS = (*PLANNERS, *REFERENCES)


def evaluate(
    method: Method,
    mazes: Sequence[Maze],
    view_range: int,
    budget: int,
    seed: int,
    *,
    batch: int = 100,
    on_finished: Callable[[int], object] = lambda _count: None,
) -> Trial:
    """Let a method steer a robot through each maze.

    The episodes of a batch run in lock-step. A robot carries out its committed actions in order
    and only then asks for more; one whose method commits to nothing has given up.

    Args:
        method: Is handed partial maps and cells, not the mazes.
        mazes: One for each episode, all of one shape.
        view_range: Cells that a view reaches to each side.
        budget: Actions after which an episode ends.
        seed: For the method.
        batch: Episodes run at once.
        on_finished: Is told how many episodes have ended since the last time.
    """
    trial = Trial(seed)
    for first in range(0, len(mazes), batch):
        simulation = MazeSimulation(mazes[first : first + batch], view_range, budget)
        method.reset(range(first, first + len(simulation.mazes)), seed)
        _run(method, simulation, trial, on_finished)
        trial.results.extend(simulation.results())
    return trial


def _run(
    method: Method,
    simulation: MazeSimulation,
    trial: Trial,
    on_finished: Callable[[int], object],
) -> None:
    """Run all episodes of a simulation to their ends."""
    committed: list[deque[int]] = [deque() for _ in simulation.mazes]
    while running := int(simulation.active.sum()):
        asking = simulation.active & np.array([not actions for actions in committed])
        if asking.any():
            begin = time.perf_counter()
            answers = method.act(simulation.partial_maps, simulation.cells, asking)
            trial.seconds += time.perf_counter() - begin
            trial.decisions += int(asking.sum())
            rows = np.flatnonzero(asking)
            for row in rows.tolist():
                committed[row].extend(answers[row])
            simulation.give_up(rows[[not answers[row] for row in rows.tolist()]])
        # Rows that are not active are ignored.
        simulation.step(
            np.array([actions.popleft() if actions else DONE for actions in committed])
        )
        on_finished(running - int(simulation.active.sum()))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp eval gridmaze``."""
    positive = whole_number(1)
    parser.add_argument(
        '--size',
        type=whole_number(MIN_SIZE),
        default=EvalConfig.size,
        help='side of the mazes in cells (%(default)s)',
    )
    parser.add_argument(
        '--view-range',
        type=positive,
        default=EvalConfig.view_range,
        help='cells that the robot sees to each side (%(default)s)',
    )
    parser.add_argument(
        '--budget',
        type=positive,
        default=EvalConfig.budget,
        help='actions after which an episode ends (%(default)s)',
    )
    parser.add_argument(
        '--episodes',
        type=positive,
        default=EvalConfig.episodes,
        help='mazes in a trial (%(default)s)',
    )
    parser.add_argument(
        '--trials', type=positive, default=EvalConfig.trials, help='trials (%(default)s)'
    )
    parser.add_argument(
        '--seed',
        type=whole_number(0),
        default=EvalConfig.seed,
        help='seed of the first trial; the next have the numbers that follow (%(default)s)',
    )
    parser.add_argument(
        '--method',
        nargs='+',
        choices=METHODS,
        default=METHODS,
        help='what to evaluate, on the same mazes (all)',
    )
    parser.add_argument(
        '--batch',
        type=positive,
        default=EvalConfig.batch,
        help='episodes run at once (%(default)s)',
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all results to FILE')
    add_planner_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Evaluate, print the table and write the report."""
    config = EvalConfig(**{item.name: getattr(args, item.name) for item in fields(EvalConfig)})
    names = list(dict.fromkeys(args.method))
    try:
        if args.json is not None:
            _prepare(args.json)
        mazes = [
            make_mazes(config.episodes, config.size, config.seed + trial)
            for trial in range(config.trials)
        ]
        planners = {name: PLANNERS[name](args) for name in names if name in PLANNERS}
    except (OSError, ValueError) as error:
        return refuse(error)
    methods = {}
    for name in names:
        per_trial = (
            [planners[name]] * config.trials
            if name in planners
            else [REFERENCES[name](of_trial) for of_trial in mazes]
        )
        methods[name] = _run_trials(name, per_trial, mazes, config)
    report = Report(config, methods, [Path(sys.argv[0]).name, *sys.argv[1:]])
    if args.json is not None:
        report.save(args.json)
    Console().print(report.table())
    return 0


def _run_trials(
    name: str,
    methods: Sequence[Method],
    mazes: Sequence[Sequence[Maze]],
    config: EvalConfig,
) -> MethodResults:
    """Evaluate a method, given once for each trial, on the mazes of all trials."""
    with tqdm(
        total=config.episodes * config.trials, desc=name, unit='episode', disable=None
    ) as progress:
        trials = [
            evaluate(
                method,
                of_trial,
                config.view_range,
                config.budget,
                config.seed + index,
                batch=config.batch,
                on_finished=progress.update,
            )
            for index, (method, of_trial) in enumerate(zip(methods, mazes, strict=True))
        ]
    return MethodResults(methods[0].settings, trials)


def _prepare(path: Path) -> None:
    """Make sure, before the work begins, that a file can be written.

    Raises:
        OSError: If it can't.
        ValueError: If it is a folder.
    """
    if path.is_dir():
        msg = f'{path} is a folder; --json needs a file.'
        raise ValueError(msg)
    path.parent.mkdir(parents=True, exist_ok=True)
