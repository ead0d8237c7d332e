"""Detectors of the target in frames, and from their boxes to places in the map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from avd_player.avd_format import index_of
from avd_player.scene import place_in_box
from gridnav.rgbd import MILLIMETRE
from vgdp_experiments.search.noise import BOXES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from avd_player.scene import Scene
    from avd_player.simulation import SearchRules
    from gridnav.rgbd import Camera, RgbdFrame
    from vgdp_experiments.search.noise import Sensors

NEAR_M = 2.5
"""A thing that is nearer than this must be seen, unless something stands before it."""

MARGIN = 0.15
"""Share of the image along its edges where a thing may be cut off."""

BEFORE_M = 0.15
"""What is nearer than a thing by more than this stands before it."""

PATCH = 2
"""Pixels to each side that tell how far it is to what is seen at a place."""

FALSE_SIZE = (0.04, 0.12)
"""Width and height of a false box, in shares of the image."""

SURE = 2
"""A detector that makes mistakes must find the target so often."""


class Detector(Protocol):
    """Finds the target in frames.

    Attributes:
        sure: So many detections at one place are no mistake; 1 for a detector that makes none.
    """

    sure: int

    def boxes(self, frame: RgbdFrame) -> NDArray[np.float64]:
        """Return boxes around the target: left, upper, right, lower pixel, (N, 4)."""


class LabelledBoxes:
    """The dataset's own boxes, brought from the images on disk into the frames.

    Args:
        scene: The scene.
        rules: Say what is looked for, and up to which difficulty boxes count.
    """

    sure = 1

    def __init__(self, scene: Scene, rules: SearchRules) -> None:
        self._scene = scene
        self._instance = scene.instance_id(rules.target)
        self._max_difficulty = rules.max_difficulty

    def boxes(self, frame: RgbdFrame) -> NDArray[np.float64]:
        """See `Detector`."""
        found = self._scene.boxes(frame.name, self._instance, self._max_difficulty)
        return np.array([self._in_frame(box, frame.camera) for box in found[:, :4]]).reshape(-1, 4)

    def _in_frame(self, box: NDArray[np.int64], camera: Camera) -> NDArray[np.float64]:
        left, upper, right, lower = box.tolist()
        corners = [[x, y] for x in (left, right + 1) for y in (upper, lower + 1)]
        slopes = self._scene.source.lens.unproject(np.array(corners, dtype=np.float64))
        pixels = slopes * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        low, high = np.rint(pixels.min(axis=0) + 0.5), np.rint(pixels.max(axis=0) - 0.5)
        return np.concatenate([low, np.maximum(high, low)])


class SpoiledBoxes:
    """A detector that misses boxes and has false ones, at the rates of the noise.

    Args:
        detector: What is spoiled.
        sensors: Say how much, and what is drawn.
    """

    sure = SURE

    def __init__(self, detector: Detector, sensors: Sensors) -> None:
        self._detector = detector
        self._sensors = sensors

    def boxes(self, frame: RgbdFrame) -> NDArray[np.float64]:
        """See `Detector`."""
        noise, rng = self._sensors.noise, self._sensors.rng(BOXES, index_of(frame.name))
        found = self._detector.boxes(frame)
        found = found[rng.random(len(found)) >= noise.missed]
        if rng.random() >= noise.false:
            return found
        size = np.array([frame.camera.width, frame.camera.height])
        half = np.array(FALSE_SIZE) * size / 2
        middle = half + 1 + rng.random(2) * (size - 2 * half - 3)
        return np.vstack([found, np.rint(np.concatenate([middle - half, middle + half]))])


class DetectorFinder:
    """Tells a robot where the target is, by a detector on what its sensors see.

    It is kept what was found in each image, so one of them does for all searches of a scene.

    Args:
        sensors: What the robot sees by.
        detector: Finds the target in frames.
        max_range: What is further away does not count, in metres.
    """

    def __init__(self, sensors: Sensors, detector: Detector, max_range: float) -> None:
        self.sure = detector.sure
        self._sensors = sensors
        self._detector = detector
        self._max_range = max_range
        self._found: dict[str, Sequence[NDArray[np.float64]]] = {}

    def sightings(self, name: str) -> Sequence[NDArray[np.float64]]:
        """See `avd_player.simulation.Finder`."""
        if name not in self._found:
            self._found[name] = self._look(name)
        return self._found[name]

    def _look(self, name: str) -> Sequence[NDArray[np.float64]]:
        frame = self._sensors.frame(name)
        if frame is None:
            return []
        camera, matrix = frame.camera, frame.camera_to_map()
        depth = np.asarray(frame.depth, np.uint16)

        def unproject(place: NDArray[np.float64]) -> NDArray[np.float64]:
            slopes: NDArray[np.float64] = (place - 0.5 - camera[4:]) / camera[2:4]
            return slopes

        places = [
            place_in_box(depth, box.astype(np.int64), unproject, matrix, self._max_range)
            for box in self._detector.boxes(frame)
        ]
        return [place for place in places if place is not None]

    def shows(self, name: str, place: NDArray[np.float64]) -> bool:
        """See `avd_player.simulation.Finder`."""
        if self.sure == 1:
            return False
        source = self._sensors.scene.source
        camera_to_map = self._sensors.pose(name).matrix() @ source.mount.matrix()
        x, y, z = (camera_to_map[:3, :3].T @ (place - camera_to_map[:3, 3])).tolist()
        if not 0 < z <= NEAR_M:
            return False
        camera = source.camera
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        across, down = MARGIN * camera.width, MARGIN * camera.height
        if not (across <= u < camera.width - across and down <= v < camera.height - down):
            return False
        frame = self._sensors.frame(name)
        if frame is None:
            return False
        row, col = round(v), round(u)
        patch = frame.depth[row - PATCH : row + PATCH + 1, col - PATCH : col + PATCH + 1]
        measured = patch[patch > 0]
        return bool(len(measured) and np.median(measured) * MILLIMETRE >= z - BEFORE_M)


def finder_for(sensors: Sensors, rules: SearchRules) -> DetectorFinder | None:
    """Return what finds the target with a scene's sensors, None for the labels as they are."""
    if not sensors.noise:
        return None
    detector: Detector = LabelledBoxes(sensors.scene, rules)
    if sensors.noise.missed or sensors.noise.false:
        detector = SpoiledBoxes(detector, sensors)
    return DetectorFinder(sensors, detector, rules.max_range)
