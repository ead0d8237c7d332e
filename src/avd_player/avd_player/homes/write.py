"""Writing scans as the Active Vision Dataset has them on disk."""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from avd_player.avd_format import (
    ANNOTATIONS,
    CAMERAS,
    COLOR_FOLDER,
    DEPTH_FOLDER,
    INSTANCE_MAP,
    INSTANCES,
    LABEL_FOLDER,
    MOVES,
    STRUCT_FIELDS,
    STRUCTS,
)
from avd_player.homes.instances import BOTTLE_ID
from avd_player.homes.scene import HEADINGS

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from avd_player.homes.scene import Box, Scan, Shot

RGB, DEPTH, LABELS = 1, 3, 4
"""Types of images in their names; AVD never gave out images of type 4."""

JPEG_QUALITY = 92

_HEADER = b'MATLAB 5.0 MAT-file, written by vgdp avd synth'

FIRST_HOME = 100
"""Home number i of a set is the home with this number plus i, none of AVD's own."""

LAST_HOME = 899
"""Names have three digits for the number of a home."""


def scene_name(number: int) -> str:
    """Return the name of the folder of home number `number`, from 1."""
    return f'Home_{FIRST_HOME + number:03d}_1'


def image_stem(number: int, index: int, kind: int = RGB) -> str:
    """Return an image's name without its ending.

    Args:
        number: Of the home, from 1.
        index: Of the image, from 0.
        kind: `RGB`, `DEPTH` or `LABELS`.
    """
    return f'0{FIRST_HOME + number:03d}1{index + 1:06d}01{kind:02d}'


def write_shot(folder: Path, number: int, index: int, shot: Shot) -> None:
    """Write the images of a pose into the folders of a scene, which must exist."""
    rgb = folder / COLOR_FOLDER / f'{image_stem(number, index)}.jpg'
    Image.fromarray(shot.rgb).save(rgb, quality=JPEG_QUALITY)
    depth = folder / DEPTH_FOLDER / f'{image_stem(number, index, DEPTH)}.png'
    Image.fromarray(shot.depth).save(depth, compress_level=1)
    labels = folder / LABEL_FOLDER / f'{image_stem(number, index, LABELS)}.png'
    Image.fromarray(shot.labels).save(labels, compress_level=1)


def write_scene(folder: Path, scan: Scan, boxes: list[list[Box]]) -> None:
    """Write what there is besides the images.

    Args:
        folder: Of the scene.
        scan: The scan.
        boxes: Of each image.
    """
    names = [f'{image_stem(scan.number, index)}.jpg' for index in range(len(scan.poses))]
    links = scan.links()
    _write_annotations(folder, names, links, boxes)
    _write_structs(folder, scan, names, links)
    width, height, *numbers = scan.lens
    (folder / CAMERAS).write_text(
        '# Camera list with one line of data per camera:\n'
        '#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n'
        '# Number of cameras: 1\n'
        f'1 OPENCV_FISHEYE {width} {height} '
        f'{" ".join(f"{value:.9g}" for value in numbers)}\n'
    )
    counts = np.bincount([thing.number for thing in scan.home.things])
    present = [INSTANCES[number] for number in np.flatnonzero(counts).tolist()]
    (folder / 'present_instance_names.txt').write_text(''.join(f'{name}\n' for name in present))
    twice = [INSTANCES[number] for number in np.flatnonzero(counts > 1).tolist()]
    if twice:
        note = f'In this scene there are two of: {", ".join(twice)}.\n'
        (folder / 'special_note.txt').write_text(note)
    _write_ground_truth(folder, scan)


def write_instance_map(folder: Path) -> None:
    """Write the numbers of all instances, which the scenes of a folder share."""
    lines = [f'{name} {number}\n' for number, name in enumerate(INSTANCES)]
    (folder / INSTANCE_MAP).write_text(''.join(lines))


def _write_annotations(
    folder: Path, names: list[str], links: dict[str, NDArray[np.int64]], boxes: list[list[Box]]
) -> None:
    entries = {}
    for index, name in enumerate(names):
        entry: dict[str, Any] = {'bounding_boxes': [list(box) for box in boxes[index]]}
        for move in MOVES:
            target = int(links[move][index])
            entry[move] = names[target] if target >= 0 else ''
        entries[name] = entry
    (folder / ANNOTATIONS).write_text(json.dumps(entries, indent=1))


def _write_structs(
    folder: Path, scan: Scan, names: list[str], links: dict[str, NDArray[np.int64]]
) -> None:
    poses = scan.scan_poses()
    units = 1000.0 / scan.scale
    structs = np.empty((1, len(names)), dtype=[(name, object) for name in STRUCT_FIELDS])
    column, empty = (3, 1), np.zeros((0, 0))

    def target(move: str, index: int) -> str | float:
        image = int(links[move][index])
        return names[image] if image >= 0 else -1.0

    for index, name in enumerate(names):
        rotation, center = poses[index, :3, :3].T, poses[index, :3, 3] * units
        cluster = index // HEADINGS
        if scan.registered[index]:
            x, y, z, w = Rotation.from_matrix(rotation).as_quat().tolist()
            sign = 1.0 if w >= 0 else -1.0
            translation: NDArray[np.float64] = (-rotation @ center).reshape(column)
            quaternion = sign * np.array([[w], [x], [y], [z]])
            direction = rotation[2]
        else:
            first = cluster * HEADINGS
            others = first + np.flatnonzero(scan.registered[first : first + HEADINGS])
            center = poses[others, :3, 3].mean(0) * units
            direction = _turned_heading(poses, index, int(others[0]))
            translation, quaternion, rotation = empty, empty, empty
        structs[0, index] = (
            name,
            translation,
            rotation,
            center.reshape(column),
            direction.reshape(column),
            quaternion,
            np.zeros(column),
            str(index + 1) if scan.registered[index] else '',
            '1' if scan.registered[index] else '',
            float(cluster),
            target('rotate_cw', index),
            target('rotate_ccw', index),
            target('forward', index),
            target('backward', index),
            target('right', index),
            target('left', index),
        )
    buffer = io.BytesIO()
    scale = np.int32(scan.scale)  # some readers ask for a whole number
    savemat(buffer, {'image_structs': structs, 'scale': scale}, do_compression=True)
    content = bytearray(buffer.getvalue())
    # The text at the beginning has the time of day in it.
    content[:116] = _HEADER.ljust(116)
    (folder / STRUCTS).write_bytes(content)


def _turned_heading(poses: NDArray[np.float64], index: int, other: int) -> NDArray[np.float64]:
    """Return where an image looks by another one at its position, turned in the plane x-z."""
    angle = (index - other) * 2 * np.pi / HEADINGS
    x, y, z = poses[other, :3, 2]
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([x * cos - z * sin, y, x * sin + z * cos])


def _write_ground_truth(folder: Path, scan: Scan) -> None:
    home = scan.home
    bottle = next(thing for thing in home.things if thing.number == BOTTLE_ID)
    np.savez_compressed(
        folder / 'ground_truth.npz',
        plan=home.plan.cells,
        origin=np.array([home.plan.x, home.plan.y]),
        resolution=np.array(home.plan.resolution),
        positions=home.positions,
        moves=home.moves,
        poses=scan.poses,
    )
    truth = {
        'seed': scan.seed,
        'number': scan.number,
        'settings': scan.settings.as_dict(),
        'scan_to_home': scan.to_home.tolist(),
        'camera_height': home.camera_height,
        'camera_pitch': home.camera_pitch,
        'bottle': list(bottle.center),
        'things': [
            {'instance': INSTANCES[thing.number], 'position': list(thing.center)}
            for thing in home.things
        ],
        'rooms': [room._asdict() for room in home.layout.rooms],
        'ceiling': home.layout.height,
    }
    (folder / 'ground_truth.json').write_text(json.dumps(truth, indent=1))
