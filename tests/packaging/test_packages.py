"""What every package has to have, and what it may import."""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from vgdp_bringup.topics import TOPICS

ROOT = Path(__file__).parents[2]
PACKAGES = sorted(path.parent.name for path in ROOT.glob('src/*/package.xml'))

ROSDEP_KEYS = {
    'PIL': 'python3-pil',
    'matplotlib': 'python3-matplotlib',
    'numpy': 'python3-numpy',
    'scipy': 'python3-scipy',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
"""What package.xml calls a module; ROS packages and ours go by their own names."""

PYPI_ONLY = {
    'gymnasium',
    'mcap',
    'open3d',
    'rich',
    'rosbags',
    'safetensors',
    'tensorboard',
    'torch',
}
"""Modules for which rosdep has no key; a comment in package.xml names them."""

PYPI_NAMES = {'PIL': 'pillow', 'open3d': 'open3d-cpu', 'yaml': 'pyyaml'}
"""What PyPI calls a module where it is not the module's name."""

USED_BY_NAME = {
    # Started as programs, by the demo and the launch file.
    'vgdp_bringup': {'bev_mapper', 'maze_sim', 'rviz2'}
    | {topic.type.split('/')[0] for topic in TOPICS},
    # Imported by torch.utils.tensorboard.
    'vgdp_experiments': {'tensorboard'},
}
"""Dependencies that no import statement shows."""

ROS_MODULES = {
    'builtin_interfaces',
    'diagnostic_msgs',
    'geometry_msgs',
    'launch',
    'launch_ros',
    'nav2_msgs',
    'nav_msgs',
    'rcl_interfaces',
    'rclpy',
    'rosgraph_msgs',
    'sensor_msgs',
    'std_msgs',
    'std_srvs',
    'tf2_msgs',
    'tf2_ros',
    'visualization_msgs',
}

ALLOWED = {
    'avd_player': {'gridnav'},
    'bev_mapper': {'gridnav'},
    'gridnav': set(),
    'maze_sim': {'gridnav'},
    'vgdp_planner': {'gridnav'},
    'vgdp_experiments': set(PACKAGES) - {'vgdp_bringup'},
    'vgdp_bringup': set(PACKAGES),
}
"""Which packages of ours each one may import besides itself."""


def sources(package: str) -> list[Path]:
    """Return the Python files of a package that run on a robot."""
    folder = ROOT / 'src' / package
    return [*(folder / package).rglob('*.py'), *folder.glob('launch/*.py')]


def imports(path: Path) -> set[str]:
    """Return the full names of all modules that a file imports, wherever it does."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path} imports relatively'
            assert node.module is not None
            names.update(f'{node.module}.{alias.name}' for alias in node.names)
    return names


def manifest(package: str) -> ET.Element:
    """Return the root of a package's package.xml."""
    return ET.parse(ROOT / 'src' / package / 'package.xml').getroot()  # noqa: S314 - our own file


def pypi_comment(package: str) -> set[str]:
    """Return the modules that package.xml names as coming from PyPI."""
    start = '<!-- From PyPI, without a rosdep key: '
    for line in (ROOT / 'src' / package / 'package.xml').read_text().splitlines():
        if line.strip().startswith(start):
            return set(line.strip().removeprefix(start).removesuffix(' -->').split(', '))
    return set()


def test_there_is_one_version() -> None:
    """All packages have one version, and the installed ones are those."""
    from importlib.metadata import version  # noqa: PLC0415

    versions = {package: manifest(package).findtext('version') for package in PACKAGES}
    assert len(set(versions.values())) == 1, versions
    assert {package: version(package) for package in PACKAGES} == versions


@pytest.mark.parametrize('package', PACKAGES)
def test_manifest(package: str) -> None:
    """package.xml is of format 3 and says what ament needs."""
    root = manifest(package)
    assert root.get('format') == '3'
    assert root.findtext('name') == package
    assert root.findtext('license') == 'Apache-2.0'
    assert root.findtext('export/build_type') == 'ament_python'
    assert 'package_format3.xsd' in (ROOT / 'src' / package / 'package.xml').read_text()


@pytest.mark.parametrize('package', PACKAGES)
def test_folder(package: str) -> None:
    """A package has its marker, its types and its page, and puts programs where ros2 looks."""
    folder = ROOT / 'src' / package
    assert (folder / 'resource' / package).is_file()
    assert (folder / package / 'py.typed').is_file()
    assert (folder / package / '__init__.py').read_text().startswith('"""')
    assert (folder / 'README.md').read_text().startswith(f'# {package}\n')
    assert (folder / 'setup.cfg').read_text().count(f'$base/lib/{package}\n') == 2


@pytest.mark.parametrize('package', PACKAGES)
def test_every_import_is_declared_and_every_declaration_used(package: str) -> None:
    """The dependencies in package.xml are those of the code, no more and no less."""
    modules = {name.split('.')[0] for path in sources(package) for name in imports(path)}
    modules -= {*sys.stdlib_module_names, package}
    used = modules | USED_BY_NAME.get(package, set())
    declared = {node.text for node in manifest(package).iterfind('exec_depend')}
    assert declared == {ROSDEP_KEYS.get(name, name) for name in used - PYPI_ONLY}
    assert pypi_comment(package) == used & PYPI_ONLY


@pytest.mark.parametrize('package', PACKAGES)
def test_layers(package: str) -> None:
    """A package imports only those below it."""
    modules = {name.split('.')[0] for path in sources(package) for name in imports(path)}
    assert modules & set(PACKAGES) <= ALLOWED[package] | {package}


def test_every_pypi_module_is_installed_by_make_setup() -> None:
    """What the packages import from PyPI stands in a requirements file."""
    required = {
        line.split('=')[0].split('>')[0].strip().lower()
        for path in ROOT.glob('requirements*.txt')
        for line in path.read_text().splitlines()
        if line and not line.startswith('#')
    }
    modules = {
        name.split('.')[0]
        for package in PACKAGES
        for path in sources(package)
        for name in imports(path)
    } - {*sys.stdlib_module_names, *PACKAGES, *ROS_MODULES}
    assert {PYPI_NAMES.get(name, name) for name in modules} <= required


def knows_ros(path: Path) -> bool:
    """Tell whether a file may know ROS."""
    package, *folders = path.relative_to(ROOT / 'src').parts[1:]
    return (
        path.name == 'node.py'
        or path.name.endswith('_node.py')
        or path.name.endswith('.launch.py')
        or (package == 'gridnav' and folders[0] == 'ros')
        # The live view of the demo, `vgdp info`, and what launch files share.
        or (package == 'vgdp_bringup' and path.name in {'watcher.py', 'info.py', 'launching.py'})
    )


@pytest.mark.parametrize('package', PACKAGES)
def test_only_nodes_know_ros(package: str) -> None:
    """The cores import neither rclpy nor messages nor what imports them."""
    for path in sources(package):
        if not knows_ros(path):
            found = imports(path)
            assert not {name.split('.')[0] for name in found} & ROS_MODULES, path
            assert not any(name.startswith('gridnav.ros') for name in found), path
            nodes = {f'{other}.node' for other in PACKAGES}
            assert not any(name.rsplit('.', 1)[0] in nodes for name in found), path
