"""Joins the parts of an evaluation, from one machine or several, into results and their page."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from vgdp_experiments.results import Results, ResultsError, load_parts
from vgdp_experiments.suites import (
    ablation,
    avd,
    belief,
    curves,
    exploration,
    generators,
    localisation,
    table,
    worlds,
)
from vgdp_experiments.sweep import add_selection, selected

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from vgdp_experiments.suite import Page

SUITES = {
    suite.name: suite
    for suite in (
        table.SUITE,
        ablation.SUITE,
        worlds.SUITE,
        generators.SUITE,
        curves.SUITE,
        belief.SUITE,
        *avd.SUITES.values(),
    )
}
"""The evaluations that are made of parts."""

SHOW: dict[str, Callable[[Path], Page]] = {
    **{name: suite.show for name, suite in SUITES.items()},
    localisation.NAME: localisation.show,
    exploration.NAME: exploration.show,
}
"""What makes the page of each kind of results."""


def page_of(path: Path) -> Page:
    """Make the page of a file of results.

    Raises:
        ResultsError: If the file does not hold any.
    """
    try:
        show = SHOW[json.loads(path.read_text(encoding='utf-8'))['suite']]
    except (OSError, LookupError, TypeError, ValueError) as error:
        msg = f'{path} holds no results of an evaluation: {error!r}.'
        raise ResultsError(msg) from error
    return show(path)


def write_page(path: Path) -> None:
    """Write the page of a file of results beside it, with its pictures.

    Raises:
        ResultsError: If the file does not hold any.
    """
    page = page_of(path)
    for name, figure in page.pictures.items():
        figure.savefig(path.with_name(name))
    path.with_suffix('.md').write_text(page.text, encoding='utf-8')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp eval merge``."""
    parser.add_argument('folders', nargs='+', type=Path, metavar='FOLDER', help='with parts')
    parser.add_argument(
        '-o',
        '--out',
        type=Path,
        required=True,
        metavar='FILE',
        help='JSON file to write; the page goes beside it',
    )
    parser.add_argument(
        '--scenes',
        nargs='+',
        metavar='NAME',
        help='of homes that were searched (the held-out ones)',
    )
    add_selection(parser)


def run(args: argparse.Namespace) -> int:
    """Join the parts and write results and page; returns the exit status.

    Raises:
        ValueError: If parts are missing or do not belong together.
        OSError: If the files can't be written.
    """
    parts = load_parts(args.folders)
    suite = SUITES[parts[0].job.suite]
    there = {part.job.place: part.job.setting for part in parts}
    if args.scenes:
        if suite.name not in avd.SUITES:
            msg = f'--scenes is for searches of homes, and these are parts of {suite.name}.'
            raise ValueError(msg)
        suite = avd.of_scenes(suite, args.scenes)
    elif not there.keys() & suite.settings.keys():
        # Of other scenes than those that an evaluation names.
        suite = replace(suite, settings=there)
    jobs = selected(suite, args)
    results = Results.join(parts, jobs)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    results.save(args.out)
    write_page(args.out)
    print(f'{len(jobs)} parts joined in {args.out}, with their page.')  # noqa: T201
    return 0
