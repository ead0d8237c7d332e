"""The Gymnasium environment and its vectorised twin."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from tests.maze_sim.test_map_file import write_map

from gridnav import DONE, GOAL, NUM_ACTIONS, OBSTACLE, Outcome
from maze_sim import (
    ENV_ID,
    WORLD_KINDS,
    MazeSimulation,
    draw_world,
    sample_maze,
    shortest_actions,
)
from maze_sim.env import CELL_PX, GOAL_RGB, ROBOT_RGB, UNSEEN_RGB, GridMaze2DEnv
from maze_sim.vector_env import GridMaze2DVectorEnv

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


def expert_action(simulation: MazeSimulation, row: int) -> int:
    """Return what the expert would do next in one row."""
    maze = simulation.mazes[row]
    cell = (int(simulation.cells[row, 0]), int(simulation.cells[row, 1]))
    return (shortest_actions(maze.blocked, cell, maze.goal) or [DONE])[0]


def simulation_of(env: Any) -> MazeSimulation:  # noqa: ANN401
    """Return what runs inside an environment."""
    simulation = env.unwrapped._simulation
    assert isinstance(simulation, MazeSimulation)
    return simulation


@pytest.mark.parametrize(
    'kwargs',
    [
        {},
        {'size': 20, 'view_range': 3, 'stop_on_repeat': True},
        {'size': [16, 24], 'kind': 'caves', 'slip': 0.2, 'pose_noise': 1.0},
    ],
)
def test_environment_passes_the_checker(kwargs: dict[str, Any]) -> None:
    """Gymnasium's checker finds nothing, not even something to warn of."""
    env = gymnasium.make(ENV_ID, **kwargs)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        check_env(env.unwrapped)


def test_environment_is_registered() -> None:
    """It can be made by its name, in one go with the import, alone and vectorised."""
    assert isinstance(gymnasium.make('maze_sim:GridMaze2D-v0').unwrapped, GridMaze2DEnv)
    assert isinstance(gymnasium.make_vec('GridMaze2D-v0', num_envs=2), GridMaze2DVectorEnv)


def test_documentation_has_the_headings_of_gymnasium() -> None:
    """The class is documented under Gymnasium's fixed headings, in their order."""
    headings = [
        line.strip().removeprefix('## ')
        for line in (GridMaze2DEnv.__doc__ or '').splitlines()
        if line.strip().startswith('## ')
    ]
    assert headings == [
        'Description',
        'Action Space',
        'Observation Space',
        'Starting State',
        'Rewards',
        'Episode End',
        'Information',
        'Arguments',
        'Version History',
    ]


def test_expert_earns_the_reward() -> None:
    """Done on the goal is the only thing rewarded, and ends the episode."""
    env = gymnasium.make(ENV_ID)
    for seed in range(5):
        _, info = env.reset(seed=seed)
        assert info == {'outcome': 'running', 'spl': 0.0}
        terminated, rewards = False, []
        while not terminated:
            action = np.int64(expert_action(simulation_of(env), 0))
            observation, reward, terminated, truncated, info = env.step(action)
            rewards.append(float(reward))
            assert not truncated
        assert sum(rewards) == rewards[-1] == 1.0
        assert info['outcome'] == 'success'
        assert info['spl'] == pytest.approx(1.0)
        assert observation['partial_map'][GOAL, observation['cell'][0], observation['cell'][1]]


def test_ends_are_terminations_and_cuts_are_truncations() -> None:
    """A collision and a false Done terminate, the budget and an exact loop truncate."""
    env = GridMaze2DEnv(max_steps=2)
    env.reset(seed=0)
    *_, terminated, truncated, info = env.step(np.int64(DONE))
    assert (terminated, truncated, info['outcome']) == (True, False, 'false_done')

    observation, _ = env.reset(seed=0)
    row, col = observation['cell']
    walls = observation['partial_map'][OBSTACLE]
    into_wall = next(
        action
        for action, (dr, dc) in enumerate([(1, 0), (0, 1), (-1, 0), (0, -1)])
        if walls[row + dr, col + dc]
    )
    *_, reward, terminated, truncated, info = env.step(np.int64(2 * into_wall))
    assert (reward, terminated, truncated, info['outcome']) == (0.0, True, False, 'collision')

    env.reset(seed=0)
    for _ in range(2):
        *_, terminated, truncated, info = env.step(np.int64(expert_action(simulation_of(env), 0)))
    assert (terminated, truncated, info['outcome']) == (False, True, 'timeout')

    env = GridMaze2DEnv(stop_on_repeat=True)
    env.reset(seed=0)
    there = expert_action(simulation_of(env), 0)
    back = (there + 4) % 8
    for action in (there, back) * 3:
        *_, terminated, truncated, info = env.step(np.int64(action))
        if truncated:
            break
    assert (terminated, truncated, info['outcome']) == (False, True, 'repeat')


def test_steps_need_a_running_episode() -> None:
    """A step before the first reset or after the end is refused with one sentence."""
    env = GridMaze2DEnv(render_mode='rgb_array')
    for call in (lambda: env.step(np.int64(0)), env.render):
        with pytest.raises(gymnasium.error.ResetNeeded, match='call reset first'):
            call()
    env.reset(seed=0)
    env.step(np.int64(DONE))
    with pytest.raises(gymnasium.error.ResetNeeded, match='call reset first'):
        env.step(np.int64(DONE))
    with pytest.raises(gymnasium.error.ResetNeeded, match='call reset first'):
        GridMaze2DVectorEnv(2).step(np.zeros(2, dtype=np.int64))


def test_episodes_follow_the_generator() -> None:
    """A seeded environment draws the mazes that the generator draws from that seed."""
    env = GridMaze2DEnv(size=13, min_expert_steps=10)
    rng, _ = gymnasium.utils.seeding.np_random(4)
    for seed in (4, None, None):
        env.reset(seed=seed)
        maze = sample_maze(13, rng, 10)
        assert (simulation_of(env).mazes[0].blocked == maze.blocked).all()
        assert simulation_of(env).mazes[0].goal == maze.goal


def test_worlds_of_all_kinds_and_from_files_are_there(tmp_path: Path) -> None:
    """The spaces have the shape of the world; the reported cell differs where it is noisy."""
    blocked = draw_world('rooms', (18, 22), np.random.default_rng(0))
    path = write_map(tmp_path, blocked)
    env = gymnasium.make(ENV_ID, map_file=str(path), pose_noise=3.0)
    observation, _ = env.reset(seed=0)
    assert observation['partial_map'].shape == (3, 18, 22)
    assert env.observation_space.contains(observation)
    assert (simulation_of(env).mazes[0].blocked == blocked).all()
    assert (observation['cell'] == simulation_of(env).reported_cells[0]).all()
    assert (observation['cell'] != simulation_of(env).cells[0]).any()
    for kind in WORLD_KINDS:
        env = gymnasium.make(ENV_ID, size=(20, 14), kind=kind)
        observation, _ = env.reset(seed=1)
        assert observation['partial_map'].shape == (3, 20, 14)
    with pytest.raises(ValueError, match="got 'swamp'"):
        GridMaze2DVectorEnv(2, kind='swamp')


def test_picture_shows_the_map_north_up() -> None:
    """Row 0 is the lowest of the picture; nothing unseen is drawn."""
    env = GridMaze2DEnv(render_mode='rgb_array')
    observation, _ = env.reset(seed=0)
    for _ in range(100):
        if observation['partial_map'][GOAL].any():
            break
        observation, *_ = env.step(np.int64(expert_action(simulation_of(env), 0)))
    picture = env.render()
    assert picture is not None
    assert picture.shape == (15 * CELL_PX, 15 * CELL_PX, 3)
    cells = picture[::CELL_PX, ::CELL_PX][::-1]
    assert tuple(cells[tuple(observation['cell'])]) == ROBOT_RGB
    assert (cells[observation['partial_map'][GOAL] > 0] == GOAL_RGB).all()
    unseen = ~observation['partial_map'].any(axis=0)
    assert ((cells == UNSEEN_RGB).all(axis=-1) == unseen).all()
    assert GridMaze2DEnv().render() is None


def assert_same(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]]) -> None:
    """Compare two dicts of arrays, their keys, types and values."""
    assert set(one) == set(other)
    for key, value in one.items():
        assert value.dtype == other[key].dtype, key
        np.testing.assert_array_equal(value, other[key], err_msg=key)


@pytest.mark.parametrize(
    'kwargs',
    [
        {'size': 15, 'view_range': 2, 'max_steps': 25, 'stop_on_repeat': True},
        {'size': (12, 15), 'kind': 'rooms', 'max_steps': 25, 'slip': 0.2, 'pose_noise': 0.7},
        {'size': 9, 'view_range': 4, 'max_steps': 8, 'stop_on_repeat': True},
    ],
)
def test_vector_environment_equals_single_ones(kwargs: dict[str, Any]) -> None:
    """Step by step the twin gives what single environments of the same seeds give, resets too."""
    count = 12
    kwargs = {'min_expert_steps': 4, **kwargs}
    twin = GridMaze2DVectorEnv(count, **kwargs)
    single = SyncVectorEnv([lambda: GridMaze2DEnv(**kwargs) for _ in range(count)])
    assert twin.observation_space == single.observation_space
    assert twin.action_space == single.action_space
    rng = np.random.default_rng(0)
    outcomes: set[str] = set()
    for seed in (3, None):
        for one, other in zip(twin.reset(seed=seed), single.reset(seed=seed), strict=True):
            assert_same(one, other)
        for _ in range(150):
            # A third follows the expert, a third wanders, a third does anything.
            simulation = simulation_of(twin)
            actions = rng.integers(NUM_ACTIONS, size=count)
            actions[: count // 3] = [expert_action(simulation, row) for row in range(count // 3)]
            for row in range(count // 3, 2 * count // 3):
                path = expert_action(simulation, row)
                actions[row] = path if rng.random() < 0.6 else (path + 4) % 8
            observation, *arrays, infos = twin.step(actions)
            other_observation, *other_arrays, other_infos = single.step(actions)
            assert_same(observation, other_observation)
            assert observation['partial_map'].dtype == np.float32
            for array, other_array in zip(arrays, other_arrays, strict=True):
                assert array.dtype == other_array.dtype
                np.testing.assert_array_equal(array, other_array)
            assert_same(infos, other_infos)
            outcomes |= set(infos['outcome'])
    expected = set(Outcome) - {Outcome.GAVE_UP}
    if not kwargs.get('stop_on_repeat'):
        expected -= {Outcome.REPEAT}
    assert outcomes == expected


def test_vector_observations_belong_to_the_caller() -> None:
    """What was returned does not change with later steps, nor does changing it matter."""
    env = GridMaze2DVectorEnv(4)
    first, infos = env.reset(seed=0)
    kept = first['partial_map'].copy(), first['cell'].copy(), infos['outcome'].copy()
    simulation = simulation_of(env)
    actions = np.array([DONE] + [expert_action(simulation, row) for row in range(1, 4)])
    second, *_ = env.step(actions)
    for before, now in zip(kept, (*first.values(), infos['outcome']), strict=True):
        assert (before == now).all()
    second['cell'][:] = 0
    second['partial_map'][:] = 0
    assert simulation.partial_maps.any()
    assert simulation.cells.all()


def test_vector_environment_works_with_wrappers() -> None:
    """The infos and the autoreset mode are those that Gymnasium's wrappers build on."""
    env = RecordEpisodeStatistics(GridMaze2DVectorEnv(3, max_steps=1))
    assert env.metadata['autoreset_mode'] is AutoresetMode.NEXT_STEP
    env.reset(seed=0)
    *_, infos = env.step(np.full(3, DONE))
    assert infos['episode']['l'].tolist() == [1, 1, 1]
