"""What one can do in a scene: stand at positions, look around, move, and see things."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from tqdm import tqdm

from avd_player.avd_format import GRID_M, ROTATIONS, VIEWS, Annotation, read_instance_ids
from avd_player.sources.avd import AvdSource
from gridnav.actions import NUM_MOVES, STEPS
from gridnav.rgbd import FrameError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from gridnav.rgbd import RgbdFrame

MAX_LINK_M = 0.55
"""A step leads no further than this: a diagonal of the grid and what its positions are off it. The
dataset's own pointers lead up to 0.75 m, through thin walls too, as they were made from poses."""

MAX_OFF_GRID_M = 0.1
"""A position is on the grid if it is no further from it than this, in x and in y."""

MAX_OFF_COURSE = math.pi / 8
"""A move leads nowhere if no position lies nearer to its direction than this, in radians."""

RING_M = GRID_M / 2
"""Of the positions in the direction of a move, those that are further than the nearest by more
than this are left out."""

SAME_THING_M = 0.75
"""Sightings that are nearer to each other are of one thing."""

MIN_SEEN_SHARE = 0.1
"""What was seen less often than this share of the thing seen most often is a mistake."""

MISSES_A_SIGHTING = 4
"""So many looks at the place of a thing that do not show it speak against one that did."""

MIN_VALID_SHARE = 0.25
"""This much of the middle of a box must have depth."""

KEPT_BYTES = 256 * 1024**2
"""So much memory is taken by the latest frames."""

FRAME_BYTES = 5
"""Of colour and depth of a pixel."""

_PROGRESS_DELAY_S = 5.0

_BEARINGS = np.arctan2(STEPS[:, 0], STEPS[:, 1])
"""Direction of each move: rows grow to the north (y), columns to the east (x)."""


class Scene:
    """A scene of the Active Vision Dataset as a graph of positions.

    Letters in shapes: P positions.

    Attributes:
        source: The images.
        clusters: Number of each position in the dataset, P.
        views: File names of the images of each position, counter-clockwise, P lists.
    """

    def __init__(self, source: AvdSource, max_link: float = MAX_LINK_M) -> None:
        """Arrange the images by position.

        Args:
            source: The images.
            max_link: How far a step leads at most, in metres.
        """
        self.source = source
        self.max_link = max_link
        views: dict[int, list[str]] = {}
        for name in source.placed_names:
            views.setdefault(source.cluster_of(name), []).append(name)
        self.clusters = sorted(views)
        self.views: list[list[str]] = [views[cluster] for cluster in self.clusters]
        camera = source.camera
        kept = max(2 * VIEWS, KEPT_BYTES // (camera.width * camera.height * FRAME_BYTES))
        self._read = lru_cache(kept)(source.read)
        self._instances = read_instance_ids(source.files.folder)
        self._sightings: dict[tuple[str, int, int, float], NDArray[np.float64] | None] = {}

    @classmethod
    def open(cls, folder: Path, width: int = 0, max_link: float = MAX_LINK_M) -> Scene:
        """Open a folder; see `AvdSource` and the class for the arguments.

        Raises:
            FrameError: If it is no scene that can be used.
        """
        return cls(AvdSource(folder, width), max_link)

    @property
    def name(self) -> str:
        """The scene's name."""
        return self.source.name

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """Where the positions are in the map, metres, (P, 2)."""
        places = [
            np.median([self.source.camera_to_map(name)[:2, 3] for name in names], axis=0)
            for names in self.views
        ]
        return np.stack(places)

    @cached_property
    def headings(self) -> list[NDArray[np.float64]]:
        """Where the images of each position look, yaw in radians, P arrays."""
        headings = []
        for names in self.views:
            ahead = np.stack([self.source.camera_to_map(name)[:2, 2] for name in names])
            headings.append(np.arctan2(ahead[:, 1], ahead[:, 0]))
        return headings

    @cached_property
    def cells(self) -> NDArray[np.int64]:
        """Column and row of each position on the grid of 0.30 m, (P, 2)."""
        return np.rint(self.positions / GRID_M).astype(np.int64)

    @cached_property
    def moves(self) -> NDArray[np.int64]:
        """The position that each of the eight moves leads to, −1 for none, (P, 8)."""
        moves = np.full((len(self.views), NUM_MOVES), -1, dtype=np.int64)
        for here, others in enumerate(self._neighbours()):
            apart = self.positions[others] - self.positions[here]
            lengths = np.hypot(apart[:, 0], apart[:, 1])
            bearings = np.arctan2(apart[:, 1], apart[:, 0])
            off = np.abs(np.angle(np.exp(1j * (bearings[None] - _BEARINGS[:, None]))))
            for move in range(NUM_MOVES):
                ahead = np.flatnonzero(off[move] <= MAX_OFF_COURSE)
                if len(ahead):
                    ring = ahead[lengths[ahead] <= lengths[ahead].min() + RING_M]
                    moves[here, move] = others[ring[off[move, ring].argmin()]]
        return moves

    @cached_property
    def costs(self) -> NDArray[np.float64]:
        """Length of each move in steps of 0.30 m, infinite where it leads nowhere, (P, 8)."""
        apart = self.positions[self.moves] - self.positions[:, None]
        lengths: NDArray[np.float64] = np.hypot(apart[..., 0], apart[..., 1]) / GRID_M
        return np.where(self.moves >= 0, lengths, np.inf)

    @cached_property
    def components(self) -> NDArray[np.int32]:
        """A number for each position, the same for those that lead to each other, (P,)."""
        here, move = np.nonzero(self.moves >= 0)
        count = len(self.views)
        graph = csr_matrix((np.ones(len(here)), (here, self.moves[here, move])), (count, count))
        labels: NDArray[np.int32] = connected_components(graph, connection='strong')[1]
        return labels

    def frame(self, name: str) -> RgbdFrame:
        """Read the frame of an image; the latest ones are kept.

        Raises:
            FrameError: If it can't be read.
        """
        return self._read(name)

    def annotation(self, name: str) -> Annotation | None:
        """Return what is said about an image, if anything is."""
        return self.source.files.annotations.get(name)

    def instance_id(self, name: str) -> int:
        """Return the number of an instance.

        Raises:
            ValueError: If there is none of this name.
        """
        if name not in self._instances:
            msg = f'There is no instance {name!r}, but for example coca_cola_glass_bottle.'
            raise ValueError(msg)
        return self._instances[name]

    def sighting(
        self, name: str, instance: int, max_difficulty: int, max_range: float
    ) -> NDArray[np.float64] | None:
        """Return where a thing is, seen in an image, metres in the map, (3,).

        The depth is the median over the middle half of its box, where a quarter of the pixels at
        least must have one; the point is that on the ray through the box's middle. A box that the
        edge of the image cuts off doesn't count, as its middle is not that of the thing.

        Args:
            name: File name of the image.
            instance: Number of the thing.
            max_difficulty: Boxes of a higher difficulty don't count.
            max_range: Nor does what is further away, in metres.

        Returns:
            The point; None if the thing is not seen, or the depth image can't be read.
        """
        key = name, instance, max_difficulty, max_range
        if key not in self._sightings:
            self._sightings[key] = self._look_for(*key)
        return self._sightings[key]

    def sightings(
        self, instance: int, max_difficulty: int, max_range: float
    ) -> dict[str, NDArray[np.float64]]:
        """Return all that is seen of a thing in the scene, by image; see `sighting`."""
        found = {}
        names = [
            name
            for name in self.source.placed_names
            if len(self.boxes(name, instance, max_difficulty))
        ]
        for name in tqdm(names, 'depth of boxes', leave=False, delay=_PROGRESS_DELAY_S):
            point = self.sighting(name, instance, max_difficulty, max_range)
            if point is not None:
                found[name] = point
        return found

    def _look_for(
        self, name: str, instance: int, max_difficulty: int, max_range: float
    ) -> NDArray[np.float64] | None:
        boxes = self.boxes(name, instance, max_difficulty)
        if not len(boxes):
            return None
        areas = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
        try:
            depth = self.source.read_raw_depth(name)
        except FrameError:
            return None
        return place_in_box(
            depth,
            boxes[areas.argmax(), :4],
            self.source.lens.unproject,
            self.source.camera_to_map(name),
            max_range,
        )

    def boxes(self, name: str, instance: int, max_difficulty: int = 5) -> NDArray[np.int64]:
        """Return the boxes of a thing in an image on disk, as the dataset has them, (N, 6).

        Args:
            name: File name of the image.
            instance: Number of the thing.
            max_difficulty: Boxes of a higher difficulty are left out.
        """
        annotation = self.annotation(name)
        if annotation is None:
            return np.empty((0, 6), dtype=np.int64)
        found = annotation.boxes
        boxes: NDArray[np.int64] = found[
            (found[:, 4] == instance) & (found[:, 5] <= max_difficulty)
        ]
        return boxes

    def _neighbours(self) -> list[NDArray[np.int64]]:
        """Return the positions that a step may lead to from each one, P arrays."""
        place = {name: index for index, names in enumerate(self.views) for name in names}
        off_grid = np.abs(self.positions - self.cells * GRID_M)
        on_grid = off_grid.max(axis=1) <= MAX_OFF_GRID_M
        keys = [(int(col), int(row)) for col, row in self.cells]
        at = {keys[index]: int(index) for index in np.flatnonzero(on_grid)}
        neighbours = []
        for here, names in enumerate(self.views):
            others = {
                place[target]
                for name in names
                for target in self._pointers(name)
                if target in place
            }
            col, row = keys[here]
            if on_grid[here]:
                around = [(col + dx, row + dy) for dy, dx in STEPS.tolist()]
                others |= {at[cell] for cell in around if cell in at}
            others.discard(here)
            found = np.array(sorted(others), dtype=np.int64)
            apart = self.positions[found] - self.positions[here]
            near = np.hypot(apart[:, 0], apart[:, 1]) <= self.max_link
            passable = [self._passes(here, other, at, on_grid) for other in found.tolist()]
            neighbours.append(found[near & np.array(passable, dtype=np.bool_)])
        return neighbours

    def _pointers(self, name: str) -> Iterable[str]:
        annotation = self.annotation(name)
        moves = {} if annotation is None else annotation.moves
        return (target for move, target in moves.items() if move not in ROTATIONS)

    def _passes(
        self,
        here: int,
        other: int,
        at: dict[tuple[int, int], int],
        on_grid: NDArray[np.bool_],
    ) -> bool:
        """Tell whether a step between two positions squeezes between no two obstacles.

        On the grid, a diagonal needs a position in one of the two cells beside it.
        """
        (col, row), (other_col, other_row) = self.cells[here].tolist(), self.cells[other].tolist()
        diagonal = abs(col - other_col) == abs(row - other_row) == 1
        if not (diagonal and on_grid[here] and on_grid[other]):
            return True
        return (col, other_row) in at or (other_col, row) in at


def place_in_box(
    depth: NDArray[np.uint16],
    box: NDArray[np.int64],
    unproject: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    camera_to_map: NDArray[np.float64],
    max_range: float,
) -> NDArray[np.float64] | None:
    """Return where the thing in a box is, metres in the map, (3,); see `Scene.sighting`.

    Args:
        depth: Millimetres, 0 for none, (H, W).
        box: First and last pixels: left, upper, right, lower, (4,).
        unproject: Gives the slopes (2,) of the ray through a place of the image (2,); the upper
            left corner of the image is at 0.
        camera_to_map: What takes points of the optical frame into the map, (4, 4).
        max_range: What is further away does not count, in metres.

    Returns:
        The point; None where the box is cut off, or its middle has too little depth.
    """
    x_min, y_min, x_max, y_max = box.tolist()
    across, down = (x_max - x_min) / 4, (y_max - y_min) / 4
    height, width = depth.shape
    if x_min <= 0 or y_min <= 0 or x_max >= width - 1 or y_max >= height - 1:
        return None
    rows = slice(round(y_min + down), round(y_max - down) + 1)
    middle = depth[rows, round(x_min + across) : round(x_max - across) + 1]
    measured = middle[middle > 0]
    if not len(measured) or len(measured) < MIN_VALID_SHARE * middle.size:
        return None
    z = float(np.median(measured)) / 1000
    if z > max_range:
        return None
    center = np.array([(x_min + x_max + 1) / 2, (y_min + y_max + 1) / 2])
    ray = np.array([*unproject(center), 1.0, 1 / z])
    point: NDArray[np.float64] = camera_to_map[:3] @ (ray * z)
    return point


@dataclass
class _Thing:
    """What may be the target.

    Attributes:
        points: Where it was seen, (3,) each.
        misses: Images that should have shown it and did not.
    """

    points: list[NDArray[np.float64]]
    misses: int = 0

    @property
    def place(self) -> NDArray[np.float64]:
        """The middle of its sightings, (3,)."""
        middle: NDArray[np.float64] = np.median(self.points, axis=0)
        return middle

    @property
    def weight(self) -> float:
        """How many sightings are left when those are taken off that the misses speak against."""
        return len(self.points) - self.misses / MISSES_A_SIGHTING


class TargetSightings:
    """Where a thing is, from several looks at it.

    Sightings within 0.75 m of each other are of one thing: where two of a kind are in a scene,
    the one that was seen most often counts. What was seen ten times less often than that is taken
    for a mistake, and so is what was missed four times as often as it was seen where it should
    have been seen well.

    Args:
        sure: A thing is confirmed when so many of its sightings are left.
    """

    def __init__(self, sure: int = 1) -> None:
        self._sure = sure
        self._things: list[_Thing] = []
        self._seen_in: set[str] = set()

    def add(self, name: str, point: NDArray[np.float64]) -> None:
        """Take in a sighting (3,) in an image; the same image counts once."""
        self.look(name, [point], lambda _place: False)

    def look(
        self,
        name: str,
        points: Sequence[NDArray[np.float64]],
        shows: Callable[[NDArray[np.float64]], bool],
    ) -> None:
        """Take in all that is seen in an image; the same image counts once.

        Args:
            name: Of the image.
            points: The sightings, (3,) each.
            shows: Tells whether the image would show a thing well that is at a place (3,).
        """
        if name in self._seen_in:
            return
        self._seen_in.add(name)
        found = [self._add(point) for point in points]
        for thing in self._things:
            if not any(thing is other for other in found) and shows(thing.place):
                thing.misses += 1

    def _add(self, point: NDArray[np.float64]) -> _Thing:
        for thing in self._things:
            if np.linalg.norm(thing.place - point) <= SAME_THING_M:
                thing.points.append(point)
                return thing
        self._things.append(_Thing([point]))
        return self._things[-1]

    def doubt(self) -> None:
        """Give up the thing that counts until it is seen again: looking longer tells no more."""
        for thing in self._believed[:1]:
            thing.misses = MISSES_A_SIGHTING * len(thing.points)

    @property
    def points(self) -> list[NDArray[np.float64]]:
        """All sightings, (3,) each."""
        return [point for thing in self._things for point in thing.points]

    @property
    def _believed(self) -> list[_Thing]:
        ordered = sorted(self._things, key=lambda thing: thing.weight, reverse=True)
        return [
            thing
            for thing in ordered
            if thing.weight > 0 and thing.weight >= MIN_SEEN_SHARE * ordered[0].weight
        ]

    @property
    def things(self) -> Sequence[NDArray[np.float64]]:
        """The middle of each thing's sightings, (3,) each, the one seen most often first."""
        return [thing.place for thing in self._believed]

    @property
    def position(self) -> NDArray[np.float64] | None:
        """Where the thing is, metres in the map, (3,), once it was seen."""
        return next(iter(self.things), None)

    @property
    def confirmed(self) -> bool:
        """Whether the thing that counts was seen often enough to be sure of it."""
        return any(thing.weight >= self._sure for thing in self._believed[:1])
