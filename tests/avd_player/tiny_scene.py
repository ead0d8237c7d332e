"""A tiny scene of the Active Vision Dataset, rendered: a bare room with a bottle in it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image
from scipy.io import savemat

from avd_player.avd_format import (
    ANNOTATIONS,
    CAMERAS,
    COLOR_FOLDER,
    DEFAULT_LENS,
    DEPTH_FOLDER,
    GRID_M,
    LABEL_FOLDER,
    MOVES,
    STRUCT_FIELDS,
    STRUCTS,
    VIEWS,
    depth_name,
)
from gridnav.rgbd import CLASSES, UNLABELLED, CameraMount, Pose3D

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

LENS = DEFAULT_LENS.resized(192, 108)
SCALE = 389.0
"""Millimetres in a unit of the reconstruction."""

ROOM = np.array([[-2.0, -1.8, 0.0], [2.9, 2.4, 2.4]])
BOTTLE = np.array([[1.45, 0.2, 0.6], [1.55, 0.3, 0.9]])
"""Lowest and highest corner, metres in the truth: z up, positions on multiples of 0.30 m."""

TARGET = 5
GRID = [(col, row) for row in range(2) for col in range(3)]
"""Columns and rows of the positions unless said otherwise."""

COLORS = np.array(
    [[200, 80, 80], [80, 200, 80], [150, 110, 70], [80, 80, 200], [200, 200, 80], [240, 240, 240]]
)
SURFACES = ('wall', 'wall', 'floor', 'wall', 'wall', 'ceiling')
DIFFICULTY = ((300, 100), (200, 75), (100, 50), (50, 30))


@dataclass
class TinyScene:
    """A scene that was written, and the truth about it.

    Attributes:
        folder: Where it lies.
        names: File names of its colour images, in order.
        camera_to_truth: Of each image, (4, 4).
        world_from_truth: What the scene's world is, in metres, (4, 4).
        cells: Column and row of each position.
    """

    folder: Path
    names: list[str] = field(default_factory=list)
    camera_to_truth: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    world_from_truth: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    cells: list[tuple[int, int]] = field(default_factory=list)


def write_scene(
    folder: Path,
    *,
    cells: list[tuple[int, int]] | None = None,
    mount: CameraMount | None = None,
    unregistered: tuple[int, ...] = (5, 17),
    cameras: bool = True,
    labels: bool = False,
    jitter: float = 0.0,
) -> TinyScene:
    """Write a scene.

    Args:
        folder: Named as a scene.
        cells: Column and row of each position.
        mount: Of the camera.
        unregistered: Numbers of the images without R and t, from 0.
        cameras: Whether there is a cameras.txt.
        labels: Whether there are label images.
        jitter: Standard deviation of the positions, metres.
    """
    scene = TinyScene(folder, cells=cells or GRID, world_from_truth=_world())
    mount = mount or CameraMount(z=1.1, pitch=0.2)
    rng = np.random.default_rng(0)
    for item in (COLOR_FOLDER, DEPTH_FOLDER, *([LABEL_FOLDER] if labels else [])):
        (folder / item).mkdir(parents=True)
    boxes = {}
    for cluster, (col, row) in enumerate(scene.cells):
        x, y = np.array([col, row]) * GRID_M + rng.normal(0.0, jitter or 0.0, 2)
        for view in range(VIEWS):
            index = cluster * VIEWS + view + 1
            name = f'00011{index:06d}0101.jpg'
            yaw = 0.2 + 2 * math.pi * view / VIEWS
            pose = Pose3D(x, y, 0.0, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
            matrix = pose.matrix() @ mount.matrix()
            scene.names.append(name)
            scene.camera_to_truth[name] = matrix
            color, depth, surface = render(matrix)
            Image.fromarray(color).save(folder / COLOR_FOLDER / name, quality=95)
            Image.fromarray(depth).save(folder / DEPTH_FOLDER / depth_name(name))
            if labels:
                Image.fromarray(surface).save(folder / LABEL_FOLDER / f'{name[:15]}.png')
            boxes[name] = _box(surface == CLASSES.index('clutter'))
    if cameras:
        values = ' '.join(f'{value:.9g}' for value in LENS[2:])
        (folder / CAMERAS).write_text(
            f'# Camera list\n# one\n# two\n1 OPENCV_FISHEYE 192 108 {values}\n', encoding='utf-8'
        )
    moves = _moves(scene)
    entries = {name: {'bounding_boxes': boxes[name], **moves[name]} for name in scene.names}
    (folder / ANNOTATIONS).write_text(json.dumps(entries, indent=1), encoding='utf-8')
    write_structs(scene, unregistered)
    return scene


def write_structs(
    scene: TinyScene, unregistered: tuple[int, ...] = (), scale: float = SCALE
) -> None:
    """Write `image_structs.mat`."""
    unit = SCALE / 1000
    table = np.zeros((1, len(scene.names)), dtype=[(name, object) for name in STRUCT_FIELDS])
    empty = np.zeros((0, 0))
    for index, name in enumerate(scene.names):
        camera_to_world = scene.world_from_truth @ scene.camera_to_truth[name]
        rotation = camera_to_world[:3, :3].T
        position = camera_to_world[:3, 3] / unit
        row: dict[str, Any] = dict.fromkeys(STRUCT_FIELDS, -1.0)
        row |= {
            'image_name': name,
            't': (-rotation @ position)[:, None],
            'R': rotation,
            'world_pos': position[:, None],
            'direction': rotation[2][:, None],
            'quat': np.array([[1.0], [0.0], [0.0], [0.0]]),
            'scaled_world_pos': np.zeros((3, 1)),
            'image_id': str(index + 1),
            'camera_id': '1',
            'cluster_id': float(index // VIEWS),
        }
        if index in unregistered:
            row |= {'t': empty, 'R': empty, 'quat': empty, 'image_id': '', 'camera_id': ''}
        table[0, index] = tuple(row[field_name] for field_name in STRUCT_FIELDS)
    savemat(scene.folder / STRUCTS, {'image_structs': table, 'scale': scale})


def render(
    camera_to_truth: NDArray[np.float64],
) -> tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.uint8]]:
    """Return colour (H, W, 3), depth in mm (H, W) and labels (H, W) as the lens sees the room."""
    u, v = np.meshgrid(np.arange(LENS.width) + 0.5, np.arange(LENS.height) + 0.5)
    rays = np.dstack((LENS.unproject(np.dstack((u, v))), np.ones_like(u)))
    # A ray has z = 1, so that its length is the depth.
    rays = rays @ camera_to_truth[:3, :3].T
    origin = camera_to_truth[:3, 3]
    with np.errstate(divide='ignore'):
        walls = np.concatenate([(ROOM[0] - origin) / rays, (ROOM[1] - origin) / rays], axis=-1)
        sides = np.stack([(BOTTLE[0] - origin) / rays, (BOTTLE[1] - origin) / rays])
    walls[walls <= 0] = np.inf
    surface = walls.argmin(axis=-1)
    z = walls.min(axis=-1)
    near, far = sides.min(axis=0).max(axis=-1), sides.max(axis=0).min(axis=-1)
    on_bottle = (near < far) & (near > 0) & (near < z)
    z = np.where(on_bottle, near, z)
    points = origin + rays * z[..., None]
    checks = (np.floor(points / 0.25).sum(axis=-1) % 2 * 40).astype(np.int64)
    color = COLORS[surface] - checks[..., None]
    color[on_bottle] = 20, 20, 20
    classes = np.array([CLASSES.index(name) for name in SURFACES], dtype=np.uint8)[surface]
    classes[on_bottle] = CLASSES.index('clutter')
    depth = np.rint(z * 1000).astype(np.uint16)
    depth[:, :4] = depth[:, -4:] = 0
    classes[:2] = UNLABELLED
    return color.astype(np.uint8), depth, classes


def _world() -> NDArray[np.float64]:
    """Return a world that is turned, tilted and has y down, metres."""
    yaw, tilt = 0.3, 0.035
    turn = np.array(
        [[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]
    )
    lean = np.array(
        [[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]]
    )
    y_down = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    world = np.eye(4)
    world[:3, :3] = lean @ y_down @ turn
    world[:3, 3] = 0.7, -0.4, 1.9
    return world


def _box(bottle: NDArray[np.bool_]) -> list[list[int]]:
    """Return the box of what is seen of the bottle, as the annotations have it."""
    rows, columns = np.nonzero(bottle)
    if len(rows) < 2:
        return []
    corners = [int(value) for value in (columns.min(), rows.min(), columns.max(), rows.max())]
    full = 1920 / LENS.width
    sides = sorted(((corners[2] - corners[0] + 1) * full, (corners[3] - corners[1] + 1) * full))
    difficulty = 1 + sum(sides[1] < long or sides[0] < short for long, short in DIFFICULTY)
    return [[*corners, TARGET, difficulty]]


def _moves(scene: TinyScene) -> dict[str, dict[str, str]]:
    """Return the pointers by the dataset's rule: 10 degrees, 30 degrees, 750 mm."""
    matrices = [scene.camera_to_truth[name] for name in scene.names]
    places = np.array([matrix[:2, 3] for matrix in matrices])
    yaws = np.array([math.atan2(matrix[1, 2], matrix[0, 2]) for matrix in matrices])
    moves: dict[str, dict[str, str]] = {}
    for index, name in enumerate(scene.names):
        first = index // VIEWS * VIEWS
        pointers = dict.fromkeys(MOVES, '')
        pointers['rotate_ccw'] = scene.names[first + (index - first + 1) % VIEWS]
        pointers['rotate_cw'] = scene.names[first + (index - first - 1) % VIEWS]
        apart = places - places[index]
        lengths = np.hypot(*apart.T)
        bearings = np.arctan2(apart[:, 1], apart[:, 0]) - yaws[index]
        same = (np.cos(yaws - yaws[index]) > math.cos(math.radians(10))) & (lengths > 1e-6)
        for move, angle in (('forward', 0), ('backward', 180), ('left', 90), ('right', -90)):
            towards = np.cos(bearings - math.radians(angle)) >= math.cos(math.radians(30))
            candidates = np.flatnonzero(same & towards & (lengths < 0.75))
            if len(candidates):
                pointers[move] = scene.names[candidates[lengths[candidates].argmin()]]
        moves[name] = pointers
    return moves
