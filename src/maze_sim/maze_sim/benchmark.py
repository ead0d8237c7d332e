"""How fast mazes are drawn and stepped on this machine: ``python -m maze_sim.benchmark``."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.vector import SyncVectorEnv

from gridnav.actions import NUM_MOVES, valid_moves
from gridnav.partial_map import FREE
from maze_sim.env import GridMaze2DEnv
from maze_sim.mazes import wilson_maze
from maze_sim.vector_env import GridMaze2DVectorEnv
from maze_sim.worlds import sample_maze

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from gymnasium.vector import VectorEnv


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print one line for each part.

    Args:
        argv: Command line without the program's name; that of the process if None.

    Returns:
        The exit status, 0.
    """
    parser = argparse.ArgumentParser(prog='maze_sim.benchmark', description=__doc__)
    parser.add_argument('--size', type=int, default=15, help='side of the mazes in cells')
    parser.add_argument('--view-range', type=int, default=2, help='cells seen to each side')
    parser.add_argument('--num-envs', type=int, default=512, help='mazes stepped at once')
    parser.add_argument('--seconds', type=float, default=3.0, help='time for each part')
    args = parser.parse_args(argv)

    rng = np.random.default_rng(0)
    kwargs = {'size': args.size, 'view_range': args.view_range}
    vector_env = GridMaze2DVectorEnv(args.num_envs, **kwargs)
    env = SyncVectorEnv([lambda: GridMaze2DEnv(**kwargs)])
    mazes = maze_rate(lambda: wilson_maze(args.size, rng), args.seconds)
    solved_mazes = maze_rate(lambda: sample_maze(args.size, rng), args.seconds)
    steps = step_rate(env, args.seconds)
    vector_steps = step_rate(vector_env, args.seconds)
    sys.stdout.write(
        f'GridMaze2D {args.size} x {args.size}, view range {args.view_range}, one process, '
        'random valid moves, new mazes included\n'
        f'  Wilson mazes                  {mazes:>10,.0f} mazes/s\n'
        f'  with start and goal           {solved_mazes:>10,.0f} mazes/s\n'
        f'  one environment               {steps:>10,.0f} steps/s\n'
        f'  {args.num_envs:>4} environments at once     {vector_steps:>10,.0f} steps/s\n'
    )
    return 0


def maze_rate(draw: Callable[[], object], seconds: float) -> float:
    """Return how many mazes a second are drawn."""
    drawn = 0
    begin = time.perf_counter()
    while (elapsed := time.perf_counter() - begin) < seconds:
        draw()
        drawn += 1
    return drawn / elapsed


def step_rate(env: VectorEnv[Any, Any, Any], seconds: float) -> float:
    """Return how many environment steps a second are taken, autoresets included.

    The choice of the random moves is not counted.
    """
    rng = np.random.default_rng(0)
    observation, _ = env.reset(seed=0)
    batch = np.arange(env.num_envs)
    taken, elapsed = 0, 0.0
    while elapsed < seconds:
        # A robot always sees its eight neighbours, so its map tells the valid moves.
        valid = valid_moves(observation['partial_map'][:, FREE] == 0)
        row, col = observation['cell'].T
        chances = rng.random((env.num_envs, NUM_MOVES)) * valid[batch, :, row, col]
        actions = chances.argmax(axis=1)
        begin = time.perf_counter()
        observation, *_ = env.step(actions)
        elapsed += time.perf_counter() - begin
        taken += env.num_envs
    return taken / elapsed


if __name__ == '__main__':
    sys.exit(main())
