"""Searching a bottle in homes: the paper's tables on the Active Vision Dataset."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from avd_player.avd_format import looks_like_scene
from vgdp_experiments import plots, sweep
from vgdp_experiments.jobs import Variant
from vgdp_experiments.pages import (
    MISSING,
    command,
    describe,
    details,
    markdown_table,
    origin,
    ratio,
    success,
    with_sd,
)
from vgdp_experiments.results import PlaceResults
from vgdp_experiments.scores import RESAMPLES, MethodResults, Trial
from vgdp_experiments.search.home_setting import HomeSetting
from vgdp_experiments.search.noise import Noise
from vgdp_experiments.suite import Page, Suite

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterable, Sequence

    from matplotlib.figure import Figure

    from vgdp_experiments.results import Results
    from vgdp_experiments.scores import Scores

DATA = Path('out/homes')

HELD_OUT = tuple(f'Home_{number}_1' for number in range(113, 121))
"""Synthetic homes that nothing is trained on."""

PAPERS = (
    'Home_001_1',
    'Home_001_2',
    'Home_002_1',
    'Home_003_1',
    'Home_003_2',
    'Home_004_1',
    'Home_007_1',
    'Home_010_1',
)
"""Scenes of the Active Vision Dataset with the bottle in them."""

MEAN = 'mean'

METHODS = (
    'vgdp',
    'greedy',
    'vgdp_object',
    'vgdp_rgbd',
    'calvin_2d',
    'calvin_3d',
    'frontier',
    'clairvoyant',
)

CURVED = ('vgdp', 'vgdp_object', 'vgdp_rgbd', 'calvin_2d', 'calvin_3d', 'frontier')
"""Methods of the curves."""

PAPER_NOISE = Noise(depth=1.0)

Rates = tuple[tuple[float, float], ...]

PUBLISHED_METHODS = ('CALVIN-2D', 'CALVIN-3D', 'zero-shot', 'retrained')

PUBLISHED: dict[str, Rates] = {
    'Home_001_1': ((0.692, 0.037), (0.720, 0.052), (0.769, 0.038), (0.776, 0.028)),
    'Home_001_2': ((0.627, 0.037), (0.640, 0.048), (0.655, 0.033), (0.732, 0.030)),
    'Home_002_1': ((0.735, 0.035), (0.740, 0.048), (0.728, 0.034), (0.755, 0.027)),
    'Home_003_1': ((0.606, 0.042), (0.642, 0.060), (0.638, 0.041), (0.686, 0.031)),
    'Home_003_2': ((0.558, 0.033), (0.590, 0.043), (0.603, 0.033), (0.622, 0.030)),
    'Home_004_1': ((0.647, 0.040), (0.680, 0.050), (0.684, 0.042), (0.695, 0.036)),
    'Home_007_1': ((0.587, 0.038), (0.610, 0.045), (0.584, 0.039), (0.601, 0.035)),
    'Home_010_1': ((0.728, 0.033), (0.736, 0.043), (0.769, 0.032), (0.781, 0.028)),
    MEAN: ((0.635, 0.032), (0.682, 0.047), (0.679, 0.040), (0.706, 0.032)),
}
"""Success in the paper's table, mean and standard deviation over five trials of 50 searches, of
`PUBLISHED_METHODS`."""

PUBLISHED_NOISY: dict[str, Rates] = {
    'Home_001_1': ((0.674, 0.048), (0.714, 0.059), (0.767, 0.043), (0.772, 0.033)),
    'Home_001_2': ((0.604, 0.042), (0.638, 0.058), (0.652, 0.036), (0.730, 0.031)),
    'Home_002_1': ((0.696, 0.045), (0.735, 0.050), (0.727, 0.033), (0.754, 0.030)),
    'Home_003_1': ((0.613, 0.050), (0.636, 0.059), (0.634, 0.043), (0.681, 0.038)),
    'Home_003_2': ((0.552, 0.036), (0.589, 0.048), (0.602, 0.034), (0.620, 0.035)),
    'Home_004_1': ((0.634, 0.043), (0.674, 0.057), (0.681, 0.042), (0.690, 0.043)),
    'Home_007_1': ((0.580, 0.041), (0.602, 0.049), (0.584, 0.040), (0.598, 0.038)),
    'Home_010_1': ((0.717, 0.030), (0.731, 0.046), (0.766, 0.032), (0.780, 0.033)),
    MEAN: ((0.626, 0.037), (0.670, 0.052), (0.675, 0.042), (0.700, 0.040)),
}
"""The same with noise N(0, I) on depth."""

ABLATION = {
    'single_sample': ('one sample of the policy', (0.024, 0.012)),
    'voting': ('the most frequent of many samples', (0.082, 0.026)),
    'guidance': ('the sample of the highest value', (0.542, 0.031)),
    'guidance_memory': ('the same with the best-plan memory', (0.776, 0.028)),
    'vgdp': ('the whole planner', None),
    'no_projector': ('a learned projector in place of the projected map', (0.486, 0.036)),
    'frontier': ('exploration of the nearest frontier', None),
}
"""What the rows of the paper's ablation on Home_001_1 are, and success in it. It is of the policy
that was trained with images."""

CURVES: dict[str, tuple[str, dict[float, Noise]]] = {
    'depth': (
        'noise of the depth, σ in mm',
        {value: Noise(depth=value) for value in (1.0, 10.0, 30.0, 100.0)},
    ),
    'missing': (
        'share of pixels without depth',
        {value: Noise(missing=value) for value in (0.3, 0.6, 0.9)},
    ),
    'position': (
        'noise of the position, σ in mm',
        {value: Noise(position=value, heading=value / 25) for value in (25.0, 50.0, 100.0)},
    ),
    'labels': (
        'share of pixels with a wrong class',
        {value: Noise(labels=value) for value in (0.1, 0.3, 0.5)},
    ),
    'detector': (
        'share of missed boxes, with false ones in 1 % of the images',
        {value: Noise(missed=value, false=0.01) for value in (0.0, 0.3, 0.6)},
    ),
}
"""What is wrong, how it is called, and its amounts. A heading is off by 1° for 25 mm."""

EXPLANATION = f"""\
A search succeeds with Done within 1 m of the bottle, or at the position that is nearest to it,
once the bottle was in sight; it has 500 actions. SPL weighs success by the length of the way over
that of the shortest one on which the bottle is seen. ± is the standard deviation over the trials.
95 % intervals of success are Wilson's; those of SPL and of its ratio to nearest-frontier
exploration come from {RESAMPLES} bootstrap resamples of the searches, the same for both methods of
a ratio. They say nothing of how homes differ. All methods search the same scenes from the same
starts. `clairvoyant` knows the scene and walks the shortest way."""

TEXT = """\
# {title}

{about}

`{command}`

{origin}

{explanation}

## Success

{success}

## SPL over that of nearest-frontier exploration

{ratios}
"""

ABOUT = """\
The robot searches the bottle in homes that nothing was trained on. `vgdp` is the planner as it is
shipped, trained on mazes alone; `greedy` steps on its values without a sample. `vgdp_object` has a
value of the unseen that was learned in other homes, `vgdp_rgbd` a policy and a value that read the
images, too; `calvin_2d` and `calvin_3d` are CALVIN on the projected maps and on a learned lattice.
`frontier` goes to the nearest frontier of the same maps. Columns with *paper* are its numbers, on
the real scenes."""

ABOUT_NOISY = """\
As in the table without noise, but the depth images have noise of N(0, σ²) with σ = 1, in their own
unit, which is a millimetre. The paper says N(0, I) and no unit."""


def scene_settings(scenes: Iterable[str], noise: Noise | None = None) -> dict[str, HomeSetting]:
    """Return the settings of some scenes by name."""
    return {scene: HomeSetting(scene, noise=noise or Noise()) for scene in scenes}


def curve_settings(scenes: Iterable[str]) -> dict[str, HomeSetting]:
    """Return each scene without noise and with each amount of it, by name."""
    noises = [Noise(), *(noise for _, amounts in CURVES.values() for noise in amounts.values())]
    settings = [HomeSetting(scene, noise=noise) for scene in scenes for noise in noises]
    return {setting.place: setting for setting in settings}


def pooled(places: Sequence[PlaceResults]) -> PlaceResults:
    """Return the results of several scenes as if they were one, trial by trial."""
    first = places[0]
    methods = {}
    for name, results in first.methods.items():
        trials = [Trial(trial.seed) for trial in results.trials]
        for place in places:
            for trial, more in zip(trials, place.methods[name].trials, strict=True):
                trial.extend(more)
        methods[name] = MethodResults(results.settings, trials)
    setting = first.setting
    if isinstance(setting, HomeSetting) and len(places) > 1:
        setting = replace(setting, scene=f'{len(places)} scenes')
    return PlaceResults(setting, methods)


def page(
    results: Results, *, title: str, about: str, words: str, published: dict[str, Rates]
) -> Page:
    """Show the results beside the paper's."""
    whole = pooled(list(results.places.values()))
    names = list(whole.methods)
    successes, ratios, sections = [], [], []
    for scene, place in {**results.places, MEAN: whole}.items():
        scores = place.scores()
        theirs = published.get(scene)
        successes.append(
            (
                scene,
                *([with_sd(*rate) for rate in theirs] if theirs else [MISSING] * 4),
                *(success(scores[name]) for name in names),
            )
        )
        ratios.append((scene, *(ratio(scores[name]) for name in names)))
        sections.append(f'\n## {describe(place)}\n\n{details(place)}\n')
    ours = [f'`{name}`' for name in names]
    theirs_names = [f'{name} (paper)' for name in PUBLISHED_METHODS]
    text = TEXT.format(
        title=title,
        about=about,
        command=command(words, results, methods=METHODS),
        origin=origin(results),
        explanation=EXPLANATION,
        success=markdown_table(('scene', *theirs_names, *ours), successes),
        ratios=markdown_table(('scene', *ours), ratios),
    )
    return Page(text + ''.join([sections[-1], *sections[:-1]]))


ABLATION_TEXT = """\
# Searching a bottle: what each part of the planner adds

The rows of the paper's ablation, here of the policy that was trained on mazes alone, in homes. The
paper's are of the policy that was trained with images, in Home_001_1.

`{command}`

{origin}

{explanation}

{table}

{details}
"""


def ablation_page(results: Results) -> Page:
    """Show the ablation beside the paper's."""
    whole = pooled(list(results.places.values()))
    rows = []
    for name, scores in whole.scores().items():
        what, theirs = ABLATION[name]
        shown = MISSING if theirs is None else with_sd(*theirs)
        rows.append((f'`{name}`', what, shown, success(scores), ratio(scores)))
    headings = ('method', 'what it is', 'paper', 'success', 'SPL / frontier')
    return Page(
        ABLATION_TEXT.format(
            command=command('vgdp eval avd --ablation', results, methods=ABLATION),
            origin=origin(results),
            explanation=EXPLANATION,
            table=markdown_table(headings, rows),
            details=f'## {describe(whole)}\n\n{details(whole)}',
        )
    )


CURVES_TEXT = """\
# Searching a bottle with worse sensors

Success and SPL against the amount of each kind of noise, the others at none; bands are 95 %
intervals. A false box is a mistake of the detector; the robot gives up what it does not see again.

`{command}`

{origin}

{explanation}
"""


def curves_page(results: Results) -> Page:
    """Show the results as curves."""
    by_noise: dict[Noise, list[PlaceResults]] = {}
    scenes: dict[str, None] = {}
    for place in results.places.values():
        if isinstance(place.setting, HomeSetting):
            scenes[place.setting.scene] = None
            by_noise.setdefault(place.setting.noise, []).append(place)
    found = {noise: pooled(places) for noise, places in by_noise.items()}
    scores = {noise: place.scores() for noise, place in found.items()}
    sections, pictures = [], {}
    for kind, (what, amounts) in CURVES.items():
        shown = {
            value: noise for value, noise in {0.0: Noise(), **amounts}.items() if noise in found
        }
        file = f'avd_curves_{kind}.png'
        pictures[file] = _draw(what, {value: scores[noise] for value, noise in shown.items()})
        sections.append(f'\n## {kind}\n\n![Success and SPL against {what}]({file})\n')
        sections += [f'\n{describe(found[n])}\n\n{details(found[n])}\n' for n in shown.values()]
    words = f'vgdp eval avd --curves --scenes {" ".join(scenes)}'
    text = CURVES_TEXT.format(
        command=command(words, results, methods=CURVED),
        origin=origin(results),
        explanation=EXPLANATION,
    )
    return Page(text + ''.join(sections), pictures)


def _draw(what: str, scores: dict[float, dict[str, Scores]]) -> Figure:
    figure, (left, right) = plots.panels(2, 'Searching a bottle with worse sensors')
    plots.label(left, what, 'success')
    plots.label(right, what, 'SPL')
    names = [name for name in next(iter(scores.values()), {}) if name != 'clairvoyant']
    for color, name in enumerate(names):
        found = [each[name] for each in scores.values()]
        # Many bands lie over one another.
        shade = plots.SHADE / len(names) ** 0.5
        plots.score_curves(left, right, list(scores), found, name, color, shade)
    plots.legend(left)
    return figure


VARIANTS = {name: Variant(name) for name in METHODS}

AVD = Suite(
    name='avd',
    settings=scene_settings(HELD_OUT),
    variants=VARIANTS,
    page=partial(
        page,
        title='Searching a bottle in homes',
        about=ABOUT,
        words='vgdp eval avd',
        published=PUBLISHED,
    ),
    episodes=50,
)

NOISY = Suite(
    name='avd-noisy',
    settings=scene_settings(HELD_OUT, PAPER_NOISE),
    variants=VARIANTS,
    page=partial(
        page,
        title='Searching a bottle in homes, with noise on depth',
        about=ABOUT_NOISY,
        words='vgdp eval avd --noisy',
        published=PUBLISHED_NOISY,
    ),
    episodes=50,
)

ABLATED = Suite(
    name='avd-ablation',
    settings=scene_settings(HELD_OUT[:1]),
    variants={name: Variant(name) for name in ABLATION},
    page=ablation_page,
    episodes=50,
)

WORSE = Suite(
    name='avd-curves',
    settings=curve_settings(HELD_OUT[:4]),
    variants={name: Variant(name) for name in CURVED},
    page=curves_page,
    trials=1,
    episodes=25,
)

SUITES = {suite.name: suite for suite in (AVD, NOISY, ABLATED, WORSE)}

_SETTINGS: dict[str, Callable[[Iterable[str]], dict[str, HomeSetting]]] = {
    AVD.name: scene_settings,
    NOISY.name: partial(scene_settings, noise=PAPER_NOISE),
    ABLATED.name: scene_settings,
    WORSE.name: curve_settings,
}
"""What each evaluation makes of the names of scenes."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``vgdp eval avd``."""
    kinds = parser.add_mutually_exclusive_group()
    for option, suite, what in (
        ('--noisy', NOISY, "the paper's noise on depth, σ = 1 mm"),
        ('--ablation', ABLATED, 'what each part of the planner adds'),
        ('--curves', WORSE, 'success and SPL against several kinds of noise'),
    ):
        kinds.add_argument(option, dest='suite', action='store_const', const=suite.name, help=what)
    kinds.add_argument(
        '--picture',
        metavar='SCENE:SEED',
        help='draw one search into the file --out (search.png) instead; search n of trial t '
        'has the seed 1000 t + n',
    )
    parser.add_argument(
        '--data',
        type=Path,
        default=DATA,
        metavar='FOLDER',
        help='with the scenes: synthetic homes, or the Active Vision Dataset (%(default)s)',
    )
    parser.add_argument(
        '--scenes',
        nargs='+',
        metavar='NAME',
        help="scenes (the held-out homes, or those of the paper's table where they are)",
    )
    parser.add_argument(
        '--learned-weights',
        type=Path,
        metavar='FOLDER',
        help='with a folder of weights for each learned method, instead of those shipped',
    )
    sweep.add_arguments(AVD, parser, chosen=False)
    parser.set_defaults(suite=AVD.name, out=None)


def run(args: argparse.Namespace) -> int:
    """Run an evaluation and print its page, or draw a search; returns the exit status.

    Raises:
        ValueError: If the options can't be used.
        OSError: If a folder can't be read or written.
    """
    if args.picture:
        # Loaded late: the other evaluations draw nothing of the kind.
        from vgdp_experiments.search.pictures import draw_search  # noqa: PLC0415

        return draw_search(args)
    suite = SUITES[args.suite]
    scenes = args.scenes or _default_scenes(args.data, suite)
    for scene in scenes:
        if not looks_like_scene(args.data / scene):
            msg = (
                f'{args.data / scene} is no scene. Make homes with: vgdp avd synth {args.data} '
                '--scenes 20 --seed 1; or say with --data where they are, and with --scenes which.'
            )
            raise ValueError(msg)
    suite = of_scenes(suite, scenes)
    args.out = args.out or Path('runs', suite.name)
    return sweep.run(suite, args)


def of_scenes(suite: Suite, scenes: Iterable[str]) -> Suite:
    """Return one of these evaluations, in other scenes."""
    return replace(suite, settings=_SETTINGS[suite.name](scenes))


def _default_scenes(data: Path, suite: Suite) -> list[str]:
    """Return the scenes of an evaluation: those of the paper's table where the dataset is."""
    homes = list(dict.fromkeys(s.scene for s in suite.settings.values()))  # type: ignore[union-attr]
    if any(looks_like_scene(data / scene) for scene in HELD_OUT):
        return homes
    there = [scene for scene in PAPERS if looks_like_scene(data / scene)]
    return there[: len(homes)] or homes
