"""Options of commands whose settings depend on the preset unless they are given."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

from vgdp_experiments.options import add_settings
from vgdp_planner.config import preset

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping

T = TypeVar('T')


def add_preset_settings(parser: argparse.ArgumentParser, settings: Mapping[str, Any]) -> None:
    """Add an option for each field; what the help calls the default is that of 'default'.

    Args:
        parser: Gets the options.
        settings: A dataclass for each preset, which has a field `preset`.
    """
    kind = type(settings['default'])
    add_settings(parser, kind)
    parser.set_defaults(**{field.name: None for field in fields(kind)})


def read_preset_settings(arguments: argparse.Namespace, settings: Mapping[str, T]) -> T:
    """Return the settings of the preset asked for, with those that the options give.

    Raises:
        ValueError: If there is no such preset or a setting is out of range.
    """
    name = arguments.preset or 'default'
    preset(name)
    names = [field.name for field in fields(settings[name])]  # type: ignore[arg-type]
    given = {key: getattr(arguments, key) for key in names if getattr(arguments, key) is not None}
    return replace(settings[name], **given)  # type: ignore[type-var]


def require_positive(settings: object, names: tuple[str, ...]) -> None:
    """Refuse settings below 1.

    Raises:
        ValueError: With one sentence that names the setting.
    """
    for name in names:
        value = getattr(settings, name)
        if value < 1:
            msg = f'--{name.replace("_", "-")} must be at least 1, got {value}.'
            raise ValueError(msg)
