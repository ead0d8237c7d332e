"""Bird's-eye-view mapping: local views or RGB-D frames fused into one growing grid.

Letters in shapes: H, W rows and columns of the map, h, w those of a window. Grids are occupancy
as in ``nav_msgs/OccupancyGrid``: -1 unseen, 0 free, 100 obstacle.
"""

from bev_mapper.grid_fusion import GridFusion
from bev_mapper.local_map_fusion import LocalMapFusion, Window
from bev_mapper.rgbd_mapper import MapperConfig, RgbdMapper
from gridnav.pose import Pose2D

__all__ = ['GridFusion', 'LocalMapFusion', 'MapperConfig', 'Pose2D', 'RgbdMapper', 'Window']
