"""Settings of the planner from the command line."""

from __future__ import annotations

import argparse

import pytest

from vgdp_experiments.methods.registry import ABLATION, PLANNERS, VARIANTS
from vgdp_experiments.planner_options import add_planner_arguments, load_planner


def options(*arguments: str) -> argparse.Namespace:
    """Read options as a command does."""
    parser = argparse.ArgumentParser()
    add_planner_arguments(parser)
    return parser.parse_args(arguments)


def test_settings_come_before_those_of_the_weights() -> None:
    """--set gives values of the right types; those of the method come before them."""
    args = options('--set', 'candidates=8', 'memory=false', 'agreement=0.5', 'score=mean_q')
    settings = load_planner(args, {'candidates': 2}).config.planner
    assert (settings.candidates, settings.memory) == (2, False)
    assert (settings.agreement, settings.score) == (0.5, 'mean_q')
    assert load_planner(options()).config.planner.memory


@pytest.mark.parametrize(
    ('setting', 'reason'),
    [
        ('candidates=many', "candidates must be a whole number, got 'many'"),
        ('candidates', "candidates must be a whole number, got ''"),
        ('guidance=far', "guidance must be a number, got 'far'"),
        ('memory=maybe', "memory must be true or false, got 'maybe'"),
        ('luck=1', "the planner has no setting 'luck'; there are candidates,"),
    ],
)
def test_wrong_settings_are_named(
    setting: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A setting that can't be read ends the command with status 2 and says why."""
    with pytest.raises(SystemExit) as stop:
        options('--set', setting)
    assert stop.value.code == 2
    assert reason in capsys.readouterr().err


def test_settings_out_of_range_are_named() -> None:
    """What can be read but is out of range is refused, too."""
    with pytest.raises(ValueError, match="got 'luck'"):
        load_planner(options('--set', 'selection=luck'))


@pytest.mark.parametrize('name', VARIANTS)
def test_variants_are_settings_of_one_planner(name: str) -> None:
    """Each variant is made from the options, and differs in what it is said to differ in."""
    method = PLANNERS[name](options('--set', 'sampling_steps=3'))
    planner = method.settings['planner']
    assert planner['sampling_steps'] == 3
    assert {setting: planner[setting] for setting in VARIANTS[name]} == VARIANTS[name]


def test_the_ablation_is_in_the_registry() -> None:
    """The paper's rows are variants."""
    assert set(ABLATION) <= set(VARIANTS)
