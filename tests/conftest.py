"""What the tests share: a ROS domain of their own, nodes as processes, and a probe."""

from __future__ import annotations

import importlib.util
import itertools
import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tests.ros_helpers import NodeProcess, Probe, StartNode

HAS_ROS = importlib.util.find_spec('rclpy') is not None
ROS_TESTS = ('test_ros', 'test_node')
"""Test files whose names begin like this need ROS 2."""

QUICK_DISCOVERY = (
    Path(__file__).parents[1] / 'src' / 'vgdp_bringup' / 'vgdp_bringup' / 'quick_discovery.xml'
)

# Before rclpy is loaded, and inherited by the processes that tests start. One domain per pytest
# process, so that several can run side by side; field checks, as they are off by default.
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(QUICK_DISCOVERY)

_namespaces = itertools.count()


class _SkippedModule(pytest.Module):
    """A test file that needs ROS 2 where there is none."""

    def _getobj(self) -> object:
        pytest.skip('ROS 2 (rclpy) is not installed', allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> object:
    """Skip the files that import rclpy where it is missing."""
    if not HAS_ROS and module_path.name.startswith(ROS_TESTS):
        return _SkippedModule.from_parent(parent, path=module_path)
    return None


@pytest.fixture(scope='session')
def ros() -> Iterator[None]:
    """Initialise ROS 2 in this process."""
    pytest.importorskip('rclpy', reason='ROS 2 (rclpy) is not installed')
    import rclpy  # noqa: PLC0415
    from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415

    import gridnav.ros  # noqa: F401, PLC0415 - names the environment to ament

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    with warnings.catch_warnings():
        # The first node loads a parser that Python has a deprecation warning for.
        warnings.simplefilter('ignore', DeprecationWarning)
        rclpy.create_node('first').destroy_node()
    yield
    rclpy.shutdown()


@pytest.fixture
def namespace() -> str:
    """Return a ROS namespace that no other test uses."""
    return f'/test_{next(_namespaces)}'


@pytest.fixture
def make_probe(ros: None, namespace: str) -> Iterator[Callable[[], Probe]]:
    """Return a function that makes probes in the test's namespace."""
    del ros
    from tests.ros_helpers import Probe  # noqa: PLC0415

    probes: list[Probe] = []

    def make() -> Probe:
        probes.append(Probe(namespace))
        return probes[-1]

    yield make
    for probe in probes:
        probe.close()


@pytest.fixture
def probe(make_probe: Callable[[], Probe]) -> Probe:
    """Return a probe in the test's namespace."""
    return make_probe()


@pytest.fixture
def node_process(namespace: str, tmp_path: Path) -> Iterator[StartNode]:
    """Return a function that starts a node of the stack as a process in the test's namespace."""
    from tests.ros_helpers import NodeProcess  # noqa: PLC0415

    processes: list[NodeProcess] = []

    def start(module: str, parameters: dict[str, object] | None = None) -> NodeProcess:
        log = tmp_path / f'{len(processes)}.log'
        processes.append(NodeProcess(module, parameters or {}, namespace, log))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
