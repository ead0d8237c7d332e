"""The demo: the whole stack as separate processes, watched, recorded and drawn."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from gridnav.metrics import Outcome
from vgdp_bringup.bags import BagError, read_episodes
from vgdp_bringup.pictures import describe_outcome, save_pictures
from vgdp_bringup.processes import NodeFailure, NodeProcesses, free_domain_id
from vgdp_bringup.progress import LiveDisplay, PlainDisplay
from vgdp_bringup.report import write_report
from vgdp_bringup.watcher import RunWatcher

if TYPE_CHECKING:
    from collections.abc import Callable

    from vgdp_bringup.bags import Episode
    from vgdp_bringup.progress import Display

START_TIMEOUT_S = 60.0
"""How long the nodes may take until they are there; the first start loads a lot from disk."""

REFRESH_S = 0.1
"""The display is brought up to date this often."""

AFTERMATH_S = 1.0
"""After the end, the last observation and map still come in for so long."""

QUICK_DISCOVERY = Path(__file__).with_name('quick_discovery.xml')
"""Settings of Fast DDS with which processes find each other at once."""

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""


@dataclass(frozen=True)
class DemoOptions:
    """What the demo does.

    Attributes:
        kind: What the world looks like, one of `maze_sim.WORLD_KINDS`.
        size: Side of the world in cells.
        seed: Of the maze, start and goal, and of the planner.
        view_range: How far the robot sees to each side, in cells.
        rate: Steps a second; 0 is as fast as it goes.
        max_steps: Actions after which the episode ends.
        timeout: Seconds without any new step after which the run counts as stuck.
        out: Folder for the bag, the logs and the pictures.
    """

    kind: str
    size: int
    seed: int
    view_range: int
    rate: float
    max_steps: int
    timeout: float
    out: Path


def run(options: DemoOptions) -> int:
    """Run the demo.

    Returns:
        The exit status: 0 only if the robot said Done on the goal.
    """
    return present(lambda bag, console: run_stack(options, bag, console), options.out)


def present(play: Callable[[Path, Console], None], out: Path) -> int:
    """Play an episode that is recorded into a bag, then draw it and report on it.

    Args:
        play: Plays and records, given the folder of the bag and where to print.
        out: Folder for the bag, the logs and the pictures.

    Returns:
        The exit status: 0 only if the robot said Done on the goal.
    """
    console = Console(highlight=False)
    bag = out / 'bag'
    # Ctrl-C and kill are the same to us: stop the nodes, then leave. A shell has its background
    # processes ignore the first one.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        for folder in (bag, out / 'logs'):
            shutil.rmtree(folder, ignore_errors=True)
        play(bag, console)
        episode = read_episodes(bag)[0]
        console.print('Drawing the pictures and writing the report from the bag.')
        gif, still = save_pictures(episode, out)
        page, _, _ = write_report([bag], out)
    except (NodeFailure, BagError, TimeoutError, ValueError, OSError) as error:
        console.print(f'The demo failed: {error}', soft_wrap=True, style='red')
        return 1
    except KeyboardInterrupt:
        console.print('Stopped before the end.')
        return INTERRUPTED
    console.print(f'\nbag    {bag}\nreport {page}\nmovie  {gif}\nstill  {still}', soft_wrap=True)
    console.print(summary(episode), soft_wrap=True, style='bold')
    return 0 if episode.outcome is Outcome.SUCCESS else 1


def summary(episode: Episode) -> str:
    """Say in one line how an episode went.

    The planning latency runs from the arrival of a map to that of the plan made on it, both at
    the recorder.
    """
    latency = episode.median_latency
    spl = episode.values.get('spl')
    parts = [
        describe_outcome(episode),
        'SPL unknown' if spl is None else f'SPL {float(spl):.2f}',
        'no plan was made'
        if latency is None
        else f'median planning latency {1000 * latency:.0f} ms',
    ]
    return ', '.join(parts)


def run_stack(options: DemoOptions, bag: Path, console: Console) -> None:
    """Run one episode on real nodes and record it.

    Raises:
        NodeFailure: If a node ended by itself or could not be stopped well.
        TimeoutError: If nothing happened for too long.
    """
    domain_id = free_domain_id()
    os.environ.setdefault('FASTRTPS_DEFAULT_PROFILES_FILE', str(QUICK_DISCOVERY))
    console.print(f'Starting the nodes, ROS_DOMAIN_ID={domain_id}.')
    with NodeProcesses(options.out / 'logs', domain_id) as nodes, RunWatcher(domain_id) as watcher:
        nodes.start('recorder', python('vgdp_bringup.node'), {'bag': bag})
        nodes.start(
            'bev_mapper',
            python('bev_mapper.node'),
            # The whole maze from the start, so that the map is the one of the simulator.
            {'width': options.size, 'height': options.size, 'origin_x': 0.0, 'origin_y': 0.0},
        )
        nodes.start('vgdp_planner', python('vgdp_planner.node'), {'seed': options.seed})
        wait_for_nodes({'recorder', 'bev_mapper', 'vgdp_planner'}, nodes, watcher)
        nodes.start(
            'maze_sim',
            python('maze_sim.node'),
            {
                'kind': options.kind,
                'size': options.size,
                'seed': options.seed,
                'view_range': options.view_range,
                'rate': options.rate,
                'max_steps': options.max_steps,
            },
        )
        with make_display(console) as display:
            follow(watcher, nodes, display, options.timeout)
        nodes.stop()


def python(module: str) -> list[str]:
    """Return the command that runs a module."""
    return [sys.executable, '-m', module]


def wait_for_nodes(names: set[str], nodes: NodeProcesses, watcher: RunWatcher) -> None:
    """Wait until nodes of these names are there.

    Raises:
        NodeFailure: If one ended.
        TimeoutError: If it takes too long.
    """
    end = time.monotonic() + START_TIMEOUT_S
    while missing := names - watcher.node_names():
        nodes.check()
        if time.monotonic() > end:
            msg = f'{", ".join(sorted(missing))} did not start in {START_TIMEOUT_S:.0f} s.'
            raise TimeoutError(msg)
        watcher.spin(REFRESH_S)


def follow(watcher: RunWatcher, nodes: NodeProcesses, display: Display, timeout: float) -> None:
    """Show the episode until it has ended."""
    progress = watcher.progress
    steps, last_step = 0, time.monotonic()
    while progress.outcome in ('', Outcome.RUNNING):
        watcher.spin(REFRESH_S)
        nodes.check()
        display.update(progress)
        if len(progress.path) > steps:
            steps, last_step = len(progress.path), time.monotonic()
        elif time.monotonic() - last_step > timeout:
            msg = f'Nothing has moved for {timeout:.0f} s after step {progress.steps}.'
            raise TimeoutError(msg)
    watcher.spin(AFTERMATH_S)
    display.update(progress)


def make_display(console: Console) -> Display:
    """Return what suits a terminal, or a file."""
    return LiveDisplay(console) if console.is_terminal else PlainDisplay(console)
