"""All searchers by name: what ``vgdp eval avd --method`` may ask for."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import torch

from vgdp_experiments.methods.registry import VARIANTS
from vgdp_experiments.planner_options import load_planner
from vgdp_experiments.search.learned import LEARNED
from vgdp_experiments.search.searchers import FrontierSearcher, PlannerSearcher

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable
    from pathlib import Path

    from vgdp_experiments.search.searchers import Searcher

CLAIRVOYANT = 'clairvoyant'
"""The shortest way of one who knows the scene, which nobody can beat; no searcher."""


def _planner(settings: dict[str, Any], args: argparse.Namespace) -> Searcher:
    return PlannerSearcher(load_planner(args, settings))


def _learned(name: str, args: argparse.Namespace) -> Searcher:
    if args.threads is not None:
        torch.set_num_threads(args.threads)
    folder: Path | None = args.learned_weights
    return LEARNED[name](folder / name if folder else None)


def _frontier(_args: argparse.Namespace) -> Searcher:
    return FrontierSearcher()


SEARCHERS: dict[str, Callable[[argparse.Namespace], Searcher]] = {
    **{name: partial(_planner, settings) for name, settings in VARIANTS.items()},
    **{name: partial(_learned, name) for name in LEARNED},
    'frontier': _frontier,
}
"""Made from the options of the planner and of what is learned for searches."""
