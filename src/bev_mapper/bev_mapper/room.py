"""Frames of a simple furnished room, to measure and to test with."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gridnav.rgbd import CLASSES, Camera, CameraMount, Pose3D, RgbdFrame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Point = tuple[float, float, float]

MOUNT = CameraMount(z=1.2, pitch=0.35)
"""A camera at the height of a table's lamp that looks down a little."""

FLOOR, CEILING, WALL = (CLASSES.index(name) for name in ('floor', 'ceiling', 'wall'))

SHADES = np.random.default_rng(5).integers(60, 230, (len(CLASSES), 3))
"""A colour for each class."""

TILE_M = 0.25
"""Side of the squares of the pattern on everything."""


class Box(NamedTuple):
    """Something with six sides, from its lowest to its highest corner in metres."""

    low: Point
    high: Point
    label: int


ROOM = Box((-3.0, -2.5, 0.0), (3.0, 2.5, 2.6), WALL)
"""What holds everything."""


def table(x: float, y: float) -> list[Box]:
    """Return a table of 1.2 m x 0.8 m on legs of 5 cm, by its middle."""
    kind = CLASSES.index('table')
    top = Box((x - 0.6, y - 0.4, 0.7), (x + 0.6, y + 0.4, 0.74), kind)
    legs = [
        Box((x + a - 0.025, y + b - 0.025, 0.0), (x + a + 0.025, y + b + 0.025, 0.7), kind)
        for a in (-0.55, 0.55)
        for b in (-0.35, 0.35)
    ]
    return [top, *legs]


def chair(x: float, y: float) -> list[Box]:
    """Return a chair of 0.4 m on legs of 3 cm, by its middle."""
    kind = CLASSES.index('chair')
    seat = Box((x - 0.2, y - 0.2, 0.43), (x + 0.2, y + 0.2, 0.47), kind)
    back = Box((x - 0.2, y + 0.17, 0.47), (x + 0.2, y + 0.2, 0.9), kind)
    legs = [
        Box((x + a - 0.015, y + b - 0.015, 0.0), (x + a + 0.015, y + b + 0.015, 0.43), kind)
        for a in (-0.18, 0.18)
        for b in (-0.18, 0.18)
    ]
    return [seat, back, *legs]


FURNITURE = (
    *table(0.6, 0.5),
    *chair(0.6, -0.4),
    Box((-3.0, 1.2, 0.0), (-2.5, 2.5, 1.9), CLASSES.index('bookcase')),
    Box((1.2, -2.5, 0.0), (2.9, -1.7, 0.7), CLASSES.index('sofa')),
    Box((-2.3, -1.5, 0.0), (-2.0, -1.2, 0.35), CLASSES.index('clutter')),
)


def walk(number: int, frames: int) -> Pose3D:
    """Return where the camera is in one of many frames: it turns as it goes round the room."""
    part = number / frames
    angle = 2 * np.pi * part
    x, y = -0.9 + 0.8 * np.cos(angle), 0.9 * np.sin(angle)
    yaw = 5 * angle
    return Pose3D(
        float(x), float(y), 0.0, 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
    )


def render(
    camera: Camera,
    pose: Pose3D,
    stamp: int = 0,
    *,
    mount: CameraMount = MOUNT,
    things: tuple[Box, ...] = FURNITURE,
    room: Box = ROOM,
) -> RgbdFrame:
    """Return what a camera sees of a room, with true labels and depth in millimetres."""
    camera_to_map = pose.matrix() @ mount.matrix()
    across = (np.arange(camera.width) - camera.cx) / camera.fx
    down = (np.arange(camera.height) - camera.cy) / camera.fy
    # As long as the optical axis is until depth 1, so that what is found is the depth.
    ways = np.stack(
        [x * across + (y * down)[:, None] + z for x, y, z in camera_to_map[:3, :3]]
    ).astype(np.float32)
    ways[np.abs(ways) < 1e-9] = 1e-9  # noqa: PLR2004 - keeps their inverses finite
    start = camera_to_map[:3, 3].astype(np.float32)[:, None, None]

    far = np.maximum(*((np.reshape(end, (3, 1, 1)) - start) / ways for end in room[:2]))
    depth = far.min(axis=0)
    sides = far.argmin(axis=0)
    labels = np.where(sides < 2, WALL, np.where(ways[2] < 0, FLOOR, CEILING))  # noqa: PLR2004
    labels = labels.astype(np.uint8)
    for thing in things:
        window = _window(thing, camera, camera_to_map)
        near, away = (
            (np.reshape(end, (3, 1, 1)).astype(np.float32) - start) / ways[:, *window]
            for end in thing[:2]
        )
        enter = np.minimum(near, away).max(axis=0)
        hit = (enter < np.maximum(near, away).min(axis=0)) & (enter > 0) & (enter < depth[window])
        depth[window][hit] = enter[hit]
        labels[window][hit] = thing.label
    places = start + ways * depth
    pattern = (np.floor(places / TILE_M + 0.01).sum(axis=0) % 2).astype(np.int64)
    color = (SHADES[labels] * (5 + pattern[..., None]) // 6).astype(np.uint8)
    return RgbdFrame(
        name=f'frame {stamp}',
        stamp=stamp,
        color=color,
        depth=np.rint(1000 * depth).astype(np.uint16),
        camera=camera,
        pose=pose,
        mount=mount,
        labels=labels,
    )


def _window(thing: Box, camera: Camera, camera_to_map: NDArray[np.float64]) -> tuple[slice, slice]:
    """Return the rows and columns of the picture in which a thing may be."""
    corners = np.array(np.meshgrid(*zip(*thing[:2], strict=True))).reshape(3, -1)
    places = camera_to_map[:3, :3].T @ (corners - camera_to_map[:3, 3:])
    if places[2].min() < 0.05:  # noqa: PLR2004 - behind the camera
        return slice(None), slice(None)
    columns = camera.fx * places[0] / places[2] + camera.cx
    rows = camera.fy * places[1] / places[2] + camera.cy
    low, high = np.floor([rows.min(), columns.min()]), np.ceil([rows.max(), columns.max()])
    top, left = np.maximum(low, 0).astype(int).tolist()
    bottom, right = np.maximum(high + 1, 0).astype(int).tolist()
    return slice(top, bottom), slice(left, right)
