"""The planner's public face."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gridnav import DONE, FREE, NUM_ACTIONS, OBSTACLE, STEPS, Outcome, valid_moves
from maze_sim import MazeSimulation, make_mazes
from vgdp_planner import Config, Plan, PlannerConfig, PolicyConfig, ValueGuidedPlanner, preset


@pytest.fixture(scope='module')
def planner() -> ValueGuidedPlanner:
    """Return the shipped planner."""
    return ValueGuidedPlanner.from_pretrained()


def first_view(seed: int = 0, size: int = 15) -> tuple[np.ndarray, tuple[int, int]]:
    """Return the first partial map and cell of a maze."""
    simulation = MazeSimulation(make_mazes(1, size, seed))
    row, col = simulation.cells[0]
    return simulation.partial_maps[0], (int(row), int(col))


def drive(planner: ValueGuidedPlanner, seed: int, plan_seed: int = 0) -> list[int]:
    """Drive one maze to its end and return all actions."""
    simulation = MazeSimulation(make_mazes(1, 15, seed))
    planner.reset(plan_seed)
    actions = []
    while simulation.active[0]:
        row, col = simulation.cells[0]
        for action in planner.plan(simulation.partial_maps[0], (int(row), int(col))).committed:
            simulation.step(np.array([action]))
            actions.append(action)
    assert simulation.outcomes[0] is Outcome.SUCCESS
    return actions


def test_plan_has_the_promised_fields(planner: ValueGuidedPlanner) -> None:
    """Shapes, ranges and the meaning of the fields of a plan."""
    planner.reset(seed=0)
    partial_map, cell = first_view()
    plan = planner.plan(partial_map, cell)
    config = planner.config
    assert plan.status == 'ok'
    assert plan.actions.shape == (config.policy.horizon,)
    assert ((plan.actions >= 0) & (plan.actions < NUM_ACTIONS)).all()
    assert 1 <= len(plan.committed) <= config.planner.execute
    assert plan.committed == plan.actions[: len(plan.committed)].tolist()
    assert len(plan.candidates) == len(plan.candidate_values) >= config.planner.candidates
    assert plan.candidates.shape[1] == config.policy.horizon
    assert plan.value in plan.candidate_values
    assert plan.value_map.shape == partial_map.shape[1:]
    assert np.isfinite(plan.value_map[cell])


def test_reaches_the_goal_again_and_again_the_same_way(planner: ValueGuidedPlanner) -> None:
    """One seed gives one sequence of actions; another seed may give another."""
    for maze_seed in range(3):
        assert drive(planner, maze_seed) == drive(planner, maze_seed)


def test_batch_equals_single(planner: ValueGuidedPlanner) -> None:
    """Episodes planned together get the plans that each gets alone, memory included."""
    simulation = MazeSimulation(make_mazes(4, 15, 7))
    planner.reset(seed=3)
    together = [planner.plan_batch(simulation.partial_maps, simulation.cells) for _ in range(2)][
        -1
    ]
    for row, plan in enumerate(together):
        planner.reset(seed=3)
        for _ in range(2):
            alone = planner.plan_batch(
                simulation.partial_maps[row, None], simulation.cells[row, None], [row]
            )[0]
        assert np.array_equal(plan.actions, alone.actions)
        assert plan.committed == alone.committed
        assert plan.value == pytest.approx(alone.value, abs=1e-3)


def test_cell_and_certain_belief_are_the_same(planner: ValueGuidedPlanner) -> None:
    """A belief that is all on one cell plans as the cell does."""
    partial_map, cell = first_view()
    belief = np.zeros(partial_map.shape[1:])
    belief[cell] = 2.0  # It need not be normalised.
    planner.reset()
    by_cell = planner.plan(partial_map, cell)
    planner.reset()
    by_belief = planner.plan(partial_map, belief)
    assert np.array_equal(by_cell.candidates, by_belief.candidates)
    assert by_cell.committed == by_belief.committed


def test_blurred_belief_gives_a_safe_plan(planner: ValueGuidedPlanner) -> None:
    """With the belief spread over two cells of a corridor the plan is valid from both."""
    partial_map = np.zeros((3, 9, 9), dtype=np.float32)
    partial_map[OBSTACLE, 3] = partial_map[OBSTACLE, 5] = 1
    partial_map[FREE, 4, 1:8] = 1
    belief = np.zeros((9, 9))
    belief[4, 3] = belief[4, 4] = 0.5
    planner.reset()
    plan = planner.plan(partial_map, belief)
    assert plan.status == 'ok'
    assert plan.committed
    assert set(plan.committed) <= {2, 6}


def test_verdicts(planner: ValueGuidedPlanner) -> None:
    """A closed room is exhausted, a goal behind a wall unreachable; nothing is committed."""
    partial_map = np.zeros((3, 7, 9), dtype=np.float32)
    partial_map[OBSTACLE] = 1
    partial_map[:, 2:5, 2:5] = np.array([0, 1, 0], dtype=np.float32)[:, None, None]
    planner.reset()
    plan = planner.plan(partial_map, (3, 3))
    assert (plan.status, plan.committed, plan.source) == ('exhausted', [], 'none')
    partial_map[:, 3, 7] = [0, 1, 1]
    plan = planner.plan(partial_map, (3, 3))
    assert (plan.status, plan.committed) == ('unreachable', [])


def test_done_on_the_goal(planner: ValueGuidedPlanner) -> None:
    """Standing on the goal, the planner says Done, and `committed` ends with it."""
    partial_map = np.zeros((3, 9, 9), dtype=np.float32)
    partial_map[FREE, 2:7, 2:7] = 1
    partial_map[:, 4, 4] = [0, 1, 1]
    planner.reset()
    assert planner.plan(partial_map, (4, 4)).committed == [DONE]
    planner.reset()
    assert planner.plan(partial_map, (4, 3)).committed == [2, DONE]


@pytest.mark.parametrize('shape', [(1, 9), (7, 31), (40, 12)])
def test_any_size(planner: ValueGuidedPlanner, shape: tuple[int, int]) -> None:
    """Maps of any height and width are planned on."""
    partial_map = np.zeros((3, *shape), dtype=np.float32)
    partial_map[FREE, 0, :3] = 1
    planner.reset()
    plan = planner.plan(partial_map, (0, 0))
    assert plan.value_map.shape == shape
    assert plan.committed


@pytest.mark.parametrize(
    ('partial_map', 'cell', 'named'),
    [
        (np.zeros((2, 9, 9)), (1, 1), r'\(2, 9, 9\)'),
        (np.zeros((1, 3, 9, 9)), (1, 1), r'\(1, 3, 9, 9\)'),
        (np.full((3, 9, 9), np.nan), (1, 1), 'other values'),
        (np.ones((3, 9, 9)), (1, 1), 'both obstacle and free'),
        (np.zeros((3, 9, 9)), (9, 1), '9'),
        (np.zeros((3, 9, 9)), (-1, 1), '-1'),
        (np.zeros((3, 9, 9)), (1.5, 1), '1.5'),
        (np.zeros((3, 9, 9)), (1, 2, 3), 'shape'),
        (np.zeros((3, 9, 9)), np.zeros((9, 9)), 'belief'),
        (np.zeros((3, 9, 9)), np.full((9, 9), np.nan), 'belief'),
        (np.zeros((3, 9, 9)), np.ones((9, 8)), 'shape'),
    ],
)
def test_bad_inputs_are_named(
    planner: ValueGuidedPlanner,
    partial_map: np.ndarray,
    cell: Any,  # noqa: ANN401
    named: str,
) -> None:
    """A bad map or cell gives one sentence that names it."""
    with pytest.raises(ValueError, match=named):
        planner.plan(partial_map, cell)


def test_inputs_are_left_alone(planner: ValueGuidedPlanner) -> None:
    """The planner does not write into what it is given."""
    partial_map, cell = first_view()
    partial_map.setflags(write=False)
    before = partial_map.copy()
    planner.plan(partial_map, cell)
    assert np.array_equal(partial_map, before)


def tiny(seed: int) -> ValueGuidedPlanner:
    """Return a planner whose networks know nothing."""
    torch.manual_seed(seed)
    policy = PolicyConfig(encoder_channels=(8, 8, 8), embedding=16, channels=(8, 16))
    return ValueGuidedPlanner(Config(policy=policy, planner=PlannerConfig(candidates=3)))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_untrained_networks_are_still_safe(data: st.DataObject) -> None:
    """Whatever the networks say, no committed step enters a known obstacle or leaves the map."""
    planner = tiny(data.draw(st.integers(0, 3)))
    size = data.draw(st.integers(2, 8))
    codes = np.array(
        data.draw(st.lists(st.integers(0, 2), min_size=size * size, max_size=size * size))
    ).reshape(size, size)
    row, col = data.draw(st.integers(0, size - 1)), data.draw(st.integers(0, size - 1))
    codes[row, col] = 1
    partial_map = np.stack([codes == 2, codes == 1, np.zeros_like(codes)]).astype(np.float32)
    plan = planner.plan(partial_map, (row, col))
    assert bool(plan.committed) == (plan.status == 'ok')
    valid = valid_moves(partial_map[OBSTACLE] > 0)
    for action in plan.committed:
        assert action != DONE
        assert valid[action, row, col]
        row, col = row + STEPS[action, 0], col + STEPS[action, 1]


def test_memory_is_kept_between_decisions(planner: ValueGuidedPlanner) -> None:
    """The rest of the best plan competes in the next decision, and only there."""
    partial_map, cell = first_view(5)
    planner.reset()
    first = planner.plan(partial_map, cell)
    second = planner.plan(partial_map, cell)
    rest = first.actions[len(first.committed) :].tolist()
    samples = planner.config.planner.candidates
    assert second.candidates[samples][: len(rest)].tolist() == rest
    planner.reset()
    third = planner.plan(partial_map, cell)
    assert np.array_equal(third.candidates[:samples], first.candidates[:samples])


def test_an_unchanged_map_is_not_read_again(
    planner: ValueGuidedPlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The network says what the unseen is worth once for each map, and again once more is seen."""
    read: list[int] = []
    worth_of_unseen = planner.value_network.worth_of_unseen

    def count(maps: torch.Tensor) -> torch.Tensor:
        read.append(len(maps))
        return worth_of_unseen(maps)

    monkeypatch.setattr(planner.value_network, 'worth_of_unseen', count)
    simulation = MazeSimulation(make_mazes(2, 15, 5))
    planner.reset()
    first = planner.plan_batch(simulation.partial_maps, simulation.cells)
    again = planner.plan_batch(simulation.partial_maps, simulation.cells)
    for before, after in zip(first, again, strict=True):
        assert np.array_equal(before.value_map, after.value_map, equal_nan=True)
    more = simulation.partial_maps.copy()
    row, col = np.argwhere(more[1, OBSTACLE] + more[1, FREE] == 0)[0]
    more[1, FREE, row, col] = 1
    planner.plan_batch(more, simulation.cells)
    assert read == [2, 1]
    planner.reset()
    planner.plan_batch(more[1:], simulation.cells[1:], [1])
    assert read == [2, 1, 1]


def test_paper_preset_plans() -> None:
    """The paper's variant runs as it stands in the paper: DDPM, equation 9, K rounds."""
    torch.manual_seed(0)
    config = preset('paper')
    small = Config(
        policy=PolicyConfig(
            **{
                **config.to_dict()['policy'],
                'channels': (16, 32),
                'encoder_channels': (8, 8, 8),
                'embedding': 16,
            }
        ),
        value=config.value,
        planner=config.planner,
    )
    plan: Plan = ValueGuidedPlanner(small).plan(*first_view())
    assert plan.committed
    assert plan.source in ('sampled', 'greedy')


def variant(**settings: Any) -> ValueGuidedPlanner:  # noqa: ANN401
    """Return the shipped planner with other settings."""
    return ValueGuidedPlanner.from_pretrained(settings=settings)


def views(count: int = 6) -> MazeSimulation:
    """Return robots that have walked a while through mazes of their own."""
    simulation = MazeSimulation(make_mazes(count, 15, 11))
    planner = variant(candidates=0, execute=1)
    for _ in range(8):
        plans = planner.plan_batch(simulation.partial_maps, simulation.cells)
        simulation.step(np.array([plan.committed[0] for plan in plans]))
    return simulation


def test_settings_replace_those_of_the_weights() -> None:
    """Settings are taken over, and refused by name if they are none or out of range."""
    assert variant(candidates=3).config.planner.candidates == 3
    with pytest.raises(ValueError, match='nonsense'):
        variant(nonsense=1)
    with pytest.raises(ValueError, match='-1'):
        variant(candidates=-1)


def test_timings_name_the_stages(planner: ValueGuidedPlanner) -> None:
    """What the last decision took is told by stage."""
    planner.plan(*first_view())
    assert set(planner.last_timings) == {'sampling', 'value', 'scoring', 'rest'}
    assert all(seconds > 0 for seconds in planner.last_timings.values())


def test_without_candidates_all_steps_are_greedy() -> None:
    """No samples, no memory: the greedy plan is the only candidate."""
    simulation = views()
    planner = variant(candidates=0, memory=False)
    for _ in range(2):
        for plan in planner.plan_batch(simulation.partial_maps, simulation.cells):
            assert plan.source == 'greedy'
            assert plan.candidates.shape == (1, planner.config.policy.horizon)
    with pytest.raises(ValueError, match='greedy_fallback'):
        variant(candidates=0, greedy_fallback=False)


def test_single_sample_is_executed_or_nothing() -> None:
    """One candidate is followed as far as it is safe; where it is not safe at all, none is."""
    simulation = views(16)
    planner = variant(candidates=1, memory=False, greedy_fallback=False, look_first=False)
    statuses = set()
    for _ in range(8):
        for plan in planner.plan_batch(simulation.partial_maps, simulation.cells):
            statuses.add(plan.status)
            if plan.status == 'ok':
                assert plan.source == 'sampled'
                assert plan.committed == plan.candidates[0, : len(plan.committed)].tolist()
            else:
                assert (plan.committed, plan.source) == ([], 'none')
                assert np.isneginf(plan.candidate_values).all()
    assert statuses == {'ok', 'stuck'}


def test_the_most_frequent_begin_is_voted_for() -> None:
    """Of the candidates with a safe first step, none begins like more others."""
    simulation = views()
    planner = variant(selection='vote', memory=False, greedy_fallback=False)
    for plan in planner.plan_batch(simulation.partial_maps, simulation.cells):
        begins = [tuple(begin) for begin in plan.candidates[:, :2].tolist()]
        safe = np.isfinite(plan.candidate_values)
        votes = np.array([begins.count(begin) for begin in begins])
        assert begins.count(tuple(plan.actions[:2].tolist())) == votes[safe].max()
        assert int(plan.value) == votes[safe].max()


@pytest.mark.parametrize('settings', [{}, {'agreement': 100.0}, {'selection': 'vote'}])
def test_committed_steps_lose_nothing_against_greedy_ones(settings: dict[str, Any]) -> None:
    """However the candidates are chosen, the steps bring the goal as close as greedy ones."""
    simulation = views(12)
    planner = variant(**settings)
    plans = planner.plan_batch(simulation.partial_maps, simulation.cells)
    assert sum(plan.source == 'sampled' for plan in plans) > len(plans) / 2
    for plan, start in zip(plans, simulation.cells, strict=True):
        assert DONE not in plan.committed
        steps = STEPS[plan.committed]
        risen = plan.value_map[tuple(start + steps.sum(axis=0))] - plan.value_map[tuple(start)]
        assert risen == pytest.approx(np.hypot(*steps.T).sum(), abs=0.3)


def test_guidance_makes_better_samples() -> None:
    """Samples that are pulled towards high values score higher on average."""
    simulation = views()
    means = []
    for guidance in (0.0, 0.3):
        plans = variant(guidance=guidance, sampling_steps=2).plan_batch(
            simulation.partial_maps, simulation.cells
        )
        scores = np.stack([plan.candidate_values[:24] for plan in plans])
        means.append(np.where(np.isfinite(scores), scores, -100).mean())
    assert means[1] > means[0] + 1


def test_looking_first_commits_to_fewer_steps() -> None:
    """The plans are the same, but what is executed ends where something may come into view."""
    simulation = views()
    looking, blind = (
        variant(look_first=look_first).plan_batch(simulation.partial_maps, simulation.cells)
        for look_first in (True, False)
    )
    for one, other in zip(looking, blind, strict=True):
        assert one.committed == other.committed[: len(one.committed)]
    assert sum(len(plan.committed) for plan in looking) < sum(
        len(plan.committed) for plan in blind
    )
