"""The command that says what of a scene is present, missing or broken."""

from __future__ import annotations

import argparse
import json
import math
import shutil
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image
from scipy.io import loadmat, savemat
from tests.avd_player.tiny_scene import TinyScene, write_scene

from avd_player import Scene, check
from avd_player.avd_format import ANNOTATIONS, CAMERAS, COLOR_FOLDER, DEPTH_FOLDER, STRUCTS
from avd_player.sources.avd import AvdSource

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def run(*words: str) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser()
    check.add_arguments(parser)
    return check.run(parser.parse_args(words))


def edit_annotations(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change the annotations of a scene."""
    path = folder / ANNOTATIONS
    entries = json.loads(path.read_text(encoding='utf-8'))
    change(entries)
    path.write_text(json.dumps(entries), encoding='utf-8')


def edit_structs(folder: Path, change: Callable[[Any], None], **others: object) -> None:
    """Change the poses of a scene."""
    contents = loadmat(folder / STRUCTS)
    change(contents['image_structs'][0])
    kept = {key: contents[key] for key in ('image_structs', 'scale')} | others
    savemat(folder / STRUCTS, kept)


def test_a_whole_scene_is_fine(tiny: TinyScene, capsys: pytest.CaptureFixture[str]) -> None:
    """With and without its images opened; status 0."""
    assert run(str(tiny.folder)) == 0
    whole = capsys.readouterr().out
    assert whole.startswith('Home_001_1: fine\n  72 images, 72 poses, 6 positions.\n')
    assert 'Images that were not registered' in whole
    assert '72 images have labels.' in whole
    assert 'A unit of image_structs.mat is 389 mm.' in whole
    assert 'The camera is 1.10 m above the floor and looks 11.5 degrees down; 6 of 6' in whole
    assert 'BROKEN' not in whole
    assert run(str(tiny.folder), '--quick') == 0
    quick = capsys.readouterr().out
    assert 'The camera is' not in quick
    assert set(quick.splitlines()) < set(whole.splitlines())


def test_several_scenes_are_counted(
    damaged: Callable[[], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """One that is broken makes status 1; the others are checked all the same."""
    folder = damaged()
    (folder / ANNOTATIONS).unlink()
    write_scene(folder.parent / 'home', cells=[(0, 0)], cameras=False)
    assert run(str(folder.parent), '--quick') == 1
    out = capsys.readouterr().out
    assert 'Home_001_1: broken' in out
    assert 'home: fine' in out
    assert 'Its folder is not named as scenes are' in out
    assert 'cameras.txt is missing: the lens of Home_001_1 is taken.' in out
    assert out.endswith('1 of 2 scenes are fine.\n')


def test_no_scene_is_a_usage_error(tmp_path: Path) -> None:
    """Which the commands print, with status 2."""
    with pytest.raises(ValueError, match='is no scene and holds none'):
        run(str(tmp_path))
    with pytest.raises(ValueError, match='There is no folder'):
        run(str(tmp_path / 'nowhere'))


FIRST, SECOND = '000110000010101.jpg', '000110000020101.jpg'
DEPTH = '000110000010103.png'


def _dangle(entries: dict[str, Any]) -> None:
    entries[FIRST]['forward'] = '000110009990101.jpg'
    entries[SECOND]['left'] = '1.jpg'


def _spoil_entries(entries: dict[str, Any]) -> None:
    entries[FIRST] = 3
    entries[SECOND] = {'bounding_boxes': [[1, 2]]}


def _spoil_moves(entries: dict[str, Any]) -> None:
    entries[FIRST]['left'] = None
    entries[SECOND]['bounding_boxes'] = 'x'


def _no_turn(entries: dict[str, Any]) -> None:
    entries[FIRST]['rotate_cw'] = ''


def _bare(rows: Any) -> None:  # noqa: ANN401 - scipy's records
    rows['R'][0] = rows['direction'][0] = np.zeros((0, 0))
    rows['world_pos'][1] = np.full((3, 1), math.nan)


def _nameless(rows: Any) -> None:  # noqa: ANN401 - scipy's records
    rows['image_name'][0] = 'thumbs.db'


DAMAGES: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    'no colour': (
        lambda f: shutil.rmtree(f / COLOR_FOLDER),
        ['The folder jpg_rgb is missing.'],
    ),
    'no depth': (
        lambda f: shutil.rmtree(f / DEPTH_FOLDER),
        ['The folder high_res_depth is missing.'],
    ),
    'one depth image less': (
        lambda f: (f / DEPTH_FOLDER / DEPTH).unlink(),
        [f'Images without depth: {FIRST}.'],
    ),
    'one colour image less': (
        lambda f: (f / COLOR_FOLDER / FIRST).unlink(),
        [f'Images that are missing in jpg_rgb: {FIRST}.'],
    ),
    'an image too many': (
        lambda f: (f / COLOR_FOLDER / '000110009990101.jpg').touch(),
        ['Images without depth: 0001', 'image_structs.mat does not know: 000110009990101.jpg.'],
    ),
    'cut JSON': (
        lambda f: (f / ANNOTATIONS).write_text((f / ANNOTATIONS).read_text()[:3_000]),
        ['annotations.json is cut or broken (', 'Images without an entry in annotations.json: '],
    ),
    'another JSON': (
        lambda f: (f / ANNOTATIONS).write_text('[1, 2]'),
        ['annotations.json holds no table of images.'],
    ),
    'no JSON': (
        lambda f: (f / ANNOTATIONS).unlink(),
        ['annotations.json is missing, so there are no boxes and no moves.'],
    ),
    'dangling pointers': (
        lambda f: edit_annotations(f, _dangle),
        [f'Moves that lead to no image: 2, the first is forward of {FIRST} to 00011000999'],
    ),
    'entries that are none': (
        lambda f: edit_annotations(f, _spoil_entries),
        [f'annotations.json says nothing usable of images: 2, the first is {FIRST}.'],
    ),
    'moves that are none': (
        lambda f: edit_annotations(f, _spoil_moves),
        [f'annotations.json says nothing usable of images: 2, the first is {FIRST}.'],
    ),
    'no turn': (
        lambda f: edit_annotations(f, _no_turn),
        [f'Images from which one can not turn both ways: {FIRST}.'],
    ),
    'no poses': (
        lambda f: edit_structs(f, _bare),
        [f'Images without any pose: 2, the first is {FIRST}.'],
    ),
    'no name': (
        lambda f: edit_structs(f, _nameless),
        ['has 1 entries without the name of an image.', 'does not know: ', 'lead to no image: '],
    ),
    'cut mat': (
        lambda f: (f / STRUCTS).write_bytes((f / STRUCTS).read_bytes()[:20_000]),
        ['image_structs.mat is cut or broken, so no image has a pose ('],
    ),
    'another mat': (
        lambda f: savemat(f / STRUCTS, {'x': 1}),
        ['image_structs.mat is cut or broken'],
    ),
    'other fields': (
        lambda f: savemat(f / STRUCTS, {'image_structs': {'a': 1}, 'scale': 1.0}),
        ['image_structs.mat lacks the fields image_name, R, world_pos, direction, cluster_id.'],
    ),
    'scale 0': (
        lambda f: edit_structs(f, lambda _: None, scale=0.0),
        ['The scale in image_structs.mat is 0, so it is not known how far things are apart.'],
    ),
    'another camera': (
        lambda f: (f / CAMERAS).write_text('1 SIMPLE 1 2 3\n'),
        ['cameras.txt has no line of an OPENCV_FISHEYE or PINHOLE camera'],
    ),
    'cut PNG': (
        lambda f: (f / DEPTH_FOLDER / DEPTH).write_bytes(
            (f / DEPTH_FOLDER / DEPTH).read_bytes()[:400]
        ),
        [f'{DEPTH} is cut or broken ('],
    ),
    'corrupt JPEG': (
        lambda f: (f / COLOR_FOLDER / FIRST).write_bytes(b'\xff\xd8' + b'1' * 500),
        [f'{FIRST} is cut or broken ('],
    ),
    'depth of another size': (
        lambda f: Image.fromarray(np.ones((9, 16), np.uint16)).save(f / DEPTH_FOLDER / DEPTH),
        [f'{DEPTH} is 16 x 9 pixels, expected 192 x 108.'],
    ),
}


@pytest.mark.parametrize('name', DAMAGES)
def test_damage_is_named(
    name: str, damaged_small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One sentence for each damage, status 1, and the rest can be used still."""
    damage, expected = DAMAGES[name]
    folder = damaged_small
    damage(folder)
    assert run(str(folder)) == 1
    out = capsys.readouterr().out
    assert out.startswith('Home_001_1: broken\n')
    broken = [line for line in out.splitlines() if line.startswith('  BROKEN: ')]
    assert len(broken) == len(expected), out
    for line, part in zip(broken, expected, strict=True):
        assert part in line
        assert line.endswith('.')
    usable = 'image_structs.mat' not in expected[0]
    if usable and 'The folder' not in expected[0]:
        assert 'positions lead to each other' in out


@pytest.mark.filterwarnings('ignore:Home_001_1')
def test_what_comes_before_a_cut_is_used(damaged: Callable[[], Path]) -> None:
    """Boxes and moves of the images before the place where the JSON ends."""
    folder = damaged()
    path = folder / ANNOTATIONS
    whole = AvdSource(folder).files.annotations
    path.write_text(path.read_text(encoding='utf-8')[:3_000], encoding='utf-8')
    source = AvdSource(folder)
    part = source.files.annotations
    assert 10 < len(part) < len(whole)
    for name, annotation in part.items():
        assert annotation.moves == whole[name].moves
        np.testing.assert_array_equal(annotation.boxes, whole[name].boxes)
    # The positions lie on a grid, so that one can move without a pointer, too.
    np.testing.assert_array_equal(Scene(source).moves, Scene(AvdSource(folder)).moves)
    assert (Scene(source).moves >= 0).sum(axis=1).min() >= 2


def test_many_broken_images_are_summed_up(
    damaged_small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first ones are named, the others counted."""
    folder = damaged_small
    for path in sorted((folder / COLOR_FOLDER).iterdir())[:22]:
        path.write_bytes(b'')
    assert run(str(folder)) == 1
    lines = capsys.readouterr().out.splitlines()
    assert sum('is cut or broken' in line for line in lines) == check.SHOWN
    assert '  BROKEN: 2 more images can not be used.' in lines
