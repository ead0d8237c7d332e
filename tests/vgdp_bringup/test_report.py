"""The report of recorded runs."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image
from tests.vgdp_bringup.simulated import ACTING, MAPPING, SimulatedRobot
from tests.vgdp_bringup.synthetic import PLANNING, SECOND, SyntheticBag

from vgdp_bringup.bags import BagError, read_bag
from vgdp_bringup.cli import main
from vgdp_bringup.figures import bag_figures
from vgdp_bringup.report_plots import OUTCOME_COLORS
from vgdp_planner import ValueGuidedPlanner

if TYPE_CHECKING:
    from pathlib import Path

SEEDS = (1, 2, 9)


@pytest.fixture(scope='module')
def reported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return a folder with three bags and their report, and the report's data.

    The last bag holds an episode that times out besides.
    """
    folder = tmp_path_factory.mktemp('report')
    planner = ValueGuidedPlanner.from_pretrained()
    for seed in SEEDS:
        robot = SimulatedRobot(folder / f'run_{seed}' / 'bag', planner)
        robot.run(seed, 100 * SECOND)
        if seed == SEEDS[-1]:
            robot.run(seed, 500 * SECOND, max_steps=6)
        robot.close()
    assert main(['bag', 'report', str(folder)]) == 0
    return folder, json.loads((folder / 'report.json').read_text())


def test_the_figures_are_those_of_the_runs(reported: tuple[Path, dict[str, Any]]) -> None:
    """Outcome, SPL, coverage, latency, delays, candidates and sources, as they were recorded."""
    _, data = reported
    assert [bag['bag'] for bag in data['bags']] == ['run_1', 'run_2', 'run_9']
    first = data['bags'][0]['episodes'][0]
    assert (first['outcome'], first['world'][-6:]) == ('success', 'seed 1')
    assert first['observations'] == first['steps'] + 1
    assert first['duration'] == pytest.approx((first['observations'] - 1) / 5)
    shares = [share for _, share in first['coverage']]
    assert shares == sorted(shares)
    assert 0.02 < shares[0] < shares[-1] < 1
    plans = first['plans']
    assert first['replans'] == len(plans) - 1 > 5
    assert sum(first['sources'].values()) == len(plans)
    assert sum(plan['turned'] for plan in plans) == first['turns']
    for plan in plans:
        assert plan['mapping'] == pytest.approx(MAPPING / SECOND)
        assert plan['acting'] == pytest.approx(ACTING / SECOND)
        assert 0.03 <= plan['planning'] <= 0.042
        assert plan['best'] >= plan['median'] >= plan['quarter']
    delays = [sum(plan[name] for name in ('mapping', 'planning', 'acting')) for plan in plans]
    assert first['delay']['p50'] == pytest.approx(np.median(delays))
    assert data['bags'][2]['episodes'][1]['outcome'] == 'timeout'
    summary = data['summary']
    episodes = [episode for bag in data['bags'] for episode in bag['episodes']]
    assert summary['outcomes'] == {'success': 3, 'timeout': 1}
    assert summary['success'] == 0.75
    assert summary['spl'] == pytest.approx(np.mean([e['spl'] for e in episodes]), abs=1e-5)


def test_rates_and_gaps(tmp_path: Path) -> None:
    """A pause is found with its place; what the recorder lost stands beside it."""
    bag = SyntheticBag(tmp_path / 'bag')
    bag.add_episode(seed=4, start=100 * SECOND)
    bag.add_episode(seed=4, start=400 * SECOND)
    bag._recorder.lost('/odom', 2)
    bag.close()
    figures = bag_figures(read_bag(tmp_path / 'bag'), 'bag')
    topics = {topic.name: topic for topic in figures.topics}
    plan, odom, silent = topics['/plan'], topics['/odom'], topics['/action']
    steps = plan.messages // 2
    assert plan.median_gap == pytest.approx(1.0)
    assert plan.longest_gap == pytest.approx(300 - steps + 1)
    assert plan.longest_gap_at == pytest.approx(steps - 1 + PLANNING / SECOND)
    assert (plan.gaps, plan.lost, odom.lost) == (1, 0, 2)
    assert (silent.messages, silent.rate) == (0, None)


def test_the_page_stands_alone(reported: tuple[Path, dict[str, Any]]) -> None:
    """It loads nothing, and shows each episode once in full and once small."""
    folder, data = reported
    page = (folder / 'report.html').read_text()
    assert not re.findall(r'(?:src|href)="(?!data:image/svg|#e\d)', page)
    episodes = sum(len(bag['episodes']) for bag in data['bags'])
    assert page.count('<summary id="e') == episodes
    assert page.count('<img') == 2 * episodes + len(data['bags']) + 1


def test_the_report_is_the_same_every_time(
    reported: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    """Byte for byte, so that two reports can be compared."""
    folder, _ = reported
    pages = []
    for name in ('a', 'b'):
        out = tmp_path / name
        assert main(['bag', 'report', str(folder / 'run_1' / 'bag'), '--out', str(out)]) == 0
        pages.append((out / 'report.html').read_bytes())
    assert pages[0] == pages[1]


def test_no_ros_is_needed(reported: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    """Neither rclpy nor messages nor PyTorch are loaded."""
    folder, _ = reported
    program = (
        'import sys\n'
        'from vgdp_bringup.cli import main\n'
        f'main(["bag", "report", {str(folder / "run_2" / "bag")!r}, "--out", {str(tmp_path)!r}])\n'
        'print([name for name in ("rclpy", "nav_msgs", "torch") if name in sys.modules])'
    )
    result = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, check=True
    )
    assert result.stdout.splitlines()[-1] == '[]'


def test_a_damaged_bag_is_left_out(
    reported: tuple[Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The others are reported, and the page names it; alone it is refused."""
    folder, _ = reported
    shutil.copytree(folder / 'run_1' / 'bag', tmp_path / 'all' / 'good')
    shutil.copytree(folder / 'run_2' / 'bag', tmp_path / 'all' / 'bad')
    file = tmp_path / 'all' / 'bad' / 'bag_0.mcap'
    file.write_bytes(file.read_bytes()[:5000])
    assert main(['bag', 'report', str(tmp_path / 'all')]) == 0
    assert 'left out bad: ' in capsys.readouterr().err
    assert 'Left out bad: ' in (tmp_path / 'all' / 'report.html').read_text()
    assert main(['bag', 'report', str(tmp_path / 'all' / 'bad')]) == 2
    assert 'vgdp bag recover' in capsys.readouterr().err


def test_a_folder_without_bags_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one sentence, with exit status 2."""
    assert main(['bag', 'report', str(tmp_path)]) == 2
    assert 'holds no bag' in capsys.readouterr().err


def test_it_looks_right_in_a_browser(
    reported: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    """Headless Chromium draws it: the outcomes' colours, walls and ways are all to be seen."""
    browser = shutil.which('chromium') or shutil.which('chromium-browser')
    if browser is None:
        pytest.skip('Chromium is not installed (apt-get install chromium)')
    folder, _ = reported
    picture = tmp_path / 'page.png'
    subprocess.run(
        [
            browser,
            '--headless',
            '--no-sandbox',
            '--disable-gpu',
            '--hide-scrollbars',
            '--window-size=1400,1000',
            f'--user-data-dir={tmp_path / "profile"}',
            f'--screenshot={picture}',
            (folder / 'report.html').as_uri(),
        ],
        check=True,
        capture_output=True,
        timeout=100,
    )
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert('RGB')).astype(int)
    assert pixels.shape == (1000, 1400, 3)
    for color in (OUTCOME_COLORS['success'], OUTCOME_COLORS['timeout'], '#3b7dd8', '#3b4252'):
        rgb = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
        assert np.count_nonzero((pixels == rgb).all(axis=2)) > 100, color
    # Drawn over the whole width, and not one thing over the other: mostly white.
    white = (pixels == 255).all(axis=2)
    assert 0.5 < white.mean() < 0.97
    assert (~white[:, 1000:1350]).any(axis=1).mean() > 0.2


def test_a_bag_of_a_real_robot_has_one_episode(tmp_path: Path) -> None:
    """Where nobody speaks of episodes, all is one; a robot that is not there is refused."""
    from tests.vgdp_bringup.synthetic import odometry  # noqa: PLC0415

    bag = SyntheticBag(tmp_path / 'bag')
    for second in range(5):
        bag.add('odom', second * SECOND, odometry(second * SECOND, float(second), 0.0))
    bag.close()
    (episode,) = bag_figures(read_bag(tmp_path / 'bag'), 'bag').episodes
    assert (episode.outcome, episode.path_length, episode.spl) == ('running', 4.0, None)
    with pytest.raises(BagError, match='holds no episode'):
        read_bag(tmp_path / 'bag', '/other')
