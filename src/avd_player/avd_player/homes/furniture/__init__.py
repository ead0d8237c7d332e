"""Furniture and other things in homes, each with dimensions, parts and colours of its own.

Things stand in a frame of their own: x to the right along the wall that they stand at, y from
that wall (0) into the room, z up from the floor, the middle of the back at the origin.
"""

from avd_player.homes.furniture.bathroom import bathtub, toilet, washbasin, washing_machine
from avd_player.homes.furniture.groups import bed_set, desk_set, dining_set, sofa_group, tv_bench
from avd_player.homes.furniture.kitchen import kitchen_island, kitchen_row
from avd_player.homes.furniture.lamps import ceiling_lamp, floor_lamp
from avd_player.homes.furniture.loose import bin_, boxes, coat_rack, plant
from avd_player.homes.furniture.seats import chair, sofa, stool
from avd_player.homes.furniture.small_things import small_thing
from avd_player.homes.furniture.storage import bookcase, cupboard
from avd_player.homes.furniture.style import (
    BEAM,
    BOARD,
    BOOKCASE,
    CEILING,
    CHAIR,
    CLUTTER,
    COLUMN,
    DOOR,
    FLOOR,
    SOFA,
    TABLE,
    WALL,
    WINDOW,
    Item,
    Style,
    Top,
)
from avd_player.homes.furniture.tables import table
from avd_player.homes.furniture.walls import curtain, picture, radiator, wall_shelf

__all__ = [
    'BEAM',
    'BOARD',
    'BOOKCASE',
    'CEILING',
    'CHAIR',
    'CLUTTER',
    'COLUMN',
    'DOOR',
    'FLOOR',
    'SOFA',
    'TABLE',
    'WALL',
    'WINDOW',
    'Item',
    'Style',
    'Top',
    'bathtub',
    'bed_set',
    'bin_',
    'bookcase',
    'boxes',
    'ceiling_lamp',
    'chair',
    'coat_rack',
    'cupboard',
    'curtain',
    'desk_set',
    'dining_set',
    'floor_lamp',
    'kitchen_island',
    'kitchen_row',
    'picture',
    'plant',
    'radiator',
    'small_thing',
    'sofa',
    'sofa_group',
    'stool',
    'table',
    'toilet',
    'tv_bench',
    'wall_shelf',
    'washbasin',
    'washing_machine',
]
