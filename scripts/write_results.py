"""Write the pages of docs/results anew from the results beside them."""

from __future__ import annotations

import json
from pathlib import Path

from vgdp_experiments import evaluate_mapping
from vgdp_experiments.merge import write_page

RESULTS = Path(__file__).parents[1] / 'docs' / 'results'
MAPPING = RESULTS / 'mapping.json'


def with_pages() -> list[Path]:
    """Return the files of results that have a page of their own."""
    return [
        path
        for path in sorted(RESULTS.glob('*.json'))
        if 'suite' in json.loads(path.read_text(encoding='utf-8'))
    ]


if __name__ == '__main__':
    for file in with_pages():
        write_page(file)
    evaluate_mapping.write_page(MAPPING)
