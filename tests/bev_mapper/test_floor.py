"""Finding the floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bev_mapper.floor import FloorTracker, Plane
from bev_mapper.room import MOUNT, render, walk
from bev_mapper.unprojection import depth_in_metres, unproject
from gridnav.rgbd import CLASSES, Camera, CameraMount, Pose3D, RgbdFrame

CAMERA = Camera(320, 240, 250.0, 250.0, 159.5, 119.5)


def fit(tracker: FloorTracker, frame: RgbdFrame) -> tuple[Plane, np.ndarray]:
    """Return the floor of a frame, and the heights of the true floor's points above it."""
    camera_to_map = frame.camera_to_map()
    depth = depth_in_metres(frame.depth)
    points = unproject(depth, frame.camera, camera_to_map)
    plane = tracker.fit(points, (depth > 0) & (depth < 5), camera_to_map)
    x, y, z = points[:, frame.labels == CLASSES.index('floor')]
    return plane, z - plane.height_at(x, y)


@pytest.mark.parametrize(
    ('pitch', 'roll', 'up'),
    [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (-3.0, 1.0, 0.0), (0.0, -3.0, 0.05), (2.0, 2.0, -0.06)],
)
def test_a_camera_that_sits_otherwise_than_is_said(pitch: float, roll: float, up: float) -> None:
    """Some degrees and centimetres do not make the floor an obstacle, from the first look on."""
    tracker = FloorTracker()
    said = MOUNT._replace(
        pitch=MOUNT.pitch + np.radians(pitch), roll=np.radians(roll), z=MOUNT.z + up
    )
    for number in range(12):
        frame = replace(render(CAMERA, walk(number, 12)), mount=said)
        _, heights = fit(tracker, frame)
        if len(heights):
            assert np.percentile(np.abs(heights), 95) < 0.05


def test_low_things_do_not_become_the_floor() -> None:
    """A camera that looks at a low table for long, and at no floor."""
    tracker = FloorTracker()
    fit(tracker, render(CAMERA, Pose3D()))
    looks_down = CameraMount(0.0, 0.0, 1.2, 0.0, 1.2, 0.0)
    for _ in range(50):
        frame = replace(render(CAMERA, Pose3D(), mount=looks_down, things=()), mount=looks_down)
        # The floor in the picture is 0.2 m higher than where it was.
        raised = frame.depth * ((1.2 - 0.2) / 1.2)
        plane, _ = fit(tracker, replace(frame, depth=raised.astype(np.uint16)))
        assert abs(plane.height_at(0.5, 0.0)) < 0.05


def test_noise_without_a_floor_leaves_it_where_it_is_said_to_be() -> None:
    """Nothing is level in noise, and a wall has no floor."""
    tracker = FloorTracker()
    rng = np.random.default_rng(0)
    wall = render(CAMERA, Pose3D(2.0), mount=CameraMount(z=1.2), things=())
    plane, _ = fit(tracker, wall)
    assert plane == Plane()
    noisy = wall.depth + rng.normal(0, 200, wall.depth.shape)
    plane, _ = fit(tracker, replace(wall, depth=np.clip(noisy, 0, 6e4).astype(np.uint16)))
    assert max(map(abs, plane)) < 0.02
    tracker.clear()
    nothing = replace(wall, depth=np.zeros_like(wall.depth))
    assert fit(tracker, nothing)[0] == Plane()
