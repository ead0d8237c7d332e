"""The reader of scenes, against the truth of a scene that was rendered."""

from __future__ import annotations

import json
import math
import os
import shutil
import time
import warnings
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image
from tests.avd_player.tiny_scene import (
    LENS,
    ROOM,
    SCALE,
    TinyScene,
    render,
    write_scene,
    write_structs,
)

from avd_player import AvdSource, open_source
from avd_player.avd_format import (
    ANNOTATIONS,
    CAMERAS,
    COLOR_FOLDER,
    DEFAULT_LENS,
    DEPTH_FOLDER,
    STRUCTS,
    depth_name,
    read_instance_ids,
)
from avd_player.distortion import Lens, Straightener
from avd_player.floor import align_to_grid, down_of, fit_floor
from gridnav.rgbd import (
    CLASSES,
    UNLABELLED,
    Camera,
    CameraMount,
    FrameError,
    RgbdFrame,
    readable_frames,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray


def world_points(frame: RgbdFrame, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unproject a frame with a transform of its optical frame, (N, 3)."""
    camera = frame.camera
    v, u = np.nonzero(frame.depth)
    z = frame.depth[v, u] / 1000
    rays = np.column_stack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, z / z))
    points: NDArray[np.float64] = (rays * z[:, None]) @ matrix[:3, :3].T + matrix[:3, 3]
    return points


def open_quietly(folder: Path, width: int = 0) -> AvdSource:
    """Open a damaged scene, whose warnings don't matter here."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        source = open_source(folder, width)
        assert isinstance(source, AvdSource)
        _ = source.map_from_world
    return source


def test_lens_bends_rays_as_the_data_set_says() -> None:
    """The fisheye polynomial at one ray, and back over the whole picture."""
    x, y = 0.5, -0.25
    r = math.hypot(x, y)
    theta = math.atan(r)
    _, _, fx, fy, cx, cy, k1, k2, k3, k4 = DEFAULT_LENS
    bent = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8)
    expected = fx * bent * x / r + cx, fy * bent * y / r + cy
    assert DEFAULT_LENS.project(np.array([x, y])) == pytest.approx(expected)
    points = np.stack(np.meshgrid(np.arange(0.5, 1920, 37), np.arange(0.5, 1080, 37)), axis=-1)
    back = DEFAULT_LENS.project(DEFAULT_LENS.unproject(points))
    np.testing.assert_allclose(back, points, atol=1e-6)
    # So near to a pinhole that a reader without distortion would hardly be noticed.
    pinhole = DEFAULT_LENS.unproject(points) * (fx, fy) + (cx, cy)
    assert 4 < np.abs(pinhole - points).max() < 8


def test_straight_pictures_are_bilinear_in_colour_and_nearest_in_depth() -> None:
    """Against the formula, pixel by pixel, with a lens that bends a lot."""
    lens = DEFAULT_LENS.resized(160, 120)
    rng = np.random.default_rng(0)
    coarse = Image.fromarray(rng.integers(0, 255, (12, 16, 3), dtype=np.uint8))
    picture = coarse.resize((160, 120), Image.Resampling.BICUBIC)
    depth = rng.integers(1, 60_000, (120, 160), dtype=np.uint16)
    camera = Camera(150, 130, 80.0, 110.0, 70.0, 60.0)
    straight = Straightener(lens, camera)

    u, v = np.meshgrid(np.arange(150), np.arange(130))
    rays = np.dstack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy))
    source = lens.project(rays)
    column, row = np.floor(source[..., 0]).astype(int), np.floor(source[..., 1]).astype(int)
    inside = (column >= 0) & (column < 160) & (row >= 0) & (row < 120)
    assert inside.any()
    assert not inside.all()
    expected = np.where(inside, depth[row.clip(0, 119), column.clip(0, 159)], 0)
    np.testing.assert_array_equal(straight.values(depth), expected)
    assert (straight.values(depth.astype(np.uint8), 255)[~inside] == 255).all()

    x, y = source[..., 0] - 0.5, source[..., 1] - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    well_inside = (left >= 0) & (left < 159) & (top >= 0) & (top < 119)
    pixels = np.asarray(picture).astype(float)
    a, b = (x - left)[..., None], (y - top)[..., None]
    left, top = left.clip(0, 158), top.clip(0, 118)
    bilinear = (1 - b) * ((1 - a) * pixels[top, left] + a * pixels[top, left + 1]) + b * (
        (1 - a) * pixels[top + 1, left] + a * pixels[top + 1, left + 1]
    )
    difference = np.abs(straight.color(picture) - bilinear)[well_inside]
    assert np.percentile(difference, 99) <= 2
    assert difference.max() <= 8


def test_frames_agree_with_the_truth(tiny: TinyScene) -> None:
    """Points, poses and labels; registered or not, whatever way the world is turned."""
    source = open_source(tiny.folder)
    assert isinstance(source, AvdSource)
    assert source.name == 'Home_001_1'
    assert list(source.frame_names) == tiny.names
    truth_to_map = source.map_from_world @ tiny.world_from_truth
    # The map's axes are those of the positions' grid, its origin is on it, and z is up.
    np.testing.assert_allclose(truth_to_map[:3, :3], np.eye(3), atol=2e-3)
    np.testing.assert_allclose(
        np.round(truth_to_map[:2, 3] / 0.3) * 0.3, truth_to_map[:2, 3], atol=5e-3
    )
    assert abs(truth_to_map[2, 3]) < 5e-3
    assert source.mount.z == pytest.approx(1.1, abs=5e-3)
    assert source.mount.pitch == pytest.approx(0.2, abs=2e-3)
    low, high = truth_to_map[:3, :3] @ ROOM[0], truth_to_map[:3, :3] @ ROOM[1]
    for name in tiny.names[5:25:4]:
        frame = source.read(name)
        expected = truth_to_map @ tiny.camera_to_truth[name]
        np.testing.assert_allclose(frame.camera_to_map(), expected, atol=1e-9)
        np.testing.assert_allclose(source.camera_to_map(name), expected, atol=1e-9)
        assert frame.pose.z == frame.pose.qx == frame.pose.qy == 0
        assert frame.color.shape == (108, 192, 3)
        assert frame.depth.dtype == np.uint16
        points = world_points(frame, expected) - truth_to_map[:3, 3]
        off = np.minimum(np.abs(points - low), np.abs(points - high)).min(axis=1)
        # All but the bottle lies on a wall, the floor or the ceiling; a pixel is 2 cm wide.
        assert np.median(off) < 6e-3
        assert np.percentile(off, 95) < 2e-2
        assert frame.labels is not None
        assert set(np.unique(frame.labels)) <= {*range(len(CLASSES)), UNLABELLED}
        v, u = np.nonzero(frame.depth)
        on_floor = frame.labels[v, u] == CLASSES.index('floor')
        assert np.abs(points[on_floor, 2] - low[2]).max() < 3e-2
    stamps = [source.read(name).stamp for name in tiny.names[:3]]
    assert stamps == sorted(set(stamps))


def test_colour_is_where_depth_is(tiny: TinyScene) -> None:
    """The straightened colour is what a pinhole camera would have seen."""
    source = open_source(tiny.folder)
    frame = source.read(tiny.names[0])
    color, _, _ = render(tiny.camera_to_truth[tiny.names[0]])
    # Straightened by hand: each pixel's ray, looked up in the lens's own picture.
    u, v = np.meshgrid(np.arange(192), np.arange(108))
    camera = frame.camera
    rays = np.dstack(((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy))
    column, row = np.floor(LENS.project(rays)).astype(int).transpose(2, 0, 1)
    inside = (column > 0) & (column < 191) & (row > 0) & (row < 107)
    expected = color[row.clip(0, 107), column.clip(0, 191)]
    difference = np.abs(frame.color.astype(int) - expected).max(axis=-1)[inside]
    assert np.median(difference) < 8
    assert (frame.color[~inside & (frame.depth == 0)].max(axis=-1) < 250).all()


def test_frames_of_another_width(tiny: TinyScene) -> None:
    """Colour, depth and labels shrink with the camera."""
    source = open_source(tiny.folder, width=96)
    frame = source.read(tiny.names[0])
    assert frame.camera == pytest.approx(LENS.camera().resized(96, 54))
    assert frame.color.shape == (54, 96, 3)
    assert frame.depth.shape == (54, 96)
    assert frame.labels is not None
    assert frame.labels.shape == (54, 96)
    full = open_source(tiny.folder).read(tiny.names[0])
    one, other = world_points(frame, np.eye(4)), world_points(full, np.eye(4))
    np.testing.assert_allclose(one.mean(axis=0), other.mean(axis=0), atol=0.05)


def test_pitch_and_jitter_are_found(tmp_path: Path) -> None:
    """A camera that looks up, positions off the grid, two images registered at each."""
    mount = CameraMount(z=0.6, pitch=-0.05)
    unregistered = tuple(index for index in range(36) if index % 12 not in (0, 4))
    scene = write_scene(
        tmp_path / 'Home_002_1',
        cells=[(0, 0), (1, 0), (2, 0)],
        mount=mount,
        unregistered=unregistered,
        jitter=0.01,
    )
    source = open_quietly(scene.folder)
    assert source.mount.z == pytest.approx(0.6, abs=0.01)
    assert source.mount.pitch == pytest.approx(-0.05, abs=5e-3)
    truth_to_map = source.map_from_world @ scene.world_from_truth
    for name in scene.names[:24:5]:
        expected = truth_to_map @ scene.camera_to_truth[name]
        np.testing.assert_allclose(source.camera_to_map(name), expected, atol=0.02)


def test_large_scenes_open_at_once(tmp_path: Path, tiny: TinyScene) -> None:
    """A scene with 2,000 frames opens within a second; of one image the size is read."""
    folder = tmp_path / 'Home_003_1'
    (folder / COLOR_FOLDER).mkdir(parents=True)
    (folder / DEPTH_FOLDER).mkdir()
    large = TinyScene(folder, world_from_truth=tiny.world_from_truth)
    entries = {}
    for index in range(2004):
        name = f'00031{index + 1:06d}0101.jpg'
        large.names.append(name)
        large.camera_to_truth[name] = tiny.camera_to_truth[tiny.names[index % 72]]
        if index:
            os.mkfifo(folder / COLOR_FOLDER / name)
        else:
            shutil.copy(tiny.folder / COLOR_FOLDER / tiny.names[0], folder / COLOR_FOLDER / name)
        (folder / DEPTH_FOLDER / depth_name(name)).touch()
        entries[name] = {'bounding_boxes': [[1, 2, 3, 4, 5, 1]], 'forward': name}
    (folder / ANNOTATIONS).write_text(json.dumps(entries), encoding='utf-8')
    write_structs(large)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        began = time.process_time()
        source = AvdSource(folder)
        elapsed = time.process_time() - began
    assert len(source.frame_names) == 2004
    assert elapsed < 1.0


def test_missing_cameras_are_warned_of_once(tmp_path: Path, tiny: TinyScene) -> None:
    """The default lens, at the size of the images."""
    scene = write_scene(tmp_path / 'Home_004_1', cells=[(0, 0)], cameras=False)
    with pytest.warns(UserWarning, match=r'Home_004_1: cameras.txt is missing: the lens of') as w:
        source = AvdSource(scene.folder)
    assert len(w) == 1
    assert source.camera == pytest.approx(open_source(tiny.folder).camera)


def test_lenses_as_colmap_writes_them(damaged: Callable[[], Path]) -> None:
    """A pinhole is a lens, too; what is none is named and the default one is taken."""
    folder = damaged()
    path = folder / CAMERAS
    path.write_text('# c\n1 PINHOLE 192 108 100 101 96 54\n', encoding='utf-8')
    assert AvdSource(folder).lens == Lens(192, 108, 100.0, 101.0, 96.0, 54.0)
    for text, reason in (
        ('1 OPENCV_FISHEYE 192 108 100', 'no line of an OPENCV_FISHEYE or PINHOLE camera'),
        ('1 OPENCV_FISHEYE 192 108 a b c d 0 0 0 0', 'no line of'),
        ('', 'no line of'),
        ('1 PINHOLE 192 108 0 101 96 54', 'a camera that can not be'),
        ('1 PINHOLE 192 108 nan 101 96 54', 'a camera that can not be'),
    ):
        path.write_text(text, encoding='utf-8')
        with pytest.warns(UserWarning, match=reason):
            source = AvdSource(folder)
        assert source.lens == pytest.approx(DEFAULT_LENS.resized(192, 108))


def test_broken_images_are_named_and_the_rest_is_read(damaged: Callable[[], Path]) -> None:
    """Each is one sentence with the name of the file."""
    folder = damaged()
    names = sorted(path.name for path in (folder / COLOR_FOLDER).iterdir())
    cut, empty, small, eight_bits, truncated, unlabelled = names[:6]
    for name in (cut, empty):
        path = folder / COLOR_FOLDER / name
        path.write_bytes(path.read_bytes()[: 900 if name == cut else 0])
    depth = folder / DEPTH_FOLDER
    Image.fromarray(np.ones((10, 20), np.uint16)).save(depth / depth_name(small))
    Image.fromarray(np.ones((108, 192), np.uint8)).save(depth / depth_name(eight_bits))
    path = depth / depth_name(truncated)
    path.write_bytes(path.read_bytes()[:500])
    Image.fromarray(np.ones((108, 192, 3), np.uint8)).save(
        folder / 'labels' / f'{unlabelled[:15]}.png'
    )
    source = AvdSource(folder)
    skipped: list[str] = []
    frames = [frame.name for frame in readable_frames(source, skipped)]
    assert frames == names[6:]
    for sentence, (file, reason) in zip(
        skipped,
        [
            (cut, 'is cut or broken'),
            (empty, 'is cut or broken'),
            (depth_name(small), 'is 20 x 10 pixels, expected 192 x 108'),
            (depth_name(eight_bits), 'no depth image of 16 bits'),
            (depth_name(truncated), 'is cut or broken'),
            (f'{unlabelled[:15]}.png', 'no image of labels'),
        ],
        strict=True,
    ):
        assert sentence.startswith(file)
        assert reason in sentence
        assert '\n' not in sentence
    with pytest.raises(FrameError, match=r"no image '1\.jpg' with a pose"):
        source.read('1.jpg')


def test_a_floor_that_few_pixels_show_is_found(tmp_path: Path) -> None:
    """A camera that looks up a little sees it in the corners of the room alone."""
    mount = CameraMount(z=1.1, pitch=-0.06)
    folder = write_scene(tmp_path / 'Home_001_1', mount=mount).folder
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        source = AvdSource(folder)
        assert source.mount.z == pytest.approx(1.1, abs=5e-3)


def test_without_depth_the_camera_is_taken_to_be_a_metre_up(damaged: Callable[[], Path]) -> None:
    """There is nothing to see the floor in."""
    folder = damaged()
    for path in (folder / DEPTH_FOLDER).iterdir():
        path.write_bytes(b'')
    source = AvdSource(folder)
    with pytest.warns(UserWarning, match='the camera is taken to be 1.00 m above it'):
        assert source.mount.z == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    ('damage', 'reason'),
    [
        (lambda path: path.unlink(), 'image_structs.mat is missing'),
        (lambda path: path.write_bytes(path.read_bytes()[:20_000]), 'is cut or broken'),
        (lambda path: path.write_bytes(b'MATLAB'), 'is cut or broken'),
    ],
)
def test_a_scene_without_poses_can_not_be_opened(
    damaged: Callable[[], Path], damage: Callable[[Path], object], reason: str
) -> None:
    """One sentence says why."""
    folder = damaged()
    damage(folder / STRUCTS)
    with pytest.raises(FrameError, match=reason) as error:
        AvdSource(folder)
    assert '\n' not in str(error.value)


def test_a_scene_without_scale_can_not_be_opened(tiny: TinyScene, tmp_path: Path) -> None:
    """Zero, as files have it that were not finished."""
    for scale in (0.0, -3.0, math.nan):
        folder = tmp_path / f'{scale}' / 'Home_001_1'
        (folder / COLOR_FOLDER).mkdir(parents=True)
        scene = TinyScene(folder, tiny.names, tiny.camera_to_truth, tiny.world_from_truth)
        write_structs(scene, scale=scale)
        with pytest.raises(FrameError, match=f'The scale in image_structs.mat is {scale:g}'):
            AvdSource(folder)
    assert SCALE > 0


def test_instances_come_from_the_map_beside_the_scene(damaged: Callable[[], Path]) -> None:
    """With or without a line for the background, and from the data set where there is none."""
    folder = damaged()
    assert read_instance_ids(folder)['coca_cola_glass_bottle'] == 5
    (folder.parent / 'instance_id_map.txt').write_text('mug 1\nspoon 2\n\n', encoding='utf-8')
    assert read_instance_ids(folder) == {'mug': 1, 'spoon': 2}


def test_floor_of_a_noisy_room_with_a_table() -> None:
    """Not the table, though more of it is seen; nor anything in a cloud without a level."""
    rng = np.random.default_rng(1)
    floor = np.column_stack((rng.uniform(-3, 3, (800, 2)), rng.normal(0, 0.01, 800)))
    table = np.column_stack((rng.uniform(0, 1, (3000, 2)), rng.normal(0.75, 0.01, 3000)))
    wall = np.column_stack((np.full(2000, 3.0), rng.uniform([-3, 0], [3, 2.4], (2000, 2))))
    below = rng.uniform([-3, -3, -2], [3, 3, 0], (40, 3))
    points = np.vstack([floor, table, wall, below]) + np.array([0, 0, 1.5])
    found = fit_floor(points, np.array([0.05, 0.02, -1.0]) / np.linalg.norm([0.05, 0.02, 1.0]))
    assert found is not None
    assert found.up[2] > math.cos(0.01)
    assert found.offset == pytest.approx(-1.5, abs=0.02)
    level = found.to_level() @ (0, 0, 1.5, 1)
    assert level[2] == pytest.approx(0.0, abs=0.02)
    assert fit_floor(rng.uniform(-5, 5, (200, 3)), np.array([0, 0, -1.0])) is None
    assert fit_floor(points[:2], np.array([0, 0, -1.0])) is None


def test_down_is_found_from_level_cameras() -> None:
    """However steeply they look, if they look around; else it is the mean of their own down."""
    mount = CameraMount(pitch=0.5).matrix()[:3, :3]
    yaws = np.arange(0, 2 * math.pi, 0.5)
    turns = [
        np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
        for a in yaws
    ]
    rotations = np.stack([(turn @ mount).T for turn in turns])
    np.testing.assert_allclose(down_of(rotations), (0, 0, -1), atol=1e-12)
    np.testing.assert_allclose(down_of(rotations[:1]), rotations[0, 1])


def test_positions_are_aligned_with_their_grid() -> None:
    """Turned by less than 45 degrees; positions on no grid are left as they are."""
    rng = np.random.default_rng(2)
    cells = np.array([(col, row) for col in range(6) for row in range(4)])
    yaw, offset = 0.6, np.array([0.11, -0.05])
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    positions = (cells * 0.3 + offset + rng.normal(0, 0.01, cells.shape)) @ turn.T
    found = align_to_grid(positions, 0.3)
    assert found.yaw == pytest.approx(-yaw, abs=0.02)
    cosine, sine = math.cos(found.yaw), math.sin(found.yaw)
    aligned = positions @ np.array([[cosine, sine], [-sine, cosine]]) + found.offset
    assert np.abs(aligned / 0.3 - np.rint(aligned / 0.3)).max() < 0.2
    assert np.abs(found.offset).max() <= 0.15
    anywhere = align_to_grid(np.array([[0.0, 0.0], [5.0, 7.0]]), 0.3)
    assert anywhere.yaw == 0
