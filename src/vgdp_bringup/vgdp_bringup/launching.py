"""What the launch files have in common; needs ``launch``, which a full ROS 2 has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

if TYPE_CHECKING:
    from collections.abc import Iterable

ARGUMENTS = (
    ('namespace', '', 'Namespace of all nodes and topics, for several robots'),
    ('use_sim_time', 'false', 'Whether the nodes follow /clock'),
    ('log_level', 'info', 'Log level of the nodes: debug, info, warn, error or fatal'),
    ('record', 'false', 'Whether to record the run'),
    ('bag', '', 'Folder of the bag, with record:=true; a new one named after the time if empty'),
    ('record_storage', 'mcap', 'Kind of the bag, with record:=true: mcap or sqlite3'),
    ('rviz', 'false', 'Whether to open RViz'),
)
"""Name, default and description of each argument that every launch file has."""

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


def declare(arguments: Iterable[tuple[str, str, str]]) -> list[DeclareLaunchArgument]:
    """Declare arguments, given as name, default and description, and then the shared ones."""
    return [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, default, description in (*arguments, *ARGUMENTS)
    ] + [declare_file('rviz_config', 'rviz', 'maze.rviz', 'View that RViz opens')]


def declare_file(name: str, folder: str, file: str, description: str) -> DeclareLaunchArgument:
    """Declare an argument for a file, by default one in this package's share."""
    default = PathJoinSubstitution([FindPackageShare('vgdp_bringup'), folder, file])
    return DeclareLaunchArgument(name, default_value=default, description=description)


def value(name: str, kind: type) -> ParameterValue:
    """Return the value of an argument, as a parameter."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def node(
    package: str,
    executable: str,
    parameters: list[Any],
    condition: IfCondition | None = None,
) -> Node:
    """Start a node of this stack with what all of them share.

    Args:
        package: Its package.
        executable: Its executable.
        parameters: Files and dictionaries, later ones win.
        condition: On which it is started.
    """
    return Node(
        package=package,
        executable=executable,
        namespace=LaunchConfiguration('namespace'),
        parameters=[*parameters, {'use_sim_time': value('use_sim_time', bool)}],
        arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
        output='screen',
        condition=condition,
    )


def recorder(topics: object, *files: object) -> Node:
    """Start the recorder where ``record`` asks for it.

    Args:
        topics: Names of the topics with spaces between, all of the stack if empty.
        files: Of parameters.
    """
    bag = {
        'bag': value('bag', str),
        'topics': topics,
        'storage': value('record_storage', str),
    }
    condition = IfCondition(LaunchConfiguration('record'))
    return node('vgdp_bringup', 'recorder_node', [*files, bag], condition)


def rviz() -> Node:
    """Start RViz where ``rviz`` asks for it."""
    return Node(
        package='rviz2',
        executable='rviz2',
        namespace=LaunchConfiguration('namespace'),
        remappings=[(f'/{topic}', topic) for topic in VIEWED_TOPICS],
        parameters=[{'use_sim_time': value('use_sim_time', bool)}],
        arguments=['-d', LaunchConfiguration('rviz_config')],
        condition=IfCondition(LaunchConfiguration('rviz')),
    )
