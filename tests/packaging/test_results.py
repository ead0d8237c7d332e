"""The pages of docs/results are those of the results beside them."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import pytest

from vgdp_experiments import evaluate_mapping
from vgdp_experiments.merge import page_of

ROOT = Path(__file__).parents[2]
SCRIPT = runpy.run_path(str(ROOT / 'scripts' / 'write_results.py'))
FILES = SCRIPT['with_pages']()


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_page_is_current(path: Path) -> None:
    """Each page is what its results give, and all pictures that it shows are there."""
    text = path.with_suffix('.md').read_text(encoding='utf-8')
    assert page_of(path).text == text, 'run scripts/write_results.py'
    for picture in re.findall(r'!\[[^]]*\]\(([^)]+)\)', text):
        assert (path.parent / picture).is_file(), picture


def test_the_page_of_the_maps_is_current() -> None:
    """As the others."""
    path: Path = SCRIPT['MAPPING']
    picture = path.with_suffix('.png')
    assert picture.is_file()
    report = json.loads(path.read_text(encoding='utf-8'))
    text = path.with_suffix('.md').read_text(encoding='utf-8')
    assert evaluate_mapping.page(report, picture.name) == text, 'run scripts/write_results.py'
