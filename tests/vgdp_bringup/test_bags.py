"""Reading episodes out of bags."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.vgdp_bringup.synthetic import PLANNING, SECOND, SyntheticBag, status

from gridnav.metrics import Outcome
from maze_sim import make_mazes
from vgdp_bringup.bags import BagError, read_episodes

if TYPE_CHECKING:
    from pathlib import Path


def test_an_episode_is_cut_into_steps(tmp_path: Path) -> None:
    """Each step has what was said with its stamp, and messages said again count once."""
    bag = SyntheticBag(tmp_path / 'bag')
    bag.add_episode(seed=4, start=100 * SECOND)
    bag.close()
    (episode,) = read_episodes(tmp_path / 'bag')
    maze = make_mazes(1, 15, 4)[0]
    assert episode.outcome is Outcome.SUCCESS
    assert float(episode.values['spl']) == pytest.approx(1.0)
    assert [step.stamp for step in episode.steps] == [
        (100 + i) * SECOND for i in range(maze.expert_steps + 2)
    ]
    first, last = episode.steps[0], episode.steps[-1]
    assert first.position == (maze.start[1] + 0.5, maze.start[0] + 0.5)
    assert last.position == episode.goal == (maze.goal[1] + 0.5, maze.goal[0] + 0.5)
    assert first.map is not None
    assert last.map is not None
    assert first.map.cells[maze.start] == 0
    assert np.count_nonzero(first.map.cells >= 0) < np.count_nonzero(last.map.cells >= 0)
    assert first.plan is not None
    assert np.array_equal(first.plan - first.position, [(0, 0), (1, 0), (2, 0)])
    assert [c.value for c in episode.steps[2].candidates] == [-3.0, -9.0, -70.0]
    assert first.value_map is not None
    assert first.value_map.cells[maze.goal] == 100
    assert last.plan is None
    assert episode.median_latency == pytest.approx(PLANNING / SECOND)


def test_the_goal_is_known_from_the_step_that_saw_it(tmp_path: Path) -> None:
    """Its stamp is that of an observation, and not of the first one."""
    bag = SyntheticBag(tmp_path / 'bag')
    bag.add_episode(seed=0, start=SECOND)
    bag.close()
    (episode,) = read_episodes(tmp_path / 'bag')
    assert episode.goal_stamp in {step.stamp for step in episode.steps[1:]}


def test_episodes_are_told_apart(tmp_path: Path) -> None:
    """Every step lies in the episode that ran at its stamp; one that did not end is running."""
    bag = SyntheticBag(tmp_path / 'bag', namespace='/robot/')
    bag.add_episode(seed=1, start=1000 * SECOND)
    bag.add_episode(seed=2, start=2000 * SECOND)
    bag.add('episode', 3000 * SECOND, status('maze_sim', 'running', 3000 * SECOND))
    bag.add('episode', 3000 * SECOND, status('vgdp_planner', 'exhausted', 2000 * SECOND))
    bag.close()
    first, second, third = read_episodes(tmp_path / 'bag', '/robot')
    assert first.values['seed'] == '1'
    assert second.values['seed'] == '2'
    assert {step.stamp // (1000 * SECOND) for step in first.steps} == {1}
    assert {step.stamp // (1000 * SECOND) for step in second.steps} == {2}
    assert second.outcome is Outcome.SUCCESS
    assert third.outcome is Outcome.RUNNING
    assert third.steps == []
    assert third.median_latency is None


def test_a_bag_without_an_episode_is_refused(tmp_path: Path) -> None:
    """There is nothing to cut."""
    SyntheticBag(tmp_path / 'bag').close()
    with pytest.raises(BagError, match='bag holds no episode'):
        read_episodes(tmp_path / 'bag')


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    """A missing folder and a damaged file are named in one sentence."""
    with pytest.raises(BagError, match='missing is not a readable bag'):
        read_episodes(tmp_path / 'missing')
    bag = SyntheticBag(tmp_path / 'bag')
    bag.add_episode(seed=0, start=SECOND)
    bag.close()
    file = tmp_path / 'bag' / 'bag_0.mcap'
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(BagError, match='bag is not a readable bag'):
        read_episodes(tmp_path / 'bag')
