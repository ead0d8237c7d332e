"""Scores of plans against the same, rolled over the whole map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch

from gridnav import DONE, NUM_ACTIONS, NUM_MOVES
from maze_sim import MazeSimulation, make_mazes
from vgdp_planner import ValueGuidedPlanner
from vgdp_planner.analog_bits import CODEWORDS, encode
from vgdp_planner.guidance import ValueGuide, soft_actions, soft_score
from vgdp_planner.selection import (
    NO_ACTION,
    Surroundings,
    agreement,
    gain,
    greedy_plan,
    score_plans,
)
from vgdp_planner.value import Values

if TYPE_CHECKING:
    from vgdp_planner.belief import BeliefFilter

HORIZON, EXECUTE = 8, 2


@pytest.fixture(scope='module')
def planner() -> ValueGuidedPlanner:
    """Return the shipped planner."""
    return ValueGuidedPlanner.from_pretrained()


def beliefs_of(kind: str, count: int, height: int, width: int) -> torch.Tensor:
    """Return repeatable beliefs: on one cell, on a patch, or all over the map."""
    generator = torch.Generator().manual_seed(1)
    beliefs = torch.rand(count, height, width, generator=generator)
    for belief in beliefs:
        row, col = (int(torch.randint(side, (), generator=generator)) for side in (height, width))
        outside = torch.ones_like(belief, dtype=torch.bool)
        reach = {'point': 0, 'patch': 2, 'spread': max(height, width)}[kind]
        outside[max(row - reach, 0) : row + reach + 1, max(col - reach, 0) : col + reach + 1] = 0
        belief[outside] = 0
    return beliefs / beliefs.sum(dim=(1, 2), keepdim=True)


def random_values(count: int, height: int, width: int) -> Values:
    """Return values of a map that nobody iterated: any numbers will do."""
    generator = torch.Generator().manual_seed(2)

    def draw(*shape: int) -> torch.Tensor:
        return torch.rand(count, *shape, height, width, generator=generator)

    return Values(
        values=-20 * draw(),
        q_values=-20 * draw(NUM_ACTIONS),
        reached=draw() > 0,
        mask=draw(NUM_MOVES),
        step_rewards=-2 * draw(NUM_ACTIONS),
        rounds=0,
        residual=0.0,
        offsets=torch.zeros(count),
    )


def random_plans(count: int, plans: int) -> torch.Tensor:
    """Return repeatable plans, some with Done in the middle, some that end early."""
    generator = torch.Generator().manual_seed(3)
    drawn = torch.randint(NUM_ACTIONS, (count, plans, HORIZON), generator=generator)
    drawn[:, 0, 3:] = NO_ACTION
    drawn[:, 1] = NO_ACTION
    drawn[:, 2, 1] = DONE
    return drawn


def plain_score(
    values: Values, belief_filter: BeliefFilter, belief: torch.Tensor, row: int, plan: list[int]
) -> dict[str, float]:
    """Score one plan as the formulas say, over the whole map."""
    earned, q_terms, returns = 0.0, [], []
    for action in plan:
        if action == NO_ACTION:
            break
        q_terms.append(float((belief * values.q_values[row, action]).sum()))
        returns.append(earned + q_terms[-1])
        earned += float((belief * values.step_rewards[row, action]).sum())
        if action == DONE:
            break
        belief = belief_filter.predict(
            belief[None], torch.tensor([action]), values.mask[row, None]
        )[0]
    if not q_terms:
        return {'mean_q': 0.0, 'mean_return': 0.0, 'begin': 0.0}
    filled = returns + returns[-1:] * (HORIZON - len(returns))
    return {
        'mean_q': float(np.mean(q_terms)),
        'mean_return': float(np.mean(filled)),
        'begin': filled[EXECUTE - 1],
    }


@pytest.mark.parametrize('kind', ['point', 'patch', 'spread'])
@pytest.mark.parametrize('shape', [(15, 15), (9, 40)])
@torch.no_grad()
def test_windows_change_no_score(
    planner: ValueGuidedPlanner, kind: str, shape: tuple[int, int]
) -> None:
    """Scores from windows around the robots are those of the whole maps, edges included."""
    count, plans = 5, random_plans(5, 4)
    values = random_values(count, *shape)
    beliefs = beliefs_of(kind, count, *shape)
    around = Surroundings.cut_out(values, beliefs, HORIZON)
    expected = [
        [
            plain_score(values, planner.belief_filter, beliefs[row], row, plan.tolist())
            for plan in plans[row]
        ]
        for row in range(count)
    ]
    for score in ('mean_q', 'mean_return'):
        found, begins = score_plans(around, planner.belief_filter, plans, score, EXECUTE)
        for result, name in ((found, score), (begins, 'begin')):
            wanted = torch.tensor([[of_plan[name] for of_plan in row] for row in expected])
            torch.testing.assert_close(result, wanted, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize('kind', ['point', 'spread'])
@torch.no_grad()
def test_gain_is_what_the_expected_value_rises_by(planner: ValueGuidedPlanner, kind: str) -> None:
    """Against beliefs that are rolled over the whole map."""
    values = random_values(3, 12, 17)
    beliefs = beliefs_of(kind, 3, 12, 17)
    plans = torch.tensor([[0, 1], [4, DONE], [6, 6]])
    rolled = beliefs
    for actions in plans.T:
        rolled = planner.belief_filter.predict(rolled, actions, values.mask)
    wanted = ((rolled - beliefs) * values.values).sum(dim=(1, 2))
    around = Surroundings.cut_out(values, beliefs, HORIZON)
    found = gain(around, planner.belief_filter, plans)
    torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-4)


def seen_maps() -> tuple[torch.Tensor, torch.Tensor]:
    """Return partial maps after some exploration and the beliefs of robots in them."""
    simulation = MazeSimulation(make_mazes(6, 15, 4))
    beliefs = np.zeros((6, 15, 15), dtype=np.float32)
    beliefs[np.arange(6), *simulation.cells.T] = 1
    return torch.from_numpy(simulation.partial_maps.copy()), torch.from_numpy(beliefs)


@torch.no_grad()
def test_no_begin_is_better_than_the_greedy_one(planner: ValueGuidedPlanner) -> None:
    """By the values they are judged by, no two steps get more than two greedy ones."""
    maps, beliefs = seen_maps()
    around = Surroundings.cut_out(planner.value_network(maps), beliefs, HORIZON)
    nothing = torch.zeros(len(maps), NUM_ACTIONS, dtype=torch.bool)
    greedy = greedy_plan(around, planner.belief_filter, nothing)
    steps = torch.arange(NUM_MOVES)
    every = torch.cartesian_prod(steps, steps).expand(len(maps), -1, -1)
    plans = torch.cat([greedy[:, None, :EXECUTE], every], dim=1)
    _, begins = score_plans(around, planner.belief_filter, plans, 'mean_return', EXECUTE)
    # The trained motion kernels leave the robot where it is now and then.
    assert (begins[:, 0] >= begins.amax(dim=1) - 0.01).all()
    assert (begins[:, 0] > begins[:, 1:].mean(dim=1) + 1).all()


@pytest.mark.parametrize('kind', ['point', 'spread'])
@pytest.mark.parametrize('score', ['mean_q', 'mean_return'])
@torch.no_grad()
def test_soft_score_of_certain_actions_is_the_score(
    planner: ValueGuidedPlanner, kind: str, score: str
) -> None:
    """With probabilities of 0 and 1 the differentiable score is that of the plans."""
    values = random_values(3, 10, 10)
    around = Surroundings.cut_out(values, beliefs_of(kind, 3, 10, 10), HORIZON)
    generator = torch.Generator().manual_seed(5)
    plans = torch.randint(NUM_ACTIONS, (3, 6, HORIZON), generator=generator)
    wanted, _ = score_plans(around, planner.belief_filter, plans, score, EXECUTE)  # type: ignore[arg-type]
    certain = torch.eye(NUM_ACTIONS)[plans.flatten(0, 1)]
    found = soft_score(around, planner.belief_filter, certain, score)  # type: ignore[arg-type]
    torch.testing.assert_close(found.reshape(3, 6), wanted, rtol=1e-4, atol=1e-4)


def test_codewords_mean_their_actions() -> None:
    """Soft actions of a codeword are nearly certain, those of no bits at all uniform."""
    probabilities = soft_actions(CODEWORDS[:, :, None])[:, 0]
    assert (probabilities.diagonal() > 0.9).all()
    torch.testing.assert_close(
        soft_actions(torch.zeros(1, CODEWORDS.shape[1], 2)),
        torch.full((1, 2, NUM_ACTIONS), 1 / NUM_ACTIONS),
    )


@torch.no_grad()
def test_guide_follows_the_gradient(planner: ValueGuidedPlanner) -> None:
    """A guided plan scores higher, the gradient is that of finite differences."""
    maps, beliefs = seen_maps()
    around = Surroundings.cut_out(planner.value_network(maps), beliefs, HORIZON)
    generator = torch.Generator().manual_seed(6)
    plans = torch.randint(NUM_MOVES, (len(maps), HORIZON), generator=generator)
    bits = 0.5 * encode(plans)

    def scored(of_bits: torch.Tensor) -> torch.Tensor:
        return soft_score(around, planner.belief_filter, soft_actions(of_bits), 'mean_return')

    small = ValueGuide(around, planner.belief_filter, 'mean_return', 1e-3)(bits)
    assert (scored(small) > scored(bits)).all()
    step = torch.zeros_like(bits)
    step[:, 1, 0] = 0.01
    slope = (scored(bits + step) - scored(bits - step)) / 0.02
    torch.testing.assert_close(1e3 * (small - bits)[:, 1, 0], slope, rtol=0.05, atol=0.05)
    far = ValueGuide(around, planner.belief_filter, 'mean_return', 1e6)(bits)
    assert (far.abs() <= 1).all()


def test_agreement_counts_the_samples() -> None:
    """Samples that begin alike and that are alike; what comes after Done makes no difference."""
    plans = torch.tensor([[[0, 1, 2], [0, 1, 3], [DONE, 4, 4], [DONE, 5, 6], [0, 1, 2]]])
    begin_alike, alike = agreement(plans, voters=4, execute=2)
    assert begin_alike.tolist() == [[2, 2, 2, 2, 2]]
    assert alike.tolist() == [[1, 1, 2, 2, 1]]
