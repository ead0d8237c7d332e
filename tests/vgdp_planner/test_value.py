"""The value function: action mask, rewards, value iteration."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch

from gridnav import DONE, FREE, GOAL, NUM_MOVES, OBSTACLE, STEP_LENGTHS, STEPS, valid_moves
from maze_sim import cost_to_go, wilson_maze
from vgdp_planner import ValueGuidedPlanner, preset
from vgdp_planner.value import ValueNetwork


@pytest.fixture(scope='module')
def network() -> ValueNetwork:
    """Return the shipped value function."""
    return ValueGuidedPlanner.from_pretrained().value_network


def known_map(blocked: np.ndarray, goal: tuple[int, int]) -> np.ndarray:
    """Return the partial map of a fully observed world, (3, H, W)."""
    partial_map = np.zeros((3, *blocked.shape), dtype=np.float32)
    partial_map[OBSTACLE], partial_map[FREE] = blocked, ~blocked
    partial_map[GOAL][goal] = 1
    return partial_map


@torch.no_grad()
def test_mask_is_right_for_every_neighbourhood(network: ValueNetwork) -> None:
    """For all 3^8 neighbourhoods of a free cell the mask is the rule of valid steps."""
    around = np.array(list(itertools.product(range(3), repeat=8)))
    codes = np.insert(around, 4, 1, axis=1).reshape(-1, 3, 3)
    maps = np.zeros((len(codes), 3, 3, 3), dtype=np.float32)
    maps[:, FREE], maps[:, OBSTACLE] = codes == 1, codes == 2
    mask = network.action_mask(torch.from_numpy(maps))[:, :NUM_MOVES, 1, 1].numpy()
    valid = valid_moves(codes == 2)[:, :, 1, 1]
    assert np.array_equal(mask > 0.5, valid)
    assert np.abs(mask - valid).max() < 0.05


@torch.no_grad()
def test_steps_off_the_map_are_invalid(network: ValueNetwork) -> None:
    """At the border of the map the mask is shut, unlike towards unseen cells."""
    maps = np.zeros((1, 3, 5, 5), dtype=np.float32)
    maps[:, FREE] = 1
    mask = network.action_mask(torch.from_numpy(maps))[0, :NUM_MOVES].numpy()
    assert np.array_equal(mask > 0.5, valid_moves(np.zeros((5, 5), dtype=bool)))


def test_motion_and_step_rewards_are_learned(network: ValueNetwork) -> None:
    """T_m puts nearly all weight where each step leads, R_m says what it costs."""
    kernels = network.motion.kernels().detach().numpy()
    for action, (dr, dc) in enumerate(STEPS.tolist()):
        assert kernels[action, 1 + dr, 1 + dc] > 0.99
    rewards = (network.motion.kernels() * network.motion_reward).sum(dim=(1, 2))
    np.testing.assert_allclose(rewards.detach().numpy(), -STEP_LENGTHS[:NUM_MOVES], atol=0.01)


@pytest.mark.parametrize('size', [9, 15, 31])
@torch.no_grad()
def test_values_are_the_cost_to_a_known_goal(network: ValueNetwork, size: int) -> None:
    """In a fully known maze V is minus Dijkstra's cost to the goal, at any size."""
    blocked = wilson_maze(size, np.random.default_rng(size))
    goal = (1, 1)
    values = network(torch.from_numpy(known_map(blocked, goal))[None])
    costs = cost_to_go(blocked, goal)
    free = np.isfinite(costs)
    assert np.array_equal(values.reached[0].numpy(), free)
    np.testing.assert_allclose(-values.values[0].numpy()[free], costs[free], rtol=0.01, atol=0.05)
    assert values.residual <= network.config.tolerance


@torch.no_grad()
def test_a_long_corridor_has_a_gradient(network: ValueNetwork) -> None:
    """A snake of 400 cells: each step towards the goal at its end is worth more."""
    blocked = np.ones((21, 41), dtype=bool)
    blocked[1::2, 1:-1] = False
    for row in range(2, 20, 2):
        blocked[row, -2 if (row // 2) % 2 else 1] = False
    costs = cost_to_go(blocked, (19, 39))
    assert costs[1, 1] > 350
    values = network(torch.from_numpy(known_map(blocked, (19, 39)))[None])
    best = values.q_values[0, :NUM_MOVES].argmax(dim=0).numpy()
    for row, col in np.argwhere(np.isfinite(costs) & (costs > 0)):
        step = STEPS[best[row, col]]
        assert costs[row + step[0], col + step[1]] < costs[row, col]


@torch.no_grad()
def test_done_is_best_on_the_goal_only(network: ValueNetwork) -> None:
    """Q prefers Done on the goal and nowhere else."""
    blocked = wilson_maze(15, np.random.default_rng(3))
    values = network(torch.from_numpy(known_map(blocked, (1, 1)))[None])
    best = values.q_values[0].argmax(dim=0).numpy()
    assert best[1, 1] == DONE
    others = ~blocked
    others[1, 1] = False
    assert (best[others] != DONE).all()


@torch.no_grad()
def test_a_goal_in_reach_beats_the_unseen(network: ValueNetwork) -> None:
    """However near something unseen is, the way leads to the goal that was seen."""
    partial_map = np.zeros((3, 3, 30), dtype=np.float32)
    partial_map[OBSTACLE] = 1
    partial_map[:, 1, 1:29] = np.array([0, 1, 0], dtype=np.float32)[:, None]
    partial_map[GOAL, 1, 28] = 1
    partial_map[:, 1, 0] = 0
    values = network(torch.from_numpy(partial_map)[None])
    assert (values.q_values[0, :, 1, 1:28].argmax(dim=0) == 2).all()


@torch.no_grad()
def test_values_stay_costs_when_the_goal_is_behind_the_unseen(network: ValueNetwork) -> None:
    """With the goal in sight but no known way, the values are those of looking further."""
    partial_map = np.zeros((3, 9, 9), dtype=np.float32)
    partial_map[FREE, 4, 1:4] = 1
    partial_map[OBSTACLE, 3, :] = partial_map[OBSTACLE, 5, :] = 1
    before = network(torch.from_numpy(partial_map)[None]).shown(0)
    partial_map[FREE, 8, 8] = partial_map[GOAL, 8, 8] = 1
    after = network(torch.from_numpy(partial_map)[None]).shown(0)
    assert after[8, 8] == 0
    assert np.abs(after[4, 1:4] - before[4, 1:4]).max() < 80


@torch.no_grad()
def test_nothing_in_reach(network: ValueNetwork) -> None:
    """In a closed, fully seen room no cell reaches anything."""
    blocked = np.ones((5, 5), dtype=bool)
    blocked[1:4, 1:4] = False
    partial_map = known_map(blocked, (2, 2))
    partial_map[GOAL] = 0
    values = network(torch.from_numpy(partial_map)[None])
    assert not values.reached.any()
    assert torch.isfinite(values.q_values).all()


def test_paper_reward_is_equation_8() -> None:
    """R = R_f (1 − Â) + Â Σ T_m R_m, with kernels over the partial map; zero before training."""
    torch.manual_seed(0)
    network = ValueNetwork(preset('paper').value)
    maps = torch.rand(2, 3, 9, 9)
    assert torch.equal(network(maps).step_rewards, torch.zeros(2, 9, 9, 9))
    with torch.no_grad():
        network.invalid_reward[:, :, 1, 1] = -5.0 / 3
    network_values = network(torch.ones(1, 3, 9, 9))
    mask = network.action_mask(torch.ones(1, 3, 9, 9))
    torch.testing.assert_close(network_values.step_rewards, -5.0 * (1 - mask))
    assert network_values.rounds == 60


def test_paper_values_can_be_trained() -> None:
    """Gradients of the action values reach all parameters of the paper's value function."""
    torch.manual_seed(0)
    network = ValueNetwork(preset('paper').value)
    with torch.no_grad():
        network.motion_reward.normal_()
    network(torch.rand(1, 3, 9, 9)).q_values.square().sum().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().sum() > 0, name


def random_maps(count: int, rows: int, cols: int) -> torch.Tensor:
    """Return partial maps of which a third is unseen, (count, 3, rows, cols)."""
    codes = np.random.default_rng(rows).choice(3, size=(count, rows, cols), p=[0.3, 0.2, 0.5])
    maps = np.zeros((count, 3, rows, cols), dtype=np.float32)
    maps[:, OBSTACLE], maps[:, FREE] = codes == 1, codes == 2
    return torch.from_numpy(maps)


@torch.no_grad()
def test_turned_and_mirrored_maps_have_the_same_worth(network: ValueNetwork) -> None:
    """The worth turns and mirrors with the map, also where that is no square."""
    maps = random_maps(2, 14, 19)
    worth = network.worth_of_unseen(maps)
    assert worth.std() > 1
    for swapped, axes in itertools.product((False, True), ((), (-1,), (-2,), (-2, -1))):
        turned = (maps.transpose(-1, -2) if swapped else maps).flip(axes)
        back = network.worth_of_unseen(turned).flip(axes)
        back = back.transpose(-1, -2) if swapped else back
        torch.testing.assert_close(back, worth, atol=1e-3, rtol=0)


@torch.no_grad()
def test_value_iteration_starts_where_it_ends(
    network: ValueNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The best ways are the fixed point that value iteration from nothing comes to, too."""
    maps = random_maps(3, 24, 31)
    at_once = network(maps)
    assert at_once.rounds == 1
    monkeypatch.setattr(
        ValueNetwork, '_best_way_values', lambda _self, boundary, _free, _costs: boundary
    )
    in_rounds = network(maps)
    assert in_rounds.rounds > 1
    assert in_rounds.residual <= network.config.tolerance
    torch.testing.assert_close(at_once.values, in_rounds.values, atol=1e-2, rtol=0)
    assert torch.equal(at_once.reached, in_rounds.reached)
