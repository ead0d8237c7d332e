"""Trains what the planner knows of the world's rules: action mask, motion models, observation.

The rules are local and the same everywhere, so they are learned from patches of random worlds:
which steps are valid as far as has been seen, where they lead and what they cost, and how a view
looks at each place of a map.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch.nn import functional
from tqdm import tqdm

from gridnav import FREE, NUM_MOVES, OBSTACLE, STEP_LENGTHS, STEPS, valid_moves
from maze_sim import open_walls, visible_cells, wilson_maze

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from vgdp_planner.belief import BeliefFilter
    from vgdp_planner.value import MotionModel, ValueNetwork

SIZE = 15
WRONG_VIEWS = 0.02
"""Share of the cells of a view that say the wrong thing, so that the filter expects errors."""


def random_maps(count: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw partial maps of noise: obstacles, free and unseen cells in random shares."""
    shares = rng.dirichlet([1.0, 1.0, 1.0], size=count).cumsum(axis=1)
    draws = rng.random((count, SIZE, SIZE))
    maps = np.zeros((count, 3, SIZE, SIZE), dtype=np.float32)
    maps[:, OBSTACLE] = draws < shares[:, 0, None, None]
    maps[:, FREE] = ~(maps[:, OBSTACLE] > 0) & (draws < shares[:, 1, None, None])
    return maps


def motion_loss(motion: MotionModel) -> Tensor:
    """Return the mean negative log-likelihood of where valid steps lead."""
    log_likelihood = motion.logits.flatten(1).log_softmax(dim=-1)
    rows, cols = torch.from_numpy(STEPS + 1).T
    return -log_likelihood[torch.arange(NUM_MOVES), 3 * rows + cols].mean()


def reward_loss(network: ValueNetwork) -> Tensor:
    """Return the squared error of what valid steps cost."""
    predicted = (network.motion.kernels() * network.motion_reward).sum(dim=(1, 2))
    actual = -torch.from_numpy(STEP_LENGTHS[:NUM_MOVES]).to(predicted)
    return functional.mse_loss(predicted, actual)


def mask_loss(network: ValueNetwork, maps: NDArray[np.float32]) -> Tensor:
    """Return the cross-entropy of the action mask on the cells that a robot may stand on."""
    valid = torch.from_numpy(valid_moves(maps[:, OBSTACLE] > 0)).float()
    logits, threshold = network.action_logits(torch.from_numpy(maps))
    standing = torch.from_numpy(maps[:, OBSTACLE] == 0)[:, None].expand_as(valid)
    return functional.binary_cross_entropy_with_logits(
        (logits[:, :NUM_MOVES] - threshold)[standing], valid[standing]
    )


def observation_loss(belief_filter: BeliefFilter, rng: np.random.Generator, count: int) -> Tensor:
    """Return the negative log-belief in the true cell after one view in a known maze."""
    blocked = np.stack(
        [open_walls(wilson_maze(SIZE, rng), rng.random() * 0.5, rng) for _ in range(count)]
    )
    maps = np.zeros((count, 3, SIZE, SIZE), dtype=np.float32)
    maps[:, OBSTACLE], maps[:, FREE] = blocked, ~blocked
    cells = np.array([rng.choice(np.argwhere(~one)) for one in blocked])
    view_range = int(rng.integers(1, 4))
    seen = visible_cells(blocked, cells, view_range)
    padded = np.pad(blocked, [(0, 0), (view_range, view_range), (view_range, view_range)])
    side = 2 * view_range + 1
    truth = np.stack(
        [one[r : r + side, c : c + side] for one, (r, c) in zip(padded, cells, strict=True)]
    )
    wrong = rng.random(truth.shape) < WRONG_VIEWS
    views = np.where(seen, np.where(truth ^ wrong, 100, 0), -1).astype(np.int8)
    free = torch.from_numpy(maps[:, FREE])
    prior = free / free.sum(dim=(1, 2), keepdim=True)
    posterior = belief_filter.correct(prior, torch.from_numpy(maps), torch.from_numpy(views))
    rows, cols = torch.from_numpy(cells).T
    return -posterior[torch.arange(count), rows, cols].clamp_min(1e-12).log().mean()


def train_dynamics(
    network: ValueNetwork, belief_filter: BeliefFilter, steps: int, seed: int
) -> dict[str, float]:
    """Train action mask, motion models, step rewards and observation function in place.

    Args:
        network: A value network of the 'boundary' kind.
        belief_filter: The belief filter.
        steps: Optimisation steps; the learning rate falls to zero over them.
        seed: Of the random worlds.

    Returns:
        The last losses.
    """
    # The motion models are a few numbers with far to go: a larger rate for them.
    models = [*network.motion.parameters(), *belief_filter.motion.parameters()]
    others = [
        *network.action_embedding.parameters(),
        network.motion_reward,
        belief_filter.log_confusion,
    ]
    optimizer = torch.optim.Adam([{'params': models, 'lr': 0.1}, {'params': others, 'lr': 0.01}])
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    rng = np.random.default_rng([seed, 1])
    losses: dict[str, float] = {}
    for _ in tqdm(range(steps), desc='dynamics', unit='step'):
        terms = {
            'mask': mask_loss(network, random_maps(32, rng)),
            'motion': motion_loss(network.motion),
            'filter_motion': motion_loss(belief_filter.motion),
            'reward': reward_loss(network),
            'observation': observation_loss(belief_filter, rng, 16),
        }
        optimizer.zero_grad()
        torch.stack(list(terms.values())).sum().backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
        losses = {name: float(term.detach()) for name, term in terms.items()}
    return losses
