"""The evaluation of searches: run, stopped and gone on with, joined, shown and drawn."""

from __future__ import annotations

import argparse
import json
import re
import shutil
from typing import TYPE_CHECKING

import pytest

from avd_player.avd_format import COLOR_FOLDER, DEPTH_FOLDER
from avd_player.simulation import SearchRules
from gridnav import EpisodeResult, Outcome
from vgdp_experiments.commands import register
from vgdp_experiments.jobs import Job, Part
from vgdp_experiments.merge import page_of
from vgdp_experiments.results import Results
from vgdp_experiments.scores import Trial
from vgdp_experiments.search import evaluate
from vgdp_experiments.search.evaluate import SEEDS_A_TRIAL, open_home, run_searches
from vgdp_experiments.search.home_setting import HomeSetting
from vgdp_experiments.search.noise import Noise
from vgdp_experiments.search.pictures import explain, follow
from vgdp_experiments.search.registry import CLAIRVOYANT, SEARCHERS
from vgdp_experiments.search.searchers import FrontierSearcher
from vgdp_experiments.suites.avd import (
    ABLATED,
    AVD,
    HELD_OUT,
    NOISY,
    PUBLISHED,
    SUITES,
    WORSE,
    pooled,
)

if TYPE_CHECKING:
    from pathlib import Path

    from vgdp_experiments.search.searchers import Sight
    from vgdp_experiments.suite import Suite

pytestmark = pytest.mark.filterwarnings('ignore:Home_113_1')


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search by rules that a small scene allows."""

    def rules(max_steps: int) -> SearchRules:
        return SearchRules(max_steps=max_steps, min_expert_steps=2, max_range=1.8)

    monkeypatch.setattr(evaluate, 'SearchRules', rules)
    evaluate._home.cache_clear()
    evaluate._scene.cache_clear()


def vgdp(*arguments: str) -> int:
    """Run a command and return its exit status."""
    parser = argparse.ArgumentParser(prog='vgdp')
    register(parser.add_subparsers(required=True))
    args = parser.parse_args(arguments)
    status: int = args.run(args)
    return status


def evaluate_avd(data: Path, out: Path, *options: str) -> int:
    """Evaluate quickly."""
    quick = ['--method', 'frontier', CLAIRVOYANT, '--trials', '2', '--episodes', '2']
    where = ['--data', str(data), '--scenes', 'Home_113_1', '--out', str(out)]
    return vgdp('eval', 'avd', *quick, *where, *options)


def test_in_parts_and_joined(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run in two shares, joined: the page has the method, the scene and the paper's mean."""
    out = tmp_path / 'parts'
    assert evaluate_avd(data, out, '--shard', '1/2') == 0
    assert '2 of 4 parts are not in' in capsys.readouterr().err
    assert evaluate_avd(data, out, '--shard', '2/2') == 0
    first = capsys.readouterr()
    assert '2 parts are there already.' in first.err
    assert '| mean | 0.635 ± 0.032 | 0.682 ± 0.047 | 0.679 ± 0.040 | 0.706 ± 0.032 |' in first.out
    joined = tmp_path / 'avd.json'
    choice = ['--scenes', 'Home_113_1', '--method', 'frontier', CLAIRVOYANT]
    size = ['--trials', '2', '--episodes', '2']
    assert vgdp('eval', 'merge', str(out), '-o', str(joined), *choice, *size) == 0
    text = joined.with_suffix('.md').read_text()
    assert text.strip() == first.out.strip()
    found = Results.load(joined)
    place = found.places['Home_113_1']
    assert place.setting == HomeSetting('Home_113_1')
    assert place.scores()[CLAIRVOYANT].summary.spl == 1.0


def test_scenes_of_ones_own_are_joined(
    tmp_path: Path, data: Path, home_copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Scenes that the evaluation does not name are joined as they are."""
    assert home_copy.parent == data
    out = tmp_path / 'parts'
    options = ['--scenes', home_copy.name, '--method', CLAIRVOYANT, '--trials', '1']
    assert evaluate_avd(data, out, *options) == 0
    joined = tmp_path / 'own.json'
    size = ['--method', CLAIRVOYANT, '--trials', '1', '--episodes', '2']
    assert vgdp('eval', 'merge', str(out), '-o', str(joined), *size) == 0
    assert list(Results.load(joined).places) == [home_copy.name]
    capsys.readouterr()


@pytest.fixture
def home_copy(data: Path) -> Path:
    """Return a scene of another name."""
    folder = data / 'Home_901_1'
    if not folder.is_dir():
        shutil.copytree(data / 'Home_113_1', folder)
    return folder


def test_searches_come_out_the_same_in_any_order(data: Path) -> None:
    """Each follows from its seed alone, with noise from that of its trial, too."""
    args = argparse.Namespace()
    setting = HomeSetting('Home_113_1', noise=Noise(depth=30.0, position=30.0, missed=0.3))
    home = open_home(data, setting, 1)
    whole, _ = run_searches(home, 'frontier', args, 1, range(2))
    evaluate._home.cache_clear()
    last, _ = run_searches(open_home(data, setting, 1), 'frontier', args, 1, range(1, 2))
    assert whole.results[1:] == last.results
    assert whole.decisions > last.decisions > 0
    assert open_home(data, setting, 2).mapper is not open_home(data, setting, 1).mapper
    clean = HomeSetting('Home_113_1')
    assert open_home(data, clean, 2) is open_home(data, clean, 1)


def test_images_that_can_not_be_read(data: Path, home_copy: Path) -> None:
    """The search goes on with the others."""
    for broken in sorted((home_copy / COLOR_FOLDER).iterdir())[::5]:
        broken.write_bytes(b'no image')
    for broken in sorted((home_copy / DEPTH_FOLDER).iterdir())[::7]:
        broken.unlink()
    with pytest.warns(UserWarning, match='Home_901_1'):
        home = open_home(data, HomeSetting(home_copy.name), 0)
    trial, _ = run_searches(home, 'frontier', argparse.Namespace(), 0, range(1))
    assert trial.results[0].outcome is not Outcome.RUNNING
    assert trial.results[0].steps > 1
    names = [name for names in home.simulation.scene.views for name in names]
    assert any(home.mapper.sensors.frame(name) is None for name in names)
    shutil.rmtree(home_copy)


class Stubborn:
    """Goes one way, and then says Done where it is, or gives up."""

    def __init__(self, *actions: list[int]) -> None:
        self._actions = actions
        self._left = iter(actions)

    def reset(self, seed: int) -> None:  # noqa: ARG002
        """Begin an episode."""
        self._left = iter(self._actions)

    def decide(self, sight: Sight) -> list[int]:  # noqa: ARG002
        """Return what is left."""
        return next(self._left, [])


@pytest.mark.parametrize(
    ('actions', 'reason'),
    [
        ([[8]], 'Done was said .* m from the bottle, which was never in sight'),
        ([[3], []], 'gave up; the bottle was never in sight, with . of 18 positions visited'),
        ([[2]] * 60, 'the budget was spent; the bottle was seen, but'),
        ([[2]] * 7 + [[6]] * 4 + [[8]], 'from the bottle: more than 1 m'),
    ],
)
def test_what_went_wrong_in_words(data: Path, actions: list[list[int]], reason: str) -> None:
    """By how the search ended."""
    home = open_home(data, HomeSetting('Home_113_1', budget=40), 0)
    home.simulation.starts = home.simulation.starts[:1]
    found = follow(home, Stubborn(*actions), 0)
    text = explain(found, home.simulation)
    assert re.search(reason, text), text
    assert found.way[0] == home.simulation.start
    assert found.way[-1] == home.simulation.position


def test_a_picture(tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of one search, with a word on how it ended; what it can't be made of is refused."""
    picture = tmp_path / 'new' / 'search.png'
    options = ['--data', str(data), '--out', str(picture), '--method', 'frontier']
    assert vgdp('eval', 'avd', '--picture', 'Home_113_1:1', *options) == 0
    assert 'Found after' in capsys.readouterr().out
    assert picture.stat().st_size > 10_000
    home = open_home(data, HomeSetting('Home_113_1'), 0)
    found = follow(home, FrontierSearcher(), 1)
    assert found.sighted is not None
    assert len(found.way) == found.result.steps
    assert vgdp('eval', 'avd', '--picture', 'Home_113_1', *options) == 2
    assert 'A picture needs a scene and a seed' in capsys.readouterr().err


def test_scenes_that_are_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Are named, with what makes them."""
    assert vgdp('eval', 'avd', '--data', str(tmp_path), '--out', str(tmp_path)) == 2
    error = capsys.readouterr().err
    assert f'{tmp_path / HELD_OUT[0]} is no scene. Make homes with: vgdp avd synth' in error


@pytest.mark.parametrize('suite', SUITES.values(), ids=SUITES)
def test_every_page(tmp_path: Path, suite: Suite) -> None:
    """Of all scenes and methods of each evaluation, with its pictures."""
    jobs = suite.jobs([*suite.settings], [*suite.variants], trials=2, episodes=1)
    assert len({job.file_name for job in jobs}) == len(jobs)
    parts = [Part(job, {}, {}, outcome_of(job)) for job in jobs]
    path = tmp_path / 'results.json'
    Results.join(parts, jobs).save(path)
    page = page_of(path)
    assert re.search(
        r'`vgdp eval avd( --\w+)?( --scenes [\w ]+)? --trials 2 --episodes 1`', page.text
    )
    for picture, figure in page.pictures.items():
        assert f']({picture})' in page.text
        figure.savefig(tmp_path / picture)
    assert page.text.count('](') == len(page.pictures)
    for name in suite.variants:
        assert f'| `{name}` |' in page.text
    assert json.loads(path.read_text())['suite'] == suite.name


def outcome_of(job: Job) -> Trial:
    """Return some episode for a job."""
    outcome = Outcome.SUCCESS if job.trial else Outcome.TIMEOUT
    return Trial(job.trial, [EpisodeResult(outcome, 12, 14.0, 10, 12.0)], 12, 0.1)


def test_scenes_are_pooled_trial_by_trial() -> None:
    """So that the deviation over trials is that of means over scenes."""
    jobs = AVD.jobs([*AVD.settings], ['frontier'], trials=2, episodes=1)
    found = Results.join([Part(job, {}, {}, outcome_of(job)) for job in jobs], jobs)
    whole = pooled(list(found.places.values()))
    trials = whole.methods['frontier'].trials
    assert [len(trial.results) for trial in trials] == [8, 8]
    assert whole.scores()['frontier'].success_sd == pytest.approx(0.5**0.5)


def test_the_evaluations_hang_together() -> None:
    """Methods exist, numbers of the paper have their scenes, noise is as small as it says."""
    for suite in SUITES.values():
        methods = {variant.method for variant in suite.variants.values()}
        assert methods <= {*SEARCHERS, CLAIRVOYANT}
    assert all(
        abs(
            sum(r[i][0] for k, r in PUBLISHED.items() if k != 'mean') / 8 - PUBLISHED['mean'][i][0]
        )
        < 0.03
        for i in range(4)
    )
    assert {setting.noise for setting in AVD.settings.values()} == {Noise()}  # type: ignore[union-attr]
    assert all(setting.noise == Noise(depth=1.0) for setting in NOISY.settings.values())  # type: ignore[union-attr]
    assert len(ABLATED.settings) == 1
    assert len(WORSE.settings) == 4 * 17
    job = WORSE.jobs(['Home_113_1 depth 30 mm'], ['frontier'], 1, 25)[0]
    assert Job.from_dict(json.loads(json.dumps(job.to_dict()))) == job
    assert job.title == 'frontier, Home_113_1 depth 30 mm, trial 0, searches 0 to 24'
    assert max(suite.episodes for suite in SUITES.values()) < SEEDS_A_TRIAL
