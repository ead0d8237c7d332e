"""A robot in an unknown maze: simulator, mapper, planner, and on request a recorder and RViz.

ros2 launch vgdp_bringup maze.launch.py size:=20 view_range:=2 seed:=3 rate:=5.0
"""

from __future__ import annotations

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = (
    ('kind', 'maze', 'What the world looks like: maze, loops, rooms, caves or obstacles'),
    ('size', '15', 'Side of the world in cells'),
    ('view_range', '2', 'How far the robot sees to each side, in cells'),
    ('seed', '3', 'Seed of the maze, start and goal, and of the planner'),
    ('rate', '5.0', 'Steps a second; 0.0 for as fast as it goes'),
    ('max_steps', '500', 'Actions after which the episode ends'),
    ('namespace', '', 'Namespace of all nodes and topics, for several robots'),
    ('use_sim_time', 'false', 'Whether the nodes follow /clock'),
    ('log_level', 'info', 'Log level of the nodes: debug, info, warn, error or fatal'),
    ('record', 'false', 'Whether to record the run'),
    ('bag', '', 'Folder of the bag, with record:=true; a new one named after the time if empty'),
    ('record_topics', '', 'Topics to record, with spaces between; all of the stack if empty'),
    ('record_storage', 'mcap', 'Kind of the bag, with record:=true: mcap or sqlite3'),
    ('rviz', 'false', 'Whether to open RViz'),
)
"""Name, default and description of each argument but those for files."""

FILE_ARGUMENTS = (
    ('params_file', 'config', 'maze.yaml', 'Parameters of the nodes; the arguments win over them'),
    ('rviz_config', 'rviz', 'maze.rviz', 'View that RViz opens'),
)
"""Name, folder and file in this package's share, and description."""

VIEWED_TOPICS = (
    'camera/color/image_raw',
    'goal_pose',
    'local_map',
    'map',
    'odom',
    'plan',
    'plan_candidates',
    'points',
    'value_map',
    'waypoint',
)
"""What the RViz view looks at, there without a namespace."""


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the nodes."""
    share = FindPackageShare('vgdp_bringup')
    declarations = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, default, description in ARGUMENTS
    ]
    declarations += [
        DeclareLaunchArgument(
            name,
            default_value=PathJoinSubstitution([share, folder, file]),
            description=description,
        )
        for name, folder, file, description in FILE_ARGUMENTS
    ]
    size = _value('size', int)
    seed = _value('seed', int)
    maze = {
        'kind': _value('kind', str),
        'size': size,
        'seed': seed,
        'view_range': _value('view_range', int),
        'rate': _value('rate', float),
        'max_steps': _value('max_steps', int),
    }
    return LaunchDescription(
        [
            *declarations,
            _node('bev_mapper', 'bev_mapper_node', {'width': size, 'height': size}),
            _node('vgdp_planner', 'planner_node', {'seed': seed}),
            _node('maze_sim', 'maze_sim_node', maze),
            _node(
                'vgdp_bringup',
                'recorder_node',
                {
                    'bag': _value('bag', str),
                    'topics': _value('record_topics', str),
                    'storage': _value('record_storage', str),
                },
                condition=IfCondition(LaunchConfiguration('record')),
            ),
            Node(
                package='rviz2',
                executable='rviz2',
                namespace=LaunchConfiguration('namespace'),
                remappings=[(f'/{topic}', topic) for topic in VIEWED_TOPICS],
                parameters=[{'use_sim_time': _value('use_sim_time', bool)}],
                arguments=['-d', LaunchConfiguration('rviz_config')],
                condition=IfCondition(LaunchConfiguration('rviz')),
            ),
        ]
    )


def _value(name: str, kind: type) -> ParameterValue:
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def _node(
    package: str,
    executable: str,
    parameters: dict[str, ParameterValue],
    condition: IfCondition | None = None,
) -> Node:
    """Start a node of this stack with what all of them share."""
    return Node(
        package=package,
        executable=executable,
        namespace=LaunchConfiguration('namespace'),
        parameters=[
            LaunchConfiguration('params_file'),
            {'use_sim_time': _value('use_sim_time', bool), **parameters},
        ],
        arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
        output='screen',
        condition=condition,
    )
