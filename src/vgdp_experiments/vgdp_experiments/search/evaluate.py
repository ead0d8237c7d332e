"""Evaluates searchers in scenes, each on the same starts."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from avd_player.scene import Scene
from avd_player.simulation import ActiveVisionSimulation, SearchRules
from gridnav import EpisodeResult, Outcome
from vgdp_experiments.scores import Trial
from vgdp_experiments.search.detector import finder_for
from vgdp_experiments.search.loop import IMAGE_WIDTH, search
from vgdp_experiments.search.mapping import SceneMapper
from vgdp_experiments.search.noise import Sensors
from vgdp_experiments.search.registry import CLAIRVOYANT, SEARCHERS
from vgdp_experiments.search.searchers import PlannerSearcher

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable
    from pathlib import Path

    from vgdp_experiments.search.home_setting import HomeSetting
    from vgdp_experiments.search.searchers import Searcher, Sight

SEEDS_A_TRIAL = 1000
"""Search n of trial t has the seed 1000 t + n."""

KEPT_SCENES = 2
KEPT_TRIALS = 6
"""What was worked out for the latest scenes, and for those with the latest noise, is kept."""


@dataclass(frozen=True)
class Home:
    """A scene with what senses and maps it.

    Attributes:
        simulation: The scene and what is looked for.
        mapper: Maps it.
    """

    simulation: ActiveVisionSimulation
    mapper: SceneMapper


def open_home(data: Path, setting: HomeSetting, trial: int) -> Home:
    """Open a scene; what was worked out for an earlier search of it is used again.

    Args:
        data: Folder of the scenes.
        setting: The scene and the noise there.
        trial: Number of the trial, which is the seed of the noise, too.

    Raises:
        ValueError: If the scene can't be used.
    """
    return _home(data, setting, trial if setting.noise else 0)


@lru_cache(maxsize=KEPT_TRIALS)
def _home(data: Path, setting: HomeSetting, seed: int) -> Home:
    scene = _scene(data / setting.scene)
    sensors = Sensors(scene, setting.noise, seed)
    rules = SearchRules(max_steps=setting.budget)
    simulation = ActiveVisionSimulation(scene, rules, finder_for(sensors, rules))
    return Home(simulation, SceneMapper(sensors))


@lru_cache(maxsize=KEPT_SCENES)
def _scene(folder: Path) -> Scene:
    return Scene.open(folder, IMAGE_WIDTH)


class _Timed:
    """A searcher, and how long it takes to decide."""

    def __init__(self, searcher: Searcher, trial: Trial) -> None:
        self._searcher = searcher
        self._trial = trial

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._searcher.reset(seed)

    def decide(self, sight: Sight) -> list[int]:
        """Return what the searcher decides."""
        begin = time.perf_counter()
        committed = self._searcher.decide(sight)
        self._trial.seconds += time.perf_counter() - begin
        self._trial.decisions += 1
        return committed


def run_searches(
    home: Home,
    method: str,
    args: argparse.Namespace,
    trial: int,
    numbers: range,
    on_finished: Callable[[int], object] = lambda _count: None,
) -> tuple[Trial, dict[str, Any]]:
    """Search a scene from several starts.

    Args:
        home: The scene.
        method: Who searches.
        args: The options of the planner.
        trial: Number of the trial.
        numbers: Of the searches in it.
        on_finished: Is told how many searches have ended since the last time.

    Returns:
        What came out, and what shaped the decisions.

    Raises:
        ValueError: If the weights can't be used.
    """
    found = Trial(trial)
    seeds = [SEEDS_A_TRIAL * trial + number for number in numbers]
    if method == CLAIRVOYANT:
        found.results.extend(shortest(home.simulation, seed) for seed in seeds)
        on_finished(len(seeds))
        return found, {}
    searcher = SEARCHERS[method](args)
    timed = _Timed(searcher, found)
    for seed in seeds:
        found.results.append(search(home.simulation, timed, seed, mapper=home.mapper))
        on_finished(1)
    return found, searcher.settings if isinstance(searcher, PlannerSearcher) else {}


def shortest(simulation: ActiveVisionSimulation, seed: int) -> EpisodeResult:
    """Return what comes out for one who knows the scene: the shortest way, and Done."""
    simulation.restart(seed)
    steps = int(simulation.expert.steps[simulation.start])
    cost = float(simulation.expert.costs[simulation.start])
    return EpisodeResult(Outcome.SUCCESS, steps + 1, cost, steps, cost)
