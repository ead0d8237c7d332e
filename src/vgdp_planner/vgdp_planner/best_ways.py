"""Values of the best ways on maps where each step leads to one cell, by Dijkstra's algorithm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

if TYPE_CHECKING:
    from numpy.typing import NDArray

UNREACHED = -1e5
"""Value of a cell from which nothing worth reaching has been reached yet; below any real value."""


def best_way_values(
    boundary_values: NDArray[np.floating],
    free: NDArray[np.bool_],
    costs: NDArray[np.floating],
    steps: NDArray[np.int64],
) -> NDArray[np.float32]:
    """Find what the best way from each free cell to the boundary is worth.

    All maps are parts of one graph that no edge connects, so that one search does for them all.

    Args:
        boundary_values: Values of the cells that keep them, `UNREACHED` elsewhere, (B, H, W).
        free: The cells to find values for, (B, H, W).
        costs: Of each step from each cell, positive; inf where there is none, (B, A, H, W).
        steps: (Δrow, Δcol) of each step, none longer than one cell each way, (A, 2).

    Returns:
        (B, H, W): the boundary values, with those of the free cells filled in; `UNREACHED` where
        no way leads to the boundary.
    """
    # Flat cells of all maps in one frame with a margin, so that no step leaves the array.
    margin = ((0, 0), (1, 1), (1, 1))
    framed = np.pad(boundary_values, margin, constant_values=UNREACHED)
    values = framed.astype(np.float64).ravel()
    cells = np.flatnonzero(np.pad(free, margin))
    nodes = np.full(values.size, -1)
    nodes[cells] = np.arange(len(cells))
    ends = cells[:, None] + steps @ np.array([framed.shape[2], 1])
    end_nodes = nodes[ends]
    prices = np.moveaxis(costs, 1, -1)[free].astype(np.float64)

    # What lies one step from the boundary is joined to it by way of one common start.
    first = np.where(end_nodes < 0, values[ends] - prices, UNREACHED).max(axis=1)
    best = first.max(initial=UNREACHED)
    starts = np.flatnonzero(first > UNREACHED / 2)
    node, step = np.nonzero((end_nodes >= 0) & np.isfinite(prices))
    # The weights of the start's edges are positive, since zeros would count as no edge.
    weights = np.concatenate([prices[node, step], best + 1 - first[starts]])
    sources = np.concatenate([end_nodes[node, step], np.full(len(starts), len(cells))])
    targets = np.concatenate([node, starts])
    graph = csr_array((weights, (sources, targets)), shape=(len(cells) + 1,) * 2)
    ways = dijkstra(graph, indices=len(cells))[:-1]
    values[cells] = np.where(np.isfinite(ways), best + 1 - ways, UNREACHED)
    found: NDArray[np.float32] = values.reshape(framed.shape)[:, 1:-1, 1:-1].astype(np.float32)
    return found
