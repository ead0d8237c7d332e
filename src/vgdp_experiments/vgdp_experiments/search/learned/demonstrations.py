"""Demonstrations of searching homes: `vgdp data homes-expert`.

Each home is searched by several who decide, for several things: by the expert who knows the home,
by the nearest frontier and by the planner as it comes. So there are partial maps of good ways and
of detours, as they are when a decision is due. What the expert would have done at each of them
follows from the home's graph, so it is kept as tables: of costs to each thing from each position.
Nothing of that is there when a learned method decides; it is what methods are trained on.

Letters in shapes: P positions, V views of a position, T things, N decisions.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from avd_player.avd_format import VIEWS, read_instance_ids
from avd_player.scene import Scene
from avd_player.simulation import ActiveVisionSimulation, SearchRules
from gridnav import DONE
from gridnav.rgbd import FrameError
from vgdp_experiments.map_codes import pack
from vgdp_experiments.options import add_settings, read_settings
from vgdp_experiments.preset_settings import require_positive
from vgdp_experiments.search.loop import search
from vgdp_experiments.search.mapping import SceneMapper
from vgdp_experiments.search.noise import Sensors
from vgdp_experiments.search.searchers import FrontierSearcher, PlannerSearcher, Searcher, Sight
from vgdp_experiments.search.views import SmallViews, small_views
from vgdp_planner import ValueGuidedPlanner

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from vgdp_planner.planning_grid import PlanningGrid


@dataclass(frozen=True)
class HomeDemonstrations:
    """What was noted in one home.

    Attributes:
        color: Of the small views of each position, uint8 (P, V, 36, 64, 3).
        depth: Millimetres, uint16 (P, V, 36, 64).
        points: Metres in the map, NaN for none, float32 (P, V, 9, 16, 3).
        bearings: Radians, NaN for a view that can't be read, float32 (P, V).
        positions: Metres in the map, float64 (P, 2).
        moves: Where each move leads, −1 for none, int64 (P, 8).
        lengths: Of the moves in steps of 0.30 m, infinite for none, float64 (P, 8).
        sees: From which positions which thing is seen, bool (T, P).
        first: Cost of the best way for one who has not seen the thing before, float64 (T, P).
        after: Cost of the best way for one who has, float64 (T, P).
        codes: Packed partial maps, in the lower left corner of arrays of one size, uint8
            (N, H, W).
        sizes: Rows and columns of the maps, int64 (N, 2).
        origins: x and y of their lower left corners in metres, float64 (N, 2).
        at: The robot's position, int64 (N,).
        episodes: Which search, int64 (N,).
        thing: What is looked for, int64 (N,).
        visited: Where the robot has been, bool (N, P).
        settings: How they were made, and the name of the home.
    """

    color: NDArray[np.uint8]
    depth: NDArray[np.uint16]
    points: NDArray[np.float32]
    bearings: NDArray[np.float32]
    positions: NDArray[np.float64]
    moves: NDArray[np.int64]
    lengths: NDArray[np.float64]
    sees: NDArray[np.bool_]
    first: NDArray[np.float64]
    after: NDArray[np.float64]
    codes: NDArray[np.uint8]
    sizes: NDArray[np.int64]
    origins: NDArray[np.float64]
    at: NDArray[np.int64]
    episodes: NDArray[np.int64]
    thing: NDArray[np.int64]
    visited: NDArray[np.bool_]
    settings: dict[str, Any]

    def __len__(self) -> int:
        """Return how many decisions were noted."""
        return len(self.at)

    @property
    def name(self) -> str:
        """Name of the home."""
        return str(self.settings['scene'])

    def save(self, path: Path) -> None:
        """Write everything into a file, which is there as a whole or not at all."""
        arrays = {item.name: getattr(self, item.name) for item in fields(self)}
        part = path.with_suffix('.part')
        with part.open('wb') as file:
            np.savez_compressed(file, **{**arrays, 'settings': json.dumps(self.settings)})
        part.replace(path)

    @classmethod
    def load(cls, path: Path) -> HomeDemonstrations:
        """Read what `save` wrote.

        Raises:
            ValueError: If the file does not hold that, with one sentence that says why.
        """
        try:
            with np.load(path, allow_pickle=False) as arrays:
                found = {item.name: arrays[item.name] for item in fields(cls)}
            found['settings'] = json.loads(str(found['settings']))
        except (OSError, KeyError, ValueError, EOFError) as error:
            msg = f'{path} does not hold demonstrations of a home: {error}.'
            raise ValueError(msg) from error
        return cls(**found)

    def costs(self, thing: int, *, seen: bool) -> NDArray[np.float64]:
        """Return the expert's cost to a thing from each position, (P,)."""
        return self.after[thing] if seen else self.first[thing]

    def plan(self, thing: int, position: int, horizon: int, *, seen: bool) -> list[int]:
        """Return the expert's next steps, ending in Done, `horizon` of them."""
        steps: list[int] = []
        while len(steps) < horizon:
            seen = seen or bool(self.sees[thing, position])
            if seen and self.after[thing, position] == 0:
                break
            ahead = self.moves[position]
            costs = self.lengths[position] + self.costs(thing, seen=seen)[ahead]
            action = int(costs.argmin())
            if not np.isfinite(costs[action]):
                break
            steps.append(action)
            position = int(ahead[action])
        return steps + [DONE] * (horizon - len(steps))

    def open_things(self, index: int) -> NDArray[np.int64]:
        """Return the things that are still to be found at a decision and have not been seen."""
        visited = self.visited[index]
        hidden = ~(self.sees & visited).any(axis=1)
        return np.flatnonzero(hidden & np.isfinite(self.first[:, self.at[index]]))


@dataclass(frozen=True)
class DataSettings:
    """Settings of the generation.

    Attributes:
        data: Folder of the homes: synthetic ones or scenes of the Active Vision Dataset.
        scenes: Their names, with commas between them; all in the folder if empty.
        out: Folder for the demonstrations, one file for each home; complete ones are kept.
        episodes: Searches of each home.
        seed: Of the starts and of those who decide.
        width: Of the images that are mapped, in pixels.
        min_expert_steps: Moves from a start to where Done succeeds, at least.
        max_steps: Actions after which a search ends.
    """

    data: str = 'out/homes-small'
    scenes: str = ''
    out: str = 'runs/homes-expert'
    episodes: int = 8
    seed: int = 0
    width: int = 128
    min_expert_steps: int = 10
    max_steps: int = 120

    def __post_init__(self) -> None:
        """Check the ranges."""
        require_positive(self, ('episodes', 'width', 'max_steps'))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings as options."""
    add_settings(parser, DataSettings)


def run(arguments: argparse.Namespace) -> int:
    """Search homes and write what was noted; returns the exit code."""
    settings = read_settings(DataSettings, arguments)
    folders = _scenes(settings)
    out = Path(settings.out)
    out.mkdir(parents=True, exist_ok=True)
    for folder in tqdm(folders, desc='homes', unit='home'):
        path = out / f'{folder.name}.npz'
        if not path.exists():
            demonstrate(folder, settings).save(path)
    print(f'Demonstrations of {len(folders)} homes are in {out}.')  # noqa: T201
    return 0


def _scenes(settings: DataSettings) -> list[Path]:
    data = Path(settings.data)
    names = [name for name in settings.scenes.split(',') if name]
    folders = [data / name for name in names] if names else sorted(data.glob('Home_*'))
    missing = next((folder for folder in folders if not folder.is_dir()), None)
    if missing is not None or not folders:
        msg = f'There is no scene {missing or data}.'
        raise ValueError(msg)
    return folders


def load_homes(
    folder: Path, leave_out: Sequence[str] = (), only: Sequence[str] = ()
) -> list[HomeDemonstrations]:
    """Read the demonstrations of a folder.

    Args:
        folder: Of `vgdp data homes-expert`.
        leave_out: Names of homes that are not read.
        only: Names of the homes to read, all if empty.

    Raises:
        ValueError: If there are none, or a name is wrong, with one sentence that says so.
    """
    paths = {path.stem: path for path in sorted(folder.glob('*.npz'))}
    unknown = next((name for name in (*leave_out, *only) if name not in paths), None)
    if unknown is not None:
        msg = f'There are no demonstrations of {unknown} in {folder}.'
        raise ValueError(msg)
    kept = [name for name in only or paths if name not in leave_out]
    if not kept:
        msg = f'There are no demonstrations in {folder}; make them with `vgdp data homes-expert`.'
        raise ValueError(msg)
    return [HomeDemonstrations.load(paths[name]) for name in kept]


def demonstrate(folder: Path, settings: DataSettings) -> HomeDemonstrations:
    """Search a home for each thing in it, and note all decisions.

    Raises:
        ValueError: If nothing in it can be looked for.
    """
    scene = Scene.open(folder, settings.width)
    simulations = _simulations(scene, settings)
    tables = _Tables.of(scene, simulations)
    walkers: list[Searcher] = [
        PlannerSearcher(ValueGuidedPlanner.from_pretrained()),
        FrontierSearcher(),
    ]
    notes: list[_Note] = []
    mapper = SceneMapper(Sensors(scene))
    for episode in tqdm(range(settings.episodes), desc=scene.name, leave=False):
        thing = episode % len(simulations)
        simulation = simulations[thing]
        turn = (episode + episode // len(simulations)) % (len(walkers) + 1)
        walker = walkers[turn] if turn < len(walkers) else _Guided(simulation, tables, thing)
        noting = _Noting(simulation, walker, episode, thing)
        search(simulation, noting, settings.seed + episode, mapper=mapper)
        notes += noting.notes
    arrays = {**asdict(tables), **_views(scene)._asdict(), **_arrays(notes, len(scene.views))}
    # Where the homes are plays no part.
    made = {**asdict(settings), 'data': '', 'scene': scene.name}
    made['things'] = [simulation.rules.target for simulation in simulations]
    return HomeDemonstrations(**arrays, settings=made)


def _simulations(scene: Scene, settings: DataSettings) -> list[ActiveVisionSimulation]:
    """Return a simulation for each thing that can be looked for in a scene."""
    made = []
    reasons = []
    for name in _instance_names(scene):
        rules = SearchRules(
            target=name,
            max_steps=settings.max_steps,
            min_expert_steps=settings.min_expert_steps,
        )
        try:
            made.append(ActiveVisionSimulation(scene, rules))
        except ValueError as error:
            reasons.append(str(error))
    if not made:
        msg = f'There is nothing to look for in {scene.name}: {reasons[:1] or "no instances"}.'
        raise ValueError(msg)
    return made


def _instance_names(scene: Scene) -> list[str]:
    """Return the names of the instances that boxes of a scene are of."""
    files = scene.source.files
    numbers = {
        int(number)
        for annotation in files.annotations.values()
        for number in annotation.boxes[:, 4]
    }
    return [name for name, number in read_instance_ids(files.folder).items() if number in numbers]


@dataclass(frozen=True)
class _Tables:
    """The fields of `HomeDemonstrations` that say what the home is like."""

    positions: NDArray[np.float64]
    moves: NDArray[np.int64]
    lengths: NDArray[np.float64]
    sees: NDArray[np.bool_]
    first: NDArray[np.float64]
    after: NDArray[np.float64]

    @classmethod
    def of(cls, scene: Scene, simulations: Sequence[ActiveVisionSimulation]) -> _Tables:
        """Ask the simulations of a scene, one for each thing."""
        rules = [simulation.rules for simulation in simulations]
        seen_in = [
            scene.sightings(scene.instance_id(rule.target), rule.max_difficulty, rule.max_range)
            for rule in rules
        ]
        return cls(
            scene.positions,
            scene.moves,
            scene.costs,
            np.array(
                [[any(n in seen for n in names) for names in scene.views] for seen in seen_in]
            ),
            np.stack([simulation.expert.costs for simulation in simulations]),
            np.stack([simulation.expert.after for simulation in simulations]),
        )


@dataclass(frozen=True)
class _Note:
    """One decision; see the fields of `HomeDemonstrations`."""

    grid: PlanningGrid
    at: int
    episode: int
    thing: int
    visited: frozenset[int]


class _Noting:
    """Lets another one decide, and notes what was decided on.

    Attributes:
        notes: One for each decision.
    """

    def __init__(
        self, simulation: ActiveVisionSimulation, walker: Searcher, episode: int, thing: int
    ) -> None:
        self.notes: list[_Note] = []
        self._simulation, self._walker = simulation, walker
        self._episode, self._thing = episode, thing
        self._visited: frozenset[int] = frozenset()

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._visited = frozenset([self._simulation.position])
        self._walker.reset(seed)

    def decide(self, sight: Sight) -> list[int]:
        """Note what there is to see, and return what the other one decides."""
        at = self._simulation.position
        self.notes.append(_Note(sight.grid, at, self._episode, self._thing, self._visited))
        committed = self._walker.decide(sight)
        for action in committed:
            if action != DONE:
                ahead = int(self._simulation.scene.moves[at, action])
                at = at if ahead < 0 else ahead
                self._visited |= {at}
        return committed


class _Guided:
    """The expert, who knows the home."""

    def __init__(self, simulation: ActiveVisionSimulation, tables: _Tables, thing: int) -> None:
        self._simulation, self._tables, self._thing = simulation, tables, thing

    def reset(self, seed: int) -> None:
        """Begin an episode; nothing is random."""

    def decide(self, sight: Sight) -> list[int]:  # noqa: ARG002 - it knows
        """Return the next step of the shortest way."""
        tables, at = self._tables, self._simulation.position
        seen = self._simulation.goal is not None
        if seen and self._simulation.goals[at]:
            return [DONE]
        costs = (tables.after if seen else tables.first)[self._thing]
        return [int((tables.lengths[at] + costs[tables.moves[at]]).argmin())]


def _views(scene: Scene) -> SmallViews:
    """Return the small views of all positions of a scene; those that can't be read are empty."""
    count = len(scene.views)
    made = SmallViews.empty(count, max(VIEWS, *map(len, scene.views)))
    for position, names in enumerate(tqdm(scene.views, desc='views', leave=False)):
        frames = []
        for name in names:
            try:
                frames.append(scene.frame(name))
            except FrameError:
                continue
        seen = small_views(frames)
        made.color[position, : len(frames)] = seen.color
        made.depth[position, : len(frames)] = seen.depth
        made.points[position, : len(frames)] = seen.points
        made.bearings[position, : len(frames)] = seen.bearings
    return made


def _arrays(notes: Sequence[_Note], positions: int) -> dict[str, Any]:
    """Return the fields of `HomeDemonstrations` that are about decisions."""
    sizes = np.array([note.grid.partial_map.shape[1:] for note in notes])
    codes = np.zeros((len(notes), *sizes.max(axis=0)), dtype=np.uint8)
    visited = np.zeros((len(notes), positions), dtype=np.bool_)
    for index, note in enumerate(notes):
        code = pack(note.grid.partial_map[None])[0]
        codes[index, : code.shape[0], : code.shape[1]] = code
        visited[index, sorted(note.visited)] = True
    geometries = [note.grid.geometry for note in notes]
    return {
        'codes': codes,
        'sizes': sizes,
        'origins': np.array([(g.origin_x, g.origin_y) for g in geometries]),
        'at': np.array([note.at for note in notes]),
        'episodes': np.array([note.episode for note in notes]),
        'thing': np.array([note.thing for note in notes]),
        'visited': visited,
    }
