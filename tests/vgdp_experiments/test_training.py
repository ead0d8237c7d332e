"""Training data and training runs, in small."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch

from gridnav import DONE, FREE, GOAL, OBSTACLE, STEPS, Outcome
from maze_sim import Maze, MazeSimulation, cost_to_go, make_mazes
from vgdp_experiments import rollouts
from vgdp_experiments.commands import register
from vgdp_experiments.data import (
    Demonstrations,
    load_demonstrations,
    walk_expert,
    walk_explorer,
)
from vgdp_experiments.labels import Labels, expected_spl
from vgdp_experiments.map_codes import pack, unpack
from vgdp_experiments.merge import page_of
from vgdp_experiments.rollouts import (
    ExplorationSteps,
    explore,
    explored_spl,
    frontier_cells,
    worth_of_unseen,
)
from vgdp_experiments.train_value import turned, worth_losses
from vgdp_experiments.worlds import training_maze
from vgdp_planner import ValueGuidedPlanner
from vgdp_planner.config import preset
from vgdp_planner.value import ValueNetwork
from vgdp_planner.weights import SHIPPED, save_weights

SUCCESS = Labels()

SCALE = SUCCESS.patience * 42
"""Patience in the corridor, in cells."""

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
    """They depend on the seed alone, most are mazes, others have loops or open space."""
    mazes = [training_maze(15, np.random.default_rng(seed)) for seed in range(40)]
    again = training_maze(15, np.random.default_rng(7))
    assert np.array_equal(again.blocked, mazes[7].blocked)
    assert (again.start, again.goal) == (mazes[7].start, mazes[7].goal)
    assert min(maze.expert_steps for maze in mazes) >= 8
    free = np.array([(~maze.blocked).sum() for maze in mazes])
    assert 16 <= (free == 97).sum() <= 32  # A tree of 49 cells has 48 openings.


def test_frontier_cells() -> None:
    """A frontier cell is unseen and one valid step away from an observed free cell."""
    maps = np.zeros((1, 3, 3, 5), dtype=np.float32)
    maps[0, OBSTACLE, 0] = maps[0, OBSTACLE, 2] = 1
    maps[0, FREE, 1, :3] = 1
    expected = np.zeros((3, 5), dtype=bool)
    expected[1, 3] = True
    assert np.array_equal(frontier_cells(maps)[0], expected)


def corridor(start: int) -> Maze:
    """Return a corridor from column 1 to 40 with the robot somewhere in it."""
    blocked = np.ones((3, 42), dtype=bool)
    blocked[1, 1:41] = False
    return Maze.solved(blocked, (1, start), (1, 40))


def compared_at_first(start: int, labels: Labels = SUCCESS) -> ExplorationSteps:
    """Return the first step in a corridor where both ways were tried."""
    steps = explore([corridor(start)], None, 2, 99, np.random.default_rng(0), labels)
    compared = np.flatnonzero(np.isfinite(steps.distances[:, 1]))
    return steps.take(compared[[steps.weights[compared].argmax()]])


def from_here(steps: ExplorationSteps) -> np.ndarray:
    """Return what each choice of a step brings, seen from where the explorer was."""
    found: np.ndarray = steps.successes[0] * np.exp(-steps.distances[0] / steps.patiences[0])
    return found


def success(costs: np.ndarray) -> float:
    """Return the mean of γ^cost."""
    return float(np.exp(-costs / SCALE).mean())


def test_labels_are_the_mean_success_of_finding_a_goal(
    network: ValueNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a corridor each label is the mean of γ^way from what is next unseen to all open goals."""
    monkeypatch.setattr(rollouts, 'KEPT_SHARE', 1.0)
    steps = explore([corridor(1)], network, 2, 2, np.random.default_rng(0), SUCCESS)
    assert steps.targets[:, 0, 1].tolist() == list(range(4, 41))
    assert np.isinf(steps.distances[:, 1:]).all()
    for (row, column), found, weight in zip(
        steps.targets[:, 0], steps.successes[:, 0], steps.weights, strict=True
    ):
        # Goals lie at least 15 cells from the start, in the columns 16 to 40.
        goals = np.arange(max(column, 16), 41)
        # The walls beside the next cell have not been seen either: that step may be diagonal.
        last_step = 1.0 if row == 1 else np.sqrt(2)
        assert found == pytest.approx(success(goals - (column - 1) - last_step), rel=1e-4)
        assert weight == pytest.approx(len(goals) / 25)


@pytest.mark.parametrize('labels', [Labels(), Labels('success', 20.0), Labels('spl')])
def test_other_choices_are_tried_from_the_same_step(labels: Labels) -> None:
    """In the middle of a corridor both ways are tried, each with what it really leads to."""
    compared = compared_at_first(20, labels)
    assert np.isinf(compared.distances[:, 2:]).all()
    code = compared.codes[0]
    first, last = np.flatnonzero(code[1])[[0, -1]]
    left, right = np.arange(1, 6), np.arange(35, 41)
    left, right = left[code[1, left] == 0], right[code[1, right] == 0]
    # The robot stands two cells from the end of what it sees, on the side that it went to.
    at = first + 2 if 20 - first > last - 20 else last - 2
    ways, spent = np.concatenate([20 - left, right - 20]), abs(at - 20)
    # To see the wall at the end it goes there up to one cell; then it turns back.
    if_left = np.concatenate([at - left, at - 2 + right - 2])
    if_right = np.concatenate([39 - at + 39 - left, right - at])
    for choice in range(2):
        to_come = if_left if compared.targets[0, choice, 1] < at else if_right
        wanted = np.exp(-to_come / (labels.patience * 42)).mean()
        if labels.objective == 'spl':
            spl, most = ways / np.maximum(spent + to_come, ways), ways / np.maximum(spent, ways)
            wanted = spl.sum() / most.sum()
        assert from_here(compared)[choice] == pytest.approx(wanted, rel=1e-4)


def test_the_expert_knows_the_way_from_the_target_on() -> None:
    """In a corridor it turns round at once, having gone one step the wrong way."""
    compared = compared_at_first(20, Labels('expert'))
    goals = np.concatenate([np.arange(1, 6), np.arange(35, 41)])
    goals = goals[compared.codes[0][1, goals] == 0]
    for choice, brought in enumerate(from_here(compared)[:2]):
        target, distance = compared.targets[0, choice], compared.distances[0, choice]
        wanted = success(distance + np.abs(goals - target[1]))
        assert target[0] == 1
        assert brought == pytest.approx(wanted, rel=1e-4)


def test_patience_is_how_fast_the_spl_falls() -> None:
    """A little more to come takes that share of the SPL away that the patience says."""
    rng = np.random.default_rng(0)
    goals = rng.random((3, 4, 5)) < 0.7
    ways = rng.uniform(15, 30, goals.shape)
    to_come = ways + rng.uniform(0, 40, goals.shape)
    spent = np.array([0.0, 20.0, 300.0])
    share, patience, at_once = expected_spl(goals, to_come, spent, ways)
    for index in range(3):
        costs, d = spent[index] + to_come[index][goals[index]], ways[index][goals[index]]
        assert share[index] * at_once[index] == pytest.approx((d / costs).sum())
    later = expected_spl(goals, to_come + 0.01, spent, ways)[0]
    assert np.log(later / share) == pytest.approx(-0.01 / patience, rel=1e-2)
    assert (np.diff(patience) > 0).all()


def test_spl_is_never_more_than_one() -> None:
    """A goal that is reached on the shortest way brings 1, whatever it is said to cost."""
    one = np.ones((1, 1, 1))
    share, _, at_once = expected_spl(one > 0, 5 * one, np.zeros(1), 20 * one)
    assert (share[0], at_once[0]) == (1.0, 1.0)


def test_spl_over_all_goals() -> None:
    """Who goes straight loses nothing; who turns back loses what the way there and back costs."""
    assert explored_spl([corridor(1)], None, 2) == pytest.approx([1.0])
    left, right = np.arange(1, 6), np.arange(35, 41)
    # It turns back a cell before the end, from where it sees that this is the end.
    right_first = [*np.ones(6), *((20 - left) / (19 + 39 - left))]
    left_first = [*np.ones(5), *((right - 20) / (18 + right - 2))]
    found = explored_spl([corridor(20)], None, 2)[0]
    assert found in (
        pytest.approx(np.mean(right_first)),
        pytest.approx(np.mean(left_first)),
    )


def test_worth_learns_the_better_choice() -> None:
    """Trained on two choices of known success, the network prefers the better one."""
    torch.manual_seed(0)
    network = ValueNetwork(preset('default').value)
    steps = compared_at_first(12)
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    for _ in range(40):
        terms = worth_losses(network, steps)
        optimizer.zero_grad()
        (terms['level'] + terms['differences']).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    worth = worth_of_unseen(network, unpack(steps.codes))[0]
    there = worth[tuple(steps.targets[0, :2].T)]
    wanted = np.log(steps.successes[0, :2]) * SCALE
    assert there - there.mean() == pytest.approx(wanted - wanted.mean(), abs=3.0)


def test_turning_keeps_targets_on_their_cells() -> None:
    """Maps that are no squares are turned and mirrored together with the targets on them."""
    rng = np.random.default_rng(0)
    steps = explore([corridor(20)], None, 2, 99, rng, SUCCESS)
    kinds = [steps.codes[i][tuple(steps.targets[i, 0])] for i in range(len(steps))]
    assert set(kinds) == {0}
    shapes = set()
    for _ in range(12):
        codes, cells = (made := turned(steps, rng)).codes, made.targets[:, 0]
        shapes.add(codes.shape[1:])
        next_to = [
            codes[i, max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2].max()
            for i, (r, c) in enumerate(cells)
        ]
        assert [codes[i][tuple(cell)] for i, cell in enumerate(cells)] == kinds
        assert min(next_to) > 0
    assert shapes == {(3, 42), (42, 3)}


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
    made = walk_explorer(mazes, network, 2, 8)
    half = len(made.codes) // 2
    assert np.array_equal(made.codes[:half], made.codes[half:])
    assert np.array_equal(made.cells[:half], made.cells[half:])
    assert (made.actions[:half] != made.actions[half:]).any()
    again = walk_explorer(mazes, network, 2, 8)
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
    assert (value / 'log.csv').read_text().startswith('step,')


@pytest.mark.parametrize(
    ('option', 'sentence'),
    [
        ('--objective fame', "There is no objective 'fame'; there are success, spl, expert"),
        ('--patience 0', 'A patience of 0.0 sides of the map is not above 0'),
        (
            '--worlds maze-15-view9',
            "There is no world 'maze-15-view9' to train in; there are maze",
        ),
    ],
)
def test_settings_that_can_not_be_used(
    parser: argparse.ArgumentParser,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    option: str,
    sentence: str,
) -> None:
    """Nothing is trained; one sentence names what is wrong."""
    assert command(parser, f'train value --out {tmp_path} {option}')
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_values_are_compared_over_all_goals(
    parser: argparse.ArgumentParser, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each explorer has the same worlds, the page shows the ratios, and a rerun is the same."""
    out = tmp_path / 'results.json'
    words = f'eval exploration {SHIPPED} --mazes 12 --setting 15-view2 kruskal -o {out}'
    assert not command(parser, words)
    first = out.read_text()
    assert 'kruskal of 21×21, view range 2, 6 worlds' in capsys.readouterr().out
    assert page_of(out).text.count('1.000 (1.000 … 1.000)') == 4
    places = json.loads(first)['places']
    assert [len(column) for place in places for column in place['spl'].values()] == [12, 12, 6, 6]
    assert not command(parser, words)
    assert out.read_text() == first


def test_values_that_can_not_be_compared(
    parser: argparse.ArgumentParser, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two folders of one name, and a value that knows no worth of the unseen, are named."""
    out = tmp_path / 'results.json'
    assert command(parser, f'eval exploration {SHIPPED} {SHIPPED} -o {out}')
    assert 'has the name of another explorer' in capsys.readouterr().err
    paper = preset('paper')
    tensors = ValueNetwork(paper.value).state_dict()
    named = {f'value.{name}': tensor for name, tensor in tensors.items()}
    save_weights(tmp_path / 'paper', paper, named, {'value': {}})
    assert command(parser, f'eval exploration {tmp_path / "paper"} -o {out}')
    assert 'says nothing of what unseen cells are worth' in capsys.readouterr().err
    assert not out.exists()


def test_broken_demonstrations_are_named(tmp_path: Path) -> None:
    """Files that are missing, cut or something else give one sentence that names them."""
    path = tmp_path / 'd.npz'
    with pytest.raises(ValueError, match=r'There are no demonstrations in .*d\.npz'):
        load_demonstrations(path)
    for content in (b'', b'nonsense'):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r'd\.npz does not hold demonstrations'):
            load_demonstrations(path)
