"""Value-guided diffusion policy: plans for a robot that sees only part of its world."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from vgdp_planner.config import PRESETS, Config, PlannerConfig, PolicyConfig, ValueConfig, preset

if TYPE_CHECKING:
    from vgdp_planner.planner import Plan, ValueGuidedPlanner
    from vgdp_planner.weights import WeightsError

__all__ = [
    'PRESETS',
    'Config',
    'Plan',
    'PlannerConfig',
    'PolicyConfig',
    'ValueConfig',
    'ValueGuidedPlanner',
    'WeightsError',
    'preset',
]

_NEED_TORCH = {
    'Plan': 'vgdp_planner.planner',
    'ValueGuidedPlanner': 'vgdp_planner.planner',
    'WeightsError': 'vgdp_planner.weights',
}


def __getattr__(name: str) -> object:
    """Import what needs torch when it is asked for: that takes seconds."""
    if name not in _NEED_TORCH:
        msg = f'module {__name__!r} has no attribute {name!r}'
        raise AttributeError(msg)
    return getattr(import_module(_NEED_TORCH[name]), name)
