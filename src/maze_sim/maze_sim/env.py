"""GridMaze2D as a Gymnasium environment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from gridnav.actions import NUM_ACTIONS
from gridnav.metrics import Outcome
from gridnav.partial_map import FREE, GOAL, OBSTACLE
from maze_sim.simulation import MazeSimulation
from maze_sim.worlds import Worlds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from maze_sim.mazes import Shape

Observation = dict[str, Any]

TRUNCATING = (Outcome.TIMEOUT, Outcome.REPEAT)
"""Outcomes that cut an episode short; the others are its end."""

CELL_PX = 16
UNSEEN_RGB, OBSTACLE_RGB, FREE_RGB = (128, 128, 128), (32, 32, 32), (255, 255, 255)
GOAL_RGB, ROBOT_RGB = (0, 158, 115), (0, 114, 178)


def make_observation_space(shape: Shape) -> gymnasium.spaces.Dict:
    """Return the space of one observation in a world of a shape (rows, columns)."""
    return gymnasium.spaces.Dict(
        {
            'partial_map': gymnasium.spaces.Box(0.0, 1.0, (3, *shape), np.float32),
            'cell': gymnasium.spaces.MultiDiscrete(list(shape)),
        }
    )


def draw_seeds(generators: Sequence[np.random.Generator], *, noisy: bool) -> list[int]:
    """Draw a seed from each generator; without noise 0 each, so that the generators stay as is."""
    return [int(rng.integers(2**32)) if noisy else 0 for rng in generators]


class GridMaze2DEnv(gymnasium.Env[Observation, np.int64]):
    """A robot looks for the goal of a maze that it has never seen.

    ## Description
    The maze is drawn uniformly from all mazes of its size (Wilson's algorithm); other kinds of
    worlds and maps from files can be chosen. The robot sees what the line of sight reaches in a
    window around it, and what it has seen stays on its map. It has to find the goal, go there and
    say Done.

    ## Action Space
    `Discrete(9)`: the (Δrow, Δcol) steps 0 (1, 0), 1 (1, 1), 2 (0, 1), 3 (-1, 1), 4 (-1, 0),
    5 (-1, -1), 6 (0, -1), 7 (1, -1), and 8 Done. Rows grow to the north, columns to the east. A
    diagonal step is valid when its target is free and at least one of the two cells beside it is.

    ## Observation Space
    A `Dict` of
    - `partial_map`: `Box(0, 1, (3, H, W), float32)`: seen obstacles, seen free cells, the seen
      goal. A cell that is 0 in the first two has not been seen.
    - `cell`: `MultiDiscrete([H, W])`: the robot's (row, col), as it is reported.

    ## Starting State
    Start and goal are uniform over all pairs of free cells with at least `min_expert_steps` steps
    of the shortest way between them. The first view is on the map already.

    ## Rewards
    1 for Done on the goal, otherwise 0.

    ## Episode End
    Termination:
    - `success`: Done on the goal.
    - `collision`: a step that is not valid. The robot stays where it is.
    - `false_done`: Done anywhere else.

    Truncation:
    - `timeout`: `max_steps` actions were taken.
    - `repeat`: an exact loop, with `stop_on_repeat` only: an action was taken a second time from
      the same cell with nothing new seen in between.

    ## Information
    `step()` and `reset()` return a dict with
    - `outcome`: one of the names above, or `running`.
    - `spl`: success weighted by path length, 0 until the episode has ended in success.

    ## Arguments
    - `size=15`: side of the world in cells, or its rows and columns, each at least 5.
    - `kind='maze'`: kind of the world, one of `maze_sim.WORLD_KINDS`.
    - `map_file=''`: a map of a map server (YAML), instead of a size and a kind.
    - `view_range=2`: cells that a view reaches to each side, at least 1.
    - `max_steps=500`: actions after which an episode is cut short.
    - `min_expert_steps=15`: moves between start and goal at least.
    - `stop_on_repeat=False`: whether an exact loop is cut short.
    - `slip=0`: probability that a step ends beside the cell it should reach, or where it began.
    - `pose_noise=0`: standard deviation of the reported `cell` in cells. The map is not affected.
    - `render_mode=None`: `'rgb_array'` gives pictures of the robot's map, north up.

    ## Version History
    The version rises with any change that gives other mazes, views or endings for a seed.
    - v0: first version.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        'render_modes': ['rgb_array'],
        'render_fps': 10,
    }

    def __init__(
        self,
        *,
        size: int | Shape = 15,
        kind: str = 'maze',
        map_file: str = '',
        view_range: int = 2,
        max_steps: int = 500,
        min_expert_steps: int = 15,
        stop_on_repeat: bool = False,
        slip: float = 0.0,
        pose_noise: float = 0.0,
        render_mode: str | None = None,
    ) -> None:
        """Set up the spaces; the first maze is drawn by ``reset``. See the class for arguments.

        Raises:
            ValueError: If there are no such worlds.
        """
        self.worlds = Worlds(size, kind, map_file=map_file, min_expert_steps=min_expert_steps)
        self.view_range = view_range
        self.max_steps = max_steps
        self.stop_on_repeat = stop_on_repeat
        self.slip = slip
        self.pose_noise = pose_noise
        self.render_mode = render_mode
        self.observation_space = make_observation_space(self.worlds.shape)
        self.action_space = gymnasium.spaces.Discrete(NUM_ACTIONS)
        self._simulation: MazeSimulation | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw a new maze and take the first look. There are no options.

        Raises:
            ValueError: If an argument of the environment is out of range.
        """
        super().reset(seed=seed, options=options)
        maze = self.worlds.sample(self.np_random)
        self._simulation = MazeSimulation(
            [maze],
            self.view_range,
            self.max_steps,
            stop_on_repeat=self.stop_on_repeat,
            slip=self.slip,
            pose_noise=self.pose_noise,
            seeds=draw_seeds([self.np_random], noisy=self.slip > 0 or self.pose_noise > 0),
        )
        return self._observation(self._simulation), self._info(self._simulation)

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take one action.

        Raises:
            gymnasium.error.ResetNeeded: If no episode is running.
            ValueError: If the action is not an index from 0 to 8.
        """
        simulation = self._simulation
        if simulation is None or not simulation.active[0]:
            msg = 'No episode is running: call reset first.'
            raise gymnasium.error.ResetNeeded(msg)
        simulation.step(np.array([action]))
        outcome = simulation.outcomes[0]
        truncated = outcome in TRUNCATING
        return (
            self._observation(simulation),
            float(outcome is Outcome.SUCCESS),
            not simulation.active[0] and not truncated,
            truncated,
            self._info(simulation),
        )

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the robot's map, (16 H, 16 W, 3), or None without a mode.

        Raises:
            gymnasium.error.ResetNeeded: If there was no episode yet.
        """
        if self.render_mode is None:
            return None
        if self._simulation is None:
            msg = 'There is nothing to render: call reset first.'
            raise gymnasium.error.ResetNeeded(msg)
        partial_map = self._simulation.partial_maps[0]
        picture = np.full((*self.worlds.shape, 3), UNSEEN_RGB, dtype=np.uint8)
        for channel, colour in ((OBSTACLE, OBSTACLE_RGB), (FREE, FREE_RGB), (GOAL, GOAL_RGB)):
            picture[partial_map[channel] > 0] = colour
        picture[tuple(self._simulation.cells[0])] = ROBOT_RGB
        return picture[::-1].repeat(CELL_PX, axis=0).repeat(CELL_PX, axis=1)

    @staticmethod
    def _observation(simulation: MazeSimulation) -> Observation:
        return {
            'partial_map': simulation.partial_maps[0].copy(),
            'cell': simulation.reported_cells[0].copy(),
        }

    @staticmethod
    def _info(simulation: MazeSimulation) -> dict[str, Any]:
        result = simulation.result(0)
        return {'outcome': result.outcome, 'spl': result.spl}
