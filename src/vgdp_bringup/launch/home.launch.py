"""A robot with a camera in a recorded home: player, mapper, planner, and on request a recorder.

ros2 launch vgdp_bringup home.launch.py scene:=homes/Home_101_1 seed:=0 record:=true
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import EnvironmentVariable, LaunchConfiguration

from launch import LaunchDescription
from vgdp_bringup.launching import declare, node, recorder, rviz

if TYPE_CHECKING:
    from launch import LaunchContext

ARGUMENTS = (
    ('mode', 'closed_loop', 'Whether the robot moves by itself, or a replay shows the images'),
    ('segmenter', 'geometric', 'What tells floor from obstacles: geometric or learned'),
    ('seed', '0', 'Seed of the start and of the planner'),
    ('rate', '0.0', 'Steps or frames a second; 0.0 for as fast as it goes, or was recorded'),
    ('max_steps', '500', 'Actions after which the search ends'),
    ('params_file', '', 'Parameters of the nodes, which win over all else; none if empty'),
    ('record_topics', '', 'Topics to record, with spaces between; all but images if empty'),
)
"""Name, default and description of each argument but the shared ones and the scene."""

PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the nodes."""
    what = 'Folder of a scene of the Active Vision Dataset, or for a replay of a sequence'
    return LaunchDescription(
        [
            DeclareLaunchArgument('scene', description=what),
            *declare(ARGUMENTS),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[object]:
    """Start the nodes; the camera's place on the robot is read from the scene."""
    # Here, as they take seconds, which --show-args does without.
    from vgdp_bringup.home_demo import (  # noqa: PLC0415
        QUICK_IMAGES,
        RECORDED,
        mapper_parameters,
        planner_parameters,
        player_parameters,
    )

    names = ('scene', 'mode', 'segmenter', 'seed', 'rate', 'max_steps')
    scene, mode, segmenter, seed, rate, max_steps = (
        LaunchConfiguration(name).perform(context) for name in names
    )
    player = player_parameters(Path(scene), int(seed), float(rate), int(max_steps))
    mapper = mapper_parameters(Path(scene), segmenter)
    planner = planner_parameters(int(seed))
    if mode == 'replay':
        # Each frame is an observation of its own, and the robot goes where it went.
        mapper['views_per_step'] = 1
        planner['pose_source'] = 'odom'
    file = LaunchConfiguration('params_file').perform(context)
    files = [file] if file else []
    topics = LaunchConfiguration('record_topics').perform(context) or RECORDED
    return [
        SetEnvironmentVariable(
            PROFILES, EnvironmentVariable(PROFILES, default_value=str(QUICK_IMAGES))
        ),
        node('bev_mapper', 'bev_mapper_node', [mapper, *files]),
        node('vgdp_planner', 'planner_node', [planner, *files]),
        node('avd_player', 'avd_player_node', [{**player, 'mode': mode}, *files]),
        recorder(topics, *files),
        rviz(),
    ]
