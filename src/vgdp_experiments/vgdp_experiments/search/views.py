"""Views made small: colour, depth, and where they were taken from."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from PIL import Image

from avd_player.sources.images import nearest_pixels
from bev_mapper.unprojection import depth_in_metres, unproject
from gridnav.rgbd import MILLIMETRE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from torch import Tensor

    from gridnav.rgbd import RgbdFrame

WIDTH, HEIGHT = 64, 36
"""Of small views in pixels."""

STRIDE = 4
"""Between the pixels whose points are kept."""

CHANNELS = 5
"""Of what a network reads of a view: colour, nearness, and whether there is depth."""


class SmallViews(NamedTuple):
    """What a robot sees from where it stands. V views.

    Attributes:
        color: RGB, uint8 (V, 36, 64, 3).
        depth: Millimetres, 0 where nothing was measured, uint16 (V, 36, 64).
        points: Where every fourth pixel of every fourth row is in the map, metres, NaN where
            nothing was measured, float32 (V, 9, 16, 3).
        bearings: Where the views look in the map, radians, float32 (V,).
    """

    color: NDArray[np.uint8]
    depth: NDArray[np.uint16]
    points: NDArray[np.float32]
    bearings: NDArray[np.float32]

    @classmethod
    def empty(cls, *shape: int) -> SmallViews:
        """Return views that show nothing and look nowhere."""
        return cls(
            np.zeros((*shape, HEIGHT, WIDTH, 3), dtype=np.uint8),
            np.zeros((*shape, HEIGHT, WIDTH), dtype=np.uint16),
            np.full((*shape, HEIGHT // STRIDE, WIDTH // STRIDE, 3), np.nan, dtype=np.float32),
            np.full(shape, np.nan, dtype=np.float32),
        )

    @classmethod
    def joined(cls, parts: Sequence[SmallViews]) -> SmallViews:
        """Return the views of several, one after the other."""
        return cls(*map(np.concatenate, zip(cls.empty(0), *parts, strict=True)))


def small_views(frames: Sequence[RgbdFrame]) -> SmallViews:
    """Shrink frames: colour by its mean, depth by single pixels, as a mean would cut corners."""
    made = SmallViews.empty(len(frames))
    for index, frame in enumerate(frames):
        picture = Image.fromarray(frame.color).resize((WIDTH, HEIGHT), Image.Resampling.BOX)
        made.color[index] = np.asarray(picture)
        camera = frame.camera.resized(WIDTH, HEIGHT)
        metres = nearest_pixels(depth_in_metres(frame.depth), camera)
        made.depth[index] = np.rint(metres / MILLIMETRE)
        to_map = frame.camera_to_map()
        places = np.moveaxis(unproject(metres, camera, to_map), 0, -1)
        places[metres == 0] = np.nan
        made.points[index] = places[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
        made.bearings[index] = np.arctan2(to_map[1, 2], to_map[0, 2])
    return made


def network_input(color: NDArray[np.uint8], depth: NDArray[np.uint16]) -> Tensor:
    """Return what a network reads of views (V, 36, 64, 3) and (V, 36, 64), (V, 5, 36, 64).

    Nearness is 1 / (1 + z) with z in metres, so that what is near is told apart best.
    """
    colors = torch.from_numpy(color).permute(0, 3, 1, 2).float() / 255 - 0.5
    metres = torch.from_numpy(depth.astype(np.float32) * MILLIMETRE)
    measured = (metres > 0).float()
    nearness = measured / (1 + metres)
    return torch.cat([colors, nearness[:, None], measured[:, None]], dim=1)
