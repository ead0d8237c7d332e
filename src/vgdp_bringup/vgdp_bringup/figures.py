"""What the numbers of recorded runs are: per episode, per topic, and over many bags."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from gridnav.metrics import EpisodeResult, Outcome, summarize
from gridnav.partial_map import UNKNOWN_VALUE
from vgdp_bringup.bags import NANOSECONDS
from vgdp_bringup.pictures import describe_world, with_maps

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from vgdp_bringup.bags import Bag, Episode, Step, TopicLog

RESULT_VALUES = ('steps', 'path_cost', 'expert_steps', 'expert_cost')
"""What a world says that SPL is made of."""

WORSE_QUARTER = 0.25
"""Of a plan's candidates, what is below this share counts as hopeless in the spread."""

GAP_FACTOR = 5.0
"""A pause this many times as long as the median one is a gap."""


@dataclass(frozen=True)
class PlanFigures:
    """One plan.

    Attributes:
        time: When the observation came in that it was made on, in seconds from the first one.
        mapping: From the observation to its map, in seconds; None where there is none.
        planning: From the map to the plan, in seconds.
        acting: From the plan to its first action, in seconds, at least 0.
        candidates: How many plans competed.
        best: The best one's value; None where none was recorded.
        median: Their median value.
        quarter: The value that three quarters of them reach.
        turned: Whether it leaves the way of the plan before it.
    """

    time: float
    mapping: float | None
    planning: float | None
    acting: float | None
    candidates: int
    best: float | None
    median: float | None
    quarter: float | None
    turned: bool


@dataclass(frozen=True)
class EpisodeFigures:
    """One episode.

    Attributes:
        bag: Folder of the bag.
        namespace: Where the robot has its topics.
        number: Which one of the bag it is, from 1.
        world: Where it was, in words.
        outcome: How it ended.
        duration: From the first observation to the last, in seconds.
        observations: How many there were.
        steps: Actions taken, as the world says; None where it says nothing.
        path_length: Length of the way in metres.
        spl: Success weighted by path length, as the world says.
        spl_steps: The same, counted in steps.
        coverage: When an observation came, in seconds, and which share of the cells had been seen
            then: of those that the world says it has, else of the last map.
        plans: Each plan.
        replans: Plans after the first one.
        turns: How many of them left the way of the plan before.
        sources: How many plans came from where, as the planner counts: sampled, memory, greedy.
        planning: Quantiles of the planning latency in seconds, by name.
        delay: Quantiles of the time from observation to action in seconds, by name.
    """

    bag: str
    namespace: str
    number: int
    world: str
    outcome: str
    duration: float
    observations: int
    steps: int | None
    path_length: float
    spl: float | None
    spl_steps: float | None
    coverage: list[tuple[float, float]]
    plans: list[PlanFigures]
    replans: int
    turns: int
    sources: dict[str, int]
    planning: dict[str, float]
    delay: dict[str, float]

    @property
    def seen(self) -> float | None:
        """The share of the map that was seen in the end."""
        return self.coverage[-1][1] if self.coverage else None

    @property
    def memory_wins(self) -> int | None:
        """How often the best-plan memory won; None where the planner did not count."""
        return self.sources.get('memory', 0) if self.sources else None


@dataclass(frozen=True)
class TopicFigures:
    """One topic.

    Attributes:
        name: Its full name.
        type: Type of its messages.
        messages: How many there are.
        rate: Messages a second from the first to the last; None for fewer than two.
        median_gap: Median time between two, in seconds.
        longest_gap: Longest time between two, in seconds.
        longest_gap_at: When that began, in seconds from the start of the bag.
        gaps: How many pauses were more than five times as long as the median one.
        dropped: Messages that the recorder could not write.
        lost: Messages that never reached the recorder.
    """

    name: str
    type: str
    messages: int
    rate: float | None
    median_gap: float | None
    longest_gap: float | None
    longest_gap_at: float | None
    gaps: int
    dropped: int
    lost: int


@dataclass(frozen=True)
class BagFigures:
    """One bag, as one robot in it sees it."""

    bag: str
    namespace: str
    duration: float
    episodes: list[EpisodeFigures]
    topics: list[TopicFigures]


@dataclass(frozen=True)
class Figures:
    """Everything that a report says.

    Attributes:
        bags: Each bag.
        skipped: Bags that could not be read, with the reason.
        summary: Over all episodes that ended; empty if there are none.
    """

    bags: list[BagFigures]
    skipped: dict[str, str] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


def bag_figures(bag: Bag, name: str) -> BagFigures:
    """Work out the figures of a bag that is shown under a name."""
    times = np.concatenate([topic.received for topic in bag.topics])
    first = int(times.min()) if len(times) else 0
    duration = float(times.max() - first) / NANOSECONDS if len(times) else 0.0
    return BagFigures(
        name,
        bag.namespace,
        duration,
        [
            episode_figures(episode, name, bag.namespace, number)
            for number, episode in enumerate(bag.episodes, start=1)
        ],
        [topic_figures(topic, first, bag.notes) for topic in bag.topics],
    )


def episode_figures(episode: Episode, bag: str, namespace: str, number: int) -> EpisodeFigures:
    """Work out the figures of an episode."""
    steps = episode.steps
    positions = np.array([step.position for step in steps]).reshape(-1, 2)
    begin = steps[0].observed if steps else 0
    plans = _plans(episode, begin)
    delays = [
        (step.acted - step.observed) / NANOSECONDS for step in steps if step.acted is not None
    ]
    return EpisodeFigures(
        bag=bag,
        namespace=namespace,
        number=number,
        world=describe_world(episode),
        outcome=str(episode.outcome),
        duration=(steps[-1].observed - begin) / NANOSECONDS if steps else 0.0,
        observations=len(steps),
        steps=_whole(episode.values.get('steps')),
        path_length=float(np.hypot(*np.diff(positions, axis=0).T).sum()) if steps else 0.0,
        spl=_number(episode.values.get('spl')),
        spl_steps=_number(episode.values.get('spl_steps')),
        coverage=_coverage(episode, begin),
        plans=plans,
        replans=max(len(plans) - 1, 0),
        turns=sum(plan.turned for plan in plans),
        sources=dict(episode.sources),
        planning=quantiles([plan.planning for plan in plans if plan.planning is not None]),
        delay=quantiles(delays),
    )


def quantiles(values: Sequence[float]) -> dict[str, float]:
    """Return median, 95th percentile and maximum; nothing for no values."""
    if not values:
        return {}
    return {
        'p50': float(np.median(values)),
        'p95': float(np.quantile(values, 0.95)),
        'max': float(np.max(values)),
    }


def topic_figures(topic: TopicLog, first: int, notes: dict[str, str]) -> TopicFigures:
    """Work out the figures of a topic of a bag that begins at ``first`` nanoseconds."""
    pauses = np.diff(topic.received) / NANOSECONDS
    said = {what: _whole(notes.get(f'{topic.name}: {what}')) or 0 for what in ('dropped', 'lost')}
    if not len(pauses):
        return TopicFigures(
            topic.name, topic.type, len(topic.received), None, None, None, None, 0, **said
        )
    median, longest = float(np.median(pauses)), int(np.argmax(pauses))
    return TopicFigures(
        topic.name,
        topic.type,
        len(topic.received),
        rate=float(len(pauses) / max(pauses.sum(), 1e-9)),
        median_gap=median,
        longest_gap=float(pauses[longest]),
        longest_gap_at=float(topic.received[longest] - first) / NANOSECONDS,
        gaps=int(np.count_nonzero(pauses > GAP_FACTOR * max(median, 1e-3))),
        **said,
    )


def overall(
    episodes: Sequence[EpisodeFigures], results: Sequence[EpisodeResult]
) -> dict[str, Any]:
    """Sum up episodes; those that ended and say enough for SPL are in ``results``."""
    said: dict[str, Any] = {
        'episodes': len(episodes),
        'outcomes': {
            outcome: sum(episode.outcome == outcome for episode in episodes)
            for outcome in sorted({episode.outcome for episode in episodes})
        },
        'planning': quantiles(
            [p.planning for e in episodes for p in e.plans if p.planning is not None]
        ),
        'delay_p50': float(np.median([e.delay['p50'] for e in episodes if e.delay]))
        if any(e.delay for e in episodes)
        else None,
        'plans': sum(len(e.plans) for e in episodes),
        'memory_wins': sum(e.memory_wins or 0 for e in episodes),
    }
    return said | (asdict(summarize(results)) if results else {})


def result_of(episode: Episode) -> EpisodeResult | None:
    """Return the result of an episode that ended and of which enough was said."""
    numbers = {key: _number(episode.values.get(key)) for key in RESULT_VALUES}
    if episode.outcome is Outcome.RUNNING or None in numbers.values():
        return None
    said = {key: value for key, value in numbers.items() if value is not None}
    return EpisodeResult(
        episode.outcome,
        steps=int(said['steps']),
        path_cost=said['path_cost'],
        expert_steps=int(said['expert_steps']),
        expert_cost=said['expert_cost'],
    )


def _plans(episode: Episode, begin: int) -> list[PlanFigures]:
    plans = []
    before: Step | None = None
    for step in episode.steps:
        if step.plan is None:
            continue
        values = np.array([c.value for c in step.candidates if np.isfinite(c.value)])
        plans.append(
            PlanFigures(
                time=(step.observed - begin) / NANOSECONDS,
                mapping=_seconds(step.observed, step.mapped),
                planning=step.latency,
                acting=_seconds(step.planned, step.acted),
                candidates=len(step.candidates),
                best=float(values.max()) if len(values) else None,
                median=float(np.median(values)) if len(values) else None,
                quarter=float(np.quantile(values, WORSE_QUARTER)) if len(values) else None,
                turned=before is not None and _turned(before, step),
            )
        )
        before = step
    return plans


def _turned(before: Step, after: Step) -> bool:
    """Tell whether a plan leaves the way of the one before, as far as both go."""
    if before.plan is None or after.plan is None or not len(after.plan):
        return False
    here = np.flatnonzero((before.plan == after.plan[0]).all(axis=1))
    if not len(here):
        return True
    rest = before.plan[here[-1] :]
    both = min(len(rest), len(after.plan))
    return not np.array_equal(rest[:both], after.plan[:both])


def _coverage(episode: Episode, begin: int) -> list[tuple[float, float]]:
    steps = with_maps(episode)
    if not steps:
        return []
    rows, cols = (_whole(episode.values.get(key)) for key in ('rows', 'cols'))
    cells = rows * cols if rows and cols else steps[-1][1].cells.size
    return [
        ((step.observed - begin) / NANOSECONDS, _seen(grid.cells) / cells) for step, grid in steps
    ]


def _seen(cells: NDArray[np.int8]) -> int:
    return int(np.count_nonzero(cells != UNKNOWN_VALUE))


def _seconds(begin: int | None, end: int | None) -> float | None:
    if begin is None or end is None:
        return None
    return max(end - begin, 0) / NANOSECONDS


def _number(text: str | None) -> float | None:
    try:
        return float(text or '')
    except ValueError:
        return None


def _whole(text: str | None) -> int | None:
    return int(text) if text is not None and text.isdecimal() else None
