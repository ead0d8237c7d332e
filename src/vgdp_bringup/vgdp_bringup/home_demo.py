"""The demo in a home: a robot with a camera looks for a bottle, as separate processes."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from avd_player.homes.synth import write_homes
from avd_player.homes.write import scene_name
from avd_player.sources import open_source
from vgdp_bringup.demo import (
    follow,
    make_display,
    present,
    python,
    wait_for_nodes,
)
from vgdp_bringup.processes import NodeProcesses, free_domain_id
from vgdp_bringup.watcher import RunWatcher
from vgdp_experiments.search.loop import (
    BLOCKED_AFTER,
    CLOSER_LOOK_CELLS,
    GOAL_REACH_M,
    GOAL_TOLERANCE_M,
    IMAGE_WIDTH,
    ROBOT_RADIUS_M,
    STEP_M,
)
from vgdp_experiments.search.mapping import mapper_config

if TYPE_CHECKING:
    from rich.console import Console

VIEWS = 12
"""Images of a position."""

WAIT_S = 30.0
"""The robot stands still meanwhile, so no view need be left out."""

HOMES_SEED = 1
"""Of the homes; the seed of the demo says which of them."""

QUICK_IMAGES = Path(__file__).with_name('quick_images.xml')
"""Settings of Fast DDS with which processes find each other at once and exchange many images."""

RECORDED = (
    'odom map goal_pose plan action waypoint plan_candidates value_map episode '
    'camera/camera_info /diagnostics'
)
"""Images and points would make a bag of several hundred megabytes."""


@dataclass(frozen=True)
class HomeDemoOptions:
    """What the demo does.

    Attributes:
        seed: Number of the synthetic home, seed of the start and of the planner.
        scene: Folder of a scene to use instead of a synthetic home.
        segmenter: What tells floor from obstacles.
        rate: Steps a second; 0 is as fast as it goes.
        max_steps: Actions after which the search ends.
        timeout: Seconds without any new step after which the run counts as stuck.
        images: Whether images and points are recorded, too.
        homes: Folder for the synthetic homes, which are made once.
        out: Folder for the bag, the logs and the pictures.
    """

    seed: int
    scene: Path | None
    segmenter: str
    rate: float
    max_steps: int
    timeout: float
    images: bool
    homes: Path
    out: Path


def run(options: HomeDemoOptions) -> int:
    """Run the demo; returns the exit status, 0 only if the bottle was found."""
    return present(lambda bag, console: run_stack(options, bag, console), options.out)


def run_stack(options: HomeDemoOptions, bag: Path, console: Console) -> None:
    """Make a home, run one search in it on real nodes, and record it.

    Raises:
        NodeFailure: If a node ended by itself or could not be stopped well.
        TimeoutError: If nothing happened for too long.
        ValueError: If the scene can't be used.
    """
    scene = options.scene or _make_home(options, console)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        mapper = mapper_parameters(scene, options.segmenter)
    for warning in caught:
        console.print(str(warning.message), soft_wrap=True)
    domain_id = free_domain_id()
    os.environ.setdefault('FASTRTPS_DEFAULT_PROFILES_FILE', str(QUICK_IMAGES))
    console.print(f'Starting the nodes, ROS_DOMAIN_ID={domain_id}.')
    with NodeProcesses(options.out / 'logs', domain_id) as nodes, RunWatcher(domain_id) as watcher:
        topics = {} if options.images else {'topics': f"'{RECORDED}'"}
        nodes.start('recorder', python('vgdp_bringup.node'), {'bag': bag, **topics})
        nodes.start(
            'bev_mapper',
            python('bev_mapper.node'),
            mapper,
        )
        nodes.start(
            'vgdp_planner',
            python('vgdp_planner.node'),
            planner_parameters(options.seed),
        )
        wait_for_nodes({'recorder', 'bev_mapper', 'vgdp_planner'}, nodes, watcher)
        nodes.start(
            'avd_player',
            python('avd_player.node'),
            player_parameters(scene, options.seed, options.rate, options.max_steps),
        )
        with make_display(console) as display:
            follow(watcher, nodes, display, options.timeout)
        nodes.stop()


def player_parameters(scene: Path, seed: int, rate: float, max_steps: int) -> dict[str, object]:
    """Return the player's parameters for a search of a scene."""
    return {
        'source': str(scene),
        'mode': 'closed_loop',
        'width': IMAGE_WIDTH,
        'seed': seed,
        'rate': rate,
        'max_steps': max_steps,
    }


def mapper_parameters(scene: Path, segmenter: str) -> dict[str, object]:
    """Return the mapper's parameters for the camera of a scene.

    Raises:
        FrameError: If the scene can't be used.
    """
    config, mount = mapper_config(), open_source(scene).mount
    geometry = config.geometry
    return {
        'input': 'rgbd',
        'segmenter': segmenter,
        'width': geometry.cols,
        'height': geometry.rows,
        'origin_x': geometry.origin_x,
        'origin_y': geometry.origin_y,
        'resolution': geometry.resolution,
        'growth': config.growth,
        'free_below': config.free_below,
        'max_range': config.max_range,
        'fit_floor': config.fit_floor,
        'views_per_step': VIEWS,
        'reliable_images': True,
        'wait': WAIT_S,
        **{f'camera_{name}': float(value) for name, value in mount._asdict().items()},
    }


def planner_parameters(seed: int) -> dict[str, object]:
    """Return the planner's parameters for a robot that moves from position to position."""
    return {
        'seed': seed,
        'robot_radius': ROBOT_RADIUS_M,
        'planning_resolution': STEP_M,
        'goal_tolerance': GOAL_TOLERANCE_M,
        'goal_reach': GOAL_REACH_M,
        'blocked_after': BLOCKED_AFTER,
        'closer_look': CLOSER_LOOK_CELLS,
    }


def _make_home(options: HomeDemoOptions, console: Console) -> Path:
    """Return the folder of the synthetic home, which is made unless it is there."""
    console.print('Making a home, which takes a minute or two the first time.')
    number = options.seed + 1
    write_homes(options.homes, 1, HOMES_SEED, first=number, workers=os.cpu_count() or 1)
    return options.homes / scene_name(number)
