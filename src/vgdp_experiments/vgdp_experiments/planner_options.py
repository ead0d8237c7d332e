"""The options of commands that load a planner."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from vgdp_experiments.options import whole_number
from vgdp_planner import PlannerConfig, ValueGuidedPlanner

if TYPE_CHECKING:
    from collections.abc import Mapping

TRUTHS = {'true': True, 'false': False}
KINDS = {bool: 'true or false', int: 'a whole number', float: 'a number'}


def add_planner_arguments(parser: argparse.ArgumentParser) -> None:
    """Add which weights to load, and where and how they run."""
    parser.add_argument(
        '--weights', type=Path, metavar='FOLDER', help='weights to load instead of those shipped'
    )
    parser.add_argument('--device', type=_device, default='cpu', help='cpu, or cuda for a GPU')
    parser.add_argument(
        '--threads', type=whole_number(1), help="CPU threads of the networks (PyTorch's choice)"
    )
    parser.add_argument(
        '--set',
        dest='settings',
        nargs='+',
        type=_setting,
        default=[],
        metavar='NAME=VALUE',
        help='settings of the planner instead of those of the weights, such as candidates=8',
    )


def load_planner(
    args: argparse.Namespace, settings: Mapping[str, Any] | None = None
) -> ValueGuidedPlanner:
    """Load the planner that the options ask for.

    Args:
        args: What `add_planner_arguments` added.
        settings: Of the planner; they come before those of the options and of the weights.

    Raises:
        ValueError: If the folder does not hold a planner or a setting is out of range, with one
            sentence that says why.
    """
    if args.threads is not None:
        torch.set_num_threads(args.threads)
    settings = dict(args.settings) | dict(settings or {})
    return ValueGuidedPlanner.from_pretrained(args.weights, args.device, settings)


def _setting(text: str) -> tuple[str, Any]:
    """Read NAME=VALUE; the field of `PlannerConfig` says of which type the value is."""
    name, _, value = text.partition('=')
    kinds: dict[str, type[Any]] = {
        field.name: type(field.default) for field in fields(PlannerConfig)
    }
    if name not in kinds:
        msg = f'the planner has no setting {name!r}; there are {", ".join(kinds)}'
        raise argparse.ArgumentTypeError(msg)
    try:
        return name, TRUTHS[value] if kinds[name] is bool else kinds[name](value)
    except (KeyError, ValueError) as error:
        msg = f'{name} must be {KINDS[kinds[name]]}, got {value!r}'
        raise argparse.ArgumentTypeError(msg) from error


def _device(name: str) -> str:
    try:
        torch.empty(0, device=name)
    except (AssertionError, RuntimeError) as error:
        msg = f'there is no device {name!r} here'
        raise argparse.ArgumentTypeError(msg) from error
    return name
