"""Every size and hyperparameter of the planner, as validated dataclasses, in two presets."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

MIN_TIME_EMBEDDING = 4


def _require(condition: bool, message: str) -> None:  # noqa: FBT001
    if not condition:
        raise ValueError(message)


@dataclass(frozen=True)
class PolicyConfig:
    """The diffusion policy.

    Attributes:
        encoder: 'pooled' is the paper's map encoder (three convolutions, global average pooling,
            three channels); 'belief' reads the features where the robot may be, soft-indexed by
            the belief, from a fully convolutional network.
        encoder_channels: Channels of the encoder's three convolutions or scales.
        embedding: Length of the map embedding.
        horizon: Steps T_h of a plan.
        denoiser: 'residual' is a stack of fully connected layers over whole plans; 'unet' the
            paper's one-dimensional U-Net.
        width: Features of the residual denoiser.
        blocks: Residual blocks of the residual denoiser.
        channels: Channels of the U-Net's scales, first to last.
        kernel: Kernel size of the U-Net's convolutions, in steps.
        groups: Groups of the U-Net's group normalisation.
        stage_blocks: Residual blocks of each stage of the U-Net.
        residual_kernel: Kernel size of the U-Net's residual connections.
        time_embedding: Length of the embedding of the diffusion step.
        diffusion_steps: Diffusion steps N of training.
        prediction: What the network predicts, the noise or the clean sample.
    """

    encoder: Literal['pooled', 'belief'] = 'belief'
    encoder_channels: tuple[int, int, int] = (32, 48, 64)
    embedding: int = 128
    horizon: int = 8
    denoiser: Literal['residual', 'unet'] = 'residual'
    width: int = 256
    blocks: int = 3
    channels: tuple[int, ...] = (32, 64)
    kernel: int = 3
    groups: int = 8
    stage_blocks: int = 2
    residual_kernel: int = 1
    time_embedding: int = 64
    diffusion_steps: int = 32
    prediction: Literal['epsilon', 'sample'] = 'sample'

    def __post_init__(self) -> None:
        """Check that the sizes fit together."""
        factor = 2 ** (len(self.channels) - 1) if self.denoiser == 'unet' else 1
        _require(len(self.channels) >= 1, 'The U-Net needs at least one scale.')
        _require(
            self.horizon >= 1 and self.horizon % factor == 0,
            f'The horizon must be a multiple of {factor} for {len(self.channels)} scales of the '
            f'U-Net, got {self.horizon}.',
        )
        _require(
            all(channels % self.groups == 0 for channels in self.channels),
            f'Each of the U-Net channels {self.channels} must be a multiple of the '
            f'{self.groups} groups.',
        )
        for kernel in (self.kernel, self.residual_kernel):
            _require(kernel % 2 == 1, f'The kernel size must be odd, got {kernel}.')
        _require(self.stage_blocks >= 1, 'A stage needs at least one residual block.')
        _require(
            self.time_embedding >= MIN_TIME_EMBEDDING and self.time_embedding % 2 == 0,
            f'The time embedding must be even and at least {MIN_TIME_EMBEDDING}, got '
            f'{self.time_embedding}.',
        )
        _require(self.diffusion_steps >= 1, 'There must be at least one diffusion step.')


@dataclass(frozen=True)
class ValueConfig:
    """The value function and the belief filter.

    Attributes:
        unseen: What value iteration makes of cells that have not been seen. 'iterated' treats
            them as cells like all others, with the rewards that the kernels give them (the
            paper); 'boundary' ends there with a learned worth, the negative of the cost that is
            still to come once the robot can look there.
        action_channels: Channels of the network of the action mask.
        trunk_channels: Channels of the three scales of the unseen-worth network ('boundary').
        reward_kernel: Side of the kernels R_m and R_f over the partial map ('iterated').
        transition: 'expected' backs up the expectation over T_m (the paper); 'most_likely' backs
            up its most likely cell, which keeps the cost of a long way exact.
        gamma: Discount factor γ.
        rounds: Value iteration stops after this many rounds K at the latest, counted per cell of
            the longer side of the map where `rounds_grow` is set.
        rounds_grow: Whether K grows with the map: K = rounds · max(H, W).
        tolerance: Value iteration stops when no value changes by more than this.
        invalid_reward: Initial R_f, the reward of an invalid action ('boundary').
    """

    unseen: Literal['iterated', 'boundary'] = 'boundary'
    action_channels: int = 64
    trunk_channels: tuple[int, int, int] = (24, 32, 48)
    reward_kernel: int = 3
    transition: Literal['expected', 'most_likely'] = 'most_likely'
    gamma: float = 1.0
    rounds: int = 40
    rounds_grow: bool = True
    tolerance: float = 1e-3
    invalid_reward: float = -20.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        _require(0 < self.gamma <= 1, f'gamma must be in (0, 1], got {self.gamma}.')
        _require(self.rounds >= 1, f'rounds must be at least 1, got {self.rounds}.')
        _require(self.tolerance >= 0, f'tolerance must not be negative, got {self.tolerance}.')
        _require(self.reward_kernel % 2 == 1, 'The reward kernel must have an odd side.')


@dataclass(frozen=True)
class PlannerConfig:
    """Plan selection and receding-horizon control.

    Attributes:
        candidates: Plans L that are sampled for one decision; none leaves greedy steps alone.
        sampling_steps: Denoising steps of a sample.
        sampler: 'ddim' is deterministic given its first noise, 'ddpm' draws noise at each step.
        guidance: How far each denoising step follows the gradient of a plan's value, in bits
            for each cell that the plan's return would rise; 0 leaves the samples as they are.
        execute: Steps T_a that are committed before planning again.
        look_first: Whether the commitment ends where something new may come into view, so that
            it is looked at before the next step is decided.
        selection: 'value' takes the candidate with the highest score (equation 9); 'vote' the one
            whose committed steps most candidates share, without looking at values.
        score: 'mean_q' is equation 9 of the paper, the mean of the action values along the plan;
            'mean_return' adds to each the reward earned before it, so that plans are compared
            from where the robot is.
        agreement: Weight, in cells, of the logarithm of the share of samples that begin with the
            same committed steps, added to the score.
        memory: Whether the rest of the last best plan competes (algorithm 1).
        greedy_fallback: Whether a plan that walks greedily on the values takes over when no
            candidate is nearly as good at first, or the best makes no progress in value.
        tolerated_loss: Cells by which the committed steps may bring less than greedy ones, for
            the greedy plan not to take over.
        collision_tolerance: A step is committed when no more than this share of the belief would
            run into a known obstacle by it.
    """

    candidates: int = 24
    sampling_steps: int = 4
    sampler: Literal['ddim', 'ddpm'] = 'ddim'
    guidance: float = 0.0
    execute: int = 2
    look_first: bool = True
    selection: Literal['value', 'vote'] = 'value'
    score: Literal['mean_q', 'mean_return'] = 'mean_return'
    agreement: float = 0.0
    memory: bool = True
    greedy_fallback: bool = True
    tolerated_loss: float = 0.05
    collision_tolerance: float = 0.1

    def __post_init__(self) -> None:
        """Check the ranges."""
        _require(self.candidates >= 0, f'candidates must be at least 0, got {self.candidates}.')
        _require(
            self.candidates > 0 or self.greedy_fallback,
            'Without candidates the greedy plan is all there is: greedy_fallback must be set.',
        )
        _require(self.execute >= 1, f'execute must be at least 1, got {self.execute}.')
        for name, choices in (
            ('sampler', ('ddim', 'ddpm')),
            ('selection', ('value', 'vote')),
            ('score', ('mean_q', 'mean_return')),
        ):
            value = getattr(self, name)
            _require(value in choices, f'{name} must be one of {choices}, got {value!r}.')
        for name in ('guidance', 'agreement', 'tolerated_loss'):
            value = getattr(self, name)
            _require(value >= 0, f'{name} must not be negative, got {value}.')
        _require(
            0 <= self.collision_tolerance < 1,
            f'collision_tolerance must be in [0, 1), got {self.collision_tolerance}.',
        )


@dataclass(frozen=True)
class Config:
    """Everything that shapes a planner."""

    policy: PolicyConfig = field(default_factory=PolicyConfig)
    value: ValueConfig = field(default_factory=ValueConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)

    def __post_init__(self) -> None:
        """Check what spans the parts."""
        _require(
            self.planner.execute <= self.policy.horizon,
            f'The planner executes {self.planner.execute} steps of plans that have only '
            f'{self.policy.horizon}.',
        )
        _require(
            1 <= self.planner.sampling_steps <= self.policy.diffusion_steps,
            f'sampling_steps must be in 1 … {self.policy.diffusion_steps}, got '
            f'{self.planner.sampling_steps}.',
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the configuration as plain values, ready for JSON."""
        return asdict(self)

    def with_planner(self, settings: Mapping[str, Any]) -> Config:
        """Return the same with other settings of the planner.

        Raises:
            ValueError: If a setting is unknown or out of range.
        """
        values = self.to_dict()
        return self.from_dict({**values, 'planner': {**values['planner'], **settings}})

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Config:
        """Build a configuration from `to_dict`'s output, JSON's lists included.

        Raises:
            ValueError: If a name is unknown or a value is out of range.
        """
        parts: dict[str, Any] = {}
        kinds = {'policy': PolicyConfig, 'value': ValueConfig, 'planner': PlannerConfig}
        for name, part in values.items():
            if name not in kinds:
                msg = f'A configuration has no part named {name!r}.'
                raise ValueError(msg)
            fields = {
                key: tuple(value) if isinstance(value, list) else value
                for key, value in part.items()
            }
            try:
                parts[name] = kinds[name](**fields)
            except TypeError as error:
                msg = f'The {name} configuration does not fit: {error}.'
                raise ValueError(msg) from error
        return cls(**parts)


PRESETS: dict[str, Config] = {
    'default': Config(),
    'paper': Config(
        policy=PolicyConfig(
            encoder='pooled',
            encoder_channels=(128, 256, 256),
            embedding=256,
            horizon=4,
            denoiser='unet',
            channels=(256, 1024, 2048),
            stage_blocks=1,
            residual_kernel=3,
            time_embedding=256,
            prediction='epsilon',
        ),
        value=ValueConfig(
            unseen='iterated',
            transition='expected',
            gamma=0.99,
            rounds=60,
            rounds_grow=False,
            tolerance=0.0,
        ),
        planner=PlannerConfig(
            sampling_steps=32,
            sampler='ddpm',
            look_first=False,
            score='mean_q',
            greedy_fallback=False,
        ),
    ),
}
"""'default' trains on two CPU cores and replans in real time; 'paper' is the appendix's table."""


def preset(name: str) -> Config:
    """Return a preset by name.

    Raises:
        ValueError: If there is none of that name.
    """
    if name not in PRESETS:
        msg = f'There is no preset named {name!r}; there are {", ".join(PRESETS)}.'
        raise ValueError(msg)
    return PRESETS[name]
