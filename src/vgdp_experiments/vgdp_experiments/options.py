"""What the commands' options have in common."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

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


def refuse(error: Exception) -> int:
    """Say in one sentence why the options can't be used, and return the exit status."""
    sys.stderr.write(f'error: {error}\n')
    return USAGE_ERROR
