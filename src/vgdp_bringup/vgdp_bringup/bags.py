"""Read the episodes of a run out of a recorded bag, offline and without ROS.

An observation and everything that follows from it carry one stamp, so a bag falls into steps.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError

from gridnav.grid import GridGeometry
from gridnav.metrics import Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

NANOSECONDS = 1_000_000_000
LINE_STRIP = 4
"""``visualization_msgs/Marker.LINE_STRIP``."""

_START = re.compile(r'(\d+)\.(\d{9})')


class BagError(ValueError):
    """A bag that can't be used; the text is one sentence that says why."""


@dataclass(frozen=True)
class Grid:
    """A grid of a bag: its cells, int8 (H, W), and where they lie."""

    cells: NDArray[np.int8]
    geometry: GridGeometry


@dataclass(frozen=True)
class Candidate:
    """One of the plans that were considered.

    Attributes:
        points: Positions in metres, (T, 2).
        value: Its score.
    """

    points: NDArray[np.float64]
    value: float


@dataclass
class Step:
    """What was known and said at one observation.

    Attributes:
        stamp: Nanoseconds; the observation and all that followed from it carry it.
        position: The robot, (x, y) in metres.
        map: What had been seen; None where no map of this stamp was recorded.
        plan: The steps ahead, positions in metres (T, 2); None where there was no plan.
        candidates: The plans it was chosen from.
        value_map: How good each cell is to be in, percent; None where there was none.
        latency: From the arrival of the map to that of the plan at the recorder, in seconds.
    """

    stamp: int
    position: tuple[float, float]
    map: Grid | None = None
    plan: NDArray[np.float64] | None = None
    candidates: list[Candidate] = field(default_factory=list)
    value_map: Grid | None = None
    latency: float | None = None


@dataclass
class Episode:
    """One episode of a bag.

    Attributes:
        start: Stamp of its first observation in nanoseconds.
        outcome: How it ended, or that it was still running.
        values: What was said about it besides, as text: ``steps``, ``spl`` and so on.
        steps: Its observations in their order.
        goal: The goal (x, y) in metres if it was seen, and the stamp of the step that saw it.
    """

    start: int
    outcome: Outcome = Outcome.RUNNING
    values: dict[str, str] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    goal: tuple[float, float] | None = None
    goal_stamp: int = 0

    @property
    def median_latency(self) -> float | None:
        """Median over all plans of the time from map to plan, in seconds; None without plans."""
        latencies = [step.latency for step in self.steps if step.latency is not None]
        return float(np.median(latencies)) if latencies else None


def read_episodes(path: Path, namespace: str = '/') -> list[Episode]:
    """Read all episodes of a bag in the order of their starts.

    Args:
        path: Folder of the bag.
        namespace: Where the robot's topics are.

    Raises:
        BagError: If there is no readable bag or no episode in it.
    """
    messages = _messages(path, namespace.rstrip('/') + '/')
    episodes: dict[int, Episode] = {}
    for _, status in messages['episode']:
        _read_status(episodes, status)
    if not episodes:
        msg = f'{path} holds no episode.'
        raise BagError(msg)
    ordered = [episodes[start] for start in sorted(episodes)]
    steps: dict[int, Step] = {}
    for _, message in messages['odom']:
        stamp = _stamp(message)
        position = message.pose.pose.position
        if stamp not in steps and stamp >= ordered[0].start:
            steps[stamp] = Step(stamp, (position.x, position.y))
            _of(ordered, stamp).steps.append(steps[stamp])
    _add_plans(steps, messages)
    _add_views(steps, messages)
    for _, message in messages['goal_pose']:
        stamp = _stamp(message)
        if stamp >= ordered[0].start:
            episode = _of(ordered, stamp)
            episode.goal = (message.pose.position.x, message.pose.position.y)
            episode.goal_stamp = stamp
    return ordered


def _messages(path: Path, prefix: str) -> dict[str, list[tuple[int, Any]]]:
    """Return all messages, with the time of their arrival, by the relative name of their topic."""
    messages: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    try:
        with AnyReader([path]) as reader:
            connections = [c for c in reader.connections if c.topic.startswith(prefix)]
            for connection, received, data in reader.messages(connections):
                message = reader.deserialize(data, connection.msgtype)
                messages[connection.topic.removeprefix(prefix)].append((received, message))
    except (AnyReaderError, OSError) as error:
        msg = f'{path} is not a readable bag: {error}'
        if any(file.suffix in {'.mcap', '.db3'} for file in path.glob('*')):
            msg += f" If its recorder was killed, 'vgdp bag recover {path}' reads what is there."
        raise BagError(msg) from error
    return messages


def _read_status(episodes: dict[int, Episode], status: Any) -> None:  # noqa: ANN401 - any bag's types
    values = {item.key: item.value for item in status.values}
    match = _START.fullmatch(values.pop('start', ''))
    if match is None or status.message not in set(Outcome):
        return
    start = int(match[1]) * NANOSECONDS + int(match[2])
    episode = episodes.setdefault(start, Episode(start))
    episode.outcome, episode.values = Outcome(status.message), values


def _add_plans(steps: dict[int, Step], messages: dict[str, list[tuple[int, Any]]]) -> None:
    """Add to each step the map and the plan with its stamp; the first ones of a stamp count."""
    map_received: dict[int, int] = {}
    for received, message in messages['map']:
        stamp = _stamp(message)
        if stamp in steps and stamp not in map_received:
            steps[stamp].map = _grid(message)
            map_received[stamp] = received
    for received, message in messages['plan']:
        stamp = _stamp(message)
        if stamp in steps and steps[stamp].plan is None:
            steps[stamp].plan = _points([pose.pose.position for pose in message.poses])
            if stamp in map_received:
                steps[stamp].latency = (received - map_received[stamp]) / NANOSECONDS


def _add_views(steps: dict[int, Step], messages: dict[str, list[tuple[int, Any]]]) -> None:
    """Add to each step what the planner shows of its choice with that stamp."""
    for _, message in messages['value_map']:
        if _stamp(message) in steps:
            steps[_stamp(message)].value_map = _grid(message)
    for _, message in messages['plan_candidates']:
        for marker in message.markers:
            if marker.type == LINE_STRIP and _stamp(marker) in steps:
                candidate = Candidate(_points(marker.points), float(marker.text or 'nan'))
                steps[_stamp(marker)].candidates.append(candidate)


def _of(episodes: Sequence[Episode], stamp: int) -> Episode:
    """Return the episode in which a stamp lies; it must not lie before the first one."""
    return [episode for episode in episodes if episode.start <= stamp][-1]


def _stamp(message: Any) -> int:  # noqa: ANN401 - any type with a header
    return int(message.header.stamp.sec) * NANOSECONDS + int(message.header.stamp.nanosec)


def _points(points: Sequence[Any]) -> NDArray[np.float64]:
    return np.array([(point.x, point.y) for point in points], dtype=np.float64).reshape(-1, 2)


def _grid(message: Any) -> Grid:  # noqa: ANN401 - an OccupancyGrid of rosbags
    info = message.info
    geometry = GridGeometry(
        rows=int(info.height),
        cols=int(info.width),
        # The message has a float32, of which only the first digits are meant.
        resolution=float(f'{info.resolution:.7g}'),
        origin_x=float(info.origin.position.x),
        origin_y=float(info.origin.position.y),
    )
    return Grid(np.asarray(message.data, dtype=np.int8).reshape(geometry.shape), geometry)
