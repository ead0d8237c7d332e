"""What the commands' options have in common."""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar('T')

USAGE_ERROR = 2
"""Exit status for options that can not be used, as argparse has it."""


def whole_number(low: int) -> Callable[[str], int]:
    """Return a type of option that takes whole numbers from `low`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if value < low:
            msg = f'{text!r} is not a whole number from {low}'
            raise argparse.ArgumentTypeError(msg)
        return value

    return parse


def add_results_file(parser: argparse.ArgumentParser, name: str) -> None:
    """Add the option that says where the results of an evaluation go."""
    parser.add_argument(
        '-o',
        '--out',
        type=Path,
        default=Path('runs', f'{name}.json'),
        metavar='FILE',
        help='JSON file to write (%(default)s)',
    )


def refuse(error: Exception) -> int:
    """Say in one sentence why the options can't be used, and return the exit status."""
    sys.stderr.write(f'error: {error}\n')
    return USAGE_ERROR


def add_settings(parser: argparse.ArgumentParser, kind: type[Any]) -> None:
    """Add an option for each field of a dataclass, explained as in its docstring."""
    text = ' '.join((kind.__doc__ or '').split())
    for field in dataclasses.fields(kind):
        explained = re.search(rf' {field.name}: (.*?)\.(?= [a-z_]+: |$)', text)
        parser.add_argument(
            f'--{field.name.replace("_", "-")}',
            type=type(field.default),
            default=field.default,
            help=f'{explained[1] if explained else ""} (default: {field.default!r})',
        )


def read_settings(kind: type[T], arguments: argparse.Namespace) -> T:
    """Return the dataclass that the options describe."""
    fields = dataclasses.fields(kind)  # type: ignore[arg-type]
    return kind(**{field.name: getattr(arguments, field.name) for field in fields})
