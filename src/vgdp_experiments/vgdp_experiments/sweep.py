"""Runs the jobs of an evaluation: what is done already is kept, the rest goes to processes."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from gridnav import summarize
from vgdp_experiments.jobs import Machinery, Part, PartError, run_job, weights_of
from vgdp_experiments.methods.calvin import add_calvin_arguments
from vgdp_experiments.methods.registry import VARIANTS
from vgdp_experiments.options import whole_number
from vgdp_experiments.planner_options import add_planner_arguments
from vgdp_experiments.results import Results

if TYPE_CHECKING:
    from collections.abc import Sequence
    from multiprocessing.queues import SimpleQueue
    from types import TracebackType
    from typing import Self

    from rich.progress import TaskID

    from vgdp_experiments.jobs import Job
    from vgdp_experiments.suite import Suite

STOPPED = 130
"""Exit status after Ctrl-C, as shells have it."""


def add_selection(parser: argparse.ArgumentParser, suite: Suite | None = None) -> None:
    """Add which parts of an evaluation are meant; all of it if nothing else is asked for."""
    names, places = (list(suite.variants), list(suite.settings)) if suite else (None, None)
    parser.add_argument('--method', nargs='+', choices=names, help='methods (all)')
    parser.add_argument('--setting', nargs='+', choices=places, help='settings (all)')
    parser.add_argument(
        '--trials',
        type=whole_number(1),
        help=f'trials of each ({suite.trials if suite else "all that the evaluation has"})',
    )
    parser.add_argument(
        '--episodes',
        type=whole_number(1),
        help=f'mazes in a trial ({suite.episodes if suite else "as the evaluation has"})',
    )


def selected(suite: Suite, args: argparse.Namespace) -> list[Job]:
    """Return the jobs that the options select.

    Raises:
        ValueError: If there is no setting or method of a name.
    """
    return suite.jobs(
        args.setting or list(suite.settings),
        args.method or list(suite.variants),
        args.trials or suite.trials,
        args.episodes or suite.episodes,
    )


def add_arguments(suite: Suite, parser: argparse.ArgumentParser, *, chosen: bool = True) -> None:
    """Add the options of a command that runs an evaluation.

    Args:
        suite: The evaluation.
        parser: Gets the options.
        chosen: Whether this is the evaluation for sure; else the options may name methods and
            settings of others, too.
    """
    add_selection(parser, suite if chosen else None)
    parser.add_argument(
        '--out',
        type=Path,
        metavar='FOLDER',
        default=Path('runs', suite.name),
        help='where a file for each method, setting and trial goes; '
        f'what is there already is not run again (runs/{suite.name})',
    )
    parser.add_argument(
        '--shard',
        type=_shard,
        default=(1, 1),
        metavar='K/N',
        help='run the K-th of N shares alone, the others elsewhere (1/1)',
    )
    parser.add_argument(
        '--workers', type=whole_number(1), default=1, help='processes (%(default)s)'
    )
    parser.add_argument(
        '--batch',
        type=whole_number(1),
        default=Machinery.batch,
        help='episodes run at once (%(default)s)',
    )
    add_planner_arguments(parser)
    add_calvin_arguments(parser)


def run(suite: Suite, args: argparse.Namespace) -> int:
    """Run what is missing and, once nothing is, print the page; returns the exit status.

    Raises:
        ValueError: If the jobs can't be run, or the folder holds parts of other ones.
        OSError: If the folder can't be written.
    """
    threads = args.threads if args.workers == 1 else 1
    options = vars(args)
    machinery = Machinery(
        args.weights,
        args.calvin_weights,
        args.device,
        threads,
        args.batch,
        options.get('data'),
        options.get('learned_weights'),
    )
    jobs = [_with_settings(job, dict(args.settings)) for job in selected(suite, args)]
    args.out.mkdir(parents=True, exist_ok=True)
    variants = {job.name: job.variant for job in jobs}
    weights = {name: weights_of(variant, machinery) for name, variant in variants.items()}
    missing = [job for job in jobs if not _is_done(job, weights[job.name], args.out)]
    share, shares = args.shard
    mine = [job for job in jobs[share - 1 :: shares] if job in missing]
    with _Display(len(jobs) - len(missing), mine) as display:
        try:
            run_jobs(mine, machinery, args.out, args.workers, display)
        except KeyboardInterrupt:
            display.say('Stopped. The same command goes on where this was.')
            return STOPPED
    left = sum(not (args.out / job.file_name).is_file() for job in jobs)
    if left:
        display.say(f'{left} of {len(jobs)} parts are not in {args.out}.')
        return 0
    parts = [Part.load(args.out / job.file_name) for job in jobs]
    Console().print(suite.page(Results.join(parts, jobs)).text, markup=False, soft_wrap=True)
    display.say(f'vgdp eval merge {args.out} -o FILE.json keeps this, with its page.')
    return 0


def run_jobs(
    jobs: Sequence[Job], machinery: Machinery, folder: Path, workers: int, display: _Display
) -> None:
    """Run jobs, each of which leaves a file in a folder when it has finished."""
    if workers == 1:
        for job in jobs:
            part = run_job(job, machinery, partial(display.advance, job))
            part.save(folder)
            display.finish(part)
        return
    # Read by each process when it loads its libraries.
    os.environ['OMP_NUM_THREADS'] = '1'
    context = multiprocessing.get_context('spawn')
    reports: SimpleQueue[tuple[Job, int]] = context.SimpleQueue()
    Thread(target=_forward, args=(reports, display), daemon=True).start()
    pool = ProcessPoolExecutor(workers, context, initializer=_begin, initargs=(reports,))
    try:
        waiting = [pool.submit(_run_and_save, job, machinery, folder) for job in jobs]
        for future in as_completed(waiting):
            display.finish(future.result())
    except BrokenProcessPool as error:
        msg = 'A process ended before its job did; the same command goes on where this was.'
        raise OSError(msg) from error
    except BaseException:
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


_reports: SimpleQueue[tuple[Job, int]]
"""Where a process of `run_jobs` says how far it is."""


def _begin(reports: SimpleQueue[tuple[Job, int]]) -> None:
    """Prepare a process: Ctrl-C is a matter of the one that started it."""
    global _reports  # noqa: PLW0603 - the one way to hand something to all jobs of a process
    _reports = reports
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run_and_save(job: Job, machinery: Machinery, folder: Path) -> Part:
    part = run_job(job, machinery, lambda count: _reports.put((job, count)) if count else None)
    part.save(folder)
    return part


def _forward(reports: SimpleQueue[tuple[Job, int]], display: _Display) -> None:
    """Hand on what the processes say."""
    while True:
        display.advance(*reports.get())


def _is_done(job: Job, weights: dict[str, str], folder: Path) -> bool:
    """Tell whether a folder has what comes out of a job.

    Raises:
        PartError: If it has something else there.
    """
    path = folder / job.file_name
    if not path.is_file():
        return False
    part = Part.load(path)
    for what, there, wanted in (
        ('weights', part.weights, weights),
        ('a job', part.job.to_dict(), job.to_dict()),
    ):
        if there != wanted:
            msg = f'{path} is of {what} {there}, wanted is {wanted}; take another folder.'
            raise PartError(msg)
    return True


def _with_settings(job: Job, settings: dict[str, Any]) -> Job:
    """Return a job with other settings of the planner where its method does not say them."""
    if not settings or job.variant.method not in VARIANTS:
        return job
    return replace(job, variant=replace(job.variant, planner=settings | job.variant.planner))


def _shard(text: str) -> tuple[int, int]:
    """Read K/N."""
    try:
        share, shares = (int(number) for number in text.split('/'))
    except ValueError:
        share, shares = 0, 0
    if not 1 <= share <= shares:
        msg = f'{text!r} is no share like 3/8'
        raise argparse.ArgumentTypeError(msg)
    return share, shares


class _Display:
    """Shows what is running and how far it is, and a line for each job that has finished."""

    def __init__(self, done: int, jobs: Sequence[Job]) -> None:
        self._progress = Progress(
            TextColumn('{task.description}'),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self._tasks: dict[str, TaskID] = {}
        self._finished: set[str] = set()
        self._lock = Lock()
        self._all = self._progress.add_task('episodes', total=sum(job.episodes for job in jobs))
        if done:
            self.say(f'{done} parts are there already.')

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()

    def say(self, line: str) -> None:
        """Print a line."""
        self._progress.console.print(line, markup=False, highlight=False, soft_wrap=True)

    def advance(self, job: Job, count: int) -> None:
        """Note that so many more episodes of a job have ended."""
        with self._lock:
            self._progress.advance(self._all, count)
            # What a process says may arrive after its job has.
            if job.title not in self._finished:
                if job.title not in self._tasks:
                    self._tasks[job.title] = self._progress.add_task(job.title, total=job.episodes)
                self._progress.advance(self._tasks[job.title], count)

    def finish(self, part: Part) -> None:
        """Note that a job has finished."""
        with self._lock:
            self._finished.add(part.job.title)
            task = self._tasks.pop(part.job.title, None)
            if task is not None:
                self._progress.remove_task(task)
        summary = summarize(part.trial.results)
        self.say(
            f'{part.job.title}: success {summary.success:.3f}, SPL {summary.spl:.3f}, '
            f'{1e3 * part.trial.seconds / max(part.trial.decisions, 1):.1f} ms a decision'
        )
