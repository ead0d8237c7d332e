"""Homes to look around in: AVD scenes, RGB-D sequences, synthetic homes, and moving in them.

Importing the package registers ``ActiveVision-v0`` with Gymnasium.
"""

from gymnasium.envs.registration import register, registry

from avd_player.scene import Scene, TargetSightings
from avd_player.simulation import ActiveVisionSimulation, SearchRules
from avd_player.sources import AvdSource, PosedSequence, open_source

__all__ = [
    'ENV_ID',
    'ActiveVisionSimulation',
    'AvdSource',
    'PosedSequence',
    'Scene',
    'SearchRules',
    'TargetSightings',
    'open_source',
]

ENV_ID = 'ActiveVision-v0'
"""Gymnasium id; the suffix rises with any change that gives other starts, views or endings."""

if ENV_ID not in registry:
    register(ENV_ID, entry_point='avd_player.environment:ActiveVisionEnv')
