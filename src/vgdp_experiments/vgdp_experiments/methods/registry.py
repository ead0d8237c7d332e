"""All methods by name: what ``--method`` may ask for."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from vgdp_experiments.methods.calvin import AutoregressiveCalvin
from vgdp_experiments.methods.clairvoyant import Clairvoyant
from vgdp_experiments.methods.frontier import NearestFrontier
from vgdp_experiments.methods.vgdp import ValueGuidedDiffusion
from vgdp_experiments.planner_options import load_planner

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from maze_sim import Maze
    from vgdp_experiments.methods import Method

SAMPLES_ALONE = {'memory': False, 'greedy_fallback': False}

VARIANTS: dict[str, dict[str, Any]] = {
    'vgdp': {},
    'single_sample': {'candidates': 1, **SAMPLES_ALONE},
    'voting': {'selection': 'vote', **SAMPLES_ALONE},
    'guidance': SAMPLES_ALONE,
    'guidance_memory': {'greedy_fallback': False},
    'gradient_guidance': {'greedy_fallback': False, 'guidance': 0.3},
    'greedy': {'candidates': 0, 'memory': False, 'greedy_fallback': True},
}
"""Settings of the planner in which each variant differs from what the weights come with.

'vgdp' is the whole planner. The next four are the rows of the paper's ablation, where sampled
plans are all there is: one sample (Diffusion Policy), the most frequent of many, the one of the
highest value, and that with the best-plan memory. 'gradient_guidance' pulls the samples
themselves towards high values, too. 'greedy' steps on the same values without any sample.
"""

ABLATION = ('single_sample', 'voting', 'guidance', 'guidance_memory')
"""The rows of the paper's ablation, in its order."""


def _planner(settings: dict[str, Any], args: argparse.Namespace) -> Method:
    return ValueGuidedDiffusion(load_planner(args, settings))


def _frontier(_args: argparse.Namespace) -> Method:
    return NearestFrontier()


PLANNERS: dict[str, Callable[[argparse.Namespace], Method]] = {
    **{name: partial(_planner, settings) for name, settings in VARIANTS.items()},
    'calvin': AutoregressiveCalvin.from_options,
    'frontier': _frontier,
}
"""Methods that see partial maps alone, made from the options."""

REFERENCES: dict[str, Callable[[Sequence[Maze]], Method]] = {'clairvoyant': Clairvoyant}
"""Methods that know everything, made from the mazes of a trial."""

METHODS = (*PLANNERS, *REFERENCES)
