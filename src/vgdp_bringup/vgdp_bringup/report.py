"""The report of recorded runs: one page that opens anywhere, and the same figures as JSON."""

from __future__ import annotations

import base64
import json
import sys
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import track

from vgdp_bringup.bags import BagError, namespaces, read_bag
from vgdp_bringup.figures import Figures, bag_figures, overall, result_of
from vgdp_bringup.report_plots import (
    OUTCOME_COLORS,
    episode_plot,
    overview_plot,
    thumbnail,
    topics_plot,
)

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from vgdp_bringup.figures import BagFigures, EpisodeFigures, TopicFigures

PAGE, DATA = 'report.html', 'report.json'
OPEN_UP_TO = 3
"""With no more episodes than this, each is shown in full from the start."""

UNKNOWN = '–'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp bag report``."""
    add = parser.add_argument
    add('bag', type=Path, metavar='BAG', help='folder of a bag, or a folder with bags in it')
    add(
        '--out',
        type=Path,
        metavar='FOLDER',
        help=f'where {PAGE} and {DATA} go (default: beside the bag, or into the folder of bags)',
    )


def run(args: argparse.Namespace) -> int:
    """Write the report of a bag or of a folder of bags."""
    bags = find_bags(args.bag)
    out: Path = args.out or (args.bag.parent if bags == [args.bag] else args.bag)
    page, data, figures = write_report(bags, out)
    for bag, reason in figures.skipped.items():
        sys.stderr.write(f'left out {bag}: {reason}\n')
    count = sum(len(bag.episodes) for bag in figures.bags)
    sys.stdout.write(f'{count} episodes\npage  {page}\ndata  {data}\n')
    return 0


def find_bags(path: Path) -> list[Path]:
    """Return the bags at or below a folder, by name.

    Raises:
        BagError: If there are none.
    """
    if (path / 'metadata.yaml').is_file() or path.is_file():
        return [path]
    found = sorted(metadata.parent for metadata in path.rglob('metadata.yaml'))
    if not found:
        hint = ''
        if any(path.rglob('*.mcap')) or any(path.rglob('*.db3')):
            hint = " If a recorder was killed, 'vgdp bag recover' makes a bag of what it left."
        msg = f'{path} holds no bag (a folder with a metadata.yaml).{hint}'
        raise BagError(msg)
    return found


def write_report(bags: Sequence[Path], out: Path) -> tuple[Path, Path, Figures]:
    """Read bags and write the report about them.

    Args:
        bags: Folders of bags.
        out: Where the page and the data go; made where it is missing.

    Returns:
        The paths of page and data, and the figures.

    Raises:
        BagError: If none of the bags can be read.
    """
    figures = Figures([])
    episodes: list[EpisodeFigures] = []
    results, small, sections = [], [], []
    names = _names(bags)
    console = Console(stderr=True)
    hidden = not console.is_terminal or len(bags) == 1
    for path in track(bags, 'reading', console=console, transient=True, disable=hidden):
        try:
            read = [read_bag(path, namespace) for namespace in namespaces(path)]
        except BagError as error:
            figures.skipped[names[path]] = str(error)
            continue
        for bag in read:
            known = bag_figures(bag, names[path])
            figures.bags.append(known)
            sections.append(_bag_heading(known))
            for episode, said in zip(bag.episodes, known.episodes, strict=True):
                result = result_of(episode)
                results += [result] if result else []
                episodes.append(said)
                number = len(episodes)
                small.append(_small(said, thumbnail(episode, _color(said)), number))
                sections.append(_episode_section(said, episode_plot(episode, said), number))
            sections.append(_topics_section(known, topics_plot(bag)))
    if not figures.bags:
        raise BagError(next(iter(figures.skipped.values())))
    figures.summary.update(overall(episodes, results))
    opened = ' open' if len(episodes) <= OPEN_UP_TO else ''
    page = PAGE_TEMPLATE.substitute(
        title=escape(_heading(bags, names)),
        tiles=_tiles(figures.summary),
        overview=_image(overview_plot(episodes), 'Outcomes, SPL, coverage and planning latency')
        if len(episodes) > 1
        else '',
        small=''.join(small) if len(episodes) > 1 else '',
        table=_episode_table(episodes),
        skipped=''.join(
            f'<p class="bad">Left out {escape(bag)}: {escape(reason)}</p>'
            for bag, reason in figures.skipped.items()
        ),
        sections=''.join(sections).replace(
            '<details class="episode">', f'<details class="episode"{opened}>'
        ),
    )
    out.mkdir(parents=True, exist_ok=True)
    (out / PAGE).write_text(page, encoding='utf-8')
    (out / DATA).write_text(json.dumps(figures.to_json(), indent=1) + '\n', encoding='utf-8')
    return out / PAGE, out / DATA, figures


def _names(bags: Sequence[Path]) -> dict[Path, str]:
    """Return the shortest names that tell the bags apart."""
    if len(bags) == 1:
        return {bags[0]: bags[0].resolve().name}
    parts = {path: path.resolve().parts for path in bags}
    while len({p[0] for p in parts.values()}) == 1 and min(map(len, parts.values())) > 1:
        parts = {path: p[1:] for path, p in parts.items()}
    while len({p[-1] for p in parts.values()}) == 1 and min(map(len, parts.values())) > 1:
        parts = {path: p[:-1] for path, p in parts.items()}
    return {path: '/'.join(p) for path, p in parts.items()}


def _heading(bags: Sequence[Path], names: dict[Path, str]) -> str:
    return names[bags[0]] if len(bags) == 1 else f'{len(bags)} bags'


def _color(episode: EpisodeFigures) -> str:
    return OUTCOME_COLORS[episode.outcome]


def _image(svg: str, description: str) -> str:
    """Return a picture that is part of the page."""
    data = base64.b64encode(svg.encode()).decode()
    return f'<img alt="{escape(description)}" src="data:image/svg+xml;base64,{data}">'


def _tiles(summary: dict[str, Any]) -> str:
    """Return the figures to see first."""
    tiles = [('episodes', str(summary['episodes']), '')]
    if 'success' in summary:
        low, high = summary['success_low'], summary['success_high']
        tiles.append(
            ('success', f'{summary["success"]:.0%}', f'95 % interval {low:.0%} to {high:.0%}')
        )
        tiles.append(('SPL', f'{summary["spl"]:.2f}', 'by path cost, mean'))
        tiles.append(('steps', f'{summary["steps"]:.0f}', 'mean'))
    planning = summary['planning']
    if planning:
        said = f'95 % {1000 * planning["p95"]:.0f} ms, longest {1000 * planning["max"]:.0f} ms'
        tiles.append(('planning', f'{1000 * planning["p50"]:.0f} ms', said))
    if summary['delay_p50'] is not None:
        delay = 1000 * summary['delay_p50']
        tiles.append(('observation to action', f'{delay:.0f} ms', 'median'))
    if summary['plans']:
        tiles.append(('plans', str(summary['plans']), f'{summary["memory_wins"]} from memory'))
    return ''.join(
        f'<div class="tile"><span>{escape(name)}</span><b>{escape(value)}</b>'
        f'<small>{escape(note)}</small></div>'
        for name, value, note in tiles
    )


def _small(episode: EpisodeFigures, svg: str, number: int) -> str:
    spl = f', SPL {episode.spl:.2f}' if episode.spl is not None else ''
    text = f'{number}: {_words(episode.outcome)}{spl}'
    return f'<a href="#e{number}" title="{escape(episode.bag)}">{_image(svg, text)}{text}</a>'


def _words(outcome: str) -> str:
    return outcome.replace('_', ' ')


COLUMNS = (
    'episode',
    'bag',
    'world',
    'outcome',
    'SPL',
    'steps',
    'time, s',
    'way, m',
    'seen',
    'plans',
    'turns',
    'from memory',
    'planning p50, ms',
    'p95',
    'longest',
    'observation to action, ms',
)


def _episode_table(episodes: Sequence[EpisodeFigures]) -> str:
    rows = []
    for number, e in enumerate(episodes, start=1):
        cells = [
            f'<a href="#e{number}">{number}</a>',
            escape(e.bag + ('' if e.namespace == '/' else f' {e.namespace}')),
            escape(e.world),
            f'<span class="dot" style="background:{_color(e)}"></span>{_words(e.outcome)}',
            _fixed(e.spl, 2),
            UNKNOWN if e.steps is None else str(e.steps),
            _fixed(e.duration, 1),
            _fixed(e.path_length, 1),
            UNKNOWN if e.seen is None else f'{e.seen:.0%}',
            str(len(e.plans)),
            str(e.turns),
            UNKNOWN if e.memory_wins is None else str(e.memory_wins),
            *(_ms(e.planning.get(name)) for name in ('p50', 'p95', 'max')),
            _ms(e.delay.get('p50')),
        ]
        rows.append(_row(cells))
    return _table(COLUMNS, rows)


def _bag_heading(bag: BagFigures) -> str:
    place = '' if bag.namespace == '/' else f', robot {escape(bag.namespace)}'
    return f'<h2>{escape(bag.bag)}{place} <small>{bag.duration:.1f} s</small></h2>'


def _episode_section(episode: EpisodeFigures, svg: str, number: int) -> str:
    sources = ', '.join(f'{count} {source}' for source, count in sorted(episode.sources.items()))
    facts = [
        f'{episode.observations} observations',
        f'{len(episode.plans)} plans ({sources})' if sources else f'{len(episode.plans)} plans',
        f'{episode.replans} replans, {episode.turns} of which left the plan before',
    ]
    title = f'Episode {number}: {_words(episode.outcome)}'
    return (
        f'<details class="episode"><summary id="e{number}">'
        f'<span class="dot" style="background:{_color(episode)}"></span><b>{title}</b> '
        f'{escape(episode.world)}</summary><p>{escape("; ".join(facts))}</p>'
        f'{_image(svg, title)}</details>'
    )


TOPIC_COLUMNS = (
    'topic',
    'type',
    'messages',
    'rate, Hz',
    'median gap, s',
    'longest gap, s',
    'from, s',
    'gaps',
    'dropped',
    'lost',
)


def _topics_section(bag: BagFigures, svg: str) -> str:
    rows = [_row(_topic_cells(topic)) for topic in bag.topics]
    bad = sum(topic.dropped + topic.lost for topic in bag.topics)
    note = f'<span class="bad">{bad} messages are missing</span>' if bad else ''
    return (
        f'<details><summary>Topics: rates and gaps {note}</summary>'
        f'{_image(svg, "When messages came in on each topic")}{_table(TOPIC_COLUMNS, rows)}'
        '<p>A gap is a pause more than five times as long as the median one. Dropped: the '
        'recorder had no room for it. Lost: it never reached the recorder.</p></details>'
    )


def _topic_cells(topic: TopicFigures) -> list[str]:
    return [
        escape(topic.name),
        escape(topic.type),
        str(topic.messages),
        _fixed(topic.rate, 1),
        _fixed(topic.median_gap, 3),
        _fixed(topic.longest_gap, 3),
        _fixed(topic.longest_gap_at, 1),
        str(topic.gaps),
        *(
            f'<span class="bad">{count}</span>' if count else '0'
            for count in (topic.dropped, topic.lost)
        ),
    ]


def _fixed(value: float | None, digits: int) -> str:
    return UNKNOWN if value is None else f'{value:.{digits}f}'


def _ms(seconds: float | None) -> str:
    return UNKNOWN if seconds is None else f'{1000 * seconds:.0f}'


def _row(cells: Sequence[str]) -> str:
    return f'<tr>{"".join(f"<td>{cell}</td>" for cell in cells)}</tr>'


def _table(columns: Sequence[str], rows: Sequence[str]) -> str:
    head = ''.join(f'<th>{escape(column)}</th>' for column in columns)
    return f'<div class="wide"><table><tr>{head}</tr>{"".join(rows)}</table></div>'


PAGE_TEMPLATE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>$title</title>
<style>
:root { color: #2b303b; font: 15px/1.45 system-ui, sans-serif; }
body { max-width: 1360px; margin: 1.5rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
h2 small { color: #8a93a3; font-weight: normal; }
.tiles { display: flex; flex-wrap: wrap; gap: .7rem; margin: 1rem 0; }
.tile { background: #f4f6f9; border-radius: 8px; padding: .6rem 1rem; min-width: 7rem; }
.tile span, .tile small { display: block; color: #6b7485; font-size: .8rem; }
.tile b { font-size: 1.6rem; }
img { max-width: 100%; height: auto; }
.small { display: flex; flex-wrap: wrap; gap: .5rem; }
.small a { width: 126px; font-size: .75rem; color: inherit; text-decoration: none; }
.small img { display: block; width: 126px; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-size: .85rem; }
th { text-align: left; color: #6b7485; font-weight: normal; vertical-align: bottom; }
th, td { padding: .25rem .6rem; border-bottom: 1px solid #e6e9ef; }
td { white-space: nowrap; font-variant-numeric: tabular-nums; }
.dot { display: inline-block; width: .7em; height: .7em; border-radius: 50%; margin-right: .4em; }
.bad { color: #c0392b; font-weight: bold; }
details { margin: .6rem 0; } summary { cursor: pointer; }
</style>
</head>
<body>
<h1>$title</h1>
$skipped
<div class="tiles">$tiles</div>
$overview
<div class="small">$small</div>
$table
$sections
<script>
// A link to an episode opens it.
const open = () => {
  const target = location.hash && document.querySelector(location.hash);
  if (target) { target.parentElement.open = true; target.scrollIntoView(); }
};
addEventListener('hashchange', open);
open();
</script>
</body>
</html>
""")
