"""The bounded cloud."""

from __future__ import annotations

from collections import Counter, defaultdict

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bev_mapper.voxel_cloud import VoxelCloud
from gridnav.rgbd import UNLABELLED


def some_points(
    rng: np.random.Generator, number: int, extent: float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions, colours and labels."""
    labels = rng.choice([0, 1, 7, 12, UNLABELLED], number).astype(np.uint8)
    colors = rng.integers(0, 256, (number, 3), dtype=np.uint8)
    return rng.uniform(-extent, extent, (3, number)), colors, labels


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 1000),
    counts=st.lists(st.integers(0, 400), min_size=1, max_size=4),
    voxel=st.sampled_from([0.04, 0.25, 3.0]),
)
def test_it_holds_means_and_most_frequent_labels(
    seed: int, counts: list[int], voxel: float
) -> None:
    """Held against dictionaries of points."""
    rng = np.random.default_rng(seed)
    cloud = VoxelCloud(voxel, 5000)
    members = defaultdict(list)
    for count in counts:
        positions, colors, labels = some_points(rng, count)
        cloud.merge(positions, colors, labels)
        for place, color, label in zip(positions.T, colors, labels.tolist(), strict=True):
            members[tuple(np.floor(place / voxel).astype(int).tolist())].append(
                (*place, *color, label)
            )
    points = cloud.points()
    assert len(cloud) == len(points.labels) == len(members)
    assert cloud.dropped == 0
    for position, color, label in zip(points.positions, points.colors, points.labels, strict=True):
        inside = np.array(members[tuple(np.floor(position / voxel).astype(int).tolist())])
        assert np.allclose(position, inside[:, :3].mean(axis=0))
        assert np.abs(color - inside[:, 3:6].mean(axis=0)).max() <= 0.51
        votes = Counter(inside[:, 6].astype(int).tolist())
        assert votes[int(label)] == max(votes.values())


def test_it_is_bounded_and_drops_what_was_not_seen_for_longest() -> None:
    """The present frame stays, what was dropped is counted."""
    rng = np.random.default_rng(0)
    cloud = VoxelCloud(0.1, 1000)
    for number in range(30):
        positions, colors, labels = some_points(rng, 300, extent=0.4)
        positions[0] += number
        cloud.merge(positions, colors, labels)
        assert len(cloud) <= 1000
        places = set(map(tuple, np.floor(cloud.points().positions / 0.1).astype(int).tolist()))
        assert set(map(tuple, np.floor(positions.T / 0.1).astype(int).tolist())) <= places
    assert cloud.points().positions[:, 0].min() > 20
    assert cloud.dropped > 5000 - 1000
    positions, colors, labels = some_points(rng, 5000, extent=5.0)
    cloud.merge(positions, colors, labels)
    assert len(cloud) == 1000
    cloud.clear()
    assert (len(cloud), cloud.dropped, len(cloud.points().labels)) == (0, 0, 0)


def test_what_is_seen_again_stays() -> None:
    """Age counts from the last time, not the first."""
    rng = np.random.default_rng(0)
    cloud = VoxelCloud(0.1, 500)
    always, colors, labels = some_points(rng, 100, extent=0.3)
    for number in range(1, 20):
        passing, _, _ = some_points(rng, 100, extent=0.3)
        passing[0] += number
        both = np.concatenate([always, passing], axis=1)
        cloud.merge(both, np.tile(colors, (2, 1)), np.tile(labels, 2))
    places = set(map(tuple, np.floor(cloud.points().positions / 0.1).astype(int).tolist()))
    assert set(map(tuple, np.floor(always.T / 0.1).astype(int).tolist())) <= places


def test_new_labels_replace_votes() -> None:
    """And later votes count on."""
    cloud = VoxelCloud(1.0, 100)
    place, color = np.array([[0.5], [0.5], [0.5]]), np.zeros((1, 3), dtype=np.uint8)
    for _ in range(3):
        cloud.merge(place, color, np.array([7], dtype=np.uint8))
    cloud.relabel(np.array([1], dtype=np.uint8))
    assert cloud.points().labels.tolist() == [1]
    for expected in (1, 1, 1, 7):
        cloud.merge(place, color, np.array([7], dtype=np.uint8))
        assert cloud.points().labels.tolist() == [expected]
    cloud.relabel(np.array([UNLABELLED], dtype=np.uint8))
    assert cloud.points().labels.tolist() == [UNLABELLED]
