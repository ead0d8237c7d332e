"""One table of parameters: declared, validated at start and at run time, documented."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
from rclpy.parameter import Parameter

from gridnav.ros.parameters import (
    ParameterError,
    declare_parameters,
    parameter,
    parameter_rows,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.node import Node


@dataclass
class Table:
    """One parameter of each kind."""

    rate: float = parameter(2.0, 'How fast it goes', unit='Hz', low=0.0, high=100.0)
    size: int = parameter(15, 'How big it is', unit='cells', low=3)
    fixed: int = parameter(7, 'What stays', low=-1, high=9, read_only=True)
    mode: str = parameter('fast', 'How it goes', choices=('fast', 'slow'))
    loud: bool = parameter(default=False, description='Whether it says so')
    limit: float = parameter(50.0, 'How fast it may go', unit='Hz')

    def __post_init__(self) -> None:
        """Check what depends on two fields."""
        if self.rate > self.limit:
            msg = f'The rate {self.rate} is above the limit {self.limit}.'
            raise ValueError(msg)


@pytest.fixture
def make_node(ros: None) -> Iterator[Callable[..., Node]]:
    """Return a function that makes a node to which parameters are given at start."""
    del ros
    nodes: list[Any] = []
    names = itertools.count()

    def make(**given: object) -> Node:
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        nodes.append(rclpy.create_node(f'table_{next(names)}', parameter_overrides=overrides))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()


BAD = [
    ('rate', -0.1, 'rate'),
    ('rate', 100.5, 'rate'),
    ('rate', math.nan, 'rate'),
    ('rate', math.inf, 'rate'),
    ('rate', 'fast', 'rate'),
    ('rate', True, 'rate'),
    ('rate', 60.0, 'above the limit'),
    ('size', 2, 'size'),
    ('size', 3.5, 'size'),
    ('mode', 'medium', 'mode'),
    ('mode', 3, 'mode'),
    ('loud', 1, 'loud'),
    ('limit', math.nan, 'limit'),
    ('limit', 1.0, 'above the limit'),
]

GOOD = [
    ('rate', 0.0),
    ('rate', 50.0),
    ('rate', 3),
    ('size', 3),
    ('size', 10**12),
    ('mode', 'slow'),
    ('loud', True),
    ('limit', 1e9),
]


@pytest.mark.parametrize(('name', 'value', 'reason'), BAD)
def test_bad_values_are_refused_at_start(
    make_node: Callable[..., Node], name: str, value: object, reason: str
) -> None:
    """With one sentence."""
    with pytest.raises(ParameterError, match=reason) as caught:
        declare_parameters(make_node(**{name: value}), Table)
    assert str(caught.value).endswith('.')


@pytest.mark.parametrize(('name', 'value', 'reason'), BAD)
def test_bad_values_are_refused_at_run_time(
    make_node: Callable[..., Node], name: str, value: object, reason: str
) -> None:
    """With a reason, and nothing changes."""
    node = make_node()
    values = declare_parameters(node, Table)
    [result] = node.set_parameters([Parameter(name, value=value)])
    assert not result.successful
    assert reason in result.reason or 'type' in result.reason
    assert values == Table()
    assert node.get_parameter(name).value == getattr(Table(), name)


@pytest.mark.parametrize(('name', 'value'), GOOD)
def test_good_values_are_taken_at_start_and_at_run_time(
    make_node: Callable[..., Node], name: str, value: object
) -> None:
    """They appear in the table; a whole number will do where a number is asked for."""
    assert getattr(declare_parameters(make_node(**{name: value}), Table), name) == value
    node = make_node()
    values = declare_parameters(node, Table)
    [result] = node.set_parameters([Parameter(name, value=value)])
    assert result.successful, result.reason
    assert getattr(values, name) == value
    assert type(getattr(values, name)) is type(getattr(Table(), name))


def test_read_only_parameters_are_set_at_start_alone(make_node: Callable[..., Node]) -> None:
    """Later they are refused."""
    node = make_node(fixed=-1)
    values = declare_parameters(node, Table)
    [result] = node.set_parameters([Parameter('fixed', value=3)])
    assert not result.successful
    assert values.fixed == -1


def test_several_at_once_are_checked_together(make_node: Callable[..., Node]) -> None:
    """A rate above the old limit and below the new one."""
    node = make_node()
    values = declare_parameters(node, Table)
    changes = [Parameter('rate', value=80.0), Parameter('limit', value=90.0)]
    assert node.set_parameters_atomically(changes).successful
    assert (values.rate, values.limit) == (80.0, 90.0)


def test_descriptors_tell_what_the_table_says(make_node: Callable[..., Node]) -> None:
    """For ros2 param describe and rqt."""
    node = make_node(rate=5)
    declare_parameters(node, Table)
    rate = node.describe_parameter('rate')
    assert rate.type == Parameter.Type.DOUBLE.value
    assert rate.description == 'How fast it goes (Hz)'
    assert rate.floating_point_range[0].from_value == 0.0
    assert rate.floating_point_range[0].to_value == 100.0
    assert not rate.dynamic_typing
    assert node.describe_parameter('size').integer_range[0].from_value == 3
    assert node.describe_parameter('fixed').read_only
    assert node.describe_parameter('mode').additional_constraints == "'fast' or 'slow'"
    assert list(node.describe_parameter('loud').integer_range) == []


def test_rows_for_the_documentation() -> None:
    """They hold all columns of the table."""
    rows = {row.name: row for row in parameter_rows(Table)}
    assert list(rows) == ['rate', 'size', 'fixed', 'mode', 'loud', 'limit']
    assert (rows['rate'].type, rows['rate'].default) == ('float', '2.0')
    assert (rows['rate'].unit, rows['rate'].allowed) == ('Hz', '0 to 100 Hz')
    assert rows['size'].allowed == '3 cells or more'
    assert rows['fixed'].read_only
    assert rows['mode'].allowed == "'fast' or 'slow'"
    assert rows['loud'].default == 'false'
    assert rows['loud'].description == 'Whether it says so'
