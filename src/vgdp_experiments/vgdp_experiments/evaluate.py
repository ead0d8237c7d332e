"""Evaluate methods on mazes, all on the same."""

from __future__ import annotations

import argparse
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
from maze_sim import WORLD_KINDS, MazeSimulation
from maze_sim.mazes import MIN_SIZE
from vgdp_experiments.methods.calvin import add_calvin_arguments
from vgdp_experiments.methods.registry import METHODS, PLANNERS, REFERENCES
from vgdp_experiments.options import refuse, whole_number
from vgdp_experiments.planner_options import add_planner_arguments
from vgdp_experiments.report import EvalConfig, Report
from vgdp_experiments.scores import MethodResults, Trial
from vgdp_experiments.tracking import BeliefTracker

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from maze_sim import Maze
    from vgdp_experiments.methods import Method
    from vgdp_planner.belief import BeliefFilter

SIDES = 2
"""Of a map."""

DEFAULT_METHODS = ('vgdp', 'frontier', 'clairvoyant')


def evaluate(
    method: Method,
    mazes: Sequence[Maze],
    view_range: int,
    budget: int,
    seed: int,
    *,
    slip: float = 0.0,
    pose_noise: float = 0.0,
    belief_filter: BeliefFilter | None = None,
    first: int = 0,
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
        seed: For the method, the slips and the noise.
        slip: Probability of a step to slip.
        pose_noise: Standard deviation of the reported cells from the true ones in cells.
        belief_filter: Keeps the beliefs that the method gets instead of the reported cells.
        first: Number of the first maze in its trial.
        batch: Episodes run at once.
        on_finished: Is told how many episodes have ended since the last time.
    """
    trial = Trial(seed)
    for start in range(0, len(mazes), batch):
        chosen = mazes[start : start + batch]
        numbers = range(first + start, first + start + len(chosen))
        simulation = MazeSimulation(
            chosen,
            view_range,
            budget,
            slip=slip,
            pose_noise=pose_noise,
            seeds=[[seed, number] for number in numbers],
        )
        tracker = BeliefTracker(belief_filter, slip, pose_noise) if belief_filter else None
        method.reset(numbers, seed)
        _run(method, simulation, tracker, trial, on_finished)
        trial.results.extend(simulation.results())
    return trial


def _run(
    method: Method,
    simulation: MazeSimulation,
    tracker: BeliefTracker | None,
    trial: Trial,
    on_finished: Callable[[int], object],
) -> None:
    """Run all episodes of a simulation to their ends."""
    committed: list[deque[int]] = [deque() for _ in simulation.mazes]
    if tracker is not None:
        tracker.begin(simulation.partial_maps, simulation.reported_cells)
    while running := int(simulation.active.sum()):
        asking = simulation.active & np.array([not actions for actions in committed])
        if asking.any():
            where = simulation.reported_cells if tracker is None else tracker.beliefs
            begin = time.perf_counter()
            answers = method.act(simulation.partial_maps, where, asking)
            trial.seconds += time.perf_counter() - begin
            trial.decisions += int(asking.sum())
            rows = np.flatnonzero(asking)
            for row in rows.tolist():
                committed[row].extend(answers[row])
            simulation.give_up(rows[[not answers[row] for row in rows.tolist()]])
        # Rows that are not active are ignored.
        actions = np.array([actions.popleft() if actions else DONE for actions in committed])
        if tracker is None:
            simulation.step(actions)
        else:
            maps_before = simulation.partial_maps.copy()
            simulation.step(actions)
            tracker.follow(actions, maps_before, simulation.reported_cells, simulation.windows())
        on_finished(running - int(simulation.active.sum()))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp eval gridmaze``."""
    positive = whole_number(1)
    parser.add_argument(
        '--size',
        type=_size,
        default=EvalConfig.size,
        metavar='SIDE|ROWSxCOLS',
        help='side of the mazes in cells, or both of them (%(default)s)',
    )
    parser.add_argument(
        '--kind', choices=WORLD_KINDS, default=EvalConfig.kind, help='of mazes (%(default)s)'
    )
    parser.add_argument(
        '--map',
        default=EvalConfig.map,
        metavar='FILE',
        help='YAML file of a map of the map server to draw starts and goals in',
    )
    parser.add_argument(
        '--slip',
        type=float,
        default=EvalConfig.slip,
        help='share of the steps that lead elsewhere (%(default)s)',
    )
    parser.add_argument(
        '--pose-noise',
        type=float,
        default=EvalConfig.pose_noise,
        help='standard deviation of the reported cells (%(default)s)',
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
        default=DEFAULT_METHODS,
        help=f'what to evaluate, on the same mazes ({" ".join(DEFAULT_METHODS)})',
    )
    parser.add_argument(
        '--batch',
        type=positive,
        default=EvalConfig.batch,
        help='episodes run at once (%(default)s)',
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all results to FILE')
    add_planner_arguments(parser)
    add_calvin_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Evaluate, print the table and write the report."""
    config = EvalConfig(**{item.name: getattr(args, item.name) for item in fields(EvalConfig)})
    names = list(dict.fromkeys(args.method))
    try:
        _check_references(names, config)
        if args.json is not None:
            _prepare(args.json)
        mazes = [
            config.mazes(range(config.episodes), config.seed + trial)
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
                slip=config.slip,
                pose_noise=config.pose_noise,
                batch=config.batch,
                on_finished=progress.update,
            )
            for index, (method, of_trial) in enumerate(zip(methods, mazes, strict=True))
        ]
    return MethodResults(methods[0].settings, trials)


def _size(text: str) -> int | tuple[int, int]:
    """Read SIDE or ROWSxCOLS."""
    sides = [whole_number(MIN_SIZE)(number) for number in text.split('x')]
    if len(sides) > SIDES:
        msg = f'{text!r} is no size like 15 or 20x30'
        raise argparse.ArgumentTypeError(msg)
    return sides[0] if len(sides) == 1 else (sides[0], sides[1])


def _check_references(names: Sequence[str], config: EvalConfig) -> None:
    """Make sure that methods that know everything can act on it.

    Raises:
        ValueError: If they would not know where they are.
    """
    for name in names:
        if name in REFERENCES and (config.slip or config.pose_noise):
            msg = f'{name} needs exact steps and poses; leave it out with --method.'
            raise ValueError(msg)


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
