"""Configurations refuse what does not fit and survive JSON."""

from __future__ import annotations

import json
from typing import Any

import pytest

from vgdp_planner import PRESETS, Config, PlannerConfig, PolicyConfig, ValueConfig, preset


@pytest.mark.parametrize('name', list(PRESETS))
def test_round_trip_through_json(name: str) -> None:
    """A preset comes back from JSON as it was."""
    config = preset(name)
    assert Config.from_dict(json.loads(json.dumps(config.to_dict()))) == config


@pytest.mark.parametrize(
    ('kind', 'values', 'named'),
    [
        (PolicyConfig, {'denoiser': 'unet', 'horizon': 7}, '7'),
        (PolicyConfig, {'channels': (30, 64)}, '30'),
        (PolicyConfig, {'denoiser': 'magic'}, 'magic'),
        (PolicyConfig, {'width': 0}, '0'),
        (PolicyConfig, {'blocks': 0}, '0'),
        (PolicyConfig, {'kernel': 4}, '4'),
        (PolicyConfig, {'time_embedding': 3}, '3'),
        (ValueConfig, {'gamma': 0.0}, '0.0'),
        (ValueConfig, {'rounds': 0}, '0'),
        (ValueConfig, {'tolerance': -1.0}, '-1.0'),
        (PlannerConfig, {'candidates': -1}, '-1'),
        (PlannerConfig, {'selection': 'luck'}, 'luck'),
        (PlannerConfig, {'guidance': -0.1}, '-0.1'),
        (PlannerConfig, {'tolerated_loss': -1.0}, '-1.0'),
        (PlannerConfig, {'execute': 0}, '0'),
        (PlannerConfig, {'collision_tolerance': 1.0}, '1.0'),
    ],
)
def test_bad_values_are_named(kind: Any, values: dict[str, Any], named: str) -> None:  # noqa: ANN401
    """A value out of range is refused by a sentence that names it."""
    with pytest.raises(ValueError, match=named):
        kind(**values)


def test_parts_must_fit_together() -> None:
    """More executed steps than planned ones are refused, so are too many sampling steps."""
    with pytest.raises(ValueError, match='executes 9'):
        Config(planner=PlannerConfig(execute=9))
    with pytest.raises(ValueError, match='got 33'):
        Config(planner=PlannerConfig(sampling_steps=33))


def test_unknown_names_are_refused() -> None:
    """Unknown presets, parts and fields are errors."""
    with pytest.raises(ValueError, match='nonsense'):
        preset('nonsense')
    with pytest.raises(ValueError, match='nonsense'):
        Config.from_dict({'nonsense': {}})
    with pytest.raises(ValueError, match='nonsense'):
        Config.from_dict({'policy': {'nonsense': 1}})
