"""What every node does: live on, warn, answer, report, start and end well."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import UInt8
from std_srvs.srv import Trigger
from tests.ros_helpers import wait_for

from gridnav.ros.qos import MAP_QOS, RELIABLE_QOS, SENSOR_QOS

if TYPE_CHECKING:
    from tests.ros_helpers import Probe, StartNode

TOY = str(Path(__file__).with_name('toy_node.py'))
READY = 'The toy is there.'


def test_a_node_lives_on_whatever_it_receives(
    node_process: StartNode, probe: Probe, namespace: str
) -> None:
    """Refused and failing messages are named and counted, then a good one is answered."""
    toy = node_process(TOY)
    numbers = probe.publisher(UInt8, 'number', RELIABLE_QOS)
    answers = probe.record(UInt8, 'answer', RELIABLE_QOS)
    diagnostics = probe.record(DiagnosticArray, '/diagnostics', RELIABLE_QOS)
    wait_for(lambda: probe.node.count_publishers(f'{namespace}/answer'))
    for number in (100, 200, 13, 13, 41):
        numbers.publish(UInt8(data=number))
    wait_for(lambda: answers)
    assert [answer.data for answer in answers] == [42]
    refusal = f'Refused a message on {namespace}/number: It is 100, expected 99 or less.'
    assert refusal in toy.output
    assert 'It is 200' not in toy.output  # the same warning is throttled
    assert 'RuntimeError: thirteen' in toy.output
    toy.assert_alive()

    def counts() -> dict[str, str]:
        return {
            item.key: item.value
            for array in diagnostics
            for status in array.status
            if status.name == f'{namespace}/toy'
            for item in status.values
        }

    wait_for(lambda: counts().get('number: received') == '5')
    assert counts()['refused: number'] == '2'
    assert counts()['failed: number'] == '2'
    assert float(counts()['number: age (s)']) < 2.0


def test_parameters_change_over_the_service(
    node_process: StartNode, probe: Probe, namespace: str
) -> None:
    """A good value takes effect, a bad one comes back with the reason."""
    node_process(TOY, {'mode': 'subtract'})
    numbers = probe.publisher(UInt8, 'number', RELIABLE_QOS)
    answers = probe.record(UInt8, 'answer', RELIABLE_QOS)
    wait_for(lambda: probe.node.count_publishers(f'{namespace}/answer'))

    def set_parameter(name: str, value: object) -> str:
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        [result] = probe.call(SetParameters, 'toy/set_parameters', request).results
        return '' if result.successful else result.reason

    numbers.publish(UInt8(data=5))
    wait_for(lambda: len(answers) == 1)
    assert "must be 'add' or 'subtract', got 'divide'" in set_parameter('mode', 'divide')
    assert 'read-only' in set_parameter('size', 20)
    assert set_parameter('mode', 'add') == ''
    numbers.publish(UInt8(data=5))
    wait_for(lambda: len(answers) == 2)
    assert [answer.data for answer in answers] == [4, 6]


def test_reset_says_what_it_did_or_why_not(node_process: StartNode, probe: Probe) -> None:
    """A reset that fails answers too."""
    toy = node_process(TOY)
    good = probe.call(Trigger, 'toy/reset', Trigger.Request())
    assert (good.success, good.message) == (True, 'It is new.')
    toy.end()
    broken = node_process(TOY, {'broken': True})
    bad = probe.call(Trigger, 'toy/reset', Trigger.Request())
    assert (bad.success, bad.message) == (False, 'it is broken')
    assert 'A callback failed: RuntimeError: the work failed' in broken.output
    broken.assert_alive()


def test_a_node_warns_of_a_second_publisher_and_of_an_incompatible_one(
    node_process: StartNode, probe: Probe, namespace: str
) -> None:
    """The two reasons why a topic seems to be silent or mad."""
    toy = node_process(TOY)
    toy.wait_output(READY)
    probe.publisher(UInt8, 'number', RELIABLE_QOS)
    probe.publisher(UInt8, 'number', RELIABLE_QOS)
    toy.wait_output(f'{namespace}/number has 2 publishers, one is expected')
    probe.node.create_publisher(UInt8, 'latched', SENSOR_QOS)
    toy.wait_output(f'A publisher of {namespace}/latched has an incompatible QoS')
    probe.record(UInt8, 'answer', MAP_QOS)
    toy.wait_output(f'A subscriber of {namespace}/answer has an incompatible QoS (DURABILITY)')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('work_s', [0.0, 0.1], ids=['idle', 'busy'])
def test_a_signal_ends_a_node_quietly(node_process: StartNode, number: int, work_s: float) -> None:
    """Code 0, no traceback, within two seconds; several times, as it must be no matter of luck."""
    toys = [node_process(TOY, {'work_s': work_s}) for _ in range(3)]
    for i, toy in enumerate(toys):
        toy.wait_output(READY)
        time.sleep(0.03 * i)
        assert toy.end(number) < 2.0


def test_a_second_signal_changes_nothing(node_process: StartNode) -> None:
    """A terminal sends Ctrl-C to the whole group, and a launch system sends its own after it."""
    toy = node_process(TOY, {'work_s': 0.2})
    toy.wait_output(READY)
    for _ in range(20):
        toy.process.send_signal(signal.SIGINT)
        time.sleep(0.005)
    assert toy.end(signal.SIGTERM) < 2.0


def test_a_signal_during_a_long_start_or_callback_ends_the_node_in_time(
    node_process: StartNode,
) -> None:
    """Whatever the node is busy with."""
    starting = node_process(TOY, {'start_s': 30.0})
    working = node_process(TOY, {'work_s': 30.0})
    working.wait_output(READY)
    time.sleep(0.3)
    for toy in (starting, working):
        assert toy.end() < 2.0
        assert 'leaving without it' in toy.output


@pytest.mark.parametrize(
    ('arguments', 'code', 'sentence'),
    [
        (['--ros-args', '-p', 'size:=2'], 1, "Parameter 'size' must be 3 cells or more, got 2."),
        (['--ros-args', '-p', 'work_s:=.nan'], 1, "Parameter 'work_s' must be finite, got nan."),
        (['--ros-args', '--params-file', 'missing.yaml'], 2, 'missing.yaml'),
        (['--size', '20'], 2, "Unknown argument '--size'"),
    ],
)
def test_a_node_that_can_not_start_says_why(
    arguments: list[str], code: int, sentence: str
) -> None:
    """One sentence and an exit code."""
    run = subprocess.run(
        [sys.executable, TOY, *arguments],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
        env=os.environ,
    )
    assert run.returncode == code
    assert sentence in run.stderr
    assert 'Traceback' not in run.stderr
