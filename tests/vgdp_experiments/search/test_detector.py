"""Detectors, and what searches make of false and of missing detections."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from avd_player.scene import TargetSightings
from avd_player.simulation import ActiveVisionSimulation, Labels
from gridnav.metrics import Outcome
from vgdp_experiments.search.detector import (
    DetectorFinder,
    LabelledBoxes,
    SpoiledBoxes,
    finder_for,
)
from vgdp_experiments.search.loop import search
from vgdp_experiments.search.mapping import SceneMapper
from vgdp_experiments.search.noise import Noise, Sensors
from vgdp_experiments.search.searchers import FrontierSearcher

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avd_player.scene import Scene
    from avd_player.simulation import SearchRules
    from gridnav.rgbd import RgbdFrame

pytestmark = pytest.mark.filterwarnings('ignore:Home_113_1')

PLACE = np.array([1.0, 2.0, 0.8])


def test_boxes_in_frames_are_where_the_labels_are(scene: Scene, rules: SearchRules) -> None:
    """To some centimetres, in nearly all of the images and in no others."""
    instance = scene.instance_id(rules.target)
    labelled = scene.sightings(instance, rules.max_difficulty, rules.max_range)
    finder = DetectorFinder(Sensors(scene), LabelledBoxes(scene, rules), rules.max_range)
    names = [name for names in scene.views for name in names]
    found = {name: finder.sightings(name) for name in names if finder.sightings(name)}
    assert len(set(found) & set(labelled)) >= 0.8 * len(labelled)
    for name in set(found) & set(labelled):
        assert np.linalg.norm(found[name][0] - labelled[name]) < 0.1
    middle = np.median(list(labelled.values()), axis=0)
    assert all(np.linalg.norm(points[0] - middle) < 0.3 for points in found.values())


def test_misses_speak_against_a_thing() -> None:
    """Four for each sighting; a new sighting brings it back."""
    sightings = TargetSightings(sure=2)
    sightings.look('a', [PLACE], lambda _place: True)
    for name in 'bcd':
        sightings.look(name, [], lambda _place: True)
        sightings.look(f'{name} of another place', [], lambda _place: False)
        assert sightings.position is not None
    assert not sightings.confirmed
    sightings.look('e', [], lambda _place: True)
    assert sightings.position is None
    for name in 'fgh':
        sightings.look(name, [PLACE + 0.1], lambda _place: True)
    assert sightings.confirmed
    sightings.doubt()
    assert sightings.position is None


def test_what_was_seen_more_often_counts_in_spite_of_misses() -> None:
    """Of two things, the one with more left; the labels' own things are never missed."""
    sightings = TargetSightings(sure=2)
    for name in 'abc':
        sightings.look(name, [PLACE], lambda _place: False)
    for name in 'defg':
        sightings.look(name, [PLACE + 3.0], lambda place: bool(place[0] < 2))
    assert sightings.position == pytest.approx(PLACE + 3.0)
    assert len(sightings.points) == 7
    assert not Labels({'a': PLACE}).shows('b', PLACE)


def test_a_place_is_shown_from_near_with_nothing_before_it(
    scene: Scene, rules: SearchRules
) -> None:
    """Behind a wall it is not, nor far away, nor behind the camera."""
    sensors = Sensors(scene, Noise(missed=0.5))
    finder = finder_for(sensors, rules)
    assert finder is not None
    name = scene.views[0][0]
    frame = sensors.frame(name)
    assert frame is not None
    matrix = frame.camera_to_map()

    def ahead(distance: float) -> np.ndarray:
        return (matrix @ [0.0, 0.0, distance, 1.0])[:3]

    wall = float(np.median(frame.depth[frame.depth > 0])) / 1000
    assert finder.shows(name, ahead(1.0))
    assert not finder.shows(name, ahead(-1.0))
    assert not finder.shows(name, ahead(3.0))
    assert wall > 1.0
    near_wall = next(
        other
        for names in scene.views
        for other in names
        if (seen := sensors.frame(other)) is not None
        and 0 < seen.depth[seen.depth.shape[0] // 2, seen.depth.shape[1] // 2] < 1500
    )
    matrix = sensors.pose(near_wall).matrix() @ scene.source.mount.matrix()
    assert not finder.shows(near_wall, ahead(2.2))


class Liar:
    """A detector that sees the target in one image, where it is not."""

    sure = 2

    def __init__(self, name: str) -> None:
        self._name = name

    def boxes(self, frame: RgbdFrame) -> np.ndarray:
        """Return a box in the middle of that image."""
        row, col = frame.depth.shape[0] // 2, frame.depth.shape[1] // 2
        box = [col - 3.0, row - 6.0, col + 3.0, row + 6.0]
        return np.array([box] if frame.name == self._name else []).reshape(-1, 4)


class Both:
    """Two detectors as one."""

    sure = 2

    def __init__(self, *detectors: Liar | LabelledBoxes) -> None:
        self._detectors = detectors

    def boxes(self, frame: RgbdFrame) -> np.ndarray:
        """Return the boxes of both."""
        return np.vstack([detector.boxes(frame) for detector in self._detectors])


def test_a_false_sighting_is_given_up(scene: Scene, rules: SearchRules) -> None:
    """The robot goes there first, sees nothing from near, and finds the bottle all the same."""
    start, west = 2, 6
    liar = Liar(scene.views[start][west])
    sensors = Sensors(scene)
    rules = replace(rules, max_steps=300)
    finder = DetectorFinder(sensors, Both(liar, LabelledBoxes(scene, rules)), rules.max_range)
    assert finder.sightings(scene.views[start][west])
    simulation = ActiveVisionSimulation(scene, rules, finder)
    mapper = SceneMapper(sensors)
    goals = []
    result = search(
        simulation,
        FrontierSearcher(),
        0,
        mapper=mapper,
        start=start,
        on_step=lambda step: goals.append(step.observation.grid.goal),
    )
    assert goals[0] != 'none'
    assert 'none' in goals
    assert result.outcome is Outcome.SUCCESS
    trusting = DetectorFinder(sensors, liar, rules.max_range)
    trusting.sure = 1
    believer = ActiveVisionSimulation(scene, rules, trusting)
    outcome = search(believer, FrontierSearcher(), 0, mapper=mapper, start=start).outcome
    assert outcome is Outcome.FALSE_DONE


def test_a_spoiled_detector_errs_at_its_rates(scene: Scene, rules: SearchRules) -> None:
    """And alike each time that an image is seen."""
    sensors = Sensors(scene, Noise(missed=0.3, false=0.2))
    labels = LabelledBoxes(scene, rules)
    spoiled = SpoiledBoxes(labels, sensors)
    frames = [sensors.frame(name) for names in scene.views for name in names]
    there = [frame for frame in frames if frame is not None]
    clean = [len(labels.boxes(frame)) for frame in there]
    found = [len(spoiled.boxes(frame)) for frame in there]
    assert found == [len(spoiled.boxes(frame)) for frame in there]
    empty = [count for count, true in zip(found, clean, strict=True) if not true]
    assert np.mean(empty) == pytest.approx(0.2, abs=0.08)
    missed = [count == 0 for count, true in zip(found, clean, strict=True) if true]
    assert 0.05 < np.mean(missed) < 0.5
    height, width = there[0].depth.shape
    for frame in there:
        boxes = spoiled.boxes(frame)
        assert (boxes >= 0).all()
        assert (boxes[:, 2] < width).all()
        assert (boxes[:, 3] < height).all()


def test_without_noise_the_labels_do(scene: Scene, rules: SearchRules) -> None:
    """As in the node; with noise on depth the boxes are right, but not where they lie."""
    assert finder_for(Sensors(scene), rules) is None
    noisy = finder_for(Sensors(scene, Noise(depth=10.0)), rules)
    assert noisy is not None
    assert noisy.sure == 1
    spoiled = finder_for(Sensors(scene, Noise(false=0.1)), rules)
    assert spoiled is not None
    assert spoiled.sure == 2


class Sure:
    """A finder that sees a thing at one place in every image."""

    sure = 1

    def __init__(self, place: NDArray[np.float64]) -> None:
        self._place = place

    def sightings(self, name: str) -> list[NDArray[np.float64]]:  # noqa: ARG002
        """Return the place."""
        return [self._place]

    def shows(self, name: str, place: NDArray[np.float64]) -> bool:  # noqa: ARG002
        """Say nothing against it."""
        return False


def test_a_true_sighting_counts_where_the_scene_has_no_depth(
    scene: Scene, rules: SearchRules
) -> None:
    """What the robot saw of the target was in sight, and what it saw elsewhere was not."""
    labels = ActiveVisionSimulation(scene, rules)
    labels.restart(0, start=0)
    assert not labels.target_seen
    target = labels.targets[0]
    for off, seen in ((0.1, True), (3.0, False)):
        simulation = ActiveVisionSimulation(scene, rules, Sure(target + np.array([0.0, off, 0.0])))
        simulation.restart(0, start=0)
        assert simulation.target_seen == seen
