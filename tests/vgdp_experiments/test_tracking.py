"""The belief filter in the loop: it knows where the robots are, as well as it can be known."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gridnav import DONE, FREE, STEPS, valid_moves
from maze_sim import MazeSimulation, make_mazes
from vgdp_experiments.suites.localisation import localise
from vgdp_experiments.tracking import BeliefTracker
from vgdp_planner.belief import BeliefFilter

COUNT, STEPS_TAKEN = 40, 12


@pytest.fixture(scope='module')
def belief_filter() -> BeliefFilter:
    """Return a filter that knows how steps lead and that views are mostly right."""
    made = BeliefFilter()
    with torch.no_grad():
        made.motion.logits.fill_(-12.0)
        for action, (row, col) in enumerate(STEPS[:8].tolist()):
            made.motion.logits[action, row + 1, col + 1] = 0.0
        made.log_confusion.copy_(torch.tensor([[0.97, 0.02, 0.4], [0.02, 0.97, 0.4]]).log())
    return made


def follow(tracker: BeliefTracker, simulation: MazeSimulation) -> tuple[float, float]:
    """Let robots wander; returns the mean errors of the belief and of the reported cells."""
    rng = np.random.default_rng(0)
    valid = valid_moves(np.stack([maze.blocked for maze in simulation.mazes]))
    tracker.begin(simulation.partial_maps, simulation.reported_cells)
    believed, reported = [], []
    for _ in range(STEPS_TAKEN):
        possible = valid[np.arange(COUNT), :, simulation.cells[:, 0], simulation.cells[:, 1]]
        actions = np.where(possible, rng.random((COUNT, 8)), -1.0).argmax(axis=1)
        maps = simulation.partial_maps.copy()
        simulation.step(actions)
        tracker.follow(actions, maps, simulation.reported_cells, simulation.windows())
        np.testing.assert_allclose(tracker.beliefs.sum(axis=(1, 2)), 1.0, rtol=1e-4)
        flat = tracker.beliefs.reshape(COUNT, -1).argmax(axis=1)
        likely = np.stack(np.divmod(flat, tracker.beliefs.shape[2]), axis=1)
        believed.append(np.hypot(*(likely - simulation.cells).T).mean())
        reported.append(np.hypot(*(simulation.reported_cells - simulation.cells).T).mean())
    return float(np.mean(believed)), float(np.mean(reported))


@pytest.mark.parametrize('slip', [0.0, 0.3])
@pytest.mark.parametrize('noise', [0.5, 1.5])
def test_the_belief_is_better_than_the_reported_cell(
    belief_filter: BeliefFilter, noise: float, slip: float
) -> None:
    """With noisy poses and slipping steps the most likely cell is nearer than the reported."""
    simulation = MazeSimulation(make_mazes(COUNT, 15, seed=0), 2, 500, slip=slip, pose_noise=noise)
    believed, reported = follow(BeliefTracker(belief_filter, slip, noise), simulation)
    assert believed < 0.5 * reported


def test_an_exact_pose_is_believed(belief_filter: BeliefFilter) -> None:
    """Without noise the belief is the reported cell, slips or not."""
    simulation = MazeSimulation(make_mazes(COUNT, 15, seed=0), 2, 500, slip=0.5)
    tracker = BeliefTracker(belief_filter, 0.5, 0.0)
    assert follow(tracker, simulation) == (0.0, 0.0)
    assert (tracker.beliefs.max(axis=(1, 2)) > 1 - 1e-6).all()


def test_reported_cells_are_as_likely_as_the_tracker_thinks(belief_filter: BeliefFilter) -> None:
    """The shares of the first belief are those with which cells are reported, edges included."""
    mazes = make_mazes(1, 15, seed=0) * 4000
    simulation = MazeSimulation(mazes, 2, 500, pose_noise=1.0)
    tracker = BeliefTracker(belief_filter, 0.0, 1.0)
    start = mazes[0].start
    reported, counts = np.unique(simulation.reported_cells[:, 0], return_counts=True)
    share = tracker._share(15, reported[:, None])[:, start[0]]
    np.testing.assert_allclose(counts / len(mazes), share, atol=0.03)


def test_robots_begin_on_cells_that_they_see(belief_filter: BeliefFilter) -> None:
    """However bad the poses, the first belief holds the true cell and nothing but free cells."""
    simulation = MazeSimulation(make_mazes(COUNT, 15, seed=0), 2, 500, pose_noise=2.0)
    tracker = BeliefTracker(belief_filter, 0.0, 2.0)
    tracker.begin(simulation.partial_maps, simulation.reported_cells)
    assert (tracker.beliefs[simulation.partial_maps[:, FREE] == 0] == 0).all()
    assert (tracker.beliefs[np.arange(COUNT), *simulation.cells.T] > 0).all()


def test_done_moves_no_belief(belief_filter: BeliefFilter) -> None:
    """What is done with says nothing about where the robot is, even where steps slip."""
    simulation = MazeSimulation(make_mazes(1, 15, seed=0), 2, 500, pose_noise=1.0)
    tracker = BeliefTracker(belief_filter, 0.3, 1.0)
    tracker.begin(simulation.partial_maps, simulation.reported_cells)
    before = tracker.beliefs.copy()
    blind = np.full((1, 5, 5), -1, dtype=np.int8)
    tracker.follow(np.array([DONE]), simulation.partial_maps, simulation.cells, blind)
    weighed = before * tracker._measured(torch.ones(1, 15, 15), simulation.cells).numpy()
    free = simulation.partial_maps[:, 0] == 0
    expected = np.where(free, weighed, 0) / np.where(free, weighed, 0).sum()
    np.testing.assert_allclose(tracker.beliefs, expected, atol=1e-5)


def test_a_lost_robot_finds_itself(belief_filter: BeliefFilter) -> None:
    """In a known maze the belief gathers around the true cell within a few steps."""
    entropies, errors = localise(
        belief_filter, make_mazes(COUNT, 15, seed=0), 2, 6, np.random.default_rng(0)
    )
    assert entropies.shape == errors.shape == (7, COUNT)
    assert entropies[6].mean() < 0.25 * entropies[0].mean()
    assert (errors[6] == 0).mean() > 0.9
