"""A robot in an unknown maze: simulator, mapper, planner, and on request a recorder and RViz.

ros2 launch vgdp_bringup maze.launch.py size:=20 view_range:=2 seed:=3 rate:=5.0
"""

from __future__ import annotations

from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from vgdp_bringup.launching import declare, declare_file, node, recorder, rviz, value

ARGUMENTS = (
    ('kind', 'maze', 'What the world looks like: maze, loops, rooms, caves or obstacles'),
    ('size', '15', 'Side of the world in cells'),
    ('view_range', '2', 'How far the robot sees to each side, in cells'),
    ('seed', '3', 'Seed of the maze, start and goal, and of the planner'),
    ('rate', '5.0', 'Steps a second; 0.0 for as fast as it goes'),
    ('max_steps', '500', 'Actions after which the episode ends'),
    ('record_topics', '', 'Topics to record, with spaces between; all of the stack if empty'),
)
"""Name, default and description of each argument but the shared ones."""

PARAMETERS = 'Parameters of the nodes; the arguments win over them'


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the nodes."""
    file = LaunchConfiguration('params_file')
    size = value('size', int)
    seed = value('seed', int)
    maze = {
        'kind': value('kind', str),
        'size': size,
        'seed': seed,
        'view_range': value('view_range', int),
        'rate': value('rate', float),
        'max_steps': value('max_steps', int),
    }
    return LaunchDescription(
        [
            *declare(ARGUMENTS),
            declare_file('params_file', 'config', 'maze.yaml', PARAMETERS),
            node('bev_mapper', 'bev_mapper_node', [file, {'width': size, 'height': size}]),
            node('vgdp_planner', 'planner_node', [file, {'seed': seed}]),
            node('maze_sim', 'maze_sim_node', [file, maze]),
            recorder(value('record_topics', str), file),
            rviz(),
        ]
    )
