"""GridMaze2D for many mazes at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from gridnav.actions import NUM_ACTIONS
from maze_sim.env import TRUNCATING, Observation, draw_seeds, make_observation_space
from maze_sim.simulation import MazeSimulation
from maze_sim.worlds import Worlds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from maze_sim.mazes import Maze, Shape


class GridMaze2DVectorEnv(VectorEnv[Observation, 'NDArray[np.int64]', 'NDArray[Any]']):
    """The vectorised twin of ``GridMaze2DEnv``: the same rules, stepped as array code.

    Environment i behaves exactly as a ``GridMaze2DEnv`` of seed + i. An episode that has ended is
    followed by a new maze on the next step, which ignores the action of that environment
    (Gymnasium's next-step autoreset). Infos are arrays with one entry per environment.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        'render_modes': [],
        'autoreset_mode': AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
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
    ) -> None:
        """Set up the spaces; the first mazes are drawn by ``reset``.

        Args:
            num_envs: Number of environments, B.
            size: Side of the worlds in cells, or their rows and columns, each at least 5.
            kind: Kind of the worlds, one of ``WORLD_KINDS``.
            map_file: A map of a map server, instead of a size and a kind; none if empty.
            view_range: Cells that a view reaches to each side, at least 1.
            max_steps: Actions after which an episode is cut short.
            min_expert_steps: Moves between start and goal at least.
            stop_on_repeat: Whether an exact loop is cut short.
            slip: Probability that a step ends beside the cell it should reach, or where it began.
            pose_noise: Standard deviation of the reported cells in cells.

        Raises:
            ValueError: If there are no such worlds.
        """
        self.num_envs = num_envs
        self.worlds = Worlds(size, kind, map_file=map_file, min_expert_steps=min_expert_steps)
        self.view_range = view_range
        self.max_steps = max_steps
        self.stop_on_repeat = stop_on_repeat
        self.slip = slip
        self.pose_noise = pose_noise
        self.single_observation_space = make_observation_space(self.worlds.shape)
        self.single_action_space = gymnasium.spaces.Discrete(NUM_ACTIONS)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator] = []
        self._simulation: MazeSimulation | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw new mazes and take the first looks. There are no options.

        Args:
            seed: Environment i is seeded with seed + i. None draws on, or seeds at random the
                first time.
            options: Not used.

        Raises:
            ValueError: If an argument of the environment is out of range.
        """
        super().reset(seed=seed, options=options)
        if seed is not None:
            self._generators = [np_random(seed + index)[0] for index in range(self.num_envs)]
        elif not self._generators:
            self._generators = [np_random()[0] for _ in range(self.num_envs)]
        mazes, seeds = self._draw(np.arange(self.num_envs))
        simulation = self._simulation = MazeSimulation(
            mazes,
            self.view_range,
            self.max_steps,
            stop_on_repeat=self.stop_on_repeat,
            slip=self.slip,
            pose_noise=self.pose_noise,
            seeds=seeds,
        )
        return self._observation(simulation), self._info(simulation, np.zeros(self.num_envs))

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Take one action in every environment whose episode is running; begin the others anew.

        Args:
            actions: Indices 0 to 8, (B,).

        Returns:
            Observations, rewards, terminations, truncations, (B, ...) each, and infos.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
            ValueError: If the actions are out of shape or range.
        """
        simulation = self._simulation
        if simulation is None:
            msg = 'No episode is running: call reset first.'
            raise gymnasium.error.ResetNeeded(msg)
        over = np.flatnonzero(~simulation.active)
        simulation.step(actions)
        if len(over):
            simulation.restart(over, *self._draw(over))

        rewards, spl = np.zeros((2, self.num_envs))
        terminations, truncations = np.zeros((2, self.num_envs), dtype=np.bool_)
        for index in np.flatnonzero(~simulation.active).tolist():
            result = simulation.result(index)
            rewards[index] = result.success
            truncations[index] = result.outcome in TRUNCATING
            terminations[index] = not truncations[index]
            spl[index] = result.spl
        infos = self._info(simulation, spl)
        return self._observation(simulation), rewards, terminations, truncations, infos

    def _draw(self, indices: NDArray[np.int64]) -> tuple[list[Maze], list[int]]:
        """Draw a maze and a seed of the noise for some environments."""
        generators = [self._generators[index] for index in indices.tolist()]
        mazes = [self.worlds.sample(rng) for rng in generators]
        return mazes, draw_seeds(generators, noisy=self.slip > 0 or self.pose_noise > 0)

    @staticmethod
    def _observation(simulation: MazeSimulation) -> Observation:
        return {
            'partial_map': simulation.partial_maps.copy(),
            'cell': simulation.reported_cells.copy(),
        }

    def _info(self, simulation: MazeSimulation, spl: NDArray[np.float64]) -> dict[str, Any]:
        """Return the infos, each with the mask of the environments that have it: all."""
        return {
            'outcome': simulation.outcomes.copy(),
            '_outcome': np.ones(self.num_envs, dtype=np.bool_),
            'spl': spl,
            '_spl': np.ones(self.num_envs, dtype=np.bool_),
        }
