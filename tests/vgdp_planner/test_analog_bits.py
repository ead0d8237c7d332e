"""Actions as analog bits."""

from __future__ import annotations

import torch

from gridnav import NUM_ACTIONS
from vgdp_planner.analog_bits import CODEWORDS, NUM_BITS, decode, encode


def test_round_trip() -> None:
    """Every action comes back from its bits, also through noise that flips no sign."""
    actions = torch.arange(NUM_ACTIONS).repeat(2, 1)
    bits = encode(actions)
    assert bits.shape == (2, NUM_BITS, NUM_ACTIONS)
    assert torch.equal(bits.abs(), torch.ones_like(bits))
    noise = torch.empty_like(bits).uniform_(-0.9, 0.9, generator=torch.Generator().manual_seed(0))
    assert torch.equal(decode(bits + noise), actions)


def test_codes_without_action_go_to_the_nearest() -> None:
    """Bits of the codes 9 to 15 become an action that differs in as few bits as any."""
    for code in range(NUM_ACTIONS, 2**NUM_BITS):
        bits = torch.tensor([1.0 if code >> bit & 1 else -1.0 for bit in range(NUM_BITS)])
        action = int(decode(bits[:, None])[0])
        distance = (bits != CODEWORDS).sum(dim=1)
        assert distance[action] == distance.min()
