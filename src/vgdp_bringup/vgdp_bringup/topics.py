"""The topics of the stack in one table: what the recorder records and ``vgdp info`` prints."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: Relative, so that a namespace moves it; ``/diagnostics`` alone is absolute.
        type: Message type as ``package/msg/Name``.
        qos: Which profile of ``gridnav.ros.qos`` its publishers offer: the name without ``_QOS``.
        meaning: What it carries, from whom to whom.
    """

    name: str
    type: str
    qos: str
    meaning: str


TOPICS = (
    Topic('odom', 'nav_msgs/msg/Odometry', 'RELIABLE', 'where the robot is: world to all'),
    Topic(
        'local_map',
        'nav_msgs/msg/OccupancyGrid',
        'RELIABLE',
        'what the robot sees, -1 where it sees nothing: maze_sim to bev_mapper',
    ),
    Topic(
        'camera/color/image_raw',
        'sensor_msgs/msg/Image',
        'SENSOR',
        'colour images: avd_player or a robot to bev_mapper',
    ),
    Topic(
        'camera/depth/image_raw',
        'sensor_msgs/msg/Image',
        'SENSOR',
        'depth images, 16UC1 in mm or 32FC1 in m: avd_player or a robot to bev_mapper',
    ),
    Topic(
        'camera/camera_info',
        'sensor_msgs/msg/CameraInfo',
        'SENSOR',
        'how the camera sees: avd_player or a robot to bev_mapper',
    ),
    Topic(
        'points',
        'sensor_msgs/msg/PointCloud2',
        'SENSOR',
        'points with colour and label: bev_mapper to viewers',
    ),
    Topic(
        'map',
        'nav_msgs/msg/OccupancyGrid',
        'MAP',
        'everything seen so far: bev_mapper (or any SLAM) to vgdp_planner',
    ),
    Topic(
        'goal_pose',
        'geometry_msgs/msg/PoseStamped',
        'MAP',
        'the goal, once it is seen: world (or a person in RViz) to vgdp_planner',
    ),
    Topic('plan', 'nav_msgs/msg/Path', 'MAP', 'the steps ahead: vgdp_planner to anyone'),
    Topic('action', 'std_msgs/msg/UInt8', 'RELIABLE', 'one step to take: vgdp_planner to world'),
    Topic(
        'waypoint',
        'geometry_msgs/msg/PoseStamped',
        'RELIABLE',
        'the same step as a pose: vgdp_planner to a controller',
    ),
    Topic(
        'plan_candidates',
        'visualization_msgs/msg/MarkerArray',
        'MARKER',
        'all plans considered, coloured by value: vgdp_planner to viewers',
    ),
    Topic(
        'value_map',
        'nav_msgs/msg/OccupancyGrid',
        'MARKER',
        'how good each cell is to be in: vgdp_planner to viewers',
    ),
    Topic(
        'episode',
        'diagnostic_msgs/msg/DiagnosticStatus',
        'EPISODE',
        'start, outcome and score of an episode: world to all',
    ),
    Topic(
        '/diagnostics',
        'diagnostic_msgs/msg/DiagnosticArray',
        'RELIABLE',
        'how each node is doing, once a second: all to tools',
    ),
)
