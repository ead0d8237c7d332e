"""What a home is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from avd_player.homes.layout import Layout
    from avd_player.homes.light import Light
    from avd_player.homes.mesh import Mesh
    from avd_player.homes.textures import Material

FREE, OCCUPIED, OUTSIDE = 0, 1, 2
"""Cells of the true plan."""


class Thing(NamedTuple):
    """Something that is looked for.

    Attributes:
        number: Its instance, as in `INSTANCES`.
        center: Its middle in metres.
        points: Places on its surface and the normals there, (N, 6).
    """

    number: int
    center: tuple[float, float, float]
    points: NDArray[np.float32]


class TruePlan(NamedTuple):
    """What is where between the heights of 0.05 and 1.5 m.

    Attributes:
        cells: `FREE`, `OCCUPIED` or `OUTSIDE`; row 0 is the southern edge, uint8 (H, W).
        x: Western edge in metres.
        y: Southern edge in metres.
        resolution: Side of the cells in metres.
    """

    cells: NDArray[np.uint8]
    x: float
    y: float
    resolution: float


@dataclass(frozen=True)
class Home:
    """A furnished flat; z is up, 0 the floor, lengths in metres.

    Attributes:
        layout: Rooms and openings.
        mesh: All of its surfaces.
        materials: What they look like.
        lights: Lamps that are on, and windows.
        things: What can be looked for; the bottle is the first of them.
        positions: Where the robot can stand, in the order of y, then x, (P, 2).
        moves: Position that each of the eight steps of `gridnav.actions` leads to, or -1 where
            the way isn't free, (P, 8).
        plan: What is where.
        camera_height: Metres.
        camera_pitch: How far the camera looks down, radians.
    """

    layout: Layout
    mesh: Mesh
    materials: tuple[Material, ...]
    lights: tuple[Light, ...]
    things: tuple[Thing, ...]
    positions: NDArray[np.float64]
    moves: NDArray[np.int64]
    plan: TruePlan
    camera_height: float
    camera_pitch: float
