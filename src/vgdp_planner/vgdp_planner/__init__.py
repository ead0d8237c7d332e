"""Value-guided diffusion policy: plans for a robot that sees only part of its world."""

from vgdp_planner.config import PRESETS, Config, PlannerConfig, PolicyConfig, ValueConfig, preset
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
