"""Positions, moves and sightings of a scene, and the search in it."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.avd_player.tiny_scene import BOTTLE, GRID, TinyScene, write_scene

from avd_player import ActiveVisionSimulation, AvdSource, Scene, SearchRules, TargetSightings
from avd_player.avd_format import ANNOTATIONS, DEPTH_FOLDER, depth_name
from gridnav.actions import DONE, NUM_MOVES, STEPS, valid_moves
from gridnav.metrics import Outcome

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

NORTH, NORTH_EAST, EAST, SOUTH, WEST = 0, 1, 2, 4, 6

NEAR = SearchRules(reach=0.5, min_expert_steps=0)
"""Done succeeds at the positions that are nearest to the bottle."""


@pytest.fixture(scope='module')
def scene(tiny: TinyScene) -> Scene:
    """Return the tiny scene as a graph."""
    return Scene(AvdSource(tiny.folder))


@pytest.fixture(scope='module')
def room(tmp_path_factory: pytest.TempPathFactory) -> tuple[TinyScene, Scene]:
    """Return a scene with a pillar, a corner that is cut, and positions further off."""
    cells = [(0, 0), (1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2), (3, 3), (5, 3)]
    tiny = write_scene(tmp_path_factory.mktemp('room') / 'Home_005_1', cells=cells, jitter=0.008)
    return tiny, Scene(AvdSource(tiny.folder))


def truth_to_map(tiny: TinyScene, scene: Scene) -> NDArray[np.float64]:
    """Return what takes the truth into the map, (4, 4)."""
    return scene.source.map_from_world @ tiny.world_from_truth


def expected_moves(cells: list[tuple[int, int]]) -> NDArray[np.int64]:
    """Return the moves by the rules of grids, (P, 8)."""
    table = np.array(cells)
    blocked = np.ones((table[:, 1].max() + 1, table[:, 0].max() + 1), dtype=np.bool_)
    blocked[table[:, 1], table[:, 0]] = False
    valid = valid_moves(blocked)
    moves = np.full((len(cells), NUM_MOVES), -1)
    for index, (col, row) in enumerate(cells):
        for move, (row_step, col_step) in enumerate(STEPS.tolist()):
            if valid[move, row, col]:
                moves[index, move] = cells.index((col + col_step, row + row_step))
    return moves


def test_positions_and_headings_are_those_of_the_truth(tiny: TinyScene, scene: Scene) -> None:
    """On the grid, twelve views each, counter-clockwise."""
    matrix = truth_to_map(tiny, scene)
    truth = np.array([(col * 0.3, row * 0.3, 0, 1) for col, row in GRID]) @ matrix.T
    np.testing.assert_allclose(scene.positions, truth[:, :2], atol=1e-3)
    assert np.abs(scene.positions - scene.cells * 0.3).max() < 5e-3
    assert [len(names) for names in scene.views] == [12] * 6
    assert scene.clusters == list(range(6))
    for headings in scene.headings:
        steps = np.angle(np.exp(1j * np.diff(headings)))
        np.testing.assert_allclose(steps, math.pi / 6, atol=2e-3)
    assert scene.name == 'Home_001_1'


def test_moves_are_those_of_the_grid(scene: Scene, room: tuple[TinyScene, Scene]) -> None:
    """Compass moves to the neighbours, none through a pillar, no diagonal between two corners."""
    np.testing.assert_array_equal(scene.moves, expected_moves(GRID))
    np.testing.assert_allclose(scene.costs[0, :3], (1, math.sqrt(2), 1), atol=0.01)
    assert np.isinf(scene.costs[0, SOUTH])
    tiny, rough = room
    np.testing.assert_array_equal(rough.moves, expected_moves(tiny.cells))
    counts = np.bincount(rough.components)
    assert sorted(counts.tolist()) == [1, 1, 7]


def test_longer_links_are_followed_on_request(room: tuple[TinyScene, Scene]) -> None:
    """The data set's own pointers, up to 0.75 m, to what lies in the direction of a move."""
    _, short = room
    far = Scene(short.source, max_link=0.8)
    assert short.moves[7, EAST] == -1
    assert far.moves[7, EAST] == 8
    assert far.moves[8, WEST] == 7
    assert far.costs[7, EAST] == pytest.approx(2.0, abs=0.1)
    # A nearer one in the same direction comes first.
    np.testing.assert_array_equal(far.moves[0, [NORTH, EAST]], short.moves[0, [NORTH, EAST]])


def test_positions_off_the_grid_are_linked_by_pointers_alone(
    damaged: Callable[[], Path],
) -> None:
    """And pointers may lead one way only."""
    folder = damaged()
    path = folder / ANNOTATIONS
    entries: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    for entry in entries.values():
        entry.update(dict.fromkeys(('forward', 'backward', 'left', 'right'), ''))
    first, last = '000110000030101.jpg', '000110000600101.jpg'
    entries[first]['left'] = last
    path.write_text(json.dumps(entries), encoding='utf-8')
    scene = Scene(AvdSource(folder))
    np.testing.assert_array_equal(scene.moves, expected_moves(GRID))
    scene = Scene(AvdSource(folder))
    scene.positions = scene.positions + np.array([0.15, 0.15])
    expected = np.full((6, NUM_MOVES), -1)
    expected[0, NORTH_EAST] = 4
    np.testing.assert_array_equal(scene.moves, expected)


def test_sightings_say_where_the_bottle_is(tiny: TinyScene, scene: Scene) -> None:
    """From each image in which it is large and near enough, to a few centimetres."""
    matrix = truth_to_map(tiny, scene)
    bottle = (matrix @ np.append(BOTTLE.mean(axis=0), 1))[:3]
    instance = scene.instance_id('coca_cola_glass_bottle')
    found = scene.sightings(instance, 4, 6.0)
    assert len(found) > 10
    for point in found.values():
        # The front of it is seen, not its middle.
        assert np.linalg.norm(point - bottle) < 0.12
    together = TargetSightings()
    for name, point in found.items():
        together.add(name, point)
        together.add(name, point + 5)
    assert len(together.things) == 1
    assert together.position is not None
    assert np.linalg.norm(together.position - bottle) < 0.08
    assert len(scene.sightings(instance, 1, 6.0)) < len(scene.sightings(instance, 2, 6.0))
    near = scene.sightings(instance, 4, 0.9)
    assert 0 < len(near) < len(found)
    assert not scene.sightings(7, 5, 10.0)
    with pytest.raises(ValueError, match="There is no instance 'teapot'"):
        scene.instance_id('teapot')


def test_what_has_no_depth_is_not_seen(damaged: Callable[[], Path]) -> None:
    """Nor what lies in a depth image that can't be read, nor a box outside of it."""
    folder = damaged()
    found = Scene(AvdSource(folder)).sightings(5, 4, 6.0)
    names = sorted(found)
    (folder / DEPTH_FOLDER / depth_name(names[0])).write_bytes(b'')
    path = folder / ANNOTATIONS
    entries = json.loads(path.read_text(encoding='utf-8'))
    entries[names[1]]['bounding_boxes'] = [[500, 20, 600, 40, 5, 1], [-9, -9, -1, -1, 5, 1]]
    # Two pixels from the side nothing was measured.
    entries[names[2]]['bounding_boxes'] = [[0, 20, 3, 40, 5, 1]]
    path.write_text(json.dumps(entries), encoding='utf-8')
    assert sorted(Scene(AvdSource(folder)).sightings(5, 4, 6.0)) == names[3:]


def test_two_things_of_a_kind_are_told_apart() -> None:
    """The one seen most often counts; the middle of its sightings is robust."""
    sightings = TargetSightings()
    assert sightings.position is None
    points = [(0, 0, 0), (3, 0, 1), (3.1, 0, 1), (0.1, 0, 0), (3.6, 0, 1), (3.05, 0, 1)]
    for index, point in enumerate(points):
        sightings.add(str(index), np.array(point, dtype=np.float64))
    first, second = sightings.things
    np.testing.assert_allclose(first, (3.075, 0, 1))
    np.testing.assert_allclose(second, (0.05, 0, 0))
    for index in range(20):
        sightings.add(f'more {index}', np.array([3.0, 0, 1]))
    assert len(sightings.things) == 1


def test_a_search_succeeds_within_reach_of_what_was_seen(scene: Scene) -> None:
    """Along the shortest way, with an SPL of 1."""
    simulation = ActiveVisionSimulation(scene, NEAR)
    assert simulation.goals.any()
    assert not simulation.goals.all()
    simulation.restart(start=int(simulation.expert.steps.argmax()))
    result = simulation.result()
    assert result.expert_steps >= 1
    # The way back through the costs.
    while not simulation.goals[simulation.position]:
        costs = simulation.expert.costs
        moves = scene.moves[simulation.position]
        totals = [
            scene.costs[simulation.position, move] + costs[moves[move]]
            if moves[move] >= 0
            else math.inf
            for move in range(NUM_MOVES)
        ]
        simulation.step(int(np.argmin(totals)))
    assert simulation.goal is not None
    simulation.step(DONE)
    result = simulation.result()
    assert result.outcome is Outcome.SUCCESS
    assert result.spl == pytest.approx(1.0)
    assert result.steps == result.expert_steps + 1
    simulation.step(NORTH)
    assert simulation.result() == result


def test_done_too_far_away_or_unseen_fails(scene: Scene) -> None:
    """Within reach it counts only once the target was seen."""
    simulation = ActiveVisionSimulation(scene, NEAR)
    away = int(np.flatnonzero(~simulation.goals)[0])
    simulation.restart(start=away)
    simulation.step(DONE)
    assert simulation.outcome is Outcome.FALSE_DONE
    rules = SearchRules(reach=0.5, min_expert_steps=0, views='heading')
    narrow = ActiveVisionSimulation(scene, rules)
    goal = int(np.flatnonzero(narrow.goals)[0])
    narrow.restart(start=goal)
    # It looks to the east, where there is no bottle; in the west there is none either.
    seen = narrow.goal is not None
    narrow.step(DONE)
    assert narrow.outcome is (Outcome.SUCCESS if seen else Outcome.FALSE_DONE)


def test_without_a_way_the_robot_stays_and_turns(scene: Scene) -> None:
    """A bump costs an action but no way; the heading follows the last move."""
    rules = SearchRules(reach=0.5, min_expert_steps=0, views='heading', max_steps=3)
    simulation = ActiveVisionSimulation(scene, rules)
    simulation.restart(start=0)
    for move, yaw in ((SOUTH, -math.pi / 2), (WEST, math.pi), (NORTH, math.pi / 2)):
        simulation.step(move)
        off = scene.headings[simulation.position][simulation.view] - yaw
        assert abs(math.remainder(off, math.tau)) <= math.pi / 12 + 1e-6
        assert simulation.seen_names == [simulation.heading_name]
    assert (simulation.bumps, simulation.steps) == (2, 3)
    assert simulation.path_cost == pytest.approx(1.0, abs=0.01)
    assert simulation.position == 3
    for _ in range(2):
        assert simulation.result().outcome is Outcome.TIMEOUT
        simulation.give_up()
    simulation.restart(start=0)
    simulation.give_up()
    assert simulation.result().outcome is Outcome.GAVE_UP
    assert simulation.result().spl == 0.0


def test_the_expert_sees_the_target_on_its_way(room: tuple[TinyScene, Scene]) -> None:
    """A way that ends within reach without having seen it is none; parts apart have none."""
    _, scene = room
    simulation = ActiveVisionSimulation(scene, SearchRules(reach=0.2, min_expert_steps=0))
    costs, steps = simulation.expert[:2]
    goals = np.flatnonzero(simulation.goals)
    assert len(goals) == 1
    assert np.isinf(costs[7:]).all()
    assert 7 not in simulation.starts
    sees = [any(name in simulation._visible for name in names) for names in scene.views]
    if sees[goals[0]]:
        assert (costs[goals[0]], steps[goals[0]]) == (0.0, 0)
    # Without its views of the bottle a goal has to be left and come back to.
    names = set(scene.views[goals[0]])
    simulation._visible = {n: p for n, p in simulation._visible.items() if n not in names}
    del simulation.expert
    assert simulation.expert.costs[goals[0]] >= 2 * 0.9


def test_starts_are_far_from_the_target(scene: Scene) -> None:
    """Seeded; a scene that is too small says so, as does one without the target."""
    simulation = ActiveVisionSimulation(scene, SearchRules(reach=0.5, min_expert_steps=1))
    starts = set()
    for seed in range(20):
        simulation.restart(seed)
        starts.add(simulation.start)
        again = simulation.start
        simulation.restart(seed)
        assert simulation.start == again
    assert len(starts) > 1
    assert not simulation.goals[list(starts)].any()
    with pytest.raises(ValueError, match='a position from 0 to 5, got 6'):
        simulation.restart(start=6)
    with pytest.raises(ValueError, match='no position 10 moves from where coca_cola_glass_bot'):
        ActiveVisionSimulation(scene, SearchRules())
    with pytest.raises(ValueError, match='red_bull is nowhere to be seen in Home_001_1'):
        ActiveVisionSimulation(scene, SearchRules(target='red_bull'))
    with pytest.raises(ValueError, match='An action is an index from 0 to 8, got 9'):
        simulation.step(9)


@pytest.mark.parametrize(
    ('settings', 'reason'),
    [
        ({'views': 'some'}, "must be 'all' or 'heading', got 'some'"),
        ({'reach': -1.0}, 'Reach and range must be above 0 m, got -1.0'),
        ({'max_range': math.nan}, 'Reach and range'),
        ({'max_steps': 0}, 'At least one action is needed'),
    ],
)
def test_rules_that_can_not_be_are_named(settings: dict[str, Any], reason: str) -> None:
    """One sentence each."""
    with pytest.raises(ValueError, match=reason):
        SearchRules(**settings)
