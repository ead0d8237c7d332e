"""Points from depth images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bev_mapper.room import render, walk
from bev_mapper.unprojection import depth_in_metres, depth_noise, smooth, thin, unproject
from gridnav.rgbd import Camera, CameraMount, Pose3D, RgbdFrame

CAMERA = Camera(64, 48, 60.0, 57.0, 30.25, 24.5)


def frame_of(depth: np.ndarray) -> RgbdFrame:
    """Return a frame with any depth, seen from anywhere."""
    pose = Pose3D(1.0, -2.0, 0.1, *(np.array([0.1, -0.2, 0.3, 0.9]) / np.sqrt(0.95)).tolist())
    color = np.zeros((*depth.shape, 3), dtype=np.uint8)
    mount = CameraMount(0.1, 0.02, 1.3, 0.02, 0.4, -0.1)
    return RgbdFrame('a frame', 5, color, depth, CAMERA, pose, mount)


@pytest.mark.parametrize('kind', [np.uint16, np.float32])
def test_points_are_those_of_open3d(kind: type) -> None:
    """To a tenth of a millimetre, at any pose."""
    open3d = pytest.importorskip('open3d', reason='open3d is not installed', exc_type=ImportError)
    depth = np.random.default_rng(0).uniform(0.5, 5.0, (48, 64))
    frame = frame_of((depth * (1000 if kind is np.uint16 else 1)).astype(kind))
    points = unproject(depth_in_metres(frame.depth), CAMERA, frame.camera_to_map())
    theirs = open3d.geometry.PointCloud.create_from_depth_image(
        open3d.geometry.Image(frame.depth),
        open3d.camera.PinholeCameraIntrinsic(*CAMERA),
        np.linalg.inv(frame.camera_to_map()),
        depth_scale=1000.0 if kind is np.uint16 else 1.0,
        depth_trunc=100.0,
    )
    assert np.abs(points.reshape(3, -1).T - np.asarray(theirs.points)).max() < 1e-4


def test_what_was_not_measured_is_dropped() -> None:
    """Whatever a camera writes there."""
    millimetres = np.array([[0, 65535, 2000]], dtype=np.uint16)
    assert depth_in_metres(millimetres).tolist() == [[0.0, 0.0, 2.0]]
    metres = np.array([[np.nan, np.inf, -np.inf, -1.0, 0.0, 1.5]], dtype=np.float32)
    assert depth_in_metres(metres).tolist() == [[0.0, 0.0, 0.0, 0.0, 0.0, 1.5]]


@pytest.mark.parametrize('size', [(640, 480), (333, 257), (20, 10)])
def test_a_thinned_frame_has_points_of_the_whole_one(size: tuple[int, int]) -> None:
    """At most as many as are asked for, with their own colours and labels."""
    width, height = size
    frame = render(
        Camera(width, height, width * 0.8, width * 0.8, width / 2, height / 2), Pose3D()
    )
    some = thin(frame, 10_000)
    assert some.depth.size <= max(10_000, 1.1 * width * height / 4) or some is frame
    assert some.camera[:2] == some.depth.shape[::-1]

    def rows(of: RgbdFrame) -> set[tuple[float, ...]]:
        points = unproject(depth_in_metres(of.depth), of.camera, of.camera_to_map())
        assert of.labels is not None
        columns = [*points, of.labels, *np.moveaxis(of.color, 2, 0)]
        return set(zip(*(np.round(c.ravel(), 6).tolist() for c in columns), strict=True))

    assert rows(some) <= rows(frame)


def test_a_small_frame_is_left_alone() -> None:
    """Nothing is copied."""
    frame = frame_of(np.ones((48, 64), dtype=np.float32))
    assert thin(frame, 48 * 64) is frame
    assert thin(replace(frame, labels=None), 100).labels is None


@pytest.mark.parametrize('sigma', [0.001, 0.01, 0.03, 0.1])
def test_noise_is_measured_and_smoothed(sigma: float) -> None:
    """To a tenth of its size; what is left of much noise is a quarter at most."""
    camera = Camera(320, 240, 250.0, 250.0, 160.0, 120.0)
    true = depth_in_metres(render(camera, walk(3, 12)).depth)
    assert depth_noise(true) < 0.001
    rng = np.random.default_rng(0)
    noisy = true + np.float32(sigma) * rng.standard_normal(true.shape, np.float32)
    noisy[rng.random(true.shape) < 0.02] = 0.0
    noise = depth_noise(noisy)
    assert noise == pytest.approx(sigma, rel=0.1)
    found = smooth(noisy, noise)
    measured = noisy > 0
    assert not found[~measured].any()
    left = np.median(np.abs(found - true)[measured & (true > 0)]) * 1.4826
    assert left < {0.001: 0.0011, 0.01: 0.005}.get(sigma, 0.25 * sigma)


def test_smoothing_keeps_edges_and_quiet_images() -> None:
    """No pixel lands between what is near and what is far."""
    depth = np.full((48, 64), 3.0, dtype=np.float32)
    depth[10:40, 20:50] = 1.0
    assert smooth(depth, 0.001) is depth
    assert set(np.unique(smooth(depth, 0.1))) == {1.0, 3.0}
    assert depth_noise(np.zeros((48, 64), dtype=np.float32)) == 0.0
