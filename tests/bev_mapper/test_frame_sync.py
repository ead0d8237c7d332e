"""Bringing messages together."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bev_mapper.frame_sync import FrameSync, SyncConfig
from gridnav.rgbd import Camera, CameraMount, Pose3D

CAMERA = Camera(4, 3, 2.0, 2.0, 1.5, 1.0)
SECOND = 1_000_000_000
KINDS = ('color', 'depth', 'camera', 'pose')


def make_sync(mount: CameraMount | None = CameraMount(), **config: int) -> FrameSync:  # noqa: B008
    """Return an empty one."""
    return FrameSync(SyncConfig(**config), mount)


def add(sync: FrameSync, kind: str, stamp: int, now: int = 0) -> list[int]:
    """Add a part that carries its stamp, and return the stamps of the frames it completed."""
    if kind == 'color':
        sync.add_color(stamp, np.full((3, 4, 3), stamp % 256, dtype=np.uint8))
    elif kind == 'depth':
        sync.add_depth(stamp, np.full((3, 4), stamp % 65536, dtype=np.uint16), now)
    elif kind == 'camera':
        sync.add_camera(stamp, CAMERA._replace(fx=float(stamp)))
    else:
        sync.add_pose(stamp, Pose3D(x=float(stamp)))
    frames = sync.ready()
    for frame in frames:
        assert frame.depth[0, 0] == frame.stamp % 65536
        if not sync.config.image_slop:
            assert frame.color[0, 0, 0] == frame.stamp % 256
            assert (frame.camera.fx, frame.pose.x) == (frame.stamp, frame.stamp)
    return [frame.stamp for frame in frames]


@settings(deadline=None, max_examples=60)
@given(order=st.lists(st.sampled_from(KINDS * 6), max_size=0) | st.permutations(KINDS * 6))
def test_each_frame_comes_once_whatever_comes_first(order: list[str]) -> None:
    """Each kind of message in its own order, and they in any."""
    sync, count, frames = make_sync(), dict.fromkeys(KINDS, 0), []
    for kind in order:
        count[kind] += 1
        frames += add(sync, kind, count[kind])
    assert frames == list(range(1, count['depth'] + 1))
    assert not sync.counts


@pytest.mark.parametrize('kind', KINDS)
def test_what_lacks_a_part_is_dropped_and_counted(kind: str) -> None:
    """As soon as a later frame is complete."""
    sync = make_sync(pose_slop=0)
    frames = []
    for stamp in (1, 2, 3):
        for part in KINDS:
            if (part, stamp) != (kind, 2):
                frames += add(sync, part, stamp)
    assert frames == [1, 3]
    names = {'color': 'colour image', 'camera': 'camera_info', 'pose': 'pose'}
    if kind == 'depth':
        expected = {'dropped: colour image without depth': 1}
        expected['dropped: camera_info without depth'] = 1
        assert sync.counts == expected
    else:
        assert sync.counts[f'dropped: depth without {names[kind]}'] == 1


def test_near_stamps_meet_where_that_is_asked_for() -> None:
    """The nearest one, once it is certain that no nearer one comes."""
    sync = make_sync(image_slop=30)
    for stamp in (980, 1020, 1300):
        assert add(sync, 'color', stamp) == []
    add(sync, 'camera', 1000)
    add(sync, 'pose', 1000)
    assert add(sync, 'depth', 1000) == [1000]
    assert sync.counts == {}
    add(sync, 'depth', 1200)
    add(sync, 'camera', 1200)
    assert add(sync, 'pose', 1200) == []
    add(sync, 'depth', 1320)
    add(sync, 'camera', 1320)
    # Color 1300 is the nearest so far; the next one settles it.
    assert add(sync, 'pose', 1320) == []
    assert add(sync, 'color', 1400) == [1320]
    assert sync.counts == {
        'dropped: depth without colour image': 1,
        'dropped: camera_info without depth': 1,
        'dropped: colour image without depth': 1,
    }


def test_a_pose_is_taken_between_two_and_never_made_up() -> None:
    """Not before the first, not after the last, not in a gap."""
    sync = make_sync(pose_slop=100)
    for stamp in (1000, 1060, 1500):
        for kind in ('color', 'camera', 'depth'):
            assert add(sync, kind, stamp) == []
    quarter = math.pi / 2
    sync.add_pose(1020, Pose3D(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert sync.ready() == []
    sync.add_pose(
        1100, Pose3D(2.0, 4.0, 0.0, 0.0, 0.0, -math.sin(quarter / 2), -math.cos(quarter / 2))
    )
    [frame] = sync.ready()
    assert frame.stamp == 1060
    assert frame.pose[:3] == pytest.approx((1.5, 2.0, 0.0))
    turn = frame.pose.matrix()[:2, 0]
    assert math.atan2(turn[1], turn[0]) == pytest.approx(quarter / 2)
    sync.add_pose(1601, Pose3D())
    assert sync.ready() == []


def test_what_waits_too_long_is_given_up_with_a_sentence() -> None:
    """A pose or a transform that never comes is not replaced by one that does not turn."""
    sync = make_sync(None, wait=SECOND)
    for kind in ('color', 'camera', 'depth'):
        add(sync, kind, 5 * SECOND, now=100)
    assert sync.expire(SECOND + 100) == []
    [sentence] = sync.expire(SECOND + 101)
    assert sentence == 'The depth image of 5.000 s waited 1 s for its pose and is left out.'
    for kind in KINDS:
        assert add(sync, kind, 6 * SECOND, now=0) == []
    [sentence] = sync.expire(2 * SECOND)
    assert 'waited 1 s for its camera transform' in sentence
    for kind in KINDS:
        assert add(sync, kind, 7 * SECOND, now=0) == []
    sync.mount = CameraMount()
    assert [frame.stamp for frame in sync.ready()] == [7 * SECOND]
    assert sync.counts['dropped: depth without pose'] == 1
    assert sync.counts['dropped: depth without camera transform'] == 1


def test_what_waits_is_bounded() -> None:
    """The oldest goes, and is counted."""
    sync = make_sync(kept=5)
    for stamp in range(1, 9):
        add(sync, 'depth', stamp)
        add(sync, 'color', 100 + stamp)
        add(sync, 'camera', 100 + stamp)
    assert sync.counts == {
        'dropped: depth without colour image': 3,
        'dropped: colour image without depth': 3,
        'dropped: camera_info without depth': 3,
    }
    sync.clear()
    for kind in KINDS[:3]:
        assert add(sync, kind, 8) == []
    assert add(sync, 'pose', 8) == [8]
