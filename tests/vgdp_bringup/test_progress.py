"""How a run looks in a terminal."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console

from gridnav.grid import GridGeometry
from vgdp_bringup.progress import (
    COLORS,
    FREE,
    GOAL,
    PLAN,
    ROBOT,
    TRACE,
    UNSEEN,
    WALL,
    LiveDisplay,
    PlainDisplay,
    Progress,
    draw_map,
)


def example() -> Progress:
    """Return a run on a map of 2 x 3 cells of half a metre."""
    return Progress(
        occupancy=np.array([[0, 0, 100], [0, 0, -1]], dtype=np.int8),
        geometry=GridGeometry(2, 3, 0.5, origin_x=-0.5),
        path=[(-0.25, 0.25), (0.25, 0.25)],
        goal=(-0.25, 0.75),
        plan=[(0.25, 0.25), (0.25, 0.75), (9.0, 9.0)],
        outcome='running',
        latencies=[0.1, 0.3],
        value=-2.5,
    )


def test_cells_show_what_matters_most() -> None:
    """Robot over goal over plan over path over map; what lies off the map is left out."""
    assert example().cells().tolist() == [[TRACE, ROBOT, WALL], [GOAL, PLAN, UNSEEN]]
    assert FREE not in example().cells()


def test_nothing_is_known_at_first() -> None:
    """Before any message everything has a default."""
    progress = Progress()
    assert progress.cells().size == 0
    assert progress.steps == 0
    assert dict(progress.rows())['episode'] == 'not begun'


def test_the_facts() -> None:
    """The rows beside the map say how far it is."""
    rows = dict(example().rows())
    assert rows['step'] == '1'
    assert rows['seen'] == '83% of the map'
    assert rows['value'] == '-2.50'
    assert rows['planning'] == '300 ms'
    assert rows['median'] == '200 ms'


@pytest.mark.parametrize(('lines', 'shape'), [(10, (2, 6)), (1, (1, 3))])
def test_the_map_fits(lines: int, shape: tuple[int, int]) -> None:
    """A cell is two characters, or half a one where the terminal is low; north is up."""
    text = draw_map(example(), lines)
    rows = text.plain.splitlines()
    assert (len(rows), len(rows[0])) == shape
    first = str(text.spans[0].style)
    assert COLORS[GOAL] in first


def test_the_live_display_draws() -> None:
    """Facts and legend are in what the terminal gets."""
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=80, height=30)
    with LiveDisplay(console) as display:
        display.update(example())
    for word in ('running', '-2.50', 'unseen', 'robot'):
        assert word in output.getvalue()


def test_the_plain_display_prints_now_and_then() -> None:
    """One line for the first step and one for every ten after it."""
    output = io.StringIO()
    progress = example()
    with PlainDisplay(Console(file=output, width=200)) as display:
        display.update(Progress())
        for _ in range(12):
            display.update(progress)
            progress.path.append((0.25, 0.75))
    steps = [line.split('step ')[1].split(',')[0] for line in output.getvalue().splitlines()]
    assert steps == ['1', '11']
