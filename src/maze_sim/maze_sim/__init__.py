"""GridMaze2D: worlds, line-of-sight views, the simulation and its Gymnasium environments.

Importing the package registers ``GridMaze2D-v0`` with Gymnasium. Letters in shapes: B mazes
stepped together, H rows, W columns, r view range.
"""

from gymnasium.envs.registration import register, registry

from maze_sim.expert import cost_to_go, shortest_actions
from maze_sim.map_file import WorldMap, read_map
from maze_sim.mazes import Maze, wilson_maze
from maze_sim.simulation import MazeSimulation
from maze_sim.visibility import visible_cells
from maze_sim.worlds import (
    WORLD_KINDS,
    Worlds,
    draw_world,
    make_mazes,
    open_walls,
    sample_episode,
    sample_maze,
    wall_off,
)

__all__ = [
    'ENV_ID',
    'WORLD_KINDS',
    'Maze',
    'MazeSimulation',
    'WorldMap',
    'Worlds',
    'cost_to_go',
    'draw_world',
    'make_mazes',
    'open_walls',
    'read_map',
    'sample_episode',
    'sample_maze',
    'shortest_actions',
    'visible_cells',
    'wall_off',
    'wilson_maze',
]

ENV_ID = 'GridMaze2D-v0'
"""Gymnasium id; the suffix rises with any change that gives other mazes, views or endings."""

if ENV_ID not in registry:
    register(
        ENV_ID,
        entry_point='maze_sim.env:GridMaze2DEnv',
        vector_entry_point='maze_sim.vector_env:GridMaze2DVectorEnv',
    )
