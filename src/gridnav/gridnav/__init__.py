"""The shared core of the stack: actions, grids, partial maps and episode metrics.

Conventions used everywhere (REP-103): grids are indexed ``[row, col]``; row is y (north), col is
x (east). Letters in shapes: B episodes, H rows, W columns, A actions, T steps.
"""

from gridnav.actions import DONE, NUM_ACTIONS, NUM_MOVES, STEP_LENGTHS, STEPS, valid_moves
from gridnav.grid import GridGeometry
from gridnav.metrics import EpisodeResult, Outcome, Summary, summarize
from gridnav.partial_map import FREE, GOAL, OBSTACLE

__all__ = [
    'DONE',
    'FREE',
    'GOAL',
    'NUM_ACTIONS',
    'NUM_MOVES',
    'OBSTACLE',
    'STEPS',
    'STEP_LENGTHS',
    'EpisodeResult',
    'GridGeometry',
    'Outcome',
    'Summary',
    'summarize',
    'valid_moves',
]
