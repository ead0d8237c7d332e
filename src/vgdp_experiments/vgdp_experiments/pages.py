"""The pages that show results, and what they have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vgdp_experiments.scores import RESAMPLES

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from vgdp_experiments.results import PlaceResults, Results
    from vgdp_experiments.scores import Scores

MISSING = '–'

DETAILS = (
    'method',
    'success',
    '± over trials',
    '95 % interval',
    'SPL',
    '± over trials',
    '95 % interval',
    'SPL / frontier',
    '95 % interval',
    'SPL by steps',
    'steps',
    'failures',
    'ms a decision',
    'decisions a second',
)

_EXPLANATION = """\
Success is Done on the goal within the budget; its interval is Wilson's. SPL weighs success by the
length of the way (by its cost, √2 for a diagonal step, unless steps are named); its intervals, and
those of the ratio to nearest-frontier exploration, come from {resamples} bootstrap resamples of
the mazes, the same for both methods of a ratio. ± is the standard deviation over the trials. Times
are means over decisions made in batches, without the simulation."""


def explanation() -> str:
    """Say what the numbers mean."""
    return _EXPLANATION.format(resamples=RESAMPLES)


def markdown_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; all columns but the first are aligned to the right."""
    marks = [':--', *['--:'] * (len(headings) - 1)]
    return '\n'.join(f'| {" | ".join(row)} |' for row in (headings, marks, *rows))


def origin(results: Results) -> str:
    """Say what the results were made with."""
    weights = ', '.join(f'{owner} `{value}`' for owner, value in results.weights.items())
    versions = ', '.join(
        f'{name} {" and ".join(values)}' for name, values in results.versions.items()
    )
    return f'Weights: {weights or "none"}. Versions: {versions}.'


def command(
    words: str,
    results: Results,
    known: Collection[str] = (),
    methods: Collection[str] = (),
) -> str:
    """Return the command that gives results again, with as many episodes of each kind.

    Args:
        words: The command.
        results: The results.
        known: All settings of the evaluation, to name those of the results where they are fewer.
        methods: All methods of the evaluation, likewise.
    """
    counts = {(place.trials, place.episodes) for place in results.places.values()}
    names = list(next(iter(results.places.values())).methods)
    if len(names) < len(methods):
        words += f' --method {" ".join(names)}'
    if len(results.places) < len(known):
        words += f' --setting {" ".join(results.places)}'
    if len(counts) == 1:
        [(trials, episodes)] = counts
        words += f' --trials {trials} --episodes {episodes}'
    return words


def describe(place: PlaceResults) -> str:
    """Say where the robots were tried, and how often."""
    return f'{place.setting.describe()}, {place.trials} × {place.episodes} {place.setting.unit}'


def details(place: PlaceResults) -> str:
    """Return a table with everything about each method in one setting."""
    rows = []
    for name, scores in place.scores().items():
        summary = scores.summary
        rows.append(
            (
                f'`{name}`',
                f'{summary.success:.4f}',
                number(scores.success_sd, 4),
                f'{summary.success_low:.4f} … {summary.success_high:.4f}',
                f'{summary.spl:.3f}',
                number(scores.spl_sd),
                span(scores.spl_interval),
                number(scores.spl_ratio),
                span(scores.ratio_interval),
                f'{summary.spl_steps:.3f}',
                f'{summary.steps:.1f}',
                ', '.join(f'{count} {why}' for why, count in summary.failures.items()) or MISSING,
                f'{scores.ms_per_decision:.3g}',
                f'{scores.decisions_per_second:.0f}',
            )
        )
    return markdown_table(DETAILS, rows)


def success(scores: Scores) -> str:
    """Return success as mean ± standard deviation over trials."""
    return with_sd(scores.summary.success, scores.success_sd)


def ratio(scores: Scores) -> str:
    """Return the SPL over the reference's with its interval."""
    if scores.spl_ratio is None:
        return MISSING
    return f'{scores.spl_ratio:.3f} ({span(scores.ratio_interval)})'


def with_sd(mean: float, sd: float | None) -> str:
    """Return mean ± standard deviation, or the mean alone."""
    return f'{mean:.3f}' if sd is None else f'{mean:.3f} ± {sd:.3f}'


def number(value: float | None, decimals: int = 3) -> str:
    """Return a number, or a dash for none."""
    return MISSING if value is None else f'{value:.{decimals}f}'


def span(interval: tuple[float, float] | None) -> str:
    """Return an interval, or a dash for none."""
    return MISSING if interval is None else f'{interval[0]:.3f} … {interval[1]:.3f}'
