"""Readers of posed sequences, and what tells the formats apart."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from avd_player import PosedSequence, open_source
from avd_player.sources.seven_scenes import FRAME_PERIOD_NS, UP_FILE
from gridnav.rgbd import Camera, CameraMount, FrameError, FrameSource, Pose3D, readable_frames

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 1.5], [0, 0, 0, 1]])
"""From a world like a level camera's, 1.5 m above the floor."""


def write_seven_scenes(folder: Path, count: int = 3) -> NDArray[np.float64]:
    """Write frames that see nothing but a floor; return the first pose."""
    folder.mkdir()
    pose = Pose3D(0.5, 0.25, 1.0, 0.0, 0.1, 0.0, np.sqrt(0.99)).matrix()
    for index in range(count):
        stem = folder / f'frame-{index:06d}'
        color = np.full((12, 16, 3), 10 * index, np.uint8)
        Image.fromarray(color).save(f'{stem}.color.png')
        depth = np.full((12, 16), 1000 + index, np.uint16)
        depth[0] = 65535
        depth[1] = 0
        Image.fromarray(depth).save(f'{stem}.depth.png')
        np.savetxt(f'{stem}.pose.txt', pose)
    np.savetxt(folder / 'camera-intrinsics.txt', [[20, 0, 8], [0, 21, 6], [0, 0, 1]])
    np.savetxt(folder / UP_FILE, UP)
    return pose


def write_tum(folder: Path) -> None:
    """Write three images, of which the last has no pose near to it."""
    (folder / 'rgb').mkdir(parents=True)
    (folder / 'depth').mkdir()
    for name, shift in (('rgb', 0.0), ('depth', 0.012)):
        lines = ['# timestamp filename']
        for index in range(3):
            time = 1305031102.175304 + index / 10 + shift
            file = f'{name}/{time:.6f}.png'
            kind = (np.uint8, (8, 10, 3)) if name == 'rgb' else (np.uint16, (8, 10))
            value = 50 if name == 'rgb' else 5000 * (index + 1)
            Image.fromarray(np.full(kind[1], value, kind[0])).save(folder / file)
            lines.append(f'{time:.6f} {file}')
        (folder / f'{name}.txt').write_text('\n'.join(lines), encoding='utf-8')
    lines = ['# timestamp tx ty tz qx qy qz qw']
    lines += [
        f'{1305031102.17 + step / 100:.4f} {step} 0 1 -0.5 0.5 -0.5 0.5' for step in range(15)
    ]
    lines += ['1305031102.18 cut']
    (folder / 'groundtruth.txt').write_text('\n'.join(lines), encoding='utf-8')


def test_seven_scenes_frames(tmp_path: Path) -> None:
    """Pixels, invalid depth, intrinsics and poses as the files say."""
    pose = write_seven_scenes(tmp_path / 'seq')
    source = open_source(tmp_path / 'seq')
    protocol: FrameSource = source
    assert protocol.frame_names == ['frame-000000', 'frame-000001', 'frame-000002']
    assert source.camera == Camera(16, 12, 20.0, 21.0, 8.0, 6.0)
    frame = source.read('frame-000001')
    assert frame.stamp == FRAME_PERIOD_NS == source.stamp_of('frame-000001')
    assert (frame.color == 10).all()
    assert frame.depth.dtype == np.uint16
    assert (frame.depth[:2] == 0).all()
    assert (frame.depth[2:] == 1001).all()
    assert frame.mount == CameraMount()
    np.testing.assert_allclose(frame.camera_to_map(), UP @ pose, atol=1e-12)
    small = open_source(tmp_path / 'seq', width=8).read('frame-000002')
    assert small.color.shape == (6, 8, 3)
    assert small.depth.tolist() == [[0] * 8] + [[1002] * 8] * 5


def test_tum_frames(tmp_path: Path) -> None:
    """What belongs together is nearest in time; depth is in metres, nothing is too far away."""
    write_tum(tmp_path / 'desk')
    source = open_source(tmp_path / 'desk')
    assert len(source.frame_names) == 2
    frames = list(readable_frames(source, []))
    assert frames[0].stamp == 1305031102175304000
    assert frames[0].depth.dtype == np.float32
    assert [float(frame.depth[0, 0]) for frame in frames] == [1.0, 2.0]
    assert source.camera == Camera(10, 8, 525.0, 525.0, 319.5, 239.5)
    # The camera looks along the world's +x; what it sees is no floor, so that the lowest is.
    apart = np.subtract(frames[1].pose[:3], frames[0].pose[:3])
    assert np.linalg.norm(apart) == pytest.approx(9 + 0, abs=1.01)


def test_the_kitchen_is_levelled_by_its_floor(kitchen: Path, tmp_path: Path) -> None:
    """Without the given transform the floor is found where that says it is."""
    given = open_source(kitchen)
    assert isinstance(given, PosedSequence)
    assert len(given.frame_names) == 40
    for path in kitchen.iterdir():
        if path.name != UP_FILE:
            (tmp_path / path.name).symlink_to(path)
    found = open_source(tmp_path)
    assert isinstance(found, PosedSequence)
    cosine = found.up_from_world[2, :3] @ given.up_from_world[2, :3]
    assert np.degrees(np.arccos(cosine)) < 1
    one, other = (
        np.array([source.camera_to_map(name)[2, 3] for name in source.frame_names])
        for source in (given, found)
    )
    assert one.mean() == pytest.approx(1.416, abs=0.01)
    assert np.abs(one - other).max() < 0.03
    frame = given.read('frame-000400')
    assert frame.color.shape == (480, 640, 3)
    assert 0.8 < np.median(frame.depth[frame.depth > 0]) / 1000 < 4


def test_broken_frames_are_named_and_the_rest_is_read(tmp_path: Path) -> None:
    """Each is one sentence with the name of the file."""
    folder = tmp_path / 'seq'
    write_seven_scenes(folder, 8)
    (folder / 'frame-000000.pose.txt').write_text('1 2 3', encoding='utf-8')
    (folder / 'frame-000001.pose.txt').write_text('nan ' * 16, encoding='utf-8')
    (folder / 'frame-000002.pose.txt').write_text('lost', encoding='utf-8')
    np.savetxt(folder / 'frame-000003.pose.txt', 2 * np.eye(4))
    (folder / 'frame-000004.color.png').write_bytes(b'')
    Image.fromarray(np.ones((2, 2), np.uint16)).save(folder / 'frame-000005.depth.png')
    (folder / 'frame-000006.depth.png').unlink()
    source = open_source(folder)
    skipped: list[str] = []
    assert [frame.name for frame in readable_frames(source, skipped)] == ['frame-000007']
    for sentence, start in zip(
        skipped,
        [
            'frame-000000.pose.txt does not hold 4 x 4',
            'frame-000001.pose.txt does not hold 4 x 4',
            'frame-000002.pose.txt is no table of numbers',
            'frame-000003.pose.txt holds no pose',
            'frame-000004.color.png is cut or broken',
            'frame-000005.depth.png is 2 x 2 pixels, expected 16 x 12',
        ],
        strict=True,
    ):
        assert sentence.startswith(start)
        assert '\n' not in sentence
    with pytest.raises(FrameError, match="has no frame 'x'"):
        source.read('x')


def test_sequences_that_can_not_be_used_are_named(tmp_path: Path) -> None:
    """One sentence says what is missing."""
    folder = tmp_path / 'seq'
    write_seven_scenes(folder, 1)
    (folder / 'camera-intrinsics.txt').write_text('0 0 1\n0 0 1\n0 0 1', encoding='utf-8')
    with pytest.raises(FrameError, match='focal lengths 0 and 0'):
        open_source(folder)
    (folder / 'camera-intrinsics.txt').unlink()
    assert open_source(folder).camera.fx == 585.0
    (folder / 'frame-000000.depth.png').unlink()
    with pytest.raises(FrameError, match='seq has no frames with colour, depth and pose'):
        open_source(folder)

    desk = tmp_path / 'desk'
    write_tum(desk)
    (desk / 'groundtruth.txt').write_text('# none\n', encoding='utf-8')
    with pytest.raises(FrameError, match=r'groundtruth.txt lists nothing: expected lines of a'):
        open_source(desk)
    lines = '1305031102.17 0 0 0 0 0 0 0\n1305031102.27 0 0 0 0 0 0 1\n'
    (desk / 'groundtruth.txt').write_text(lines, encoding='utf-8')
    source = open_source(desk)
    with pytest.raises(FrameError, match=r'The pose of rgb/1305031102.175304.png in ground'):
        source.read(source.frame_names[0])
    (desk / 'groundtruth.txt').write_text(lines.splitlines()[0], encoding='utf-8')
    source = open_source(desk)
    with pytest.raises(FrameError, match='desk has no frame with depth and pose that can be read'):
        source.read(source.frame_names[0])
    (desk / 'groundtruth.txt').unlink()
    with pytest.raises(FrameError, match=r'groundtruth.txt is missing'):
        open_source(desk)


def test_the_format_is_found_or_all_are_named(tmp_path: Path) -> None:
    """A folder that holds nothing of the kind, one of scenes, and none at all."""
    with pytest.raises(FrameError, match=r"'nowhere' is no folder"):
        open_source('nowhere')
    with pytest.raises(FrameError, match=r'expected jpg_rgb, .* \(7-Scenes\), or .* \(TUM\)'):
        open_source(tmp_path)
    for number in (1, 2):
        (tmp_path / f'Home_00{number}_1' / 'jpg_rgb').mkdir(parents=True)
    with pytest.raises(FrameError, match=r'holds 2 scenes: name one of them, such as .*001_1'):
        open_source(tmp_path)
    shutil.rmtree(tmp_path / 'Home_002_1')
    with pytest.raises(FrameError, match=r'Home_001_1 can not be used: image_structs.mat is'):
        open_source(tmp_path / 'Home_001_1')
