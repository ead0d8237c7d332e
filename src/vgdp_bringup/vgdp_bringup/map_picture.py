"""A picture of a map and of the cloud it was made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gridnav.partial_map import UNKNOWN_VALUE
from gridnav.rgbd import CLASSES
from vgdp_experiments.plots import draw_map

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from bev_mapper.voxel_cloud import CloudPoints
    from vgdp_bringup.mapping import Mapping

PATH, START = '#3b7dd8', '#d64545'
BACKGROUND = 255
CUT_M = 1.9
"""The cloud is drawn up to this height, as if the ceiling were taken off."""

MARGIN_M = 0.3
PANEL_INCHES = 6.0
SIMPLE = 3
"""With no more classes than this a panel of classes would show nothing that the plan does not."""


def save_picture(mapping: Mapping, path: Path) -> None:
    """Draw the floor plan, the cloud from above and, where there are some, its classes."""
    cloud = mapping.mapper.cloud.points()
    labels = np.unique(cloud.labels[cloud.labels < len(CLASSES)])
    panels = 2 + (len(labels) > SIMPLE)
    west, east, south, north = _extent(mapping)
    height = PANEL_INCHES * (north - south) / (east - west)
    figure = Figure(figsize=(panels * PANEL_INCHES, min(max(height, 2.5), 12.0) + 0.9))
    axes = figure.subplots(1, panels, squeeze=False, sharey=True)[0]
    _draw_plan(axes[0], mapping)
    voxel = mapping.mapper.cloud.voxel
    _draw_cloud(axes[1], cloud, cloud.colors, voxel)
    axes[1].set_title('cloud from above, without ceiling')
    if panels > 2:  # noqa: PLR2004
        _draw_classes(axes[2], cloud, labels.tolist(), voxel)
    for each in axes:
        each.set(xlim=(west, east), ylim=(south, north), aspect='equal', xlabel='x (m)')
        each.spines[:].set_color('#8a93a3')
    axes[0].set_ylabel('y (m)')
    figure.tight_layout()
    FigureCanvasAgg(figure).print_png(str(path))


def _extent(mapping: Mapping) -> tuple[float, float, float, float]:
    """Return west, east, south and north of what is known and of the way, in metres."""
    grid, geometry = mapping.mapper.grid, mapping.mapper.grid.geometry
    rows, cols = np.nonzero(grid.occupancy != UNKNOWN_VALUE)
    if not len(rows):
        rows, cols = np.array([0, geometry.rows - 1]), np.array([0, geometry.cols - 1])
    corners = [
        geometry.center_of(int(rows.min()), int(cols.min())),
        geometry.center_of(int(rows.max()), int(cols.max())),
    ]
    x, y = np.array([*corners, *mapping.way]).T
    west, south = float(x.min()), float(y.min())
    east, north = float(x.max()), float(y.max())
    return west - MARGIN_M, east + MARGIN_M, south - MARGIN_M, north + MARGIN_M


def _draw_plan(axes: Axes, mapping: Mapping) -> None:
    grid = mapping.mapper.grid
    draw_map(axes, grid.occupancy, grid.geometry)
    if mapping.way:
        x, y = zip(*mapping.way, strict=True)
        axes.plot(x, y, '.-', color=PATH, linewidth=1.2, markersize=4, label='camera')
        axes.plot(x[0], y[0], 'o', color=START, markersize=6, label='start')
        axes.legend(loc='lower right', fontsize=8, framealpha=0.7)
    axes.set_title(
        f'{mapping.name}: floor plan, cells of {100 * grid.geometry.resolution:g} cm '
        f'({mapping.mapper.segmenter})'
    )


def _draw_cloud(axes: Axes, cloud: CloudPoints, colors: NDArray[np.uint8], voxel: float) -> None:
    """Draw the highest point of each column below the cut, in its colour."""
    shown = np.flatnonzero(cloud.positions[:, 2] < CUT_M)
    if not len(shown):
        return
    shown = shown[np.argsort(cloud.positions[shown, 2], kind='stable')]
    cells = np.floor(cloud.positions[shown, :2] / voxel).astype(np.int64)
    low = cells.min(axis=0)
    cols, rows = (cells - low).T
    picture = np.full((rows.max() + 1, cols.max() + 1, 3), BACKGROUND, dtype=np.uint8)
    picture[rows, cols] = colors[shown]
    west, south = low * voxel
    extent = (west, west + picture.shape[1] * voxel, south, south + picture.shape[0] * voxel)
    axes.imshow(picture, origin='lower', extent=extent, interpolation='nearest')


def _draw_classes(axes: Axes, cloud: CloudPoints, labels: list[int], voxel: float) -> None:
    table = np.full((256, 3), BACKGROUND, dtype=np.uint8)
    table[: len(CLASSES)] = (255 * colormaps['tab20'](range(len(CLASSES)))[:, :3]).astype(np.uint8)
    _draw_cloud(axes, cloud, table[cloud.labels], voxel)
    patches = [Patch(color=tuple(table[label] / 255), label=CLASSES[label]) for label in labels]
    axes.legend(handles=patches, loc='lower right', fontsize=8, ncols=2)
    axes.set_title('classes from above')
