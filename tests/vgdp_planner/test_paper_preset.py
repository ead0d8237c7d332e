"""The paper's preset against the appendix: its layers and sizes, that it trains and plans."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from torch import nn

from gridnav import DONE, FREE
from maze_sim import MazeSimulation, make_mazes
from vgdp_experiments.data import paper_maze, walk_expert
from vgdp_experiments.parallel import Team
from vgdp_experiments.train_policy import SETTINGS, DenoisingLoss, PolicyTraining
from vgdp_experiments.train_policy import passes as policy_passes
from vgdp_experiments.train_value_paper import ImitationLoss, PaperValueTraining, views_of
from vgdp_experiments.train_value_paper import passes as value_passes
from vgdp_experiments.training import ValueParts
from vgdp_planner import Plan, ValueGuidedPlanner, preset
from vgdp_planner.belief import BeliefFilter
from vgdp_planner.value import ValueNetwork

if TYPE_CHECKING:
    from vgdp_experiments.data import Demonstrations

ALONE = Team(0, 1, torch.device('cpu'))

# Shape of each parameter of the other networks; weights before biases.
ENCODER = [
    (128, 3, 3, 3), (128,), (128,), (128,),
    (256, 128, 3, 3), (256,), (256,), (256,),
    (256, 256, 3, 3), (256,), (256,), (256,),
    (256, 256), (256,),
    (256, 256), (256,),
]  # fmt: skip
STEP_EMBEDDING = [(1024, 256), (1024,), (256, 1024), (256,)]
VALUE = {
    # R_m and R_f: one kernel over the partial map for each of the nine actions.
    'motion_reward': (9, 3, 3, 3),
    'invalid_reward': (9, 3, 3, 3),
    # Â_logit and Â_thresh: |A| + 1 channels.
    'action_embedding.0.weight': (64, 3, 3, 3),
    'action_embedding.0.bias': (64,),
    'action_embedding.2.weight': (64, 64, 1, 1),
    'action_embedding.2.bias': (64,),
    'action_embedding.4.weight': (10, 64, 1, 1),
    'action_embedding.4.bias': (10,),
    # T_m of the eight steps; Done leads nowhere.
    'motion.logits': (8, 3, 3),
}
BELIEF = {'motion.logits': (8, 3, 3), 'log_confusion': (2, 3)}

PARAMETERS = {
    'encoder': 1_021_696,
    'value': 7_160,
    'belief': 78,
}


@pytest.fixture(scope='module')
def planner() -> ValueGuidedPlanner:
    """Return the paper's planner with random weights."""
    torch.manual_seed(0)
    return ValueGuidedPlanner(preset('paper'))


@pytest.fixture(scope='module')
def demonstrations() -> Demonstrations:
    """Return what the paper's expert shows in a few mazes."""
    rng = np.random.default_rng(0)
    return walk_expert([paper_maze(15, rng) for _ in range(3)], 2, 4)


def count(module: nn.Module) -> int:
    """Return the number of parameters."""
    return sum(parameter.numel() for parameter in module.parameters())


def shapes(module: nn.Module) -> list[tuple[int, ...]]:
    """Return the shape of each parameter."""
    return [tuple(parameter.shape) for parameter in module.parameters()]


def test_other_layers(planner: ValueGuidedPlanner) -> None:
    """Encoder, step embedding, value function and belief filter have these parameters."""
    assert shapes(planner.policy.encoder) == ENCODER
    norms = [
        layer for layer in planner.policy.encoder.modules() if isinstance(layer, nn.GroupNorm)
    ]
    assert [layer.num_groups for layer in norms] == [8, 8, 8]
    assert shapes(planner.policy.denoiser.step_embedding) == STEP_EMBEDDING
    for module, expected in ((planner.value_network, VALUE), (planner.belief_filter, BELIEF)):
        named = {name: tuple(value.shape) for name, value in module.named_parameters()}
        assert named == expected


def test_parameter_counts(planner: ValueGuidedPlanner) -> None:
    """The networks have so many parameters."""
    assert {
        'encoder': count(planner.policy.encoder),
        'value': count(planner.value_network),
        'belief': count(planner.belief_filter),
    } == PARAMETERS


def test_initial_values(planner: ValueGuidedPlanner) -> None:
    """T_m is a Gaussian that sums to 1, for value iteration and belief apart; rewards are zero."""
    network, belief_filter = planner.value_network, planner.belief_filter
    kernels = network.motion.kernels()
    torch.testing.assert_close(kernels.sum(dim=(1, 2)), torch.ones(8))
    ratio = kernels[:, 1, 1] / kernels[:, 0, 1]
    torch.testing.assert_close(ratio, torch.full((8,), float(np.exp(0.5))))
    assert network.motion.logits is not belief_filter.motion.logits
    assert not network.motion_reward.any()
    assert not network.invalid_reward.any()


def test_a_training_step_of_each_network(
    planner: ValueGuidedPlanner, demonstrations: Demonstrations
) -> None:
    """Forward, backward and a step of the optimiser: every parameter gets a gradient and moves."""
    both = ValueParts(planner.value_network, planner.belief_filter)
    small = {'batch': 2, 'accumulation': 1, 'device': 'cpu'}
    dealt = {
        DenoisingLoss(planner.policy): policy_passes(
            planner.policy,
            demonstrations,
            PolicyTraining(**{**vars(SETTINGS['paper']), **small}),
            ALONE,
            0,
        ),
        ImitationLoss(both): value_passes(
            demonstrations,
            PaperValueTraining(**small),  # type: ignore[arg-type]
            ALONE,
            0,
        ),
    }
    for objective, passes in dealt.items():
        optimizer = torch.optim.RAdam(objective.parameters(), lr=2e-4)
        losses = objective(*passes[0])
        torch.stack(list(losses.values())).sum().backward()  # type: ignore[no-untyped-call]
        gradients = [parameter.grad for parameter in objective.parameters()]
        assert all(gradient is not None and gradient.isfinite().all() for gradient in gradients)
        sums = [float(parameter.detach().double().sum()) for parameter in objective.parameters()]
        optimizer.step()
        after = [float(parameter.detach().double().sum()) for parameter in objective.parameters()]
        assert np.not_equal(sums, after).mean() > 0.9


def plan(planner: ValueGuidedPlanner, simulation: MazeSimulation) -> Plan:
    """Plan once and check what comes out."""
    planner.reset(0)
    made = planner.plan(simulation.partial_maps[0], simulation.cells[0])
    assert len(made.candidates) == planner.config.planner.candidates
    assert made.actions.shape == (4,)
    assert ((made.actions >= 0) & (made.actions <= DONE)).all()
    assert len(made.committed) <= 2
    assert made.source != 'memory'
    return made


def test_a_plan(planner: ValueGuidedPlanner, monkeypatch: pytest.MonkeyPatch) -> None:
    """The planner plans, here in fewer steps than it has; the same again after a reset."""
    config = preset('paper').with_planner({'sampling_steps': 2, 'candidates': 3})
    monkeypatch.setattr(planner, 'config', config)
    simulation = MazeSimulation(make_mazes(1, 15, 0), 2, 200)
    first, again = plan(planner, simulation), plan(planner, simulation)
    assert np.array_equal(first.candidates, again.candidates)


@pytest.mark.slow
def test_a_full_plan(planner: ValueGuidedPlanner) -> None:
    """24 candidates in 32 DDPM steps, scored by the mean of Q, two steps committed at most."""
    made = plan(planner, MazeSimulation(make_mazes(1, 15, 0), 2, 200))
    assert len(made.candidates) == 24


def test_views_of_partial_maps() -> None:
    """What the observation function learns from is what the robot sees, wrong cells included."""
    simulation = MazeSimulation(make_mazes(4, 15, 3), 2, 200)
    wrong = np.zeros((4, 5, 5), dtype=bool)
    views = views_of(simulation.partial_maps, simulation.cells, wrong)
    assert np.array_equal(views, simulation.windows())
    wrong[:, 2, 2] = True
    turned = views_of(simulation.partial_maps, simulation.cells, wrong)
    assert (views[:, 2, 2] == 0).all()
    assert (turned[:, 2, 2] == 100).all()


def test_training_data(demonstrations: Demonstrations) -> None:
    """Plans of T_h steps that end in T_h times Done, in plain mazes of 16 to 50 actions."""
    rng = np.random.default_rng(5)
    mazes = [paper_maze(15, rng) for _ in range(30)]
    assert all(16 <= maze.expert_steps + 1 <= 50 for maze in mazes)
    assert {int((~maze.blocked).sum()) for maze in mazes} == {97}  # No loops.
    assert demonstrations.actions.shape[1] == 4
    batch = demonstrations.take(np.arange(len(demonstrations.codes)))
    finished = (batch.actions == DONE).all(axis=1)
    assert finished.sum() == 3
    assert (batch.maps[finished, FREE].sum(axis=(1, 2)) > 0).all()


def test_losses_fall() -> None:
    """A few steps on the expert's moves lower the value function's losses."""
    torch.manual_seed(0)
    both = ValueParts(ValueNetwork(preset('paper').value), BeliefFilter())
    objective = ImitationLoss(both)
    made = walk_expert(make_mazes(4, 15, 2), 2, 4)
    settings = PaperValueTraining(batch=16, accumulation=1, device='cpu')
    fixed = value_passes(made, settings, ALONE, 0)[0]
    optimizer = torch.optim.RAdam(both.parameters(), lr=0.02)
    history = []
    for _ in range(12):
        losses = objective(*fixed)
        optimizer.zero_grad()
        torch.stack(list(losses.values())).sum().backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        history.append({name: float(loss.detach()) for name, loss in losses.items()})
    assert set(history[0]) == {'mask', 'action', 'motion', 'filter_motion', 'observation'}
    for name, loss in history[-1].items():
        assert loss < history[0][name], name
