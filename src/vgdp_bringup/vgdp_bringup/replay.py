"""Run the mapper or the planner again over a bag, offline, and say where the outputs differ."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import track

from bev_mapper import GridFusion, LocalMapFusion, Pose2D, Window
from bev_mapper.grid_fusion import DEFAULT_GROWTH
from gridnav.actions import DONE
from gridnav.rgbd import VIEW_SUFFIX
from vgdp_bringup.bags import (
    LINE_STRIP,
    NANOSECONDS,
    PLANNER,
    BagError,
    only_namespace,
    parameters_of,
    read_bag,
    read_messages,
    stamp_of,
    to_grid,
    to_points,
)

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from vgdp_bringup.bags import Episode, Grid, Messages
    from vgdp_planner.cycle import Decision, PlanningCycle
    from vgdp_planner.planner import Plan, ValueGuidedPlanner
    from vgdp_planner.planning_grid import PlanningGrid

MAX_CELLS = 4096 * 4096
MAPPER = 'bev_mapper'
"""Name of the node that maps."""

PLANNER_TOPICS = (
    'odom',
    'map',
    'goal_pose',
    'plan',
    'plan_candidates',
    'action',
    '/diagnostics',
)
LOCKSTEP = 'lockstep'
"""The planner's parameter pose_source of which plans can be made again."""

SAME_PLACE_M = 1e-4
"""Points of a path that are no further apart are the same."""

SHOWN = 20
"""No more differences than this are printed."""

DIFFERENT = 1
"""Exit status where something differs."""


@dataclass(frozen=True)
class Difference:
    """Something that was recorded otherwise than it comes out now.

    Attributes:
        stamp: Of the observation it was made from, in nanoseconds.
        what: How they differ.
    """

    stamp: int
    what: str


@dataclass
class Comparison:
    """What came out of a replay.

    Attributes:
        compared: How many outputs were compared.
        equal: How many of them are the same.
        missing: How many came out now that are not in the bag.
        differences: Where they differ.
    """

    compared: int = 0
    equal: int = 0
    missing: int = 0
    differences: list[Difference] = field(default_factory=list)

    def compare(self, stamp: int, differences: Sequence[str]) -> None:
        """Note in what an output differs, nothing if it does not."""
        self.compared += 1
        self.equal += not differences
        self.differences += [Difference(stamp, what) for what in differences]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp bag replay``."""
    add = parser.add_argument
    add('bag', type=Path, metavar='BAG', help='folder of the bag')
    add('--against', required=True, choices=('map', 'plan'), help='whose outputs to compare')
    add('--namespace', help='where the robot has its topics (default: where the bag has one)')
    add(
        '--growth',
        type=int,
        metavar='N',
        help="the mapper's parameter growth, for --against map (default: as recorded)",
    )
    add(
        '--seed',
        type=int,
        metavar='N',
        help="the planner's parameter seed, for --against plan (default: as recorded)",
    )
    add(
        '--weights',
        type=Path,
        metavar='FOLDER',
        help='the weights of the planner, for --against plan (default: as recorded)',
    )


def run(args: argparse.Namespace) -> int:
    """Replay a bag and print where the outputs differ."""
    namespace = args.namespace or only_namespace(args.bag)
    began = time.perf_counter()
    if args.against == 'map':
        comparison = replay_map(args.bag, namespace, args.growth)
    else:
        comparison = replay_plan(args.bag, namespace, args.seed, args.weights)
    elapsed = time.perf_counter() - began
    if not comparison.compared:
        msg = f'{args.bag} holds no {args.against} that can be made again from its inputs.'
        raise BagError(msg)
    for difference in comparison.differences[:SHOWN]:
        seconds, rest = divmod(difference.stamp, NANOSECONDS)
        sys.stdout.write(f'{seconds}.{rest:09d}: {difference.what}\n')
    if len(comparison.differences) > SHOWN:
        sys.stdout.write(f'... and {len(comparison.differences) - SHOWN} more\n')
    left_out = f'; {comparison.missing} are not in the bag' if comparison.missing else ''
    sys.stdout.write(
        f'{args.against}: {comparison.equal} of {comparison.compared} the same, made again in '
        f'{elapsed:.1f} s{left_out}\n'
    )
    return DIFFERENT if comparison.differences else 0


def _spans(episodes: Sequence[Episode]) -> list[tuple[int, float]]:
    """Return from which stamp to which each episode goes."""
    starts = [episode.start for episode in episodes]
    return list(zip(starts, [*starts[1:], math.inf], strict=True))


def _progress(stamps: Sequence[int], what: str) -> Iterator[int]:
    """Go through stamps and show how far that is, on a terminal."""
    console = Console(stderr=True)
    yield from track(
        stamps, what, console=console, transient=True, disable=not console.is_terminal
    )


# The mapper


def replay_map(path: Path, namespace: str, growth: int | None = None) -> Comparison:
    """Make all maps of a bag again from its local maps and poses, and compare bit for bit.

    Args:
        path: Folder of the bag.
        namespace: Where the robot has its topics.
        growth: Cells by which a side of the map grows at least; as recorded if None, and the
            default where that is not known.

    Raises:
        BagError: If the bag can't be read.
    """
    episodes = read_bag(path, namespace).episodes
    messages = read_messages(path, namespace, ('odom', 'local_map', 'map', '/diagnostics'))
    if growth is None:
        said = parameters_of(messages['/diagnostics'], f'{namespace.rstrip("/")}/{MAPPER}')
        growth = said.get('growth', DEFAULT_GROWTH)
    # A new world's first map may have been made before its episode was known, and then again.
    recorded = {stamp_of(message): message for _, message in messages['map']}
    comparison = Comparison()
    last = max(recorded, default=0)
    for begin, end in _spans(episodes):
        maps = [stamp for stamp in sorted(recorded) if begin <= stamp < end]
        if not maps:
            continue
        # What it has grown by before it was published first, it would grow by again.
        first = recorded[maps[0]]
        fusion = LocalMapFusion(GridFusion(to_grid(first).geometry, growth, MAX_CELLS))
        steps = _observations(fusion, messages, first.header.frame_id, begin, end)
        for stamp in _progress(sorted(steps), 'mapping'):
            has_map = False
            for take_in in steps[stamp]:
                has_map |= take_in()
            if not has_map:
                continue
            if stamp in recorded:
                comparison.compare(stamp, _compare_maps(to_grid(recorded[stamp]), fusion.grid))
            elif stamp < last:
                comparison.missing += 1
    return comparison


def _observations(
    fusion: LocalMapFusion, messages: Messages, map_frame: str, begin: int, end: float
) -> dict[int, list[Callable[[], bool]]]:
    """Return by stamp what takes in the poses and the local maps of an episode."""
    steps: dict[int, list[Callable[[], bool]]] = {}
    for _, message in messages['odom']:
        stamp = stamp_of(message)
        if begin <= stamp < end:
            take_in = partial(fusion.add_pose, stamp, _pose(message))
            steps.setdefault(stamp, []).append(take_in)
    for _, message in messages['local_map']:
        stamp = stamp_of(message)
        if begin <= stamp < end:
            grid = to_grid(message)
            on_robot = message.header.frame_id != map_frame
            window = Window(grid.cells, grid.geometry, on_robot)
            steps.setdefault(stamp, []).append(partial(fusion.add_window, stamp, window))
    return steps


def _pose(odometry: Any) -> Pose2D:  # noqa: ANN401 - an Odometry of rosbags
    """Return the pose of an odometry message as the mapper reads it."""
    position, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    sine = 2 * (turn.w * turn.z + turn.x * turn.y)
    cosine = 1 - 2 * (turn.y * turn.y + turn.z * turn.z)
    return Pose2D(position.x, position.y, math.atan2(sine, cosine))


def _compare_maps(recorded: Grid, remade: GridFusion) -> list[str]:
    if recorded.geometry != remade.geometry:
        return [f'the map lies at {recorded.geometry}, made again at {remade.geometry}']
    different = np.argwhere(recorded.cells != remade.occupancy)
    if not len(different):
        return []
    row, col = different[0].tolist()
    before, now = recorded.cells[row, col], remade.occupancy[row, col]
    what = (
        f'{len(different)} of {recorded.cells.size} cells of the map differ, first (row, col) '
        f'({row}, {col}): {before} recorded, {now} now'
    )
    return [what]


# The planner


@dataclass(frozen=True)
class _Recorded:
    """What the planner said on one observation, once or, after lost actions, several times."""

    paths: list[NDArray[np.float64]]
    candidates: list[dict[int, str]]


def replay_plan(
    path: Path, namespace: str, seed: int | None = None, weights: Path | None = None
) -> Comparison:
    """Make all plans of a bag again from its maps and poses, and compare steps and values.

    Args:
        path: Folder of the bag.
        namespace: Where the robot has its topics.
        seed: Of the planner; as recorded if None, and that of the first episode where that is not
            known, as the demo and the launch files have it.
        weights: Folder of the weights; as recorded if None, and the shipped ones where that is
            not known.

    Raises:
        BagError: If the bag can't be read, says nothing of a seed, or is of a robot that moves by
            itself.
        WeightsError: If the weights can't be loaded.
    """
    # Here, as it takes seconds.
    import torch  # noqa: PLC0415

    from vgdp_planner.planner import ValueGuidedPlanner  # noqa: PLC0415

    episodes = read_bag(path, namespace).episodes
    messages = read_messages(path, namespace, PLANNER_TOPICS)
    said = parameters_of(messages['/diagnostics'], f'{namespace.rstrip("/")}/{PLANNER}')
    cycle = _cycle_of(said)
    seed = said.get('seed') if seed is None else seed
    if seed is None:
        if not episodes[0].values.get('seed', '').isdecimal():
            msg = f'{path} does not say the seed of its first episode, give it by --seed.'
            raise BagError(msg)
        seed = int(episodes[0].values['seed'])
    # As in the node: on more threads sums may be rounded otherwise.
    torch.set_num_threads(said.get('threads', 1))
    planner = ValueGuidedPlanner.from_pretrained(weights or said.get('weights') or None)
    recorded = _recorded_plans(messages)
    comparison = Comparison()
    actions = [(received, int(message.data)) for received, message in messages['action']]
    ends = [episode.steps[0].observed for episode in episodes[1:] if episode.steps]
    for index, (begin, end) in enumerate(_spans(episodes)):
        planner.reset(seed)
        cycle.begin(begin)
        steps = _planner_inputs(cycle, messages, begin, end)
        sent = _plan_again(planner, cycle, steps, recorded, comparison)
        low = ends[index - 1] if index else 0
        high = ends[index] if index < len(ends) else math.inf
        heard = [action for received, action in actions if low <= received < high]
        if sent and heard != sent[: len(heard)]:
            where = next(i for i, (a, b) in enumerate(zip_longest(heard, sent)) if a != b)
            comparison.compare(
                begin, [f'action {where} of the episode is not the one that is planned now']
            )
    return comparison


def _cycle_of(parameters: dict[str, Any]) -> PlanningCycle:
    """Return what brings maps and poses together for a planner with these parameters."""
    from vgdp_planner.cycle import (  # noqa: PLC0415 - loads what maps do without
        BLOCKED_AFTER,
        PlanningCycle,
    )
    from vgdp_planner.planning_grid import GridSettings  # noqa: PLC0415

    source = parameters.get('pose_source', LOCKSTEP)
    if source != LOCKSTEP:
        msg = (
            f'The plans are those of a robot that moves by itself (pose_source {source!r}); only '
            f'those made in lockstep can be made again.'
        )
        raise BagError(msg)
    settings = GridSettings.from_parameters(**parameters)
    return PlanningCycle(
        settings,
        parameters.get('blocked_after', BLOCKED_AFTER),
        parameters.get('closer_look', 0),
    )


def _recorded_plans(messages: Messages) -> dict[int, _Recorded]:
    plans: dict[int, _Recorded] = {}
    for _, message in messages['plan']:
        points = to_points([pose.pose.position for pose in message.poses])
        plans.setdefault(stamp_of(message), _Recorded([], [])).paths.append(points)
    for _, message in messages['plan_candidates']:
        lines = [marker for marker in message.markers if marker.type == LINE_STRIP]
        if lines and stamp_of(lines[0]) in plans:
            values = {int(marker.id): marker.text for marker in lines}
            plans[stamp_of(lines[0])].candidates.append(values)
    return plans


def _planner_inputs(
    cycle: PlanningCycle, messages: Messages, begin: int, end: float
) -> dict[int, list[Callable[[], object]]]:
    """Return by stamp what takes in the goal, the poses and the maps of an episode."""
    steps: dict[int, list[Callable[[], object]]] = {}
    for topic in ('goal_pose', 'odom', 'map'):
        for _, message in messages[topic]:
            stamp = stamp_of(message)
            if not begin <= stamp < end:
                continue
            take_in: Callable[[], object]
            if topic == 'map':
                grid = to_grid(message)
                take_in = partial(cycle.add_map, stamp, grid.cells, grid.geometry)
            elif topic == 'odom':
                if message.child_frame_id.endswith(VIEW_SUFFIX):
                    continue
                position = message.pose.pose.position
                take_in = partial(cycle.add_pose, stamp, position.x, position.y)
            else:
                position = message.pose.position
                take_in = partial(cycle.set_goal, stamp, position.x, position.y)
            steps.setdefault(stamp, []).append(take_in)
    return steps


def _plan_again(
    planner: ValueGuidedPlanner,
    cycle: PlanningCycle,
    steps: dict[int, list[Callable[[], object]]],
    recorded: dict[int, _Recorded],
    comparison: Comparison,
) -> list[int]:
    """Plan where a plan was recorded, compare, and return the actions that are sent now."""
    sent: list[int] = []
    last_plan = max((stamp for stamp in steps if stamp in recorded), default=-1)
    for stamp in _progress(sorted(steps), 'planning'):
        for take_in in steps[stamp]:
            take_in()
        if stamp not in recorded:
            comparison.missing += stamp < last_plan and cycle.observation() is not None
            continue
        said = recorded[stamp]
        for number, points in enumerate(said.paths):
            observation = cycle.observation(overdue=True)
            if observation is None:
                comparison.compare(stamp, ['a plan was made, but not on what was recorded'])
                break
            observation, plan = cycle.plan(planner, observation)
            grid = observation.grid
            cycle.planned(observation, decision_of(plan, grid))
            sent += plan.committed
            candidates = said.candidates[number] if number < len(said.candidates) else None
            differences = _compare_plans(points, candidates, plan, grid)
            comparison.compare(stamp, differences)
    return sent


def decision_of(plan: Plan, grid: PlanningGrid) -> Decision:
    """Return what a plan decided, as far as it counts in lockstep: how many steps were sent."""
    from vgdp_planner.cycle import Decision  # noqa: PLC0415 - loads what reports do without

    return Decision(plan.committed, grid.start, DONE in plan.committed, np.empty((0, 2)))


def _compare_plans(
    points: NDArray[np.float64],
    candidates: dict[int, str] | None,
    plan: Plan,
    grid: PlanningGrid,
) -> list[str]:
    """Compare a recorded path, and the values of its candidates where there are some.

    Raises:
        BagError: If the path was planned on other cells than this grid's.
    """
    from vgdp_planner.route import plan_blocks  # noqa: PLC0415 - loads what maps do without

    if grid.ground is None and len(points) > len(plan.actions) + 1:
        msg = (
            'The recorded plans were made on a grid coarser than the map (robot_radius or '
            'planning_resolution), and the bag does not say on which.'
        )
        raise BagError(msg)
    differences = []
    if (plan.status == 'ok') != bool(len(points)):
        differences.append(f'a path of {len(points)} poses is recorded, now it is {plan.status}')
    elif len(points):
        blocks, moves = plan_blocks(grid, plan)
        way = grid.way(blocks, via=moves)
        both = min(len(points), len(way))
        off = np.abs(points[:both] - way[:both]).max(axis=1) > SAME_PLACE_M
        if off.any():
            step = max(int(off.argmax()) - 1, 0)
            differences.append(f'step {step} of the plan goes another way now')
        elif len(points) != len(way):
            differences.append(f'a path of {len(points)} poses is recorded, now it has {len(way)}')
    if candidates is not None:
        finite = np.flatnonzero(np.isfinite(plan.candidate_values))
        now = {int(index): f'{plan.candidate_values[index]:.2f}' for index in finite}
        changed = sorted(
            index
            for index in candidates.keys() | now.keys()
            if candidates.get(index) != now.get(index)
        )
        if changed:
            first = changed[0]
            differences.append(
                f'{len(changed)} of {len(candidates)} candidates have other values, first number '
                f'{first}: {candidates.get(first, "none")} recorded, {now.get(first, "none")} now'
            )
    return differences
