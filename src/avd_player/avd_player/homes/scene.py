"""A home as a scan of the Active Vision Dataset: its images, their poses, links and boxes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from avd_player.avd_format import DEFAULT_LENS, TRANSLATIONS
from avd_player.homes.noise import DepthNoise, add_noise
from avd_player.homes.plan import POSITIONS, draw_home
from avd_player.homes.render import HomeRenderer
from gridnav.rgbd import CameraMount

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avd_player.homes.home import Home
    from avd_player.homes.render import Picture

HEADINGS = 12
"""Images at each position, counter-clockwise."""

FULL_SIZE = (1920, 1080)
"""Width and height of AVD's own images; difficulties count pixels of theirs."""

SCAN_LENS = DEFAULT_LENS._replace(cx=DEFAULT_LENS.cx + 0.5, cy=DEFAULT_LENS.cy + 0.5)
"""The lens of AVD's Home_001_1, but for half a pixel at full size."""

MIN_VISIBLE = 0.3
"""Share of a thing's side towards the camera that must be seen for a box."""

MIN_PIXELS = 8
"""A box holds at least so many pixels of its thing."""

MIN_BOX = (40.0, 12.0)
"""Longer and shorter side of the smallest box, in pixels of AVD's own images."""

DIFFICULTIES = ((300, 100), (200, 75), (100, 50), (50, 30))
"""Longer and shorter sides from which on a box is of difficulty 1, 2, 3, 4; others are of 5."""

_BEARINGS = np.radians([0.0, 180.0, 90.0, -90.0])
MOVE_BEARING = np.radians(30.0)
"""A move's way is so close to its nominal direction."""

SURFACE = 0.03
"""A point is seen when the depth there is its own up to this, metres."""

UNREGISTERED = 0.004
"""Share of the images that have no pose of their own, as in real scans."""


@dataclass(frozen=True)
class SceneSettings:
    """What a scan is like, besides its seed and number.

    Attributes:
        width: Pixels.
        height: Pixels.
        positions: At most so many.
        jitter: 1 for the small errors of a good scan in the robot's poses, 0 for none; also
            whether a few images have no pose.
        noise: Errors of the depth images.
    """

    width: int = 480
    height: int = 270
    positions: int = POSITIONS
    jitter: float = 1.0
    noise: DepthNoise = field(default_factory=DepthNoise)

    def __post_init__(self) -> None:
        """Refuse what can't be drawn."""
        if not (16 <= self.width <= FULL_SIZE[0] and 16 <= self.height <= FULL_SIZE[1]):  # noqa: PLR2004
            msg = f'Images have 16 x 16 to 1920 x 1080 pixels, not {self.width} x {self.height}.'
            raise ValueError(msg)
        if not 0.0 <= self.jitter <= 10.0:  # noqa: PLR2004
            msg = f'jitter is from 0 to 10, not {self.jitter:g}.'
            raise ValueError(msg)

    def as_dict(self) -> dict[str, Any]:
        """Return them as JSON has them."""
        return asdict(self)


class Box(NamedTuple):
    """Where a thing is seen, in pixels of the image; the edges belong to it."""

    xmin: int
    ymin: int
    xmax: int
    ymax: int
    instance: int
    difficulty: int


class Shot(NamedTuple):
    """What an image of a scan holds.

    Attributes:
        rgb: uint8 (H, W, 3).
        depth: Millimetres, uint16 (H, W).
        labels: True classes, uint8 (H, W).
        boxes: The things that are seen well enough.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.uint16]
    labels: NDArray[np.uint8]
    boxes: list[Box]


class Scan:
    """A home and the poses from which it is scanned.

    Attributes:
        seed: Of the set of homes.
        number: Of the home, from 1.
        settings: What the scan is like.
        home: The home.
        lens: Of the camera.
        poses: What takes points of the optical frames into the home's, (N, 4, 4). Twelve images
            at each of the home's positions, in their order.
        to_home: What takes points of the scan's frame (metres, y down) to the home's, (4, 4).
        scale: Millimetres per unit of the scan's frame.
        registered: Which images have poses, (N,).
    """

    def __init__(self, seed: int, number: int, settings: SceneSettings) -> None:
        """Draw the home and the poses.

        Raises:
            ValueError: If no such home was found, or open3d is missing.
        """
        self.seed, self.number, self.settings = seed, number, settings
        self.home: Home = draw_home([seed, number], positions=settings.positions)
        self.lens = SCAN_LENS.resized(settings.width, settings.height)
        rng = np.random.default_rng([seed, number, 1])
        self.poses = _poses(self.home, rng, settings.jitter)
        tilt = Rotation.from_euler(
            'xz', np.radians(rng.uniform(1.0, 2.2, 2)) * rng.choice([-1, 1], 2)
        ).as_matrix()
        to_home = np.eye(4)
        # The scan's y points down and its z is the home's y, but for a tilt.
        to_home[:3, :3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) @ tilt.T
        to_home[:3, 3] = -to_home[:3, :3] @ rng.uniform(-3.0, 3.0, 3)
        self.to_home = to_home
        self.scale = float(rng.integers(350, 900))
        self.registered = rng.random(len(self.poses)) >= (UNREGISTERED if settings.jitter else 0)
        for start in range(0, len(self.poses), HEADINGS):
            if (~self.registered[start : start + HEADINGS]).sum() > 1:
                self.registered[start : start + HEADINGS] = True
        self._renderer: HomeRenderer | None = None

    def shoot(self, index: int) -> Shot:
        """Take an image.

        Args:
            index: Of the image, from 0.
        """
        if self._renderer is None:
            self._renderer = HomeRenderer(self.home, self.lens)
        pose = self.poses[index]
        picture = self._renderer.render(pose)
        millimetres = np.round(picture.depth * np.float32(1000.0))
        depth = np.where(millimetres < 65536, millimetres, 0).astype(np.uint16)  # noqa: PLR2004
        if self.settings.noise != DepthNoise():
            rng = np.random.default_rng([self.seed, self.number, 2, index])
            depth = add_noise(depth, self.settings.noise, rng, picture.rgb)
        return Shot(picture.rgb, depth, picture.labels, self._boxes(picture, pose))

    def _boxes(self, picture: Picture, pose: NDArray[np.float64]) -> list[Box]:
        """Return a box for each thing that is seen well enough."""
        best: dict[int, tuple[int, Box]] = {}
        for index in np.flatnonzero(np.bincount(picture.instances.ravel())).tolist():
            if index == 0:
                continue
            thing = self.home.things[index - 1]
            rows, columns = np.nonzero(picture.instances == index)
            left, right = int(columns.min()), int(columns.max())
            low, high = int(rows.min()), int(rows.max())
            across = (right - left + 1) * FULL_SIZE[0] / self.settings.width
            down = (high - low + 1) * FULL_SIZE[1] / self.settings.height
            long, short = max(across, down), min(across, down)
            if len(rows) < MIN_PIXELS or long < MIN_BOX[0] or short < MIN_BOX[1]:
                continue
            if self._visible(thing.points, picture, pose) < MIN_VISIBLE:
                continue
            difficulty = 1 + sum(long < least or short < less for least, less in DIFFICULTIES)
            box = Box(left, low, right, high, thing.number, difficulty)
            # A thing that the home has twice is never twice in one image.
            if thing.number not in best or best[thing.number][0] < len(rows):
                best[thing.number] = len(rows), box
        return [box for _, (_, box) in sorted(best.items())]

    def _visible(
        self, points: NDArray[np.float32], picture: Picture, pose: NDArray[np.float64]
    ) -> float:
        """Return the share of the surface towards the camera that is seen."""
        local = (points[:, :3] - pose[:3, 3]) @ pose[:3, :3]
        facing = ((pose[:3, 3] - points[:, :3]) * points[:, 3:]).sum(1) > 0
        local = local[facing & (local[:, 2] > 0.1)]  # noqa: PLR2004
        if not len(local):
            return 0.0
        pixels = self.lens.project(local[:, :2] / local[:, 2:])
        u, v = np.round(pixels - 0.5).astype(int).T
        inside = (u >= 0) & (u < self.settings.width) & (v >= 0) & (v < self.settings.height)
        seen = local[inside, 2] < picture.depth[v[inside], u[inside]] + SURFACE
        return float(seen.sum() / facing.sum())

    def scan_poses(self) -> NDArray[np.float64]:
        """Return the poses in the scan's frame, y down, in metres, (N, 4, 4)."""
        poses: NDArray[np.float64] = np.linalg.inv(self.to_home) @ self.poses
        return poses

    def links(self) -> dict[str, NDArray[np.int64]]:
        """Return the image that each move leads to from each image, -1 for none, each (N,).

        Turns go around the images of a position. As in AVD, the other moves lead to the nearest
        image with the same heading whose bearing is within 30° of where the move goes, but only
        where the robot can drive there straight.
        """
        count = len(self.poses)
        index = np.arange(count)
        position, turn = np.divmod(index, HEADINGS)
        links = {
            'rotate_ccw': position * HEADINGS + (turn + 1) % HEADINGS,
            'rotate_cw': position * HEADINGS + (turn - 1) % HEADINGS,
        }
        poses = self.scan_poses()
        place = poses[:, [0, 2], 3]
        heading = np.arctan2(poses[:, 2, 2], poses[:, 0, 2])
        neighbour = self.home.moves[position]
        candidate = np.where(neighbour >= 0, neighbour * HEADINGS + turn[:, None], index[:, None])
        way = place[candidate] - place[:, None]
        distance = np.where(neighbour >= 0, np.hypot(way[..., 0], way[..., 1]), np.inf)
        bearing = np.arctan2(way[..., 1], way[..., 0]) - heading[:, None]
        for name, nominal in zip(TRANSLATIONS, _BEARINGS.tolist(), strict=True):
            off = np.abs((bearing - nominal + np.pi) % (2 * np.pi) - np.pi)
            usable = np.where(off <= MOVE_BEARING + 1e-6, distance, np.inf)
            nearest = usable.argmin(1)
            found = np.isfinite(usable[index, nearest])
            links[name] = np.where(found, candidate[index, nearest], -1)
        return links


def _poses(home: Home, rng: np.random.Generator, jitter: float) -> NDArray[np.float64]:
    """Return the poses of the camera at all positions, (N, 4, 4)."""
    count = len(home.positions) * HEADINGS
    place = np.repeat(home.positions, HEADINGS, axis=0)
    place = place + jitter * rng.uniform(-0.007, 0.007, (count, 2))
    heading = np.tile(np.arange(HEADINGS) * 2 * np.pi / HEADINGS, len(home.positions))
    heading += np.radians(jitter * rng.uniform(-1.0, 1.0, count))
    poses = [
        CameraMount(x, y, home.camera_height, 0.0, home.camera_pitch, yaw).matrix()
        for (x, y), yaw in zip(place.tolist(), heading.tolist(), strict=True)
    ]
    return np.stack(poses)
