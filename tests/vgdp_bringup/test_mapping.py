"""``vgdp map`` on sequences of posed images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from bev_mapper.rgbd_mapper import RgbdMapper
from bev_mapper.room import MOUNT, render, walk
from gridnav.rgbd import Camera, CameraMount, Pose3D
from vgdp_bringup.cli import main
from vgdp_bringup.mapping import MapOptions, map_source

if TYPE_CHECKING:
    from gridnav.rgbd import RgbdFrame

pytest.importorskip('avd_player.sources', reason='there is no reader of sequences')

KITCHEN = Path(__file__).parents[3] / 'shared' / 'data' / 'redkitchen'
FREE, WALL = 0, 100


def write_sequence(folder: Path, frames: list[RgbdFrame]) -> Path:
    """Write frames as 7-Scenes has them."""
    folder.mkdir()
    camera = frames[0].camera
    intrinsics = np.diag([camera.fx, camera.fy, 1.0])
    intrinsics[:2, 2] = camera.cx, camera.cy
    np.savetxt(folder / 'camera-intrinsics.txt', intrinsics)
    np.savetxt(folder / 'T_zup_from_world.txt', np.eye(4))
    for number, frame in enumerate(frames):
        name = folder / f'frame-{number:06d}'
        Image.fromarray(frame.color).save(f'{name}.color.png')
        Image.fromarray(frame.depth).save(f'{name}.depth.png')
        np.savetxt(f'{name}.pose.txt', frame.camera_to_map())
    return folder


def test_a_sequence_gives_the_map_of_its_frames(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Equal to that of a robot that carries the camera, but for its footprint."""
    camera = Camera(160, 120, 115.0, 113.0, 79.5, 59.5)
    frames = [render(camera, walk(number, 8), number) for number in range(8)]
    folder = write_sequence(tmp_path / 'room', frames)
    (folder / 'frame-000003.depth.png').write_bytes(b'no image')
    assert main(['map', str(folder), '-o', str(tmp_path / 'out')]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith('7 frames in ')
    assert 'left out: ' in captured.err
    assert 'frame-000003' in captured.err
    mapper = RgbdMapper()
    for number, frame in enumerate(frames):
        if number != 3:
            carried = Pose3D.from_matrix(
                frame.pose.matrix() @ MOUNT.matrix() @ np.linalg.inv(CameraMount().matrix())
            )
            frame = type(frame)(**{**vars(frame), 'pose': carried, 'mount': CameraMount()})  # noqa: PLW2901
            mapper.add(frame)
    mapping = map_source(MapOptions(folder, tmp_path))
    assert np.array_equal(mapping.mapper.grid.occupancy, mapper.grid.occupancy)
    assert len(mapping.way) == 7


@pytest.mark.skipif(not KITCHEN.is_dir(), reason='needs ../shared/data/redkitchen')
def test_the_kitchen_is_recognised(tmp_path: Path) -> None:
    """The floor is free; table, cabinets and the row at the wall are occupied."""
    grid = map_source(MapOptions(KITCHEN, tmp_path)).mapper.grid

    def share(value: int, west: float, east: float, south: float, north: float) -> float:
        rows, cols = zip(
            grid.geometry.cell_at(west, south), grid.geometry.cell_at(east, north), strict=True
        )
        part = grid.occupancy[rows[0] : rows[1] + 1, cols[0] : cols[1] + 1]
        return float((part == value).mean())

    assert share(WALL, -0.75, 1.15, 1.25, 1.95) > 0.97  # the table
    assert share(WALL, -2.55, 2.4, 3.25, 3.35) > 0.9  # the row at the wall
    assert share(WALL, 2.05, 2.3, 2.3, 3.0) > 0.8  # a cabinet on the right
    assert share(FREE, -1.75, -1.35, 1.15, 2.65) > 0.9  # the carpet on the left
    assert share(WALL, -1.75, -1.35, 1.15, 2.65) < 0.05


def test_what_is_no_source_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One sentence."""
    assert main(['map', str(tmp_path / 'nowhere'), '-o', str(tmp_path / 'out')]) == 2
    assert 'nowhere' in capsys.readouterr().err
    assert main(['map', str(tmp_path), '-o', str(tmp_path / 'out')]) == 2
    assert 'no RGB-D images that can be read' in capsys.readouterr().err
