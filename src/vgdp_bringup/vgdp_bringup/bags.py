"""Read the episodes of a run out of a recorded bag, offline and without ROS.

An observation and everything that follows from it carry one stamp, so a bag falls into steps.
"""

from __future__ import annotations

import json
import math
import re
from bisect import bisect_right
from collections import Counter, defaultdict
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError

from gridnav.grid import GridGeometry
from gridnav.metrics import Outcome
from gridnav.rgbd import VIEW_SUFFIX

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Messages = defaultdict[str, list[tuple[int, Any]]]

NANOSECONDS = 1_000_000_000
LINE_STRIP = 4
"""``visualization_msgs/Marker.LINE_STRIP``."""

WORLDS = ('maze_sim', 'avd_player')
"""Who may say on ``episode`` how an episode stands; a planner speaks there too."""

PLANNER = 'vgdp_planner'
"""Name of the node that plans."""

PARAMETERS = 'parameters'
"""How a node's parameters, as JSON, are called in its diagnostics."""

PLANS = 'plans: '
"""How the planner's counts of plans by their source are called in its diagnostics."""

READ = (
    'episode',
    'odom',
    'map',
    'plan',
    'value_map',
    'plan_candidates',
    'goal_pose',
    'action',
    '/diagnostics',
)
"""The topics whose messages are looked into; of all others, only when they came."""

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
        observed: When the observation, the pose, came in at the recorder, in nanoseconds.
        mapped: When the map came in; None where there was none.
        planned: When the plan came in; None where there was none.
        acted: When the first action of the plan came in; None where there was none.
    """

    stamp: int
    position: tuple[float, float]
    map: Grid | None = None
    plan: NDArray[np.float64] | None = None
    candidates: list[Candidate] = field(default_factory=list)
    value_map: Grid | None = None
    observed: int = 0
    mapped: int | None = None
    planned: int | None = None
    acted: int | None = None

    @property
    def latency(self) -> float | None:
        """From the arrival of the map to that of the plan at the recorder, in seconds."""
        if self.planned is None or self.mapped is None:
            return None
        return (self.planned - self.mapped) / NANOSECONDS


@dataclass
class Episode:
    """One episode of a bag.

    Attributes:
        start: Stamp of its first observation in nanoseconds.
        outcome: How it ended, or that it was still running.
        values: What was said about it besides, as text: ``steps``, ``spl`` and so on.
        steps: Its observations in their order.
        goal: The goal (x, y) in metres if it was seen.
        goal_stamp: Stamp of the step that saw it.
        sources: How many plans came from where (sampled, memory, greedy), as the planner counts
            them once a second; empty if it does not.
    """

    start: int
    outcome: Outcome = Outcome.RUNNING
    values: dict[str, str] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    goal: tuple[float, float] | None = None
    goal_stamp: int = 0
    sources: dict[str, int] = field(default_factory=dict)

    @property
    def median_latency(self) -> float | None:
        """Median over all plans of the time from map to plan, in seconds; None without plans."""
        latencies = [step.latency for step in self.steps if step.latency is not None]
        return float(np.median(latencies)) if latencies else None


@dataclass(frozen=True)
class TopicLog:
    """When messages came in on a topic.

    Attributes:
        name: Its full name.
        type: Type of its messages.
        received: Nanoseconds, in the order of arrival, (N,).
    """

    name: str
    type: str
    received: NDArray[np.int64]


@dataclass(frozen=True)
class Bag:
    """What one robot did and said in a bag.

    Attributes:
        path: Where the bag is.
        namespace: Where the robot's topics are, ``/`` or ``/name/``.
        episodes: In the order of their starts.
        topics: All topics of the bag, by name.
        notes: What the recorder says about the recording, such as the messages it dropped.
    """

    path: Path
    namespace: str
    episodes: list[Episode]
    topics: list[TopicLog]
    notes: dict[str, str]


def read_episodes(path: Path, namespace: str = '/') -> list[Episode]:
    """Read all episodes of a bag in the order of their starts.

    Where nobody speaks of episodes, as on a robot in a real place, all is one that is running.

    Args:
        path: Folder of the bag.
        namespace: Where the robot's topics are.

    Raises:
        BagError: If there is no readable bag or no episode in it.
    """
    return read_bag(path, namespace).episodes


def read_bag(path: Path, namespace: str = '/') -> Bag:
    """Read what one robot did and said; see ``read_episodes``."""
    prefix = namespace.rstrip('/') + '/'
    messages, topics, notes = _contents(path, prefix, READ)
    episodes: dict[int, Episode] = {}
    for _, status in messages['episode']:
        _read_status(episodes, status)
    if not episodes and messages['odom']:
        start = min(stamp_of(message) for _, message in messages['odom'])
        episodes[start] = Episode(start)
    if not episodes:
        msg = f'{path} holds no episode.'
        raise BagError(msg)
    ordered = [episodes[start] for start in sorted(episodes)]
    steps: dict[int, Step] = {}
    for received, message in messages['odom']:
        if message.child_frame_id.endswith(VIEW_SUFFIX):
            continue
        stamp = stamp_of(message)
        position = message.pose.pose.position
        if stamp not in steps and stamp >= ordered[0].start:
            steps[stamp] = Step(stamp, (position.x, position.y), observed=received)
            _of(ordered, stamp).steps.append(steps[stamp])
    _add_plans(steps, messages)
    _add_views(steps, messages)
    for _, message in messages['goal_pose']:
        stamp = stamp_of(message)
        if stamp >= ordered[0].start:
            episode = _of(ordered, stamp)
            episode.goal = (message.pose.position.x, message.pose.position.y)
            episode.goal_stamp = stamp
    _add_sources(ordered, messages['/diagnostics'], f'{prefix}{PLANNER}')
    return Bag(path, prefix, ordered, topics, notes)


def namespaces(path: Path) -> list[str]:
    """Return where the robots of a bag have their topics: ``/`` or ``/name/``.

    Raises:
        BagError: If there is no readable bag or no robot in it.
    """
    with open_bag(path) as reader:
        names = {connection.topic for connection in reader.connections if connection.msgcount}
    for topic in ('episode', 'odom'):
        found = sorted(
            name.removesuffix(topic) for name in names if name.rsplit('/', 1)[-1] == topic
        )
        if found:
            return found
    msg = f'{path} holds neither an episode nor odom.'
    raise BagError(msg)


def only_namespace(path: Path) -> str:
    """Return where the one robot of a bag has its topics.

    Raises:
        BagError: If there is no readable bag, no robot in it, or more than one.
    """
    found = namespaces(path)
    if len(found) > 1:
        msg = f'{path} holds several robots, choose one by --namespace: {", ".join(found)}.'
        raise BagError(msg)
    return found[0]


@contextmanager
def open_bag(path: Path) -> Iterator[AnyReader]:
    """Open a bag.

    Raises:
        BagError: If that can't be, or while it is read.
    """
    try:
        with AnyReader([path]) as reader:
            yield reader
    except (AnyReaderError, OSError) as error:
        msg = f'{path} is not a readable bag: {error}'
        if any(file.suffix in {'.mcap', '.db3'} for file in path.glob('*')):
            msg += f" If its recorder was killed, 'vgdp bag recover {path}' reads what is there."
        raise BagError(msg) from error


def read_messages(path: Path, namespace: str, topics: Collection[str]) -> Messages:
    """Return the messages of some topics, with their times of arrival, by relative name.

    Raises:
        BagError: If there is no readable bag.
    """
    return _contents(path, namespace.rstrip('/') + '/', topics)[0]


def parameters_of(arrays: list[tuple[int, Any]], node: str) -> dict[str, Any]:
    """Return the parameters that a node said first in its diagnostics; none if it did not.

    Args:
        arrays: The messages on ``/diagnostics``, with their times of arrival.
        node: Full name of the node.
    """
    for _, array in arrays:
        for status in array.status:
            values = {item.key: item.value for item in status.values}
            if status.name == node and PARAMETERS in values:
                said: dict[str, Any] = json.loads(values[PARAMETERS])
                return said
    return {}


def _contents(
    path: Path, prefix: str, wanted: Collection[str]
) -> tuple[Messages, list[TopicLog], dict[str, str]]:
    """Return the messages of the wanted topics by relative name, and when all others came."""
    messages: Messages = defaultdict(list)
    received_of: dict[str, list[int]] = defaultdict(list)
    with open_bag(path) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        for connection, received, data in reader.messages():
            received_of[connection.topic].append(received)
            name = connection.topic
            if name not in wanted and name.startswith(prefix):
                name = name.removeprefix(prefix)
            if name in wanted:
                message = reader.deserialize(data, connection.msgtype)
                messages[name].append((received, message))
        notes = getattr(getattr(reader.readers[0], 'storage', None), 'metadata', None)
    topics = [
        TopicLog(name, types[name], np.array(received_of[name], dtype=np.int64))
        for name in sorted(types)
    ]
    return messages, topics, dict(getattr(notes, 'custom', None) or {})


def _read_status(episodes: dict[int, Episode], status: Any) -> None:  # noqa: ANN401 - any bag's types
    start = start_of(status)
    if start is None or status.name not in WORLDS or status.message not in set(Outcome):
        return
    values = {item.key: item.value for item in status.values if item.key != 'start'}
    episode = episodes.setdefault(start, Episode(start))
    episode.outcome, episode.values = Outcome(status.message), values


def _add_plans(steps: dict[int, Step], messages: Messages) -> None:
    """Add to each step the map and the plan with its stamp; the first ones of a stamp count."""
    for received, message in messages['map']:
        step = steps.get(stamp_of(message))
        if step is not None and step.map is None:
            step.map, step.mapped = to_grid(message), received
    for received, message in messages['plan']:
        step = steps.get(stamp_of(message))
        if step is not None and step.plan is None:
            step.plan = to_points([pose.pose.position for pose in message.poses])
            step.planned = received
    # An action bears no stamp: the first one that came after the map of a plan is of this plan.
    acted = [received for received, _ in messages['action']]
    begun = {
        step.mapped: step
        for step in steps.values()
        if step.mapped is not None and step.planned is not None
    }
    for begin, end in pairwise([*sorted(begun), math.inf]):
        first = bisect_right(acted, begin)
        if first < len(acted) and acted[first] <= end:
            begun[int(begin)].acted = acted[first]


def _add_sources(episodes: Sequence[Episode], arrays: list[tuple[int, Any]], planner: str) -> None:
    """Add to each episode how many of its plans came from where."""
    counted: Counter[str] = Counter()
    ends = [episode.steps[0].observed for episode in episodes[1:] if episode.steps]
    for received, array in arrays:
        for status in array.status:
            if status.name != planner:
                continue
            counts = Counter(
                {
                    item.key.removeprefix(PLANS): int(item.value)
                    for item in status.values
                    if item.key.startswith(PLANS) and item.value.isdecimal()
                }
            )
            episode = episodes[bisect_right(ends, received)]
            for source, count in (counts - counted).items():
                episode.sources[source] = episode.sources.get(source, 0) + count
            counted = counts


def _add_views(steps: dict[int, Step], messages: Messages) -> None:
    """Add to each step what the planner shows of its choice with that stamp."""
    for _, message in messages['value_map']:
        if stamp_of(message) in steps:
            steps[stamp_of(message)].value_map = to_grid(message)
    for _, message in messages['plan_candidates']:
        for marker in message.markers:
            if marker.type == LINE_STRIP and stamp_of(marker) in steps:
                candidate = Candidate(to_points(marker.points), float(marker.text or 'nan'))
                steps[stamp_of(marker)].candidates.append(candidate)


def _of(episodes: Sequence[Episode], stamp: int) -> Episode:
    """Return the episode in which a stamp lies; it must not lie before the first one."""
    return [episode for episode in episodes if episode.start <= stamp][-1]


def stamp_of(message: Any) -> int:  # noqa: ANN401 - any type with a header
    """Return the stamp of a message in nanoseconds."""
    return int(message.header.stamp.sec) * NANOSECONDS + int(message.header.stamp.nanosec)


def start_of(status: Any) -> int | None:  # noqa: ANN401 - a DiagnosticStatus of rosbags
    """Return the stamp that names the episode of a status, in nanoseconds, if it has one."""
    values = {item.key: item.value for item in status.values}
    match = _START.fullmatch(values.get('start', ''))
    return None if match is None else int(match[1]) * NANOSECONDS + int(match[2])


def to_points(points: Sequence[Any]) -> NDArray[np.float64]:
    """Return points as (x, y) in metres, (N, 2)."""
    return np.array([(point.x, point.y) for point in points], dtype=np.float64).reshape(-1, 2)


def to_grid(message: Any) -> Grid:  # noqa: ANN401 - an OccupancyGrid of rosbags
    """Return an occupancy grid."""
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
