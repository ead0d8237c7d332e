"""The launch file, the RViz view and the parameter file, without launch or RViz."""

from __future__ import annotations

import json
import runpy
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, get_type_hints

import pytest
import yaml
from tests.avd_player.tiny_scene import write_scene
from tests.vgdp_bringup.synthetic import odometry

from vgdp_bringup.topics import TOPICS

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parents[2]
SHARE = ROOT / 'src' / 'vgdp_bringup'


@dataclass
class Recorded:
    """A call of something from launch: its name and arguments."""

    name: str
    positional: tuple[Any, ...]
    named: dict[str, Any]

    def perform(self, context: dict[str, str]) -> str:
        """Return the value of an argument."""
        return context[self.positional[0]]


def stub(module: str, *names: str) -> ModuleType:
    """Return a module whose classes only record how they are called."""
    made = ModuleType(module)
    for name in names:

        def call(*positional: Any, _name: str = name, **named: Any) -> Recorded:  # noqa: ANN401
            return Recorded(_name, positional, named)

        setattr(made, name, call)
    return made


@pytest.fixture(scope='module')
def launched() -> list[Recorded]:
    """Return what the launch file for mazes describes."""
    return described('maze')


@pytest.fixture(scope='module')
def home() -> list[Recorded]:
    """Return what the launch file for homes describes."""
    return described('home')


def described(name: str) -> list[Recorded]:
    """Return what a launch file describes."""
    stubs = {
        'launch': stub('launch', 'LaunchDescription'),
        'launch.actions': stub(
            'launch.actions', 'DeclareLaunchArgument', 'OpaqueFunction', 'SetEnvironmentVariable'
        ),
        'launch.conditions': stub('launch.conditions', 'IfCondition'),
        'launch.substitutions': stub(
            'launch.substitutions',
            'EnvironmentVariable',
            'LaunchConfiguration',
            'PathJoinSubstitution',
        ),
        'launch_ros': ModuleType('launch_ros'),
        'launch_ros.actions': stub('launch_ros.actions', 'Node'),
        'launch_ros.parameter_descriptions': stub(
            'launch_ros.parameter_descriptions', 'ParameterValue'
        ),
        'launch_ros.substitutions': stub('launch_ros.substitutions', 'FindPackageShare'),
    }
    with pytest.MonkeyPatch.context() as patch:
        for module, stubbed in stubs.items():
            patch.setitem(sys.modules, module, stubbed)
        patch.delitem(sys.modules, 'vgdp_bringup.launching', raising=False)
        namespace = runpy.run_path(str(SHARE / 'launch' / f'{name}.launch.py'))
        description: Recorded = namespace['generate_launch_description']()
    items: list[Recorded] = description.positional[0]
    return items


def find(item: Any, name: str) -> Iterator[Recorded]:  # noqa: ANN401
    """Return all calls of a name within calls, lists and dictionaries."""
    if isinstance(item, Recorded):
        if item.name == name:
            yield item
        yield from find([*item.positional, *item.named.values()], name)
    elif isinstance(item, dict):
        yield from find(list(item.values()), name)
    elif isinstance(item, (list, tuple)):
        for part in item:
            yield from find(part, name)


def test_every_argument_is_declared(launched: list[Recorded]) -> None:
    """With a default and a description, and none is declared in vain."""
    declared = {call.positional[0]: call.named for call in find(launched, 'DeclareLaunchArgument')}
    used = {call.positional[0] for call in find(launched, 'LaunchConfiguration')}
    assert set(declared) == used
    for name, settings in declared.items():
        assert len(settings['description']) > 10, name
        assert 'default_value' in settings, name
    issue = {'size', 'view_range', 'seed', 'rate', 'namespace', 'use_sim_time', 'log_level'}
    assert issue | {'rviz', 'record', 'params_file'} <= set(declared)


def test_declarations_come_first(launched: list[Recorded]) -> None:
    """An argument has to be declared before it is used."""
    names = [call.name for call in launched]
    assert names == sorted(names)
    assert set(names) == {'DeclareLaunchArgument', 'Node'}


def test_the_nodes_exist(launched: list[Recorded]) -> None:
    """Each executable is an entry point of its package."""
    nodes = [call.named for call in launched if call.name == 'Node']
    ours = {node['package']: node['executable'] for node in nodes if node['package'] != 'rviz2'}
    assert set(ours) == {'maze_sim', 'bev_mapper', 'vgdp_planner', 'vgdp_bringup'}
    for package, executable in ours.items():
        assert f"'{executable} = " in (ROOT / 'src' / package / 'setup.py').read_text()


def test_the_files_exist(launched: list[Recorded]) -> None:
    """What the launch file looks for in the package's share is there."""
    joined = [call.positional[0][1:] for call in find(launched, 'PathJoinSubstitution')]
    assert sorted(joined) == [['config', 'maze.yaml'], ['rviz', 'maze.rviz']]
    for folder, file in joined:
        assert (SHARE / folder / file).is_file()


def test_the_parameters_exist(launched: list[Recorded]) -> None:
    """Each parameter that is set is one of the node."""
    pytest.importorskip('rclpy')
    tables = {**write_config()['TABLES'], 'vgdp_bringup': recorder_table()}
    for call in launched:
        if call.name == 'Node' and call.named['package'] in tables:
            known = {*tables[call.named['package']].__dataclass_fields__, 'use_sim_time'}
            files, tables_given = files_and_tables(call)
            assert [file.positional for file in files] == [('params_file',)]
            assert set().union(*tables_given) <= known


def files_and_tables(call: Recorded) -> tuple[list[Any], list[dict[str, Any]]]:
    """Return what a node gets its parameters from."""
    given = call.named['parameters']
    return (
        [item for item in given if not isinstance(item, dict)],
        [item for item in given if isinstance(item, dict)],
    )


def test_a_home_has_the_parameters_of_the_demo(home: list[Recorded], tmp_path: Path) -> None:
    """Each of its node and of its type; a file given wins, and a replay shows every frame."""
    pytest.importorskip('rclpy')
    from avd_player.node import AvdPlayerParameters  # noqa: PLC0415 - needs ROS
    from vgdp_bringup.home_demo import mapper_parameters  # noqa: PLC0415

    scene = write_scene(tmp_path / 'Home_001_1', cells=[(0, 0)]).folder
    declared = {call.positional[0]: call.named for call in find(home, 'DeclareLaunchArgument')}
    context = {name: given.get('default_value', '') for name, given in declared.items()}
    (start,) = find(home, 'OpaqueFunction')
    tables = {**write_config()['TABLES'], 'avd_player': AvdPlayerParameters}
    for mode, views in (('closed_loop', 12), ('replay', 1)):
        context |= {'scene': str(scene), 'mode': mode, 'params_file': 'my.yaml', 'seed': '7'}
        calls = start.named['function'](context)
        names = {call.positional[0] for call in find(calls, 'LaunchConfiguration')}
        assert names <= set(declared)
        nodes = {call.named['package']: call for call in calls if call.name == 'Node'}
        assert set(nodes) == {*tables, 'vgdp_bringup', 'rviz2'} - {'maze_sim'}
        given = {}
        for package in ('avd_player', 'bev_mapper', 'vgdp_planner'):
            files, (given[package], _) = files_and_tables(nodes[package])
            assert files == ['my.yaml']
            hints = get_type_hints(tables[package])
            for name, value in given[package].items():
                assert type(value) is hints[name], name
        assert (given['avd_player']['mode'], given['avd_player']['seed']) == (mode, 7)
        assert given['vgdp_planner']['seed'] == 7
        assert ('pose_source' in given['vgdp_planner']) == (mode == 'replay')
        expected = mapper_parameters(scene, 'geometric') | {'views_per_step': views}
        assert given['bev_mapper'] == expected
        _, (bag, _) = files_and_tables(nodes['vgdp_bringup'])
        assert 'map' in bag['topics'].split()
        assert 'image_raw' not in bag['topics']


def recorder_table() -> type:
    """Return the parameters of the recorder."""
    from vgdp_bringup.node import RecorderParameters  # noqa: PLC0415 - needs ROS

    return RecorderParameters


def write_config() -> dict[str, Any]:
    """Return what is defined in the script that writes the parameter file."""
    return runpy.run_path(str(ROOT / 'scripts' / 'write_config.py'))


def test_the_parameter_file_is_up_to_date() -> None:
    """It holds every parameter at its default; `make tables` writes it anew."""
    pytest.importorskip('rclpy')
    text = (SHARE / 'config' / 'maze.yaml').read_text()
    assert text == write_config()['render']()
    parsed = yaml.safe_load(text)
    assert parsed['/**/bev_mapper']['ros__parameters']['map_frame'] == 'map'


def view() -> dict[str, Any]:
    """Return the RViz view."""
    content: dict[str, Any] = yaml.safe_load((SHARE / 'rviz' / 'maze.rviz').read_text())
    manager: dict[str, Any] = content['Visualization Manager']
    return manager


TO_BE_SEEN = (
    'camera/color/image_raw',
    'map',
    'odom',
    'plan',
    'plan_candidates',
    'points',
    'value_map',
)
"""What every view of the stack has to show."""

MESSAGES = {
    'rviz_default_plugins/Image': 'sensor_msgs/msg/Image',
    'rviz_default_plugins/Map': 'nav_msgs/msg/OccupancyGrid',
    'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'rviz_default_plugins/Odometry': 'nav_msgs/msg/Odometry',
    'rviz_default_plugins/Path': 'nav_msgs/msg/Path',
    'rviz_default_plugins/PointCloud2': 'sensor_msgs/msg/PointCloud2',
    'rviz_default_plugins/Pose': 'geometry_msgs/msg/PoseStamped',
    'rviz_default_plugins/SetGoal': 'geometry_msgs/msg/PoseStamped',
}


def test_the_view_looks_at_topics_of_the_stack(launched: list[Recorded]) -> None:
    """Of the right type, and latched where the topic is; each is remapped into the namespace."""
    topics = {f'/{topic.name}': topic for topic in TOPICS}
    shown = [*view()['Displays'], *view()['Tools']]
    viewed = [item for item in shown if 'Topic' in item]
    assert len(viewed) >= 10
    assert {f'/{name}' for name in TO_BE_SEEN} <= {item['Topic']['Value'] for item in viewed}
    for item in viewed:
        topic = topics[item['Topic']['Value']]
        assert MESSAGES[item['Class']] == topic.type
        latched = topic.qos in {'MAP', 'EPISODE'}
        assert (item['Topic']['Durability Policy'] == 'Transient Local') == latched, topic.name
        reliability = 'Best Effort' if topic.qos == 'SENSOR' else 'Reliable'
        assert item['Topic']['Reliability Policy'] == reliability
    (rviz,) = (c.named for c in launched if c.name == 'Node' and c.named['package'] == 'rviz2')
    names = {item['Topic']['Value'] for item in viewed}
    assert set(rviz['remappings']) == {(name, name.removeprefix('/')) for name in names}


def test_the_view_is_in_the_map_frame() -> None:
    """The one the map and the goals are in."""
    assert view()['Global Options']['Fixed Frame'] == 'map'


SHOWN_IN_3D = {
    'geometry_msgs/msg/PoseStamped',
    'nav_msgs/msg/OccupancyGrid',
    'nav_msgs/msg/Path',
    'sensor_msgs/msg/PointCloud2',
    'visualization_msgs/msg/MarkerArray',
}
"""What Foxglove's 3D panel draws; for odom there is a plot."""


def test_the_foxglove_layout_looks_at_topics_of_the_stack() -> None:
    """Of types that its panels can show, and every panel has its place."""
    content = json.loads((SHARE / 'foxglove' / 'maze.json').read_text())
    types = {
        topic.name if topic.name.startswith('/') else f'/{topic.name}': topic.type
        for topic in TOPICS
    }
    seen: set[str] = set()
    for panel, settings in content['configById'].items():
        kind = panel.split('!')[0]
        if kind == '3D':
            seen |= {name for name, how in settings['topics'].items() if how['visible']}
            assert {types[name] for name in settings['topics']} <= SHOWN_IN_3D
        elif kind == 'Image':
            mode = settings['imageMode']
            seen.add(mode['imageTopic'])
            assert types[mode['imageTopic']] == 'sensor_msgs/msg/Image'
            assert types[mode['calibrationTopic']] == 'sensor_msgs/msg/CameraInfo'
        elif kind == 'Plot':
            for path in (settings['xAxisPath'], *settings['paths']):
                topic, field = path['value'].split('.', 1)
                seen.add(topic)
                message: Any = odometry(0, 1.0, 2.0)
                assert types[topic] == message.__msgtype__
                for name in field.split('.'):
                    message = getattr(message, name)
                assert isinstance(message, float)
        elif kind == 'RawMessages':
            assert settings['topicPath'] in types
        else:
            assert kind == 'DiagnosticSummary'
            assert types[settings['topicToRender']] == 'diagnostic_msgs/msg/DiagnosticArray'
    assert {f'/{name}' for name in TO_BE_SEEN} <= seen
    assert set(placed(content['layout'])) == set(content['configById'])


def placed(layout: str | dict[str, Any]) -> list[str]:
    """Return the panels of a part of a layout."""
    if isinstance(layout, str):
        return [layout]
    return [*placed(layout['first']), *placed(layout['second'])]
