"""Maps and clouds as files that other programs read."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from bev_mapper.evidence_grid import OCCUPIED_FROM
from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from bev_mapper.voxel_cloud import CloudPoints
    from gridnav.grid import GridGeometry

FREE_GREY, OCCUPIED_GREY, UNKNOWN_GREY = 254, 0, 205
"""As Nav2's map saver has them."""

POINT = np.dtype(
    [(name, '<f4') for name in 'xyz']
    + [(name, 'u1') for name in ('red', 'green', 'blue', 'label')]
)


def save_map(folder: Path, occupancy: NDArray[np.int8], geometry: GridGeometry) -> None:
    """Write ``map.pgm`` and ``map.yaml`` for a map server.

    Args:
        folder: An existing folder.
        occupancy: -1 unknown, 0 free, 100 obstacle, (H, W).
        geometry: Where the map lies.
    """
    grey = np.full(occupancy.shape, UNKNOWN_GREY, dtype=np.uint8)
    grey[occupancy == FREE_VALUE] = FREE_GREY
    grey[occupancy == OCCUPIED_VALUE] = OCCUPIED_GREY
    head = f'P5\n{geometry.cols} {geometry.rows}\n255\n'.encode()
    _write(folder / 'map.pgm', head + grey[::-1].tobytes())
    settings = (
        'image: map.pgm\n'
        'mode: trinary\n'
        f'resolution: {geometry.resolution:.9g}\n'
        f'origin: [{geometry.origin_x:.9g}, {geometry.origin_y:.9g}, 0.0]\n'
        'negate: 0\n'
        f'occupied_thresh: {OCCUPIED_FROM}\n'
        # Below the share of black in the grey of what is unknown.
        'free_thresh: 0.196\n'
    )
    _write(folder / 'map.yaml', settings.encode())


def save_cloud(folder: Path, cloud: CloudPoints) -> None:
    """Write ``cloud.ply``: x, y, z in metres, colour, and label as in `gridnav.rgbd.CLASSES`."""
    points = np.empty(len(cloud.labels), dtype=POINT)
    for axis, name in enumerate('xyz'):
        points[name] = cloud.positions[:, axis]
    for channel, name in enumerate(('red', 'green', 'blue')):
        points[name] = cloud.colors[:, channel]
    points['label'] = cloud.labels
    lines = [
        'ply',
        'format binary_little_endian 1.0',
        f'element vertex {len(points)}',
        *(f'property float {name}' for name in 'xyz'),
        *(f'property uchar {name}' for name in ('red', 'green', 'blue', 'label')),
        'end_header\n',
    ]
    _write(folder / 'cloud.ply', '\n'.join(lines).encode() + points.tobytes())


def _write(path: Path, content: bytes) -> None:
    """Write a file, which is there as a whole or as it was before."""
    part = path.with_name(f'.{path.name}.{os.getpid()}.part')
    try:
        part.write_bytes(content)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
