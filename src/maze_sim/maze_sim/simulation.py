"""Many mazes stepped at once as array code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gridnav.actions import DONE, NUM_ACTIONS, NUM_MOVES, STEP_LENGTHS, STEPS
from gridnav.metrics import EpisodeResult, Outcome
from gridnav.partial_map import FREE, FREE_VALUE, GOAL, OBSTACLE, OCCUPIED_VALUE, UNKNOWN_VALUE
from maze_sim.visibility import visible_in_windows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from maze_sim.mazes import Maze

Seed = int | Sequence[int]
"""What a random generator is made from: a number from 0, or several."""

_STEPS = np.vstack((STEPS, np.zeros((1, 2), dtype=np.int64)))
"""(Δrow, Δcol) of all nine actions, (9, 2): Done stays."""

_SLIPS = np.column_stack(
    (
        (np.arange(NUM_MOVES) - 1) % NUM_MOVES,
        (np.arange(NUM_MOVES) + 1) % NUM_MOVES,
        np.full(NUM_MOVES, DONE),
    )
)
"""Where a move leads that slips, as actions (8, 3): beside the right cell, or nowhere."""


class MazeSimulation:
    """B mazes of one shape, one robot in each.

    An episode ends in success (Done on the goal), collision (a step that is not valid: the robot
    stays where it is), false_done (Done elsewhere), timeout (``max_steps`` actions) or, where
    asked for, repeat. A repeat is an exact loop: the robot takes an action that it has taken from
    the same cell before, and has seen nothing new in between, so it decided on the same partial
    map. If the last action allowed ends the episode in another way too, that way counts. Nothing
    is reset by itself.

    A move slips with probability ``slip``: the robot then stays, or lands in one of the two cells
    beside the one that it should reach, each as likely as the others that a valid step leads to.
    A slip is never a collision, and a move into a wall is one whatever happens.

    With ``pose_noise`` the robot's cell is known up to a Gaussian error alone, drawn anew with
    each observation. The partial maps still hold what was seen where it is, and views are centred
    on the true cell: mapping is perfect, so that what the uncertain pose does can be told apart.

    Attributes:
        partial_maps: What each robot has seen, float32 (B, 3, H, W), updated in place.
        cells: The robots' true cells (row, col), (B, 2).
        reported_cells: The cells that the robots are told to be in, (B, 2).
        goal_seen: Whether the goal has been seen, (B,).
        active: Whether the episode is still running, (B,).
        steps: Actions taken, collisions and Done included, (B,).
        path_costs: Length of the way so far in cells, (B,).
        outcomes: How each episode ended, or ``Outcome.RUNNING``, (B,).
        mazes: The mazes, B.
        view_range: Cells that a view reaches to each side, r.
        max_steps: Actions after which an episode ends.
        slip: Probability of a move to slip.
        pose_noise: Standard deviation of the reported cells from the true ones in cells.
    """

    def __init__(
        self,
        mazes: Sequence[Maze],
        view_range: int = 2,
        max_steps: int = 500,
        *,
        stop_on_repeat: bool = False,
        slip: float = 0.0,
        pose_noise: float = 0.0,
        seeds: Sequence[Seed] | None = None,
    ) -> None:
        """Put each robot on its start and take the first look.

        Args:
            mazes: At least one maze, all of one shape.
            view_range: Cells that a view reaches to each side, at least 1.
            max_steps: Actions after which an episode ends, at least 1.
            stop_on_repeat: Whether an exact loop ends the episode. With slips or noise there are
                none, as nothing repeats exactly.
            slip: Probability of a move to slip, 0 to 1.
            pose_noise: Standard deviation of the reported cells from the true ones in cells.
            seeds: Of the slips and the noise of each episode, B; 0 to B - 1 if None.

        Raises:
            ValueError: If an argument is out of range.
        """
        if not mazes:
            msg = 'A simulation needs at least one maze.'
            raise ValueError(msg)
        if max_steps < 1:
            msg = f'The number of steps must be at least 1, got {max_steps}.'
            raise ValueError(msg)
        if view_range < 1:
            msg = f'The view range must be at least 1, got {view_range}.'
            raise ValueError(msg)
        _check_noise(slip, pose_noise, stop_on_repeat=stop_on_repeat)
        count = len(mazes)
        height, width = mazes[0].blocked.shape
        self.mazes = list(mazes)
        self.view_range = view_range
        self.max_steps = max_steps
        self.slip = slip
        self.pose_noise = pose_noise
        self.partial_maps = np.zeros((count, 3, height, width), dtype=np.float32)
        self.cells = np.zeros((count, 2), dtype=np.int64)
        # One array, unless they differ.
        self.reported_cells = self.cells.copy() if pose_noise else self.cells
        self.goal_seen = np.zeros(count, dtype=np.bool_)
        self.active = np.zeros(count, dtype=np.bool_)
        self.steps = np.zeros(count, dtype=np.int64)
        self.path_costs = np.zeros(count)
        self.outcomes = np.full(count, Outcome.RUNNING, dtype=np.object_)
        self._goals = np.zeros((count, 2), dtype=np.int64)

        # The true maps and what is known of them as occupancy, with a margin as wide as a view,
        # so that no window leaves the array. The margin is unknown in both and so never new.
        padded = (count, height + 2 * view_range, width + 2 * view_range)
        self._truth = np.full(padded, UNKNOWN_VALUE, dtype=np.int8)
        self._known = np.full(padded, UNKNOWN_VALUE, dtype=np.int8)
        self._inside = np.s_[view_range : view_range + height, view_range : view_range + width]
        span = np.arange(-view_range, view_range + 1)
        self._window = np.stack(np.meshgrid(span, span, indexing='ij'), axis=-1).reshape(-1, 2)
        # Offsets and positions in the flat padded arrays.
        stride = np.array((padded[2], 1))
        self._window_offsets = self._window @ stride
        self._step_offsets = _STEPS @ stride
        self._row_offsets, self._col_offsets = (_STEPS * stride).T
        self._positions = np.zeros(count, dtype=np.int64)

        # How often something new was seen, and how often it had been when each action was last
        # taken from each cell.
        self._news = np.zeros(count, dtype=np.int32)
        self._news_when_taken: NDArray[np.int32] | None = None
        if stop_on_repeat:
            self._news_when_taken = np.zeros((count, height, width, NUM_ACTIONS), dtype=np.int32)

        self._generators = [np.random.default_rng(0)] * count
        self.restart(np.arange(count), mazes, range(count) if seeds is None else seeds)

    def restart(
        self, rows: NDArray[np.int64], mazes: Sequence[Maze], seeds: Sequence[Seed] | None = None
    ) -> None:
        """Begin new episodes in some rows and take their first look.

        Args:
            rows: The rows, (N,).
            mazes: Their new mazes, N, of the shape of the others.
            seeds: Of their slips and noise, N; if None, the rows draw on from where they are.

        Raises:
            ValueError: If a maze has another shape, or the numbers differ.
        """
        if seeds is not None:
            for row, seed in zip(rows.tolist(), seeds, strict=True):
                self._generators[row] = np.random.default_rng(seed)
        shape = self.partial_maps.shape[2:]
        for row, maze in zip(rows.tolist(), mazes, strict=True):
            if maze.blocked.shape != shape:
                msg = f'All mazes must have the shape {shape}, got {maze.blocked.shape}.'
                raise ValueError(msg)
            self.mazes[row] = maze
            self._truth[row][self._inside] = np.where(maze.blocked, OCCUPIED_VALUE, FREE_VALUE)
            self.cells[row] = maze.start
            self._goals[row] = maze.goal
        self._known[rows] = UNKNOWN_VALUE
        self.partial_maps[rows] = 0.0
        self.goal_seen[rows] = False
        self.active[rows] = True
        self.steps[rows] = 0
        self.path_costs[rows] = 0.0
        self.outcomes[rows] = Outcome.RUNNING
        padded_cells = self.cells[rows] + self.view_range
        _, padded_height, padded_width = self._truth.shape
        self._positions[rows] = (
            rows * padded_height + padded_cells[:, 0]
        ) * padded_width + padded_cells[:, 1]
        self._observe(rows)
        self._report(rows)

    def step(self, actions: NDArray[np.integer]) -> None:
        """Take one action in every running episode and merge what is then seen.

        Args:
            actions: Indices 0 to 8, (B,). Rows that are not active are ignored.

        Raises:
            ValueError: If the shape is wrong or an active row has an action out of range.
        """
        if actions.shape != self.active.shape:
            msg = f'One action per maze is needed, {self.active.shape}, got {actions.shape}.'
            raise ValueError(msg)
        rows = np.flatnonzero(self.active)
        chosen = actions[rows]
        out_of_range = (chosen < 0) | (chosen >= NUM_ACTIONS)
        if out_of_range.any():
            msg = f'An action is an index from 0 to {DONE}, got {chosen[out_of_range][0]}.'
            raise ValueError(msg)

        collided = self._blocked(rows, chosen)
        repeated = self._note_taken(rows, chosen)
        moves = np.where(collided, DONE, chosen)
        if self.slip:
            moves = self._slipped(rows, moves)
        self.steps[rows] += 1
        self.path_costs[rows] += STEP_LENGTHS[moves]
        self.cells[rows] += _STEPS[moves]
        self._positions[rows] += self._step_offsets[moves]
        self._observe(rows)
        self._report(rows)

        done = chosen == DONE
        on_goal = (self.cells[rows] == self._goals[rows]).all(axis=1)
        for ended, outcome in (
            (self.steps[rows] >= self.max_steps, Outcome.TIMEOUT),
            (repeated, Outcome.REPEAT),
            (collided, Outcome.COLLISION),
            (done & ~on_goal, Outcome.FALSE_DONE),
            (done & on_goal, Outcome.SUCCESS),
        ):
            self._end(rows[ended], outcome)

    def give_up(self, rows: NDArray[np.int64]) -> None:
        """End the episodes of some rows as given up; those that have ended stay as they are.

        Args:
            rows: The rows, (N,).
        """
        self._end(rows[self.active[rows]], Outcome.GAVE_UP)

    def windows(self) -> NDArray[np.int8]:
        """Return the latest views as occupancy, (B, 2r + 1, 2r + 1).

        -1 is unseen or off the map, 0 free and 100 wall; the robot is in the middle.
        """
        _, truth, seen = self._look(np.arange(len(self.mazes)))
        side = 2 * self.view_range + 1
        return np.where(seen, truth, np.int8(UNKNOWN_VALUE)).reshape(-1, side, side)

    def result(self, row: int) -> EpisodeResult:
        """Return what the episode of one row came to so far."""
        maze = self.mazes[row]
        return EpisodeResult(
            self.outcomes[row],
            int(self.steps[row]),
            float(self.path_costs[row]),
            maze.expert_steps,
            maze.expert_cost,
        )

    def results(self) -> list[EpisodeResult]:
        """Return what each episode came to so far, B."""
        return [self.result(row) for row in range(len(self.mazes))]

    def _blocked(self, rows: NDArray[np.int64], actions: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Tell which actions (N,) can not be done where the robots are, (N,); Done can."""
        truth = self._truth.reshape(-1)
        positions = self._positions[rows]
        # A diagonal step needs one open cell beside it. For the others, and for Done, one of the
        # two cells is the robot's own.
        blocked: NDArray[np.bool_] = (
            truth[positions + self._step_offsets[actions]] != FREE_VALUE
        ) | (
            (truth[positions + self._row_offsets[actions]] != FREE_VALUE)
            & (truth[positions + self._col_offsets[actions]] != FREE_VALUE)
        )
        return blocked

    def _slipped(self, rows: NDArray[np.int64], moves: NDArray[np.integer]) -> NDArray[np.integer]:
        """Return where the moves (N,) really lead, as actions (N,)."""
        # Two draws each step whatever the action is, so that the luck of a step is its own.
        draws = np.reshape([self._generators[row].random(2) for row in rows], (-1, 2))
        slips = np.flatnonzero((moves != DONE) & (draws[:, 0] < self.slip))
        ways = _SLIPS[moves[slips]]
        possible = np.column_stack([~self._blocked(rows[slips], way) for way in ways.T])
        number = (draws[slips, 1] * possible.sum(axis=1)).astype(np.int64)
        drawn = (possible.cumsum(axis=1) > number[:, None]).argmax(axis=1)
        led = moves.copy()
        led[slips] = ways[np.arange(len(slips)), drawn]
        return led

    def _report(self, rows: NDArray[np.int64]) -> None:
        """Draw the cells that some robots are told to be in."""
        if self.pose_noise:
            errors = [self._generators[row].normal(0.0, self.pose_noise, 2) for row in rows]
            reported = np.rint(self.cells[rows] + np.reshape(errors, (-1, 2)))
            highest = np.array(self.partial_maps.shape[2:]) - 1
            self.reported_cells[rows] = np.clip(reported, 0, highest).astype(np.int64)

    def _look(
        self, rows: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int8], NDArray[np.bool_]]:
        """Return flat positions, true occupancy and sight of the windows, each (N, (2r + 1)²)."""
        positions = self._positions[rows, None] + self._window_offsets
        truth = self._truth.reshape(-1)[positions]
        return positions, truth, visible_in_windows(truth != FREE_VALUE, self.view_range)

    def _observe(self, rows: NDArray[np.int64]) -> None:
        """Merge the views of some rows into their partial maps."""
        positions, truth, seen = self._look(rows)
        known = self._known.reshape(-1)
        index, place = np.nonzero(seen & (known[positions] != truth))
        if not len(index):
            return
        new_rows = rows[index]
        values = truth[index, place]
        known[positions[index, place]] = values
        cells = self.cells[new_rows] + self._window[place]
        channels = np.where(values == FREE_VALUE, FREE, OBSTACLE)
        self.partial_maps[new_rows, channels, cells[:, 0], cells[:, 1]] = 1.0
        goal_rows = new_rows[(cells == self._goals[new_rows]).all(axis=1)]
        self.goal_seen[goal_rows] = True
        self.partial_maps[
            goal_rows, GOAL, self._goals[goal_rows, 0], self._goals[goal_rows, 1]
        ] = 1.0
        self._news[new_rows] += 1

    def _note_taken(
        self, rows: NDArray[np.int64], chosen: NDArray[np.integer]
    ) -> NDArray[np.bool_]:
        """Note the actions and tell which were taken before with nothing new seen since, (N,)."""
        if self._news_when_taken is None:
            return np.zeros(len(rows), dtype=np.bool_)
        place = rows, self.cells[rows, 0], self.cells[rows, 1], chosen
        news = self._news[rows]
        repeated: NDArray[np.bool_] = self._news_when_taken[place] == news
        self._news_when_taken[place] = news
        return repeated

    def _end(self, rows: NDArray[np.int64], outcome: Outcome) -> None:
        self.active[rows] = False
        self.outcomes[rows] = outcome


def _check_noise(slip: float, pose_noise: float, *, stop_on_repeat: bool) -> None:
    if not 0.0 <= slip <= 1.0:
        msg = f'The probability of a slip must be 0 to 1, got {slip}.'
        raise ValueError(msg)
    if not 0.0 <= pose_noise < np.inf:
        msg = f'The noise of the pose must be 0 cells or more and finite, got {pose_noise}.'
        raise ValueError(msg)
    if stop_on_repeat and (slip or pose_noise):
        msg = 'Exact loops can not be told where steps slip or poses are noisy.'
        raise ValueError(msg)
