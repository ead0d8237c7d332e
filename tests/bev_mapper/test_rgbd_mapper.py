"""From frames to maps, and episode by episode."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bev_mapper.frame_sync import SyncConfig
from bev_mapper.map_files import save_cloud, save_map
from bev_mapper.rgbd_fusion import RgbdFusion
from bev_mapper.rgbd_mapper import STAGES, MapperConfig, RgbdMapper
from bev_mapper.room import FURNITURE, MOUNT, ROOM, Box, chair, render, walk
from bev_mapper.segmentation import GroundTruthSegmenter
from gridnav.grid import GridGeometry
from gridnav.rgbd import CLASSES, Camera, Pose3D
from maze_sim.map_file import read_map

if TYPE_CHECKING:
    from pathlib import Path

    from bev_mapper.rgbd_mapper import Mode
    from gridnav.rgbd import RgbdFrame

CAMERA = Camera(240, 180, 170.0, 170.0, 119.5, 89.5)
FREE, WALL, UNKNOWN = 0, 100, -1
VIEWS = 18

GEOMETRY = GridGeometry(45, 45, 0.1, -2.25, -2.25)
"""The room's walls are in the middle of cells."""


@pytest.fixture(scope='module')
def frames() -> list[RgbdFrame]:
    """Return the frames of a walk through the room."""
    return [render(CAMERA, walk(number, VIEWS), number) for number in range(VIEWS)]


def true_plan(geometry: GridGeometry, things: tuple[Box, ...] = FURNITURE) -> np.ndarray:
    """Return which cells hold something, with a margin of nothing."""
    rows, cols = geometry.shape
    plan = np.zeros((rows, cols), dtype=np.bool_)
    y, x = (np.indices((rows, cols)) + 0.5) * geometry.resolution
    x, y = x + geometry.origin_x, y + geometry.origin_y
    for thing in things:
        reach = geometry.resolution / 2
        plan |= (
            (x > thing.low[0] - reach) & (x < thing.high[0] + reach)
            & (y > thing.low[1] - reach) & (y < thing.high[1] + reach)
        )  # fmt: skip
    plan |= (np.abs(x) > ROOM.high[0] - 0.01) | (np.abs(y) > ROOM.high[1] - 0.01)
    return plan


@pytest.mark.parametrize('mode', ['evidence', 'majority'])
@pytest.mark.parametrize('truth', [True, False])
def test_the_map_of_a_room_is_its_plan(
    frames: list[RgbdFrame], mode: Mode, *, truth: bool
) -> None:
    """Legs and tops of tables are obstacles, the floor around them is free."""
    segmenter = GroundTruthSegmenter() if truth else None
    mapper = RgbdMapper(MapperConfig(GEOMETRY, mode=mode), segmenter)
    for frame in frames:
        mapper.add(frame)
    plan, occupancy = true_plan(mapper.grid.geometry), mapper.grid.occupancy
    assert (occupancy == FREE)[~plan].sum() > 1800
    # Most points decide where a thing only touches a cell; evidence takes no such chance.
    assert (occupancy == FREE)[plan].sum() < (25 if mode == 'evidence' else 150)
    assert (occupancy == WALL)[~plan].mean() < 0.01
    assert mapper.segmenter == ('ground_truth' if truth else 'geometric')
    assert set(mapper.timings) == set(STAGES)
    assert mapper.frames == VIEWS
    assert len(mapper.cloud) > 10_000


def test_the_legs_of_a_chair_are_obstacles_by_themselves() -> None:
    """Without its seat and back, 3 cm thick, on a floor that all cells are full of."""
    legs = tuple(thing for thing in chair(0.6, -0.4) if thing.high[2] < 0.44)
    mapper = RgbdMapper()
    for number in range(12):
        pose = walk(number, 12)
        turn = np.arctan2(-0.4 - pose.y, 0.6 - pose.x)
        pose = pose._replace(qz=float(np.sin(turn / 2)), qw=float(np.cos(turn / 2)))
        mapper.add(render(CAMERA, pose, number, things=legs))
    for leg in legs:
        x, y = (leg.low[0] + leg.high[0]) / 2, (leg.low[1] + leg.high[1]) / 2
        assert mapper.grid.occupancy[mapper.grid.geometry.cell_at(x, y)] == WALL
    assert mapper.grid.occupancy[mapper.grid.geometry.cell_at(0.6, -0.4)] == FREE


def test_a_camera_that_sits_otherwise_than_is_said_gives_the_same_plan(
    frames: list[RgbdFrame],
) -> None:
    """Two degrees and four centimetres; without looking for the floor it is an obstacle."""
    said = MOUNT._replace(pitch=MOUNT.pitch - np.radians(2.0), z=MOUNT.z + 0.04)
    blocked = {}
    for fit_floor in (True, False):
        mapper = RgbdMapper(MapperConfig(GEOMETRY, fit_floor=fit_floor))
        for frame in frames:
            mapper.add(replace(frame, mount=said))
        plan = true_plan(mapper.grid.geometry)
        blocked[fit_floor] = int((mapper.grid.occupancy == WALL)[~plan].sum())
    assert blocked[True] < 80
    assert blocked[False] > 4 * blocked[True]


def test_only_a_robot_on_the_floor_has_a_footprint() -> None:
    """A camera that is carried has none."""
    blind = replace(render(CAMERA, Pose3D()), depth=np.zeros((180, 240), dtype=np.uint16))
    for height, free in ((0.0, True), (1.2, False)):
        mapper = RgbdMapper()
        mapper.add(replace(blind, pose=Pose3D(z=height)))
        assert (mapper.grid.occupancy == FREE).any() == free


def test_parts_of_unequal_size_are_refused() -> None:
    """One sentence, and nothing has changed."""
    mapper = RgbdMapper()
    frame = render(CAMERA, Pose3D(), 7)
    with pytest.raises(ValueError, match=r'frame 7 has .*: colour 180 x 240, depth 90 x 240'):
        mapper.add(replace(frame, depth=frame.depth[::2]))
    assert (mapper.frames, len(mapper.cloud)) == (0, 0)


class FloorEverywhere:
    """A model of whole clouds that knows one class."""

    name = 'floor everywhere'

    def cloud_labels(self, positions: np.ndarray, colors: np.ndarray) -> np.ndarray:
        """Call all of it floor."""
        assert positions.shape == colors.shape
        return np.full(len(positions), CLASSES.index('floor'), dtype=np.uint8)


@pytest.mark.parametrize('every', [0, 3])
def test_models_of_whole_clouds_label_it_at_times_or_at_the_end(
    frames: list[RgbdFrame], every: int
) -> None:
    """Until then the geometric labels count."""
    mapper = RgbdMapper(MapperConfig(relabel_every=every), FloorEverywhere())
    assert mapper.segmenter == 'floor everywhere'
    for number, frame in enumerate(frames[:3]):
        mapper.add(frame)
        labelled = every and number == 2
        assert bool((mapper.grid.occupancy == WALL).any()) == (not labelled)
    mapper.finish()
    assert not (mapper.grid.occupancy == WALL).any()
    assert (mapper.grid.occupancy == FREE).any()


def test_files_are_read_by_others(frames: list[RgbdFrame], tmp_path: Path) -> None:
    """The map by a map server's rules, the cloud by open3d."""
    mapper = RgbdMapper()
    for frame in frames[:4]:
        mapper.add(frame)
    save_map(tmp_path, mapper.grid.occupancy, mapper.grid.geometry)
    world = read_map(tmp_path / 'map.yaml')
    assert world.geometry == mapper.grid.geometry
    assert np.array_equal(world.blocked, mapper.grid.occupancy != FREE)
    cloud = mapper.cloud.points()
    save_cloud(tmp_path, cloud)
    content = (tmp_path / 'cloud.ply').read_bytes()
    assert f'element vertex {len(cloud.labels)}\n'.encode() in content
    open3d = pytest.importorskip('open3d', reason='open3d is not installed', exc_type=ImportError)
    read = open3d.t.io.read_point_cloud(str(tmp_path / 'cloud.ply'))
    assert np.allclose(read.point.positions.numpy(), cloud.positions, atol=1e-5)
    assert np.array_equal(read.point.colors.numpy(), cloud.colors)
    assert np.array_equal(read.point.label.numpy().ravel(), cloud.labels)


def make_fusion() -> RgbdFusion:
    """Return an empty one."""
    return RgbdFusion(RgbdMapper(), SyncConfig(), MOUNT)


def add(fusion: RgbdFusion, frame: RgbdFrame, stamp: int) -> int:
    """Add the parts of a frame at a stamp; returns how many frames were fused."""
    fused = fusion.add_color(stamp, frame.color)
    fused += fusion.add_depth(stamp, frame.depth, 0)
    fused += fusion.add_camera(stamp, frame.camera)
    return fused + fusion.add_pose(stamp, frame.pose)


def test_a_new_episode_starts_from_nothing_but_its_own_frames(frames: list[RgbdFrame]) -> None:
    """Those that came before the word of it are fused again, equal to the last bit."""
    fusion, alone = make_fusion(), make_fusion()
    for stamp, frame in enumerate(frames[:6], start=10):
        assert add(fusion, frame, stamp) == 1
        assert add(fusion, frame, stamp) == 0
    assert fusion.begin_episode(13) == 3
    assert fusion.begin_episode(13) == 0
    for stamp, frame in list(enumerate(frames[:6], start=10))[3:]:
        add(alone, frame, stamp)
    assert np.array_equal(fusion.mapper.grid.probability, alone.mapper.grid.probability)
    assert fusion.mapper.stamp == 15
    assert add(fusion, frames[0], 12) == 0
    assert fusion.counts['dropped: older than the episode'] == 4
    assert fusion.begin_episode(5) == 0
    assert fusion.mapper.frames == 0
    assert add(fusion, frames[0], 12) == 1
    fusion.clear()
    assert add(fusion, frames[0], 12) == 1


def test_when_time_goes_back_the_map_starts_again(frames: list[RgbdFrame]) -> None:
    """A bag that loops."""
    fusion = make_fusion()
    add(fusion, frames[0], 10_000_000_000)
    add(fusion, frames[1], 1)
    assert fusion.mapper.frames == 1
    assert fusion.counts['time went back'] == 1


def test_a_frame_that_can_not_be_used_is_named(frames: list[RgbdFrame]) -> None:
    """And the next one is fused."""
    fusion = make_fusion()
    bad = replace(frames[0], color=frames[0].color[:10])
    assert add(fusion, bad, 1) == 0
    [sentence] = fusion.refused
    assert 'unequal size' in sentence
    assert add(fusion, frames[0], 2) == 1
    fusion.add_depth(3, frames[0].depth, 0)
    fusion.expire(10_000_000_000)
    assert 'waited 5 s for its colour image' in fusion.refused[1]
