"""The mapper's benchmark."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from bev_mapper.rgbd_mapper import STAGES
from vgdp_bringup.cli import main
from vgdp_experiments.bench_mapper import BASELINE_STAGES

if TYPE_CHECKING:
    from pathlib import Path


def test_it_times_frames_beside_open3d(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """On the same frames in the same run, and writes the numbers."""
    pytest.importorskip('open3d', reason='open3d is not installed', exc_type=ImportError)
    file = tmp_path / 'out' / 'mapper.json'
    options = ['--sizes', '160x120', '--frames', '5', '--memory-frames', '10']
    assert main(['bench', 'mapper', *options, '--json', str(file)]) == 0
    assert '160x120' in capsys.readouterr().out
    record = json.loads(file.read_text())
    [result] = record['sizes']
    assert set(result['stages_ms']) == set(STAGES)
    assert set(result['baseline_stages_ms']) == set(BASELINE_STAGES)
    assert result['ratio'] > 0
    assert result['bounded_ratio'] > 0
    assert result['frames_per_second'] == pytest.approx(1000 / result['median_ms'])
    assert record['memory']['frames'] == [1, 10]
    assert record['memory']['voxels'][1] > record['memory']['voxels'][0] > 1000


@pytest.mark.parametrize('text', ['640', '0x480', 'axb', '640x480x3'])
def test_sizes_that_are_none_are_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    """By argparse, with the text."""
    with pytest.raises(SystemExit):
        main(['bench', 'mapper', '--sizes', text])
    assert 'is no size such as 640x480' in capsys.readouterr().err
