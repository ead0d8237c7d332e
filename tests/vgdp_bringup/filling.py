"""Messages of any type with something in every field."""

from __future__ import annotations

import importlib
import itertools
import re
from typing import Any

_SEQUENCE = re.compile(r'sequence<(.*?)(?:, \d+)?>')
_ARRAY = re.compile(r'(.*)\[(\d+)\]')


def fill(kind: type[Any]) -> Any:  # noqa: ANN401 - generated classes
    """Build a message with a different value in each field, sequences with two elements."""
    return _message(kind, itertools.count(1))


def _message(kind: type[Any], numbers: itertools.count[int]) -> Any:  # noqa: ANN401
    message = kind()
    for name, field in kind.get_fields_and_field_types().items():
        setattr(message, name, _value(field, numbers))
    return message


def _value(kind: str, numbers: itertools.count[int]) -> Any:  # noqa: ANN401
    if match := _SEQUENCE.fullmatch(kind):
        return [_value(match[1], numbers) for _ in range(2)]
    if match := _ARRAY.fullmatch(kind):
        return [_value(match[1], numbers) for _ in range(int(match[2]))]
    if '/' in kind:
        package, name = kind.split('/')
        return _message(getattr(importlib.import_module(f'{package}.msg'), name), numbers)
    number = next(numbers) % 100
    makers: dict[str, Any] = {
        'string': f'text {number}',
        'boolean': True,
        'octet': bytes([number]),
        'float': float(number),
        'double': number + 0.1,
    }
    return makers.get(kind, number)
