"""Search in homes as a Gymnasium environment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from avd_player.avd_format import GRID_M
from avd_player.scene import MAX_LINK_M, Scene
from avd_player.simulation import DEFAULT_TARGET, ActiveVisionSimulation, SearchRules
from gridnav.actions import NUM_ACTIONS
from gridnav.metrics import Outcome
from gridnav.rgbd import FrameError, RgbdFrame

if TYPE_CHECKING:
    from numpy.typing import NDArray

Observation = dict[str, Any]


class ActiveVisionEnv(gymnasium.Env[Observation, np.int64]):
    """A robot looks for a bottle in a home that it has never seen.

    ## Description
    The home is a scene of the Active Vision Dataset, scanned or synthetic: positions on a grid of
    0.30 m with colour and depth images in twelve directions. The robot moves from position to
    position and sees real images. It has to find the target, go there and say Done.

    ## Action Space
    `Discrete(9)`: moves to the north 0, north-east 1, east 2, south-east 3, south 4, south-west
    5, west 6, north-west 7, and Done 8. North is +y and east +x of the map, however the robot
    is turned. A move leads to the next position whose direction is no more than 22.5 degrees off;
    where there is none the robot stays where it is.

    ## Observation Space
    A `Dict`, with V = 12 views at the position counter-clockwise, or the V = 1 of the heading, in
    images of H rows and W columns:
    - `color`: `Box(0, 255, (V, H, W, 3), uint8)`: RGB without distortion.
    - `depth`: `Box(0, 65535, (V, H, W), uint16)`: millimetres along the optical axis, 0 for none.
    - `camera_to_map`: `Box(-inf, inf, (V, 4, 4), float64)`: takes points of the optical frame (x
      right, y down, z forward) into the map (z up, z = 0 on the floor), metres.
    - `valid`: `MultiBinary(V)`: 0 for an image that is missing or broken; its arrays are 0.
    - `pose`: `Box(-inf, inf, (3,), float64)`: the robot's x and y in the map, and its yaw.

    The camera's intrinsics are `env.unwrapped.camera`.

    ## Starting State
    Uniform over the positions at least `min_expert_steps` moves from where Done succeeds. The
    robot looks to the east, or as near to that as an image does.

    ## Rewards
    1 for Done where it succeeds, otherwise 0.

    ## Episode End
    Termination:
    - `success`: the target was seen, and Done is said within `reach` of it, or at the position
      that is nearest to it. Seen means: in a view with a box of the target of a difficulty of
      `max_difficulty` at most, and valid depth of `max_range` at most.
    - `false_done`: Done anywhere else, or before the target was seen.

    Truncation:
    - `timeout`: `max_steps` actions were taken.

    ## Information
    `step()` and `reset()` return a dict with
    - `outcome`: one of the names above, or `running`.
    - `goal`: x, y, z of the target in the map as far as it was seen, or None.
    - `position`: number of the position in the scene.
    - `path_length`: length of the way so far in metres.
    - `shortest_path`: length of the shortest way from the start on which the target is seen and
      that ends where Done succeeds, in metres.
    - `spl`: success weighted by path length, 0 until the episode has ended in success.
    - `bumps`: moves that led nowhere.

    ## Arguments
    - `scene`: folder of the scene.
    - `target='coca_cola_glass_bottle'`: name of the instance to look for.
    - `views='all'`: what is seen at a position, or `'heading'` for the image that looks where the
      robot last moved.
    - `width=240`: of the images in pixels; 0 for that on disk.
    - `reach=1.0`, `max_difficulty=4`, `max_range=6.0`: as above, metres.
    - `max_steps=500`: actions after which an episode is cut short.
    - `min_expert_steps=10`: moves from the start to where Done succeeds, at least.
    - `max_link=0.55`: how far a move leads at most, metres.
    - `render_mode=None`: `'rgb_array'` gives what the robot sees ahead.

    ## Version History
    The version rises with any change that gives other starts, views or endings for a seed.
    - v0: first version.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        'render_modes': ['rgb_array'],
        'render_fps': 4,
    }

    def __init__(
        self,
        scene: str | Path,
        *,
        target: str = DEFAULT_TARGET,
        views: str = 'all',
        width: int = 240,
        reach: float = 1.0,
        max_difficulty: int = 4,
        max_range: float = 6.0,
        max_steps: int = 500,
        min_expert_steps: int = 10,
        max_link: float = MAX_LINK_M,
        render_mode: str | None = None,
    ) -> None:
        """Open the scene; see the class for the arguments.

        Raises:
            FrameError: If the scene can't be used.
            ValueError: If the target is not in it, or an argument is out of range.
        """
        self.scene = Scene.open(Path(scene), width, max_link)
        rules = SearchRules(
            target, reach, max_difficulty, max_range, max_steps, min_expert_steps, views
        )
        self.simulation = ActiveVisionSimulation(self.scene, rules)
        self.camera = self.scene.source.camera
        self.render_mode = render_mode
        self._has_begun = False
        count = max(map(len, self.scene.views)) if views == 'all' else 1
        shape = count, self.camera.height, self.camera.width
        boxes = gymnasium.spaces
        self._parts: dict[str, gymnasium.spaces.Space[Any]] = {
            'color': boxes.Box(0, 255, (*shape, 3), np.uint8),
            'depth': boxes.Box(0, 65535, shape, np.uint16),
            'camera_to_map': boxes.Box(-np.inf, np.inf, (count, 4, 4), np.float64),
            'valid': boxes.MultiBinary(count),
            'pose': boxes.Box(-np.inf, np.inf, (3,), np.float64),
        }
        self.observation_space = boxes.Dict(self._parts)
        self.action_space = boxes.Discrete(NUM_ACTIONS)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw a start and look around. The option `start` is the number of a position instead.

        Raises:
            ValueError: If there is no such position.
        """
        super().reset(seed=seed, options=options)
        start = (options or {}).get('start')
        self.simulation.restart(int(self.np_random.integers(2**32)), start)
        self._has_begun = True
        return self._observation(), self._info()

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take one action.

        Raises:
            gymnasium.error.ResetNeeded: If no episode is running.
            ValueError: If the action is not an index from 0 to 8.
        """
        simulation = self.simulation
        if not self._has_begun or simulation.outcome is not Outcome.RUNNING:
            msg = 'No episode is running: call reset first.'
            raise gymnasium.error.ResetNeeded(msg)
        simulation.step(int(action))
        outcome = simulation.result().outcome
        return (
            self._observation(),
            float(outcome is Outcome.SUCCESS),
            outcome in (Outcome.SUCCESS, Outcome.FALSE_DONE),
            outcome is Outcome.TIMEOUT,
            self._info(),
        )

    def render(self) -> NDArray[np.uint8] | None:
        """Return what the robot sees ahead, (H, W, 3), black if it can't be read.

        Raises:
            gymnasium.error.ResetNeeded: If there was no episode yet.
        """
        if self.render_mode is None:
            return None
        if not self._has_begun:
            msg = 'There is nothing to render: call reset first.'
            raise gymnasium.error.ResetNeeded(msg)
        frame = self._frame(self.simulation.heading_name)
        if frame is None:
            return np.zeros((self.camera.height, self.camera.width, 3), dtype=np.uint8)
        return frame.color

    def _frame(self, name: str) -> RgbdFrame | None:
        """Return a frame, or None if it can't be read."""
        try:
            return self.scene.frame(name)
        except FrameError:
            return None

    def _observation(self) -> Observation:
        observation: Observation = {
            key: np.zeros(part.shape, part.dtype) for key, part in self._parts.items()
        }
        for index, name in enumerate(self.simulation.seen_names):
            matrix = self.scene.source.camera_to_map(name)
            observation['camera_to_map'][index] = matrix
            frame = self._frame(name)
            if frame is not None:
                observation['color'][index] = frame.color
                observation['depth'][index] = frame.depth
                observation['valid'][index] = 1
        x, y = self.scene.positions[self.simulation.position].tolist()
        yaw = self.scene.headings[self.simulation.position][self.simulation.view]
        observation['pose'][:] = x, y, yaw
        return observation

    def _info(self) -> dict[str, Any]:
        simulation = self.simulation
        result = simulation.result()
        return {
            'outcome': result.outcome,
            'goal': simulation.goal,
            'position': simulation.position,
            'path_length': result.path_cost * GRID_M,
            'shortest_path': result.expert_cost * GRID_M,
            'spl': result.spl,
            'bumps': simulation.bumps,
        }
