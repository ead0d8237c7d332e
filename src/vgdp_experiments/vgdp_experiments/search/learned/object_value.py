"""The planner with the object-search value: what is unseen is worth a look by what stands there.

Bottles stand on tables and counters. So the worth of the unseen reads, besides the partial map,
at which heights there is something in each cell that was ever in view, and where the robot has
stood. The policy is the planner's own. The weights that read the new channels begin at zero, so
before any training it decides just as the planner does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from avd_player.avd_format import GRID_M
from vgdp_experiments.search.learned.records import load_networks
from vgdp_experiments.search.learned.rgbd import SeeingValue, with_blind_channels
from vgdp_planner import Config, ValueGuidedPlanner
from vgdp_planner.weights import load_part, load_weights, save_record

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from gridnav import GridGeometry

EDGES_M = np.array([0.1, 0.35, 0.6, 0.8, 1.0, 1.4, 2.0])
"""Heights between which there is something or not: what is low, seats and beds, tables, counters,
shelves, and what is taller than all of these. What is higher is in nobody's way."""

BANDS = len(EDGES_M) - 1

CHANNELS = BANDS + 1
"""The heights, and where the robot has stood."""

SETTINGS = {'execute': 1}
"""Of the planner: one step at a time, so that each position is looked at."""


def height_map(
    points: NDArray[np.floating],
    stood: NDArray[np.floating],
    corner: NDArray[np.floating],
    shape: tuple[int, ...],
) -> NDArray[np.float32]:
    """Return at which heights there is something in each cell, and where the robot has stood.

    Args:
        points: That were seen, metres in the map, NaN for none, (N, 3).
        stood: Where the robot was, metres in the map, (K, 2).
        corner: x and y of the lower left corner of the map, metres, (2,).
        shape: Rows and columns of the map; its cells have a side of 0.30 m.

    Returns:
        1 where there is something and 0 elsewhere, (BANDS + 1, H, W).
    """
    found = np.zeros((CHANNELS, *shape), dtype=np.float32)
    bands = np.digitize(points[:, 2], EDGES_M) - 1
    # NaN is beyond the last edge.
    kept = (bands >= 0) & (bands < BANDS)
    kinds = np.concatenate([bands[kept], np.full(len(stood), BANDS)])
    places = np.concatenate([points[kept, :2], stood])
    cols, rows = np.floor((places - corner) / GRID_M).astype(np.int64).T
    inside = (rows >= 0) & (rows < shape[0]) & (cols >= 0) & (cols < shape[1])
    found[kinds[inside], rows[inside], cols[inside]] = 1.0
    return found


class HeightMemory:
    """What was seen of the heights in an episode."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Forget everything: a new episode begins."""
        # By their content: a robot that goes to and fro sees nothing that it has not seen.
        self._points: dict[bytes, NDArray[np.floating]] = {}
        self._stood: set[tuple[float, float]] = set()

    def look(
        self, points: NDArray[np.floating], cell: tuple[int, int], geometry: GridGeometry
    ) -> NDArray[np.float32]:
        """Take in what the robot sees from a cell; returns the height map, (C, H, W).

        Args:
            points: That it sees, metres in the map, NaN for none, of any shape (..., 3).
            cell: Where it stands.
            geometry: Of the map.
        """
        self._points[points.tobytes()] = points.reshape(-1, 3)
        self._stood.add(geometry.center_of(*cell))
        corner = np.array([geometry.origin_x, geometry.origin_y])
        return height_map(
            np.concatenate(list(self._points.values())),
            np.array(sorted(self._stood)),
            corner,
            geometry.shape,
        )


def begin_value(folder: Path | None = None) -> SeeingValue:
    """Return the value function of a planner, the shipped one if None, that reads heights.

    Raises:
        WeightsError: If the folder does not hold it, with one sentence that says why.
    """
    config, own = load_part(folder, 'value')
    value = SeeingValue(config.value, CHANNELS)
    own['trunk.stem.weight'] = with_blind_channels(own['trunk.stem.weight'], CHANNELS)
    value.load_state_dict(own)
    return value


def save_value(value: SeeingValue, folder: Path, training: dict[str, Any]) -> None:
    """Write weights, configuration and how they came about into a folder, creating it."""
    config = Config(value=value.config).to_dict()['value']
    save_record(folder, config, value.state_dict(), training)


def load_value(folder: Path | None = None) -> SeeingValue:
    """Read what `save_value` wrote; the weights that come with the package if None.

    Raises:
        WeightsError: If the folder does not hold it, with one sentence that says why.
    """
    return load_networks(
        folder,
        'vgdp_object',
        'an object-search value',
        lambda config: SeeingValue(Config.from_dict({'value': config}).value, CHANNELS),
    )


class ObjectSearchPlanner(ValueGuidedPlanner):
    """The shipped planner with the object-search value. Before each decision it has to `look`.

    Args:
        value: With trained weights.
    """

    def __init__(self, value: SeeingValue) -> None:
        config, tensors = load_weights()
        super().__init__(config.with_planner(SETTINGS))
        self.load_tensors(tensors)
        self.value_network = self._value = value.eval()

    def look(self, heights: NDArray[np.float32]) -> None:
        """Take in a height map (C, H, W), which lies where the partial map does."""
        self._value.seen = torch.from_numpy(heights)[None]
