"""Mazes and obstacles from generators that nothing is trained on."""

from __future__ import annotations

from functools import partial

from vgdp_experiments import sweep
from vgdp_experiments.held_out import HELD_OUT_KINDS
from vgdp_experiments.jobs import Variant
from vgdp_experiments.settings import Setting
from vgdp_experiments.suite import Suite
from vgdp_experiments.suites import worlds

TEXT = """\
# Worlds from generators that nothing is trained on

The weights learned in Wilson mazes, some with loops, in rooms, caves and obstacle fields. These
worlds come from none of those generators: mazes with many short dead ends (after Prim, after
Kruskal) or with long winding corridors (depth-first search), with ways that all lead to one side
(sidewinder) or to one corner (binary tree), with long straight walls (recursive division), and
cells that are blocked by chance. No method has settings of its own for them.

`{command}`

{origin}

{explanation}

## Success, and SPL over that of nearest-frontier exploration

{table}
"""

SUITE = Suite(
    name='generators',
    settings={kind: Setting(21, kind=kind, budget=1000) for kind in HELD_OUT_KINDS},
    variants={name: Variant(name) for name in worlds.METHODS},
    page=partial(worlds.page, text=TEXT, known=HELD_OUT_KINDS),
    episodes=100,
)

add_arguments = partial(sweep.add_arguments, SUITE)
run = partial(sweep.run, SUITE)
