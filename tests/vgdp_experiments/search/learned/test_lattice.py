"""The learned lattice, CALVIN-3D on it, and the planner without the projector."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch.nn import functional

from gridnav import FREE, NUM_ACTIONS, NUM_MOVES, OBSTACLE, STEPS, GridGeometry
from vgdp_experiments.calvin import load_calvin
from vgdp_experiments.search.learned.batches import HomeBatches
from vgdp_experiments.search.learned.calvin_3d import GIVEN, Calvin3D, Calvin3DConfig
from vgdp_experiments.search.learned.lattice import (
    LatticeMemory,
    LatticePointNet,
    Points,
    cell_shift,
    heading_of,
)
from vgdp_experiments.search.learned.lattice_batches import draw_lattices
from vgdp_experiments.search.learned.no_projector import (
    FEATURES,
    NoProjectorNetworks,
    NoProjectorPlanner,
)
from vgdp_experiments.search.views import SmallViews
from vgdp_planner.planning_grid import PlanningGrid

if TYPE_CHECKING:
    from vgdp_experiments.search.learned.demonstrations import HomeDemonstrations


def test_cells_keep_the_largest_of_their_points() -> None:
    """Points off the map and those that don't count are left out; a shift moves all."""
    points = Points(
        torch.tensor([[1.0, 5.0], [2.0, 3.0], [9.0, 9.0], [4.0, 4.0]]),
        torch.tensor([[0, 1], [0, 1], [7, 7], [1, 0]]),
        torch.tensor([0, 1, 1, 1]),
    )
    lattice = points.lattice((2, 3), torch.zeros(2, dtype=torch.int64))
    assert lattice[:, 0, 1].tolist() == [2.0, 5.0]
    assert lattice[:, 1, 0].tolist() == [4.0, 4.0]
    assert lattice.sum() == 15.0
    moved = points.lattice((2, 3), torch.tensor([1, 1]), points.views == 0)
    assert moved[:, 1, 2].tolist() == [1.0, 5.0]
    assert moved.sum() == 6.0


def test_corners_and_headings() -> None:
    """A map whose corner lies two cells to the west has the same place two columns further."""
    assert cell_shift((0.0, 0.3), (-0.6, 0.3)).tolist() == [0, 2]
    bearings = np.arctan2(STEPS[:, 0], STEPS[:, 1])
    assert heading_of(bearings + 0.1).tolist() == list(range(NUM_MOVES))


def test_training_and_deciding_see_the_same_lattice(made: HomeDemonstrations) -> None:
    """What is put together for training is what a robot on the same way puts together."""
    torch.manual_seed(0)
    net = LatticePointNet(4)
    batches = HomeBatches([made])
    rng = np.random.default_rng(1)
    batch = draw_lattices(batches, 3, 2, rng)._replace(turn=torch.tensor(0))
    with torch.no_grad():
        lattices = batch.lattices(net)
    rng = np.random.default_rng(1)
    last = batches.draw_way(3, rng)[-1]
    rows, cols = lattices.shape[2:]
    geometry = GridGeometry(rows, cols, 0.3, *made.origins[last.index].tolist())
    memory = LatticeMemory(net)
    here = int(made.at[last.index])
    found = torch.empty(0)
    for at in [p for p in np.flatnonzero(made.visited[last.index]) if p != here] + [here]:
        cell = geometry.cell_at(*made.positions[at])
        grid = PlanningGrid(np.zeros((3, *geometry.shape), dtype=np.float32), geometry, cell)
        views = SmallViews(made.color[at], made.depth[at], made.points[at], made.bearings[at])
        found = memory.look(views, grid)
    torch.testing.assert_close(found[0, :4], lattices[-1, :4], atol=1e-3, rtol=1e-3)
    assert torch.equal(found[0, -1], lattices[-1, -1])
    assert (lattices[-1, :4].amax(dim=0) > 0).sum() > 50


@torch.no_grad()
def test_q_values_of_headings_obey_the_bellman_equation() -> None:
    """A move costs more the further the robot has to turn for it; Done costs no turn."""
    torch.manual_seed(0)
    model = Calvin3D(Calvin3DConfig(channels=8, rounds=60, features=2))
    for parameter in model.parameters():
        torch.nn.init.normal_(parameter, std=0.5)
    lattices = torch.rand(2, 2 + GIVEN - 1, 5, 7)
    found = model(lattices)
    assert found.q_values.shape == (2, 8, NUM_ACTIONS, 5, 7)
    values = found.q_values.amax(dim=2)
    headings = (10 * model.heading_logits).softmax(dim=1)
    kernels = model.log_kernels().exp().view(NUM_MOVES, 1, 3, 3)
    after = torch.einsum('ah,bhrc->barc', headings, values)
    ahead = functional.conv2d(after, kernels, padding=1, groups=NUM_MOVES)
    rewards = model.rewards(found.available)[:, :NUM_MOVES]
    straight = rewards + 0.99 * found.available[:, :NUM_MOVES] * ahead
    costs = model.turn_costs()
    assert (costs.diagonal() == 0).all()
    assert (costs[0, 1:5].diff() > 0).all()
    for heading in range(8):
        expected = straight - costs[heading][:, None, None]
        torch.testing.assert_close(
            found.q_values[:, heading, :NUM_MOVES], expected, rtol=1e-4, atol=1e-4
        )


def test_the_learned_map_goes_in_place_of_the_projected_one() -> None:
    """Plans and values depend on the lattice; what may be executed on the projected map."""
    torch.manual_seed(0)
    networks = NoProjectorNetworks.from_planner(load_calvin())
    torch.nn.init.normal_(networks.kinds.weight, std=0.3)
    planner = NoProjectorPlanner(networks)
    partial_map = np.zeros((3, 9, 9), dtype=np.float32)
    partial_map[FREE, 3:6, 3:6] = 1.0
    partial_map[OBSTACLE, 3:6, 5] = 1.0
    partial_map[FREE, 3:6, 5] = 0.0
    plans = []
    for seed in range(2):
        torch.manual_seed(seed)
        planner.reset(0)
        lattice = torch.rand(1, FEATURES + 2, 9, 9)
        lattice[:, FEATURES] = 0.0
        q_values = planner.look(lattice)
        assert q_values.shape == (NUM_ACTIONS, 9, 9)
        plans.append(planner.plan(partial_map, (4, 4)))
        for action in plans[-1].committed:
            assert STEPS[action, 1] <= 0
    assert not math.isclose(plans[0].value, plans[1].value, rel_tol=1e-4)
    shares = networks.learned_maps(torch.rand(1, FEATURES + 2, 9, 9))
    assert ((shares[:, :2] > 0) & (shares[:, :2].sum(dim=1) < 1)).all()
