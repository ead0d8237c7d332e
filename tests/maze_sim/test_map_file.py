"""Maps of a map server, forged in the test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image
from tests.maze_sim.drawing import walls

from gridnav.grid import GridGeometry
from maze_sim import read_map

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SETTINGS = {
    'image': 'map.pgm',
    'mode': 'trinary',
    'resolution': '0.05',
    'origin': '[-1.5, 2.0, 0.0]',
    'negate': '0',
    'occupied_thresh': '0.65',
    'free_thresh': '0.196',
}
OCCUPIED, UNKNOWN, FREE = 0, 205, 254
"""The greys that the map saver writes."""


def write_settings(folder: Path, **changes: str) -> Path:
    """Write the YAML file with some settings changed, or left out where empty."""
    path = folder / 'map.yaml'
    lines = [f'{key}: {value}' for key, value in (SETTINGS | changes).items() if value]
    path.write_text('\n'.join(lines), encoding='utf-8')
    return path


def write_pgm(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write a binary PGM as the map saver does, with a comment in its header."""
    height, width = pixels.shape
    header = f'P5\n# CREATOR: map saver\n{width} {height}\n255\n'
    path.write_bytes(header.encode() + pixels.tobytes())


def write_map(folder: Path, blocked: NDArray[np.bool_]) -> Path:
    """Write a map with these walls, row 0 as the lowest row of the image."""
    pixels = np.where(blocked, OCCUPIED, FREE).astype(np.uint8)[::-1]
    write_pgm(folder / 'map.pgm', pixels)
    return write_settings(folder)


def test_free_is_free_and_all_else_is_blocked(tmp_path: Path) -> None:
    """The unknown counts as wall, the lowest row comes first, and the map lies where it says."""
    pixels = np.array([[OCCUPIED, FREE, FREE], [UNKNOWN, FREE, OCCUPIED]], dtype=np.uint8)
    write_pgm(tmp_path / 'map.pgm', pixels)
    blocked, geometry = read_map(write_settings(tmp_path))
    assert (blocked == walls('#.# #..')).all()
    assert blocked.dtype == np.bool_
    assert geometry == GridGeometry(2, 3, 0.05, -1.5, 2.0)


@pytest.mark.parametrize(
    ('changes', 'free'),
    [
        ({}, [False, False, False, True, True]),
        # An occupancy of exactly the threshold is not below it.
        ({'free_thresh': '0.4'}, [False, False, False, True, True]),
        ({'free_thresh': '0.41'}, [False, False, True, True, True]),
        ({'negate': '1'}, [True, False, False, False, False]),
        ({'negate': 'true', 'free_thresh': '0.5'}, [True, True, False, False, False]),
        ({'mode': 'scale'}, [False, False, False, True, True]),
        ({'mode': ''}, [False, False, False, True, True]),
    ],
)
def test_thresholds_tell_what_is_free(
    tmp_path: Path, changes: dict[str, str], free: list[bool]
) -> None:
    """Darkness counts, brightness with negate, against the thresholds of the file."""
    write_pgm(tmp_path / 'map.pgm', np.array([[0, 102, 153, 230, 255]], dtype=np.uint8))
    blocked, _ = read_map(write_settings(tmp_path, **changes))
    assert (~blocked[0]).tolist() == free


@pytest.mark.parametrize('mode', ['L', 'RGB', 'RGBA', 'LA', 'P', '1', 'I;16'])
def test_images_of_all_sorts_are_read(tmp_path: Path, mode: str) -> None:
    """Grey, coloured, with a palette, black and white, of sixteen bits: the same map."""
    grey = np.array([[0, 255, 255], [0, 0, 255]], dtype=np.uint8)
    image = Image.fromarray(grey)
    if mode == 'I;16':
        image = Image.fromarray(grey.astype(np.uint16) * 257)
    else:
        image = image.convert(mode)
    assert image.mode == mode
    image.save(tmp_path / 'map.png')
    blocked, _ = read_map(write_settings(tmp_path, image='map.png'))
    assert (blocked == walls('##. #..')).all()


def test_wide_and_plain_pgm_are_read(tmp_path: Path) -> None:
    """Sixteen bits a pixel, and numbers written out."""
    deep = np.array([[0, 65535, 1000]], dtype='>u2')
    (tmp_path / 'map.pgm').write_bytes(b'P5\n3 1\n65535\n' + deep.tobytes())
    assert read_map(write_settings(tmp_path)).blocked.tolist() == [[True, False, True]]
    (tmp_path / 'map.pgm').write_text('P2\n3 1\n100\n0 100 20\n', encoding='ascii')
    assert read_map(write_settings(tmp_path)).blocked.tolist() == [[True, False, True]]


def test_transparent_pixels_are_unknown(tmp_path: Path) -> None:
    """White that can be looked through is not free."""
    pixels = np.full((1, 2, 4), 255, dtype=np.uint8)
    pixels[0, 1, 3] = 0
    Image.fromarray(pixels).save(tmp_path / 'map.png')
    blocked, _ = read_map(write_settings(tmp_path, image='map.png'))
    assert blocked.tolist() == [[False, True]]


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'image': ''}, "'image' is missing"),
        ({'image': 'other.pgm'}, r'other\.pgm can not be read: No such file or directory\.$'),
        ({'image': 'map.yaml'}, r'map\.yaml can not be read: it is no image\.$'),
        ({'image': 'cut.pgm'}, r'cut\.pgm can not be read: it is no image\.$'),
        ({'image': 'cut.png'}, r'cut\.png can not be read: '),
        ({'image': 'huge.pgm'}, r'huge\.pgm has 9000 x 9000 cells, more than 4000000'),
        ({'resolution': ''}, "'resolution' is missing"),
        ({'resolution': 'fine'}, "'resolution' must be a number, got 'fine'"),
        ({'resolution': '0.0'}, r'resolution must be finite and above 0 m, got 0\.0'),
        ({'resolution': '.nan'}, "'resolution' must be a number, got nan"),
        ({'origin': '[0, 0]'}, r"'origin' must be x, y and yaw, got \[0, 0\]"),
        ({'origin': '[0, .inf, 0]'}, "'origin' must be x, y and yaw"),
        ({'origin': '[0, 0, 0.3]'}, r'must not be turned, got a yaw of 0\.3'),
        ({'negate': 'maybe'}, "'negate' must be a number, got 'maybe'"),
        ({'mode': 'raw'}, "mode must be trinary or scale, got 'raw'"),
        ({'free_thresh': '0.7'}, r'at most occupied_thresh, .* got 0\.7 and 0\.65'),
        ({'occupied_thresh': '65'}, r'at most 1, got 0\.196 and 65\.0'),
    ],
)
def test_malformed_maps_are_refused(tmp_path: Path, changes: dict[str, str], message: str) -> None:
    """With one sentence that names the file and what is wrong with it."""
    write_pgm(tmp_path / 'map.pgm', np.zeros((3, 3), dtype=np.uint8))
    (tmp_path / 'cut.pgm').write_bytes(b'P5\n30 30\n255\n12')
    (tmp_path / 'huge.pgm').write_bytes(b'P5\n9000 9000\n255\n12')
    Image.new('L', (40, 40)).save(tmp_path / 'cut.png')
    whole = (tmp_path / 'cut.png').read_bytes()
    (tmp_path / 'cut.png').write_bytes(whole[:-20])
    with pytest.raises(ValueError, match=message) as refused:
        read_map(write_settings(tmp_path, **changes))
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (b'a: [', r'map\.yaml is not YAML\.$'),
        (b'\xff\xfe\x00', r'map\.yaml is not YAML\.$'),
        (b'', r'map\.yaml has no settings\.$'),
        (b'- image', r'map\.yaml has no settings\.$'),
    ],
)
def test_files_that_are_no_settings_are_refused(
    tmp_path: Path, content: bytes, message: str
) -> None:
    """So is a file that is not there."""
    path = tmp_path / 'map.yaml'
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_map(path)
    with pytest.raises(ValueError, match=r'none\.yaml can not be read: No such file'):
        read_map(tmp_path / 'none.yaml')
