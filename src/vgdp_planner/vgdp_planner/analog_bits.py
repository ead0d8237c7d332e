"""Actions as analog bits (Chen et al. 2022), the form that the diffusion model denoises."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from gridnav import NUM_ACTIONS

NUM_BITS = math.ceil(math.log2(NUM_ACTIONS))
"""Bits an action takes: n = ⌈log2 K⌉, 4 for nine actions."""

CODEWORDS = (
    torch.arange(NUM_ACTIONS)[:, None].bitwise_right_shift(torch.arange(NUM_BITS)).bitwise_and(1)
    * 2.0
    - 1.0
)
"""Codeword of each action, least significant bit first, −1 for 0 and +1 for 1, (A, NUM_BITS)."""


def encode(actions: Tensor) -> Tensor:
    """Turn action indices (..., T) into analog bits (..., NUM_BITS, T)."""
    return CODEWORDS.to(actions.device)[actions].transpose(-1, -2)


def closeness(bits: Tensor) -> Tensor:
    """Return how close analog bits (..., NUM_BITS, T) are to each codeword, (..., T, A).

    That is their scalar product: `NUM_BITS` for the codeword itself.
    """
    return bits.transpose(-1, -2) @ CODEWORDS.to(bits).T


def decode(bits: Tensor) -> Tensor:
    """Turn analog bits (..., NUM_BITS, T) into the actions (..., T) with the nearest codeword.

    Where thresholding each bit gives a code that belongs to an action, that is the action; the
    codes that belong to none (9 to 15) go to the nearest that does.
    """
    return closeness(bits).argmax(dim=-1)
