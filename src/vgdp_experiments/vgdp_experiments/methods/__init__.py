"""The methods that an evaluation compares, one file each.

A method is handed partial maps and cells, never the maze: the mazes stay in the evaluation. The
clairvoyant expert alone is built from them, and is a reference, not a planner.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from numpy.typing import NDArray


class Method(Protocol):
    """Steers B robots at once, each in an episode of its own.

    Attributes:
        settings: What shaped its decisions, as plain values, for the record.
    """

    settings: dict[str, Any]

    def reset(self, episodes: range, seed: int) -> None:
        """Begin new episodes.

        What happens in an episode must depend on its number and the seed, not on which others
        are run beside it.

        Args:
            episodes: Their numbers in the trial; row i of what follows belongs to episodes[i].
            seed: Source of whatever is random.
        """

    def act(
        self,
        partial_maps: NDArray[Any],
        cells: NDArray[Any],
        active: NDArray[Any],
    ) -> list[list[int]]:
        """Decide what to do next; the inputs must be left as they are.

        Args:
            partial_maps: What each robot has seen, float32 (B, 3, H, W).
            cells: Where each robot is, (row, col), int64 (B, 2).
            active: Which rows need a decision, bool (B,).

        Returns:
            The actions that each robot carries out before it asks again, B lists. An empty list
            in an active row means that the method stops there; other rows are not looked at.
        """
