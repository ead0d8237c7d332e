"""What a node publishes about itself."""

from __future__ import annotations

import json
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from tests.ros_helpers import wait_for

from gridnav.ros.diagnostics import Diagnostics
from gridnav.ros.qos import RELIABLE_QOS

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.ros_helpers import Probe


def test_counters_latencies_ages_and_values(make_probe: Callable[[], Probe]) -> None:
    """All of it in one status, under the node's full name."""
    node = make_probe().node
    diagnostics = Diagnostics(node)
    first = diagnostics.status()
    assert not first.values
    assert (first.level, first.message) == (DiagnosticStatus.OK, 'running')
    for i in range(101):
        diagnostics.latency(i / 1000, 'plan')
    diagnostics.count('dropped: old map')
    diagnostics.count('dropped: old map')
    diagnostics.received('map')
    diagnostics.value('weights', 'default')
    diagnostics.report(DiagnosticStatus.WARN, 'exhausted')
    time.sleep(0.05)
    status = diagnostics.status()
    values = {item.key: item.value for item in status.values}
    assert (status.level, status.message) == (DiagnosticStatus.WARN, 'exhausted')
    assert status.name == node.get_fully_qualified_name()
    assert values['dropped: old map'] == '2'
    assert values['plan: p50 (ms)'] == '50.000'
    assert values['plan: p95 (ms)'] == '95.000'
    assert values['map: received'] == '1'
    assert 0.05 <= float(values['map: age (s)']) < 5.0
    assert values['weights'] == 'default'


def test_the_parameters_are_said_as_they_are_now(make_probe: Callable[[], Probe]) -> None:
    """As JSON, with what has changed at run time."""
    parameters = SimpleNamespace(seed=3, mode='add')
    diagnostics = Diagnostics(make_probe().node, parameters)
    parameters.seed = 4
    (said,) = diagnostics.status().values
    assert said.key == 'parameters'
    assert json.loads(said.value) == {'seed': 4, 'mode': 'add'}


def test_once_a_second_on_the_absolute_topic(make_probe: Callable[[], Probe]) -> None:
    """Tools look for /diagnostics, whatever the namespace."""
    watched, watcher = make_probe(), make_probe()
    arrays = watcher.record(DiagnosticArray, '/diagnostics', RELIABLE_QOS)
    Diagnostics(watched.node)
    name = watched.node.get_fully_qualified_name()

    def own() -> list[DiagnosticArray]:
        return [array for array in list(arrays) if array.status[0].name == name]

    wait_for(lambda: len(own()) >= 2)
    first, second = (array.header.stamp for array in own()[:2])
    assert 0.8 < second.sec - first.sec + (second.nanosec - first.nanosec) / 1e9 < 1.5
