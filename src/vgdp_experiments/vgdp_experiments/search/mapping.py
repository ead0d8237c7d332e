"""Maps of a scene that is searched again and again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_mapper.evidence_grid import EvidenceGrid
from bev_mapper.rgbd_mapper import MapperConfig, RgbdMapper
from bev_mapper.segmentation import GeometricSegmenter
from gridnav import GridGeometry

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bev_mapper.evidence_grid import Change
    from bev_mapper.segmentation import Segmenter
    from vgdp_experiments.search.noise import Sensors

MAP_CELL_M = 0.1
MAP_CELLS = 45
"""The map begins with so many rows and columns."""

GROWTH_CELLS = 15
"""It grows by whole blocks."""

FREE_BELOW_M = 1.2
"""The camera does not see the floor beside the robot. What it looks over from all around is taken
to be free, rather than searched step by step."""

MAPPED_RANGE_M = 3.0
"""What is further away is not mapped: a bottle there would not be seen yet."""


def mapper_config() -> MapperConfig:
    """Return how a home is mapped: the positions lie in the middle of cells.

    Poses of scenes are level and the floor is at 0, so it need not be looked for; and so what an
    image says of the cells does not depend on the images before it.
    """
    corner = -MAP_CELL_M * MAP_CELLS / 2
    geometry = GridGeometry(MAP_CELLS, MAP_CELLS, MAP_CELL_M, corner, corner)
    return MapperConfig(
        geometry=geometry,
        growth=GROWTH_CELLS,
        free_below=FREE_BELOW_M,
        max_range=MAPPED_RANGE_M,
        fit_floor=False,
    )


class SceneMapper:
    """Maps what a robot sees in a scene, and works out once what each image changes.

    The grid is that of an `RgbdMapper` that gets the same frames in the same order.

    Attributes:
        sensors: What the robot sees by.
        grid: The map.
    """

    def __init__(
        self,
        sensors: Sensors,
        segmenter: Segmenter | None = None,
        config: MapperConfig | None = None,
    ) -> None:
        """Start with nothing seen.

        Args:
            sensors: What the robot sees by.
            segmenter: What tells floor from obstacles, the geometric one if None.
            config: How to map, as homes are mapped if None.

        Raises:
            ValueError: If what an image changes would depend on others.
        """
        config = config or mapper_config()
        labels = sensors.segmenter(segmenter or GeometricSegmenter())
        self._mapper = RgbdMapper(config, labels)
        if config.fit_floor or not isinstance(self._mapper.grid, EvidenceGrid):
            msg = (
                'What an image changes can be kept only with fit_floor=False and the mode '
                f"'evidence', got {config.fit_floor} and {config.mode!r}."
            )
            raise ValueError(msg)
        self.sensors = sensors
        self.grid: EvidenceGrid = self._mapper.grid
        self._changes: dict[str, Change | None] = {}

    def clear(self) -> None:
        """Forget the map, but not what the images change."""
        self.grid.clear()

    def look(self, names: Iterable[str]) -> None:
        """Map some images; those that can't be read are left out.

        Raises:
            ValueError: If the map would grow beyond its limit.
        """
        for name in names:
            if name not in self._changes:
                frame = self.sensors.frame(name)
                self._changes[name] = (
                    None if frame is None else self.grid.change_of(self._mapper.evidence(frame))
                )
            change = self._changes[name]
            if change is not None:
                self.grid.apply(change)
