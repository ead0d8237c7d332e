"""Errors of what a robot senses."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bev_mapper.segmentation import GeometricSegmenter
from bev_mapper.unprojection import depth_in_metres, unproject
from vgdp_experiments.search.noise import Noise, Sensors

if TYPE_CHECKING:
    from avd_player.scene import Scene
    from gridnav.rgbd import RgbdFrame

pytestmark = pytest.mark.filterwarnings('ignore:Home_113_1')


def seen(scene: Scene, noise: Noise, seed: int = 0, image: int = 0) -> RgbdFrame:
    """Return a frame."""
    frame = Sensors(scene, noise, seed).frame(scene.views[0][image])
    assert frame is not None
    return frame


def test_without_noise_a_frame_is_that_of_the_player(scene: Scene) -> None:
    """But for the mount, which is the same for all of them, so that its place stays."""
    name = scene.views[0][0]
    frame = seen(scene, Noise())
    np.testing.assert_array_equal(frame.depth, scene.frame(name).depth)
    np.testing.assert_allclose(frame.camera_to_map(), scene.source.camera_to_map(name), atol=1e-9)


def test_depth_is_wrong_by_millimetres(scene: Scene) -> None:
    """As much as was asked for, and the same again for the same seed and image."""
    clean = seen(scene, Noise()).depth.astype(float)
    noisy = seen(scene, Noise(depth=30.0)).depth.astype(float)
    error = (noisy - clean)[clean > 0]
    assert error.std() == pytest.approx(30.0, rel=0.05)
    np.testing.assert_array_equal(noisy, seen(scene, Noise(depth=30.0)).depth)
    assert (noisy != seen(scene, Noise(depth=30.0), seed=1).depth).any()
    other = seen(scene, Noise(depth=30.0), image=1).depth - seen(scene, Noise(), image=1).depth
    assert (other.astype(float) != noisy - clean).any()


def test_pixels_are_missing(scene: Scene) -> None:
    """In the share that was asked for."""
    clean = seen(scene, Noise()).depth > 0
    noisy = seen(scene, Noise(missing=0.4)).depth > 0
    assert not (noisy & ~clean).any()
    assert (clean & ~noisy).sum() / clean.sum() == pytest.approx(0.4, abs=0.02)


def test_poses_are_wrong_by_position(scene: Scene) -> None:
    """All images of a position are off alike, and the camera stays at its height."""
    sensors = Sensors(scene, Noise(position=50.0, heading=3.0))
    off, turns = [], []
    for names in scene.views:
        moved = [
            np.subtract(sensors.pose(name)[:2], Sensors(scene).pose(name)[:2]) for name in names
        ]
        np.testing.assert_allclose(moved, np.tile(moved[0], (len(names), 1)), atol=1e-9)
        off.append(moved[0])
        true, said = Sensors(scene).pose(names[0]).matrix(), sensors.pose(names[0]).matrix()
        turn = said[:3, :3] @ true[:3, :3].T
        turns.append(math.degrees(math.atan2(turn[1, 0], turn[0, 0])))
        assert said[2, 3] == pytest.approx(true[2, 3])
    assert 0.02 < np.std(off) < 0.1
    assert 1.0 < np.std(turns) < 6.0


def test_classes_are_wrong(scene: Scene) -> None:
    """A share of the pixels gets any class."""
    frame = replace(seen(scene, Noise()))
    depth = depth_in_metres(frame.depth)
    points = unproject(depth, frame.camera, frame.camera_to_map())
    metric = replace(frame, depth=depth)
    clean = GeometricSegmenter().labels(metric, points)
    sensors = Sensors(scene, Noise(labels=0.3))
    noisy = sensors.segmenter(GeometricSegmenter()).labels(metric, points)
    assert (clean != noisy).mean() == pytest.approx(0.3 * 12 / 13, abs=0.02)
    assert len(np.unique(noisy)) == 13


@pytest.mark.parametrize('name', ['depth', 'missing', 'false'])
def test_noise_that_makes_no_sense_is_refused(name: str) -> None:
    """By its name."""
    with pytest.raises(ValueError, match=f"'{name}' is"):
        Noise(**{name: -0.1})
    with pytest.raises(ValueError, match="'labels' is a share from 0 to 1, got 1"):
        Noise(labels=1.5)
