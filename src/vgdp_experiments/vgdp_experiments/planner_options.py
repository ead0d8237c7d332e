"""The options of commands that load a planner."""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from vgdp_experiments.options import whole_number
from vgdp_planner import ValueGuidedPlanner


def add_planner_arguments(parser: argparse.ArgumentParser) -> None:
    """Add which weights to load, and where and how they run."""
    parser.add_argument(
        '--weights', type=Path, metavar='FOLDER', help='weights to load instead of those shipped'
    )
    parser.add_argument('--device', type=_device, default='cpu', help='cpu, or cuda for a GPU')
    parser.add_argument(
        '--threads', type=whole_number(1), help="CPU threads of the networks (PyTorch's choice)"
    )


def load_planner(args: argparse.Namespace) -> ValueGuidedPlanner:
    """Load the planner that the options ask for.

    Raises:
        WeightsError: If the folder does not hold a planner, with one sentence that says why.
    """
    if args.threads is not None:
        torch.set_num_threads(args.threads)
    return ValueGuidedPlanner.from_pretrained(args.weights, args.device)


def _device(name: str) -> str:
    try:
        torch.empty(0, device=name)
    except (AssertionError, RuntimeError) as error:
        msg = f'there is no device {name!r} here'
        raise argparse.ArgumentTypeError(msg) from error
    return name
