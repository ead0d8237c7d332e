"""Demonstrations for behaviour cloning: partial maps, cells and the plans that followed.

The expert who knows the whole maze walks the shortest way, as in the paper. With a value function
at hand, the planner's own exploration is demonstrated, too, and the expert says at each step of
it what it would have done: that shows the dead ends which the expert's own ways never enter.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tqdm import tqdm

from gridnav import DONE
from maze_sim import MazeSimulation, sample_maze
from maze_sim.expert import Expert
from vgdp_experiments.map_codes import pack, unpack
from vgdp_experiments.preset_settings import (
    add_preset_settings,
    read_preset_settings,
    require_positive,
)
from vgdp_experiments.rollouts import GreedyExplorer, load_explorer
from vgdp_experiments.worlds import training_maze

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from maze_sim import Maze
    from vgdp_planner.value import ValueNetwork

AT_ONCE = 128
"""Mazes that one worker walks side by side."""

PAPER_STEPS = (16, 50)
"""Least and most actions of an episode of the paper's data, Done included (appendix)."""


@dataclass(frozen=True)
class Batch:
    """Demonstrations ready for training.

    Attributes:
        maps: Partial maps, float32 (N, 3, H, W).
        cells: The robot's cells (row, col), int64 (N, 2).
        actions: The plans that followed, ending in Done, int64 (N, T_h).
    """

    maps: NDArray[np.float32]
    cells: NDArray[np.int64]
    actions: NDArray[np.int64]


@dataclass(frozen=True)
class Demonstrations:
    """Demonstrations as they are kept.

    Attributes:
        codes: Packed partial maps, uint8 (N, H, W).
        cells: uint8 (N, 2).
        actions: uint8 (N, T).
        settings: How they were made.
    """

    codes: NDArray[np.uint8]
    cells: NDArray[np.uint8]
    actions: NDArray[np.uint8]
    settings: dict[str, Any] = field(default_factory=dict)

    def draw(self, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Draw which demonstrations to train on, (count,)."""
        return rng.integers(len(self.codes), size=count)

    def take(self, chosen: NDArray[np.int64]) -> Batch:
        """Return some demonstrations, unpacked."""
        return Batch(
            unpack(self.codes[chosen]),
            self.cells[chosen].astype(np.int64),
            self.actions[chosen].astype(np.int64),
        )

    def require_horizon(self, horizon: int) -> None:
        """Refuse to train plans that are longer than those demonstrated.

        Raises:
            ValueError: If they are, with one sentence that says what to do.
        """
        kept = self.actions.shape[1]
        if kept < horizon:
            msg = (
                f'The demonstrations hold plans of {kept} steps and the policy needs {horizon}; '
                f'make them with `vgdp data expert --horizon {horizon}`.'
            )
            raise ValueError(msg)


@dataclass(frozen=True)
class DataSettings:
    """Settings of the generation.

    Attributes:
        preset: Which preset they are for: 'default' has mazes with loops among them, 'paper'
            Wilson mazes alone, where the expert needs 16 to 50 actions; it decides what the
            other settings are by default.
        out: File to write.
        mazes: How many mazes.
        size: Their side in cells.
        view_range: View range in cells; 0 draws 1, 2 or 3 for each group of mazes.
        horizon: Steps of a plan that are kept.
        seed: Of the mazes.
        explorer: Folder with a trained value function that explores; the expert alone if empty.
        workers: Processes; 0 for one per CPU.
    """

    preset: str = 'default'
    out: str = 'runs/demonstrations.npz'
    mazes: int = 20000
    size: int = 15
    view_range: int = 0
    horizon: int = 8
    seed: int = 0
    explorer: str = ''
    workers: int = 0

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self, ('mazes', 'horizon'))


SETTINGS = {
    'default': DataSettings(),
    'paper': DataSettings(
        preset='paper', out='runs/demonstrations-paper.npz', view_range=2, horizon=4
    ),
}
"""What is demonstrated for each preset unless the options say otherwise."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_preset_settings(parser, SETTINGS)


def run(arguments: argparse.Namespace) -> int:
    """Generate demonstrations and write them; returns the exit code."""
    settings = read_preset_settings(arguments, SETTINGS)
    groups = [
        (settings, number, min(AT_ONCE, settings.mazes - begin))
        for number, begin in enumerate(range(0, settings.mazes, AT_ONCE))
    ]
    workers = settings.workers or os.cpu_count() or 1
    context = multiprocessing.get_context('spawn')
    with context.Pool(workers) as pool, tqdm(total=settings.mazes, unit='maze') as progress:
        parts = []
        for (_, _, count), part in zip(groups, pool.imap(_walk_group, groups), strict=True):
            parts.append(part)
            progress.update(count)
    path = Path(settings.out)
    path.parent.mkdir(parents=True, exist_ok=True)
    made = _join(parts)
    np.savez_compressed(
        path,
        codes=made.codes,
        cells=made.cells,
        actions=made.actions,
        settings=json.dumps(asdict(settings)),
    )
    print(f'{len(made.codes)} demonstrations written to {path}.')  # noqa: T201
    return 0


def load_demonstrations(path: Path) -> Demonstrations:
    """Read demonstrations from a file.

    Raises:
        ValueError: If the file does not hold demonstrations, with one sentence that says why.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return Demonstrations(
                arrays['codes'],
                arrays['cells'],
                arrays['actions'],
                json.loads(str(arrays['settings'])),
            )
    except FileNotFoundError as error:
        msg = f'There are no demonstrations in {path}; make them with `vgdp data expert`.'
        raise ValueError(msg) from error
    except (OSError, KeyError, ValueError, EOFError) as error:
        msg = f'{path} does not hold demonstrations: {error}.'
        raise ValueError(msg) from error


def _walk_group(task: tuple[DataSettings, int, int]) -> Demonstrations:
    """Demonstrate in one group of mazes; what comes out depends on seed and number alone."""
    settings, number, count = task
    torch.set_num_threads(1)
    rng = np.random.default_rng([settings.seed, 5, number])
    draw = paper_maze if settings.preset == 'paper' else training_maze
    mazes = [draw(settings.size, rng) for _ in range(count)]
    view_range = settings.view_range or int(rng.integers(1, 4))
    parts = [walk_expert(mazes, view_range, settings.horizon)]
    if settings.explorer:
        network = load_explorer(settings.explorer)
        parts.append(walk_explorer(mazes, network, view_range, settings.horizon))
    return _join(parts)


def paper_maze(size: int, rng: np.random.Generator) -> Maze:
    """Draw a Wilson maze whose expert episode is as long as the paper's data have them."""
    least, most = PAPER_STEPS
    while True:
        maze = sample_maze(size, rng, least - 1)
        if maze.expert_steps < most:
            return maze


def _join(parts: Sequence[Demonstrations]) -> Demonstrations:
    return Demonstrations(
        np.concatenate([part.codes for part in parts]),
        np.concatenate([part.cells for part in parts]),
        np.concatenate([part.actions for part in parts]),
    )


def walk_expert(mazes: Sequence[Maze], view_range: int, horizon: int) -> Demonstrations:
    """Demonstrate the expert's own ways from start to goal."""
    ways = [
        [*expert.actions(maze.start, expert.cost_to_go(maze.goal)), DONE]
        for maze, expert in ((maze, Expert(maze.blocked)) for maze in mazes)
    ]
    noted = _Notes(horizon)
    simulation = MazeSimulation(mazes, view_range, max_steps=max(map(len, ways)) + 1)
    tick = 0
    while simulation.active.any():
        actions = np.full(len(mazes), DONE)
        for row in np.flatnonzero(simulation.active).tolist():
            noted.add(simulation, row, ways[row][tick:])
            actions[row] = ways[row][tick]
        simulation.step(actions)
        tick += 1
    return noted.finish()


def walk_explorer(
    mazes: Sequence[Maze],
    network: ValueNetwork,
    view_range: int,
    horizon: int,
) -> Demonstrations:
    """Demonstrate greedy exploration: what it did next, and what the expert would have done."""
    experts = [Expert(maze.blocked) for maze in mazes]
    costs = [expert.cost_to_go(maze.goal) for maze, expert in zip(mazes, experts, strict=True)]
    height, width = mazes[0].blocked.shape
    simulation = MazeSimulation(mazes, view_range, max_steps=20 * height * width)
    explorer = GreedyExplorer(network, (len(mazes), height, width))
    noted = _Notes(horizon)
    taken: list[list[int]] = [[] for _ in mazes]
    states: list[tuple[int, int, Any, Any]] = []
    while simulation.active.any():
        explorer.look(simulation.partial_maps, simulation.active)
        actions, reached = explorer.at(simulation.cells)
        simulation.give_up(np.flatnonzero(~reached))
        for row in np.flatnonzero(simulation.active).tolist():
            cell = (int(simulation.cells[row, 0]), int(simulation.cells[row, 1]))
            noted.add(simulation, row, experts[row].actions(cell, costs[row]))
            code, where = noted.last_state()
            states.append((row, len(taken[row]), code, where))
            taken[row].append(int(actions[row]))
        simulation.step(np.where(simulation.active, actions, DONE))
    for row, tick, code, where in states:
        noted.add_state(code, where, taken[row][tick:])
    return noted.finish()


class _Notes:
    """Collects demonstrations."""

    def __init__(self, horizon: int) -> None:
        self._horizon = horizon
        self._codes: list[NDArray[np.uint8]] = []
        self._cells: list[NDArray[np.int64]] = []
        self._actions: list[list[int]] = []

    def add(self, simulation: MazeSimulation, row: int, plan: Sequence[int]) -> None:
        """Note what a robot sees now and the plan that follows."""
        code = pack(simulation.partial_maps[row, None])[0]
        self.add_state(code, simulation.cells[row].copy(), plan)

    def add_state(
        self, code: NDArray[np.uint8], cell: NDArray[np.int64], plan: Sequence[int]
    ) -> None:
        """Note a state and the plan that follows; what comes after its end is Done."""
        actions = [int(action) for action in plan[: self._horizon]]
        self._codes.append(code)
        self._cells.append(cell)
        self._actions.append(actions + [DONE] * (self._horizon - len(actions)))

    def last_state(self) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Return the state noted last."""
        return self._codes[-1], self._cells[-1]

    def finish(self) -> Demonstrations:
        """Return what was collected."""
        return Demonstrations(
            np.stack(self._codes),
            np.stack(self._cells).astype(np.uint8),
            np.array(self._actions, dtype=np.uint8),
        )
