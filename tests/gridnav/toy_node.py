"""A node for the tests of what all nodes share; its parameters say how it misbehaves."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import UInt8

from gridnav.ros.node import BaseNode
from gridnav.ros.parameters import parameter
from gridnav.ros.qos import MAP_QOS, RELIABLE_QOS
from gridnav.ros.run import run_node
from gridnav.ros.validation import InvalidMessage


@dataclass
class ToyParameters:
    """Parameters of the toy."""

    start_s: float = parameter(0.0, 'How long the start takes', unit='s', low=0.0, high=60.0)
    work_s: float = parameter(0.0, 'How long a piece of work takes', unit='s', low=0.0, high=60.0)
    broken: bool = parameter(default=False, description='Whether the work fails')
    size: int = parameter(15, 'How big it is', unit='cells', low=3, read_only=True)
    mode: str = parameter('add', 'What it does', choices=('add', 'subtract'))


class ToyNode(BaseNode[ToyParameters]):
    """Answers each number on ``number`` by the next one on ``answer``."""

    def __init__(self) -> None:
        """Start it."""
        super().__init__('toy', ToyParameters)
        time.sleep(self.parameters.start_s)
        self._answer = self.advertise(UInt8, 'answer', RELIABLE_QOS)
        self.subscribe(UInt8, 'number', self._on_number, RELIABLE_QOS, validate=refuse_large)
        self.subscribe(UInt8, 'latched', self._on_number, MAP_QOS)
        self.provide_reset(self._reset)
        if self.parameters.work_s or self.parameters.broken:
            self.create_timer(0.001, self._work)
        self.get_logger().info('The toy is there.')

    def _on_number(self, message: UInt8) -> None:
        """Answer; 13 is bad luck."""
        if message.data == 13:
            msg = 'thirteen'
            raise RuntimeError(msg)
        step = 1 if self.parameters.mode == 'add' else -1
        self._answer.publish(UInt8(data=message.data + step))

    def _reset(self) -> str:
        if self.parameters.broken:
            msg = 'it is broken'
            raise RuntimeError(msg)
        self.diagnostics.report(DiagnosticStatus.WARN, 'was reset')
        return 'It is new.'

    def _work(self) -> None:
        time.sleep(self.parameters.work_s)
        if self.parameters.broken:
            msg = 'the work failed'
            raise RuntimeError(msg)


def refuse_large(message: UInt8) -> None:
    """Refuse what is larger than 99."""
    if message.data > 99:
        msg = f'It is {message.data}, expected 99 or less.'
        raise InvalidMessage(msg)


if __name__ == '__main__':
    sys.exit(run_node(ToyNode))
