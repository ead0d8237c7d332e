"""Training data and training runs, in small."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from gridnav import DONE, FREE, GOAL, OBSTACLE, STEPS, Outcome
from maze_sim import Maze, MazeSimulation, cost_to_go, make_mazes
from vgdp_experiments import train_policy, train_value
from vgdp_experiments.commands import register
from vgdp_experiments.data import (
    Demonstrations,
    load_demonstrations,
    walk_expert,
    walk_explorer,
)
from vgdp_experiments.map_codes import pack, unpack
from vgdp_experiments.rollouts import explore, frontier_cells
from vgdp_experiments.train_policy import PolicyTraining
from vgdp_experiments.train_value import ValueTraining
from vgdp_experiments.training import Ema, save_checkpoint
from vgdp_experiments.worlds import open_walls, training_maze
from vgdp_planner import ValueGuidedPlanner, preset
from vgdp_planner.policy import DiffusionPolicy
from vgdp_planner.value import ValueNetwork

if TYPE_CHECKING:
    import argparse
    from pathlib import Path


@pytest.fixture(scope='module')
def network() -> ValueNetwork:
    """Return the shipped value function."""
    return ValueGuidedPlanner.from_pretrained().value_network


def test_packed_maps_come_back() -> None:
    """Packing loses nothing of maps whose cells are obstacle, free, goal or unseen."""
    rng = np.random.default_rng(0)
    kinds = rng.integers(3, size=(4, 7, 9))
    maps = np.zeros((4, 3, 7, 9), dtype=np.float32)
    maps[:, OBSTACLE], maps[:, FREE] = kinds == 2, kinds == 1
    maps[0, GOAL, 3, 3] = 1
    assert np.array_equal(unpack(pack(maps)), maps)


def test_training_mazes() -> None:
    """Training mazes depend on the seed alone, some have loops, all have a long enough way."""
    mazes = [training_maze(15, np.random.default_rng(seed)) for seed in range(40)]
    again = training_maze(15, np.random.default_rng(7))
    assert np.array_equal(again.blocked, mazes[7].blocked)
    assert (again.start, again.goal) == (mazes[7].start, mazes[7].goal)
    assert min(maze.expert_steps for maze in mazes) >= 15
    free = [(~maze.blocked).sum() for maze in mazes]
    assert min(free) == 97  # A tree of 49 cells has 48 openings.
    assert max(free) > 97


def test_opening_all_walls() -> None:
    """With a share of 1 every wall between two free cells goes, with 0 none."""
    blocked = np.ones((5, 5), dtype=bool)
    blocked[1::2, 1::2] = False
    rng = np.random.default_rng(0)
    assert np.array_equal(open_walls(blocked, 0.0, rng), blocked)
    assert open_walls(blocked, 1.0, rng).sum() == blocked.sum() - 4


def test_frontier_cells() -> None:
    """A frontier cell is unseen and one valid step away from an observed free cell."""
    maps = np.zeros((1, 3, 3, 5), dtype=np.float32)
    maps[0, OBSTACLE, 0] = maps[0, OBSTACLE, 2] = 1
    maps[0, FREE, 1, :3] = 1
    expected = np.zeros((3, 5), dtype=bool)
    expected[1, 3] = True
    assert np.array_equal(frontier_cells(maps)[0], expected)


def test_labels_are_the_mean_cost_of_finding_a_goal(network: ValueNetwork) -> None:
    """In a corridor each label is the mean way from what is next unseen to all open goals."""
    blocked = np.ones((3, 42), dtype=bool)
    blocked[1, 1:41] = False
    steps = explore([Maze.solved(blocked, (1, 1), (1, 40))], network, 2, np.random.default_rng(0))
    assert steps.targets[:, 1].tolist() == list(range(4, 41))
    for (row, column), cost, weight in zip(steps.targets, steps.costs, steps.weights, strict=True):
        # Goals lie at least 15 cells from the start, in the columns 16 to 40.
        goals = np.arange(max(column, 16), 41)
        # The walls beside the next cell have not been seen either: that step may be diagonal.
        last_step = 1.0 if row == 1 else np.sqrt(2)
        assert cost == pytest.approx(goals.mean() - (column - 1) - last_step, abs=1e-3)
        assert weight == pytest.approx(len(goals) / 25)


def follow(made: Demonstrations, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the cells that a demonstrated plan goes through and the map that it starts on."""
    cells = [made.cells[index].astype(int)]
    for action in made.actions[index]:
        if action == DONE:
            break
        cells.append(cells[-1] + STEPS[action])
    return np.array(cells), unpack(made.codes[index : index + 1])[0]


def test_expert_demonstrations() -> None:
    """The expert's plans lead along shortest ways, end in Done and start on what was seen."""
    mazes = make_mazes(3, 15, 11)
    made = walk_expert(mazes, 2, 8)
    assert len(made.codes) == sum(maze.expert_steps + 1 for maze in mazes)
    assert made.actions.shape[1] == 8
    to_goal = [cost_to_go(maze.blocked, maze.goal) for maze in mazes]
    finishing = 0
    for index in range(len(made.codes)):
        cells, partial_map = follow(made, index)
        assert partial_map[FREE][tuple(cells[0])] == 1
        owners = [
            costs
            for maze, costs in zip(mazes, to_goal, strict=True)
            if not (partial_map[FREE] * maze.blocked).any()
            and all(np.isfinite(costs[tuple(cell)]) for cell in cells)
        ]
        assert any((np.diff([costs[tuple(cell)] for cell in cells]) < 0).all() for costs in owners)
        finishing += int(made.actions[index, 0] == DONE)
    assert finishing == len(mazes)


def test_explorer_demonstrations(network: ValueNetwork) -> None:
    """Each state of an exploration comes twice: with the expert's plan and with what was done."""
    mazes = make_mazes(2, 15, 12)
    made = walk_explorer(mazes, network, 2, 8, np.random.default_rng(0))
    half = len(made.codes) // 2
    assert np.array_equal(made.codes[:half], made.codes[half:])
    assert np.array_equal(made.cells[:half], made.cells[half:])
    assert (made.actions[:half] != made.actions[half:]).any()
    again = walk_explorer(mazes, network, 2, 8, np.random.default_rng(0))
    assert np.array_equal(made.actions, again.actions)


@pytest.fixture
def parser() -> argparse.ArgumentParser:
    """Return the parser of the commands."""
    import argparse  # noqa: PLC0415

    parser = argparse.ArgumentParser()
    register(parser.add_subparsers(required=True))
    return parser


def command(parser: argparse.ArgumentParser, words: str) -> int:
    """Run a command."""
    args = parser.parse_args(words.split())
    status: int = args.run(args)
    return status


@pytest.mark.timeout(300)
def test_the_whole_chain_of_commands(parser: argparse.ArgumentParser, tmp_path: Path) -> None:
    """Value, data, policy and join make weights that load and reach a goal."""
    value, data, policy, out = (tmp_path / name for name in ('value', 'd.npz', 'policy', 'out'))
    assert not command(
        parser,
        f'train value --out {value} --dynamics-steps 150 --rounds 2 --mazes 12 --steps 4 '
        '--batch 8 --threads 1',
    )
    assert not command(
        parser, f'data expert --out {data} --mazes 4 --explorer {value} --workers 1'
    )
    assert not command(
        parser,
        f'train policy --data {data} --out {policy} --steps 6 --batch 4 --threads 1 '
        '--precision bfloat16',
    )
    assert not command(parser, f'train join --value {value} --policy {policy} --out {out}')
    card = (out / 'README.md').read_text()
    assert 'vgdp train policy' in card
    assert f'--explorer {value}' in card
    planner = ValueGuidedPlanner.from_pretrained(out)
    simulation = MazeSimulation(make_mazes(1, 15, 0), 2, 300)
    for _ in range(3):
        plan = planner.plan(simulation.partial_maps[0], simulation.cells[0])
        for action in plan.committed:
            simulation.step(np.array([action]))
    assert simulation.outcomes[0] is not Outcome.COLLISION
    assert (value / 'log.csv').read_text().startswith('step,loss')


def test_an_interrupted_policy_training_goes_on_as_if_nothing_had_happened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped after its checkpoint and started again, a run ends with the very same weights."""
    monkeypatch.setattr(train_policy, 'CHECKPOINT_EVERY', 3)
    made = walk_expert(make_mazes(2, 15, 1), 2, 8)
    settings = PolicyTraining(out=str(tmp_path / 'whole'), steps=6, batch=4, noises=2)

    def policy() -> DiffusionPolicy:
        torch.manual_seed(0)
        return DiffusionPolicy(preset('default').policy)

    whole = policy()
    train_policy.train(whole, made, settings)
    stopped = replace(settings, out=str(tmp_path / 'stopped'))

    class StopError(Exception):
        """Ends a run in the middle."""

    draws = 0
    sample = Demonstrations.sample

    def stop(self: Demonstrations, count: int, rng: np.random.Generator) -> object:
        nonlocal draws
        draws += 1
        if draws == 5:
            raise StopError
        return sample(self, count, rng)

    with monkeypatch.context() as patch:
        patch.setattr(Demonstrations, 'sample', stop)
        with pytest.raises(StopError):
            train_policy.train(policy(), made, stopped)
    resumed = policy()
    train_policy.train(resumed, made, stopped)
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name


def test_a_run_is_not_continued_with_other_settings(tmp_path: Path) -> None:
    """Another learning rate for a run that has begun is refused, naming its folder."""
    made = walk_expert(make_mazes(1, 15, 1), 2, 8)
    policy = DiffusionPolicy(preset('default').policy)
    settings = PolicyTraining(out=str(tmp_path), steps=2, batch=2)
    original, train_policy.CHECKPOINT_EVERY = train_policy.CHECKPOINT_EVERY, 1
    try:
        train_policy.train(policy, made, settings)
        with pytest.raises(ValueError, match='other settings'):
            train_policy.train(policy, made, replace(settings, learning_rate=0.5))
    finally:
        train_policy.CHECKPOINT_EVERY = original


def test_paper_value_trains_on_demonstrations(tmp_path: Path) -> None:
    """The paper's value function learns from the expert: its losses fall."""
    made = walk_expert(make_mazes(4, 15, 2), 2, 4)
    path = tmp_path / 'd.npz'
    np.savez(path, codes=made.codes, cells=made.cells, actions=made.actions, settings='{}')
    settings = ValueTraining(
        preset='paper',
        out=str(tmp_path / 'value'),
        steps=12,
        batch=8,
        learning_rate=0.01,
        data=str(path),
    )
    torch.manual_seed(0)
    parts = train_value.ValueParts(
        ValueNetwork(preset('paper').value), ValueGuidedPlanner(preset('default')).belief_filter
    )
    batch = made.sample(16, np.random.default_rng(0))
    arguments = (batch.maps, batch.cells, batch.actions[:, 0])
    before = train_value.demonstration_losses(parts, *arguments)
    train_value.train_from_demonstrations(parts.value, parts.belief, settings)
    after = train_value.demonstration_losses(parts, *arguments)
    assert float(after['action'].detach()) < float(before['action'].detach())
    assert float(after['mask'].detach()) < float(before['mask'].detach())


def test_broken_demonstrations_are_named(tmp_path: Path) -> None:
    """Files that are missing, cut or something else give one sentence that names them."""
    path = tmp_path / 'd.npz'
    with pytest.raises(ValueError, match=r'There are no demonstrations in .*d\.npz'):
        load_demonstrations(path)
    for content in (b'', b'nonsense'):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r'd\.npz does not hold demonstrations'):
            load_demonstrations(path)


def test_checkpoints_hold_no_pickle(tmp_path: Path) -> None:
    """A checkpoint is safetensors and JSON, the optimiser's state included."""
    made = walk_expert(make_mazes(1, 15, 1), 2, 8)
    settings = PolicyTraining(out=str(tmp_path), steps=1000, batch=1, noises=1)
    policy = DiffusionPolicy(preset('default').policy)
    optimizer = torch.optim.RAdam(policy.parameters())
    ema = Ema(policy, 0.9)
    rng = np.random.default_rng(0)
    batch = made.sample(2, rng)
    loss = train_policy.denoising_loss(policy, batch, 1, rng)
    loss.backward()  # type: ignore[no-untyped-call]
    optimizer.step()
    save_checkpoint(tmp_path, 1, policy, ema, optimizer, {'seed': settings.seed})
    assert {path.suffix for path in tmp_path.iterdir()} == {'.safetensors', '.json'}
    tensors = load_file(tmp_path / 'checkpoint.safetensors')
    assert any(name.startswith('optimizer.') for name in tensors)
