"""Scenes of the Active Vision Dataset as they lie on disk, before any geometry.

Everything that is wrong with a file becomes a sentence; what can be used is used.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from avd_player.distortion import Lens
from gridnav.rgbd import ROTATION_TOLERANCE

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from numpy.typing import NDArray

COLOR_FOLDER, DEPTH_FOLDER, LABEL_FOLDER = 'jpg_rgb', 'high_res_depth', 'labels'
ANNOTATIONS, STRUCTS, CAMERAS = 'annotations.json', 'image_structs.mat', 'cameras.txt'
INSTANCE_MAP = 'instance_id_map.txt'

SCENE_NAME = re.compile(r'(Home|Office|Gen)_\d{3}_\d')
IMAGE_NAME = re.compile(r'\d{12}\d01\.jpg')

VIEWS = 12
"""Images are taken at each position."""

GRID_M = 0.3
"""Nominal distance of neighbouring positions."""

STRUCT_FIELDS = (
    'image_name',
    't',
    'R',
    'world_pos',
    'direction',
    'quat',
    'scaled_world_pos',
    'image_id',
    'camera_id',
    'cluster_id',
    'rotate_cw',
    'rotate_ccw',
    'translate_forward',
    'translate_backward',
    'translate_right',
    'translate_left',
)
"""Fields of `image_structs`, in their order."""

NEEDED_FIELDS = ('image_name', 'R', 'world_pos', 'direction', 'cluster_id')

ROTATIONS = ('rotate_ccw', 'rotate_cw')
TRANSLATIONS = ('forward', 'backward', 'left', 'right')
MOVES = (*ROTATIONS, *TRANSLATIONS)
"""Pointers of an image to others, in the order of `annotations.json`."""

BOX_VALUES = 6
"""x and y of two corners, instance and difficulty."""

DEFAULT_LENS = Lens(
    1920, 1080, 1049.51, 1092.28, 927.269, 545.76, 0.382444, 0.105826, 0.000859549, -0.00143275
)
"""Of Home_001_1; those of other scans differ by a percent."""

INSTANCES = (
    'background',
    'advil_liqui_gels',
    'aunt_jemima_original_syrup',
    'bumblebee_albacore',
    'cholula_chipotle_hot_sauce',
    'coca_cola_glass_bottle',
    'crest_complete_minty_fresh',
    'crystal_hot_sauce',
    'expo_marker_red',
    'hersheys_bar',
    'honey_bunches_of_oats_honey_roasted',
    'honey_bunches_of_oats_with_almonds',
    'hunts_sauce',
    'listerine_green',
    'mahatma_rice',
    'nature_valley_granola_thins_dark_chocolate',
    'nutrigrain_harvest_blueberry_bliss',
    'pepto_bismol',
    'pringles_bbq',
    'progresso_new_england_clam_chowder',
    'quaker_chewy_low_fat_chocolate_chunk',
    'red_bull',
    'softsoap_clear',
    'softsoap_gold',
    'softsoap_white',
    'spongebob_squarepants_fruit_snaks',
    'tapatio_hot_sauce',
    'vo5_tea_therapy_healthful_green_tea_smoothing_shampoo',
    'nature_valley_sweet_and_salty_nut_almond',
    'nature_valley_sweet_and_salty_nut_cashew',
    'nature_valley_sweet_and_salty_nut_peanut',
    'nature_valley_sweet_and_salty_nut_roasted_mix_nut',
    'paper_plate',
    'red_cup',
)
"""The instances of the dataset; an instance's id is its index."""


@dataclass(frozen=True)
class Annotation:
    """What is said about one image.

    Attributes:
        boxes: x_min, y_min, x_max, y_max in pixels, instance, difficulty; (B, 6).
        moves: The images that it points to, by the names in `MOVES`.
    """

    boxes: NDArray[np.int64]
    moves: dict[str, str]


@dataclass(frozen=True)
class ImageStruct:
    """Where one image was taken, in units of the reconstruction.

    Attributes:
        name: File name of the colour image.
        cluster: Number of the position.
        position: Of the camera, (3,).
        direction: Unit vector that it looks along, (3,).
        rotation: Of the world into the camera, (3, 3); None if the image was not registered.
    """

    name: str
    cluster: int
    position: NDArray[np.float64]
    direction: NDArray[np.float64]
    rotation: NDArray[np.float64] | None


@dataclass
class SceneFiles:
    """What lies in the folder of a scene.

    Attributes:
        folder: The folder.
        colors: File names of the colour images, sorted.
        depths: File names of the depth images.
        labels: File names of the label images by the first eleven digits of their names.
        annotations: By file name of the colour image.
        named: The colour images that the file of poses names, with or without one.
        structs: Of the images that have a pose, in their order in the file.
        scale: Millimetres in a unit of the reconstruction; None if it can't be used.
        lens: Of the camera; the default one where none is given.
        problems: One sentence for each thing that is broken.
        guesses: One sentence for each thing that is missing and was guessed.
        notes: One sentence for each thing that one may want to know.
    """

    folder: Path
    colors: list[str] = field(default_factory=list)
    depths: set[str] = field(default_factory=set)
    labels: dict[str, str] = field(default_factory=dict)
    annotations: dict[str, Annotation] = field(default_factory=dict)
    named: set[str] = field(default_factory=set)
    structs: list[ImageStruct] = field(default_factory=list)
    scale: float | None = None
    lens: Lens = DEFAULT_LENS
    problems: list[str] = field(default_factory=list)
    guesses: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The scene's name."""
        return self.folder.resolve().name


def looks_like_scene(folder: Path) -> bool:
    """Tell whether a folder holds anything of a scene."""
    return any((folder / item).exists() for item in (COLOR_FOLDER, STRUCTS, ANNOTATIONS))


def depth_name(name: str) -> str:
    """Return the file name of the depth image that belongs to a colour image."""
    return f'{name[:13]}03.png'


def index_of(name: str) -> int:
    """Return the number of an image in its scan, from 1."""
    return int(name[5:11])


def read_scene_files(folder: Path) -> SceneFiles:
    """Read everything but the images."""
    files = SceneFiles(folder)
    _list_images(files)
    _read_structs(files)
    _read_annotations(files)
    _read_lens(files)
    return files


def read_instance_ids(folder: Path) -> dict[str, int]:
    """Return the instances' ids by name: of the map beside or in a scene, else the dataset's."""
    for place in (folder.resolve().parent, folder):
        path = place / INSTANCE_MAP
        if path.is_file():
            lines = path.read_text(encoding='utf-8', errors='replace').splitlines()
            rows = [line.split() for line in lines]
            ids = {row[0]: int(row[1]) for row in rows if len(row) > 1 and row[1].isdecimal()}
            if ids:
                return ids
    return {name: index for index, name in enumerate(INSTANCES)}


def some_of(what: Iterable[str]) -> str:
    """Return how many there are and the first of them, for a sentence."""
    names = list(what)
    return names[0] if len(names) == 1 else f'{len(names)}, the first is {names[0]}'


def _list_images(files: SceneFiles) -> None:
    listed: dict[str, list[str]] = {}
    for item in (COLOR_FOLDER, DEPTH_FOLDER):
        try:
            listed[item] = sorted(_names_in(files.folder / item))
        except OSError:
            files.problems.append(f'The folder {item} is missing.')
            listed[item] = []
    files.colors = [name for name in listed[COLOR_FOLDER] if IMAGE_NAME.fullmatch(name)]
    strangers = [name for name in listed[COLOR_FOLDER] if name not in set(files.colors)]
    if strangers:
        files.notes.append(
            f'Files in {COLOR_FOLDER} are not named as images are: {some_of(strangers)}.'
        )
    files.depths = set(listed[DEPTH_FOLDER])
    without = [name for name in files.colors if depth_name(name) not in files.depths]
    if without and listed[DEPTH_FOLDER]:
        files.problems.append(f'Images without depth: {some_of(without)}.')
    if (files.folder / LABEL_FOLDER).is_dir():
        files.labels = {name[:11]: name for name in _names_in(files.folder / LABEL_FOLDER)}


def _names_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def _read_structs(files: SceneFiles) -> None:
    """Read `image_structs.mat`."""
    # Here, as it takes a while that programs without a scene should not wait for.
    from scipy.io import loadmat  # noqa: PLC0415

    path = files.folder / STRUCTS
    if not path.is_file():
        files.problems.append(f'{STRUCTS} is missing, so no image has a pose.')
        return
    try:
        contents = loadmat(path)
        table = contents['image_structs'].reshape(-1)
        scale = contents['scale'].reshape(-1)
    except Exception as error:  # noqa: BLE001 - a broken file raises whatever it happens to
        files.problems.append(
            f'{STRUCTS} is cut or broken, so no image has a pose ({_first_line(error)}).'
        )
        return
    lacking = [name for name in NEEDED_FIELDS if name not in (table.dtype.names or ())]
    if lacking:
        files.problems.append(f'{STRUCTS} lacks the fields {", ".join(lacking)}.')
        return
    value = float(scale[0]) if scale.size == 1 and scale.dtype.kind in 'iuf' else math.nan
    if math.isfinite(value) and value > 0:
        files.scale = value
    else:
        files.problems.append(
            f'The scale in {STRUCTS} is {value:g}, so it is not known how far things are apart.'
        )
    names = [_text(row['image_name']) for row in table]
    named = [
        (name, row) for name, row in zip(names, table, strict=True) if IMAGE_NAME.fullmatch(name)
    ]
    if len(named) < len(names):
        number = len(names) - len(named)
        files.problems.append(f'{STRUCTS} has {number} entries without the name of an image.')
    structs = {name: _struct(name, row) for name, row in named}
    files.structs = [struct for struct in structs.values() if struct is not None]
    bare = [name for name, struct in structs.items() if struct is None]
    if bare:
        files.problems.append(f'Images without any pose: {some_of(bare)}.')
    files.named = set(structs)
    _compare_structs(files)


def _compare_structs(files: SceneFiles) -> None:
    """Compare the poses with the images."""
    unregistered = [struct.name for struct in files.structs if struct.rotation is None]
    if unregistered:
        files.notes.append(
            'Images that were not registered get the pose of their position and direction: '
            f'{some_of(unregistered)}.'
        )
    strangers = [name for name in files.colors if name not in files.named]
    if strangers:
        files.problems.append(f'Images that {STRUCTS} does not know: {some_of(strangers)}.')
    missing = sorted(files.named - set(files.colors))
    if missing and files.colors:
        files.problems.append(f'Images that are missing in {COLOR_FOLDER}: {some_of(missing)}.')


def _struct(name: str, row: Any) -> ImageStruct | None:  # noqa: ANN401 - scipy's record
    """Read one element of `image_structs`; None if it has no pose."""
    rotation = _numbers(row['R'], 9)
    if rotation is not None:
        rotation = rotation.reshape(3, 3)
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if error > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            rotation = None
    direction = rotation[2] if rotation is not None else _numbers(row['direction'], 3)
    position = _numbers(row['world_pos'], 3)
    if position is None or direction is None or not direction.any():
        return None
    cluster = _numbers(row['cluster_id'], 1)
    number = (index_of(name) - 1) // VIEWS if cluster is None else int(cluster[0])
    return ImageStruct(name, number, position, direction / np.linalg.norm(direction), rotation)


def _text(value: Any) -> str:  # noqa: ANN401 - scipy's array of characters
    flat = np.asarray(value).reshape(-1)
    return str(flat[0]) if flat.size == 1 and flat.dtype.kind in 'US' else ''


def _numbers(value: Any, count: int) -> NDArray[np.float64] | None:  # noqa: ANN401 - scipy's array
    """Return finite numbers, or None where they are not those."""
    array = np.asarray(value)
    if array.size != count or array.dtype.kind not in 'iuf' or not np.isfinite(array).all():
        return None
    return array.astype(np.float64).reshape(-1)


def _read_annotations(files: SceneFiles) -> None:
    path = files.folder / ANNOTATIONS
    try:
        text = path.read_text(encoding='utf-8', errors='replace')
    except OSError:
        files.problems.append(f'{ANNOTATIONS} is missing, so there are no boxes and no moves.')
        return
    entries: Any
    try:
        entries = json.loads(text)
    except ValueError as error:
        entries = _whole_entries(text)
        files.problems.append(
            f'{ANNOTATIONS} is cut or broken ({error}); {len(entries)} of its images can be used.'
        )
    if not isinstance(entries, dict):
        files.problems.append(f'{ANNOTATIONS} holds no table of images.')
        return
    broken = []
    for name, entry in entries.items():
        annotation = _annotation(entry)
        if annotation is None:
            broken.append(name)
        else:
            files.annotations[name] = annotation
    if broken:
        files.problems.append(f'{ANNOTATIONS} says nothing usable of images: {some_of(broken)}.')
    _compare_annotations(files, entries)


def _compare_annotations(files: SceneFiles, entries: Iterable[str]) -> None:
    """Compare pointers and boxes with the images."""
    known = files.named or set(files.colors)
    without = sorted(known - set(entries))
    if without:
        files.problems.append(f'Images without an entry in {ANNOTATIONS}: {some_of(without)}.')
    dangling = [
        f'{move} of {name} to {target}'
        for name, annotation in files.annotations.items()
        for move, target in annotation.moves.items()
        if target not in known
    ]
    if dangling and known:
        files.problems.append(f'Moves that lead to no image: {some_of(dangling)}.')
    still = [
        name
        for name, annotation in files.annotations.items()
        if not all(move in annotation.moves for move in ROTATIONS)
    ]
    if still:
        files.problems.append(f'Images from which one can not turn both ways: {some_of(still)}.')


def _whole_entries(text: str) -> dict[str, Any]:
    """Return the entries of a JSON object that come before the place where it breaks."""
    decoder = json.JSONDecoder()
    entries: dict[str, Any] = {}
    place = text.find('{') + 1
    pattern = re.compile(r'[\s,]*("[^"]*")\s*:\s*')
    while place and (match := pattern.match(text, place)):
        try:
            value, place = decoder.raw_decode(text, match.end())
        except ValueError:
            break
        entries[match[1][1:-1]] = value
    return entries


def _annotation(entry: Any) -> Annotation | None:  # noqa: ANN401 - whatever the file holds
    if not isinstance(entry, dict):
        return None
    boxes = entry.get('bounding_boxes', [])
    try:
        table = np.array(boxes, dtype=np.float64).reshape(-1, BOX_VALUES)
    except (TypeError, ValueError):
        return None
    if not isinstance(boxes, list) or not np.isfinite(table).all():
        return None
    moves = {move: entry.get(move, '') for move in MOVES}
    if not all(isinstance(target, str) for target in moves.values()):
        return None
    return Annotation(
        table.astype(np.int64), {move: target for move, target in moves.items() if target}
    )


def _read_lens(files: SceneFiles) -> None:
    """Read `cameras.txt`: COLMAP's line of a camera after lines of comment."""
    path = files.folder / CAMERAS
    default = 'the lens of Home_001_1 is taken'
    if not path.is_file():
        files.guesses.append(f'{CAMERAS} is missing: {default}.')
        return
    lines = path.read_text(encoding='utf-8', errors='replace').splitlines()
    tokens = next((line.split() for line in lines if line.strip() and line[0] != '#'), [])
    distortion = {'OPENCV_FISHEYE': 4, 'PINHOLE': 0}.get(tokens[1] if len(tokens) > 1 else '')
    try:
        values = [float(token) for token in tokens[2:]]
    except ValueError:
        values = []
    if distortion is None or len(values) != BOX_VALUES + distortion:
        files.problems.append(
            f'{CAMERAS} has no line of an OPENCV_FISHEYE or PINHOLE camera: {default}.'
        )
    elif not all(math.isfinite(value) for value in values) or min(values[:4]) <= 0:
        files.problems.append(f'{CAMERAS} holds a camera that can not be: {default}.')
    else:
        files.lens = Lens(int(values[0]), int(values[1]), *values[2:])


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).split('\n', maxsplit=1)[0].rstrip('.')
