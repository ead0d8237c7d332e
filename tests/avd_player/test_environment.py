"""The Gymnasium environment."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from tests.avd_player.test_avd import world_points

from avd_player import ENV_ID
from avd_player.avd_format import COLOR_FOLDER
from avd_player.environment import ActiveVisionEnv
from gridnav.actions import DONE

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.avd_player.tiny_scene import TinyScene

SMALL: dict[str, Any] = {'width': 48, 'reach': 0.5, 'min_expert_steps': 1}


@pytest.mark.parametrize('views', ['all', 'heading'])
def test_environment_passes_the_checker(tiny: TinyScene, views: str) -> None:
    """Gymnasium's checker finds nothing but that coordinates have no bounds."""
    env = gymnasium.make(ENV_ID, scene=str(tiny.folder), views=views, **SMALL)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        warnings.filterwarnings('ignore', message='.*infinity')
        check_env(env.unwrapped)


def test_documentation_has_the_headings_of_gymnasium() -> None:
    """The class is documented under Gymnasium's fixed headings, in their order."""
    lines = (line.strip() for line in (ActiveVisionEnv.__doc__ or '').splitlines())
    assert [line.removeprefix('## ') for line in lines if line.startswith('## ')] == [
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


def test_observations_are_the_frames_of_a_position(tiny: TinyScene) -> None:
    """All twelve in their order with their poses, or the one that looks ahead."""
    env = ActiveVisionEnv(tiny.folder, **SMALL)
    observation, info = env.reset(seed=0, options={'start': 2})
    assert info['position'] == 2
    assert observation['valid'].all()
    for index, name in enumerate(tiny.names[24:36]):
        frame = env.scene.frame(name)
        np.testing.assert_array_equal(observation['color'][index], frame.color)
        np.testing.assert_array_equal(observation['depth'][index], frame.depth)
        np.testing.assert_allclose(observation['camera_to_map'][index], frame.camera_to_map())
        points = world_points(frame, observation['camera_to_map'][index])
        assert -0.1 < points[:, 2].min() < points[:, 2].max() < 2.5
    x, y, yaw = observation['pose']
    assert (x, y) == pytest.approx(env.scene.positions[2])
    assert abs(yaw) < 0.3
    ahead = ActiveVisionEnv(tiny.folder, views='heading', render_mode='rgb_array', **SMALL)
    narrow, _ = ahead.reset(options={'start': 2})
    assert narrow['color'].shape == (1, 27, 48, 3)
    assert narrow['pose'] == pytest.approx(observation['pose'])
    picture = ahead.render()
    assert picture is not None
    np.testing.assert_array_equal(picture, narrow['color'][0])
    assert env.render() is None


def test_an_episode_ends_as_documented(tiny: TinyScene) -> None:
    """Reward and termination for Done, truncation for the budget; lengths are metres."""
    env = ActiveVisionEnv(tiny.folder, max_steps=2, **SMALL)
    with pytest.raises(gymnasium.error.ResetNeeded, match='call reset first'):
        env.step(np.int64(0))
    _, info = env.reset(seed=1)
    assert info['outcome'] == 'running'
    start = env.simulation.start
    assert info['shortest_path'] == pytest.approx(0.3 * env.simulation.expert.costs[start])
    *_, reward, terminated, truncated, info = env.step(np.int64(DONE))
    assert (reward, terminated, truncated, info['outcome']) == (0.0, True, False, 'false_done')
    with pytest.raises(gymnasium.error.ResetNeeded, match='call reset first'):
        env.step(np.int64(DONE))

    _, info = env.reset(options={'start': 1})
    assert info['goal'] is not None
    *_, reward, terminated, truncated, info = env.step(np.int64(1))
    assert (reward, terminated, truncated, info['outcome']) == (0.0, False, False, 'running')
    long = ActiveVisionEnv(tiny.folder, **SMALL)
    _, info = long.reset(options={'start': 1})
    assert info['goal'] is not None
    *_, info = long.step(np.int64(1))
    assert long.simulation.goals[info['position']]
    *_, reward, terminated, truncated, info = long.step(np.int64(DONE))
    assert (reward, terminated, truncated, info['outcome']) == (1.0, True, False, 'success')
    assert info['path_length'] == pytest.approx(info['shortest_path'])
    assert info['spl'] == pytest.approx(1.0)

    env.reset(options={'start': 0})
    env.step(np.int64(2))
    *_, terminated, truncated, info = env.step(np.int64(4))
    assert (terminated, truncated, info['outcome'], info['bumps']) == (False, True, 'timeout', 1)
    assert info['path_length'] == pytest.approx(0.3, abs=0.01)


def test_seeds_give_starts(tiny: TinyScene) -> None:
    """The same for the same seed, others for others."""
    env = ActiveVisionEnv(tiny.folder, **SMALL)
    starts = [env.reset(seed=seed)[1]['position'] for seed in range(12)]
    assert starts == [env.reset(seed=seed)[1]['position'] for seed in range(12)]
    assert len(set(starts)) > 1


def test_images_that_can_not_be_read_are_not_valid(damaged: Callable[[], Path]) -> None:
    """Their arrays are 0, their poses are there, and the others are as ever."""
    folder = damaged()
    (folder / COLOR_FOLDER / '000110000020101.jpg').write_bytes(b'')
    env = ActiveVisionEnv(folder, **SMALL)
    observation, _ = env.reset(options={'start': 0})
    assert observation['valid'].tolist() == [1, 0] + [1] * 10
    assert not observation['color'][1].any()
    assert observation['camera_to_map'][1, 3].tolist() == [0, 0, 0, 1]
    assert env.observation_space.contains(observation)
