"""The lock-step evaluation of methods."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from gridnav import DONE, Outcome
from maze_sim import Maze, make_mazes, shortest_actions
from vgdp_experiments.evaluate import evaluate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


class Script:
    """A method that hands out a prepared list of commitments for each episode."""

    def __init__(self, commitments: Sequence[Sequence[list[int]]]) -> None:
        """Take, for each episode, what it commits to one time after the other."""
        self.settings: dict[str, Any] = {}
        self.asked: list[tuple[int, tuple[int, int]]] = []
        self.seeds: list[int] = []
        self._commitments = [iter(of_episode) for of_episode in commitments]
        self._episodes = range(0)

    def reset(self, episodes: range, seed: int) -> None:
        """Begin new episodes."""
        self._episodes = episodes
        self.seeds.append(seed)

    def act(
        self,
        partial_maps: NDArray[np.float32],
        cells: NDArray[np.int64],
        active: NDArray[np.bool_],
    ) -> list[list[int]]:
        """Hand out the next commitment of each active row."""
        assert len(partial_maps) == len(cells) == len(active) == len(self._episodes)
        actions: list[list[int]] = [[] for _ in active]
        for row in np.flatnonzero(active).tolist():
            episode = self._episodes[row]
            self.asked.append((episode, (int(cells[row, 0]), int(cells[row, 1]))))
            actions[row] = next(self._commitments[episode])
        return actions


def ways(mazes: Sequence[Maze]) -> list[list[int]]:
    """Return the expert's way through each maze."""
    return [shortest_actions(maze.blocked, maze.start, maze.goal) for maze in mazes]


@pytest.mark.parametrize('batch', [1, 2, 10])
def test_commitments_are_carried_out_in_order(batch: int) -> None:
    """Robots that commit to different numbers of steps all arrive, each asked at its own pace."""
    mazes = make_mazes(3, 15, seed=0)
    commitments = [
        [*([way[i : i + length] for i in range(0, len(way), length)]), [DONE]]
        for length, way in enumerate(ways(mazes), start=1)
    ]
    method = Script(commitments)
    finished: list[int] = []
    trial = evaluate(method, mazes, 2, 500, seed=5, batch=batch, on_finished=finished.append)
    assert [result.outcome for result in trial.results] == [Outcome.SUCCESS] * 3
    assert [result.steps for result in trial.results] == [maze.expert_steps + 1 for maze in mazes]
    assert [result.spl for result in trial.results] == pytest.approx([1.0] * 3)
    asked = [[cell for episode, cell in method.asked if episode == i] for i in range(3)]
    assert [len(cells) for cells in asked] == [len(of_episode) for of_episode in commitments]
    assert [(cells[0], cells[-1]) for cells in asked] == [
        (maze.start, maze.goal) for maze in mazes
    ]
    assert trial.decisions == len(method.asked)
    assert set(method.seeds) == {5}
    assert sum(finished) == 3


def test_a_method_may_give_up() -> None:
    """An empty commitment ends its own episode as given up, the others go on."""
    mazes = make_mazes(2, 15, seed=0)
    first, second = ways(mazes)
    trial = evaluate(Script([[first[:2], []], [[*second, DONE]]]), mazes, 2, 500, seed=0)
    assert [result.outcome for result in trial.results] == [Outcome.GAVE_UP, Outcome.SUCCESS]
    assert trial.results[0].steps == 2


def test_actions_after_the_end_are_dropped() -> None:
    """What was committed beyond a collision, or beyond the budget, is not carried out."""
    mazes = make_mazes(2, 15, seed=0)
    way = ways(mazes)[1]
    into_the_wall = next(
        action
        for action, (row, col) in {0: (1, 0), 2: (0, 1), 4: (-1, 0), 6: (0, -1)}.items()
        if mazes[0].blocked[mazes[0].start[0] + row, mazes[0].start[1] + col]
    )
    trial = evaluate(Script([[[into_the_wall] * 9], [way]]), mazes, 2, budget=4, seed=0)
    assert [result.outcome for result in trial.results] == [Outcome.COLLISION, Outcome.TIMEOUT]
    assert [result.steps for result in trial.results] == [1, 4]
