"""One table of parameters per node: a dataclass whose fields say everything about them.

From the fields come the declarations with descriptors, the validation at start and at run time,
and the rows of the documentation.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.parameter import Parameter

if TYPE_CHECKING:
    from rclpy.node import Node

T = TypeVar('T')

_INT64_MAX = 2**63 - 1
_TYPE_NAMES = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a text'}


class ParameterError(ValueError):
    """A parameter that can't be used; the text is one sentence that says why."""


@dataclass(frozen=True)
class ParameterInfo:
    """What is known about a parameter besides its name, type and default.

    Attributes:
        description: What it does, one sentence without a full stop.
        unit: Its unit, if it has one.
        low: Lowest value allowed, if there is one.
        high: Highest value allowed, if there is one.
        choices: The values allowed, if they are few.
        read_only: Whether it is fixed once the node has started.
    """

    description: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False

    @property
    def allowed(self) -> str:
        """The allowed values in words, with the unit; empty if all are."""
        if self.choices:
            return ' or '.join(repr(choice) for choice in self.choices)
        unit = f' {self.unit}' if self.unit else ''
        if self.low is not None and self.high is not None:
            return f'{self.low:.15g} to {self.high:.15g}{unit}'
        if self.low is not None:
            return f'{self.low:.15g}{unit} or more'
        if self.high is not None:
            return f'{self.high:.15g}{unit} or less'
        return ''


@dataclass(frozen=True)
class ParameterRow:
    """One line of a parameter table in the documentation."""

    name: str
    type: str
    default: str
    unit: str
    allowed: str
    description: str
    read_only: bool


def parameter(
    default: Any,  # noqa: ANN401 - as dataclasses.field
    description: str,
    *,
    unit: str = '',
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    read_only: bool = False,
) -> Any:  # noqa: ANN401 - as dataclasses.field
    """Describe a parameter: a dataclass field of type bool, int, float or str."""
    info = ParameterInfo(description, unit, low, high, choices, read_only)
    return dataclasses.field(default=default, metadata={'info': info})


def parameter_rows(table: type) -> list[ParameterRow]:
    """Return the documentation of a parameter dataclass."""
    hints = get_type_hints(table)
    rows = []
    for field in dataclasses.fields(table):
        info: ParameterInfo = field.metadata['info']
        default = str(field.default).lower() if hints[field.name] is bool else str(field.default)
        rows.append(
            ParameterRow(
                name=field.name,
                type=hints[field.name].__name__,
                default=default,
                unit=info.unit,
                allowed=info.allowed,
                description=info.description,
                read_only=info.read_only,
            )
        )
    return rows


def declare_parameters(node: Node, table: type[T]) -> T:
    """Declare the parameters of a node and keep them up to date.

    The table may check what depends on several fields in ``__post_init__``, by a ``ValueError``.

    Args:
        node: Whose parameters they are.
        table: A dataclass made of ``parameter(...)`` fields.

    Returns:
        The values; changes at run time that are valid appear in it.

    Raises:
        ParameterError: If a given value can't be used.
    """
    hints = get_type_hints(table)
    infos: dict[str, ParameterInfo] = {
        field.name: field.metadata['info']
        for field in dataclasses.fields(table)  # type: ignore[arg-type]
    }
    given: dict[str, Any] = {}
    for field in dataclasses.fields(table):  # type: ignore[arg-type]
        name, info = field.name, infos[field.name]
        # Declared without a type first, so that every mistake gets a sentence of ours.
        free = ParameterDescriptor(dynamic_typing=True)
        value = node.declare_parameter(name, field.default, free).value
        given[name] = _checked(name, value, hints[name], info)
        checked = Parameter(name, value=given[name])
        descriptor = _descriptor(hints[name], info)
        descriptor.type = checked.type_.value
        node.set_descriptor(name, descriptor, checked.get_parameter_value())
    try:
        values = table(**given)
    except ValueError as error:
        raise ParameterError(str(error)) from error

    def widen(parameters: list[Parameter]) -> list[Parameter]:
        return [
            Parameter(p.name, value=float(p.value))
            if hints.get(p.name) is float and p.type_ is Parameter.Type.INTEGER
            else p
            for p in parameters
        ]

    def validate(parameters: list[Parameter]) -> SetParametersResult:
        try:
            changes = {
                p.name: _checked(p.name, p.value, hints[p.name], infos[p.name])
                for p in parameters
                if p.name in infos
            }
            dataclasses.replace(values, **changes)  # type: ignore[type-var]
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(parameters: list[Parameter]) -> None:
        for p in parameters:
            if p.name in infos:
                setattr(values, p.name, p.value)

    node.add_pre_set_parameters_callback(widen)
    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(apply)
    return values


def _checked(name: str, value: object, kind: type, info: ParameterInfo) -> object:
    """Return a value as the kind it should be, or raise a ParameterError."""
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        msg = f'Parameter {name!r} must be {_TYPE_NAMES[kind]}, got {value!r}.'
        raise ParameterError(msg)
    if isinstance(value, float) and not math.isfinite(value):
        msg = f'Parameter {name!r} must be finite, got {value}.'
        raise ParameterError(msg)
    too_low = info.low is not None and value < info.low  # type: ignore[operator]
    too_high = info.high is not None and value > info.high  # type: ignore[operator]
    if too_low or too_high or (info.choices and value not in info.choices):
        msg = f'Parameter {name!r} must be {info.allowed}, got {value!r}.'
        raise ParameterError(msg)
    return value


def _descriptor(kind: type, info: ParameterInfo) -> ParameterDescriptor:
    """Describe a parameter to ``ros2 param describe`` and to rqt."""
    unit = f' ({info.unit})' if info.unit else ''
    descriptor = ParameterDescriptor(
        description=info.description + unit,
        additional_constraints=info.allowed if info.choices else '',
        read_only=info.read_only,
    )
    if info.low is None and info.high is None:
        return descriptor
    if kind is int:
        low = -_INT64_MAX if info.low is None else int(info.low)
        high = _INT64_MAX if info.high is None else int(info.high)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high)]
    else:
        lowest = -sys.float_info.max if info.low is None else float(info.low)
        highest = sys.float_info.max if info.high is None else float(info.high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=lowest, to_value=highest)]
    return descriptor
