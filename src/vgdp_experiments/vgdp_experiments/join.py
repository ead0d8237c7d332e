"""Joins a trained value function and a trained policy into the weights of one planner."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from vgdp_experiments.report import Report, markdown
from vgdp_experiments.train_value import chosen_worlds
from vgdp_planner.config import Config, preset
from vgdp_planner.weights import load_weights, read_record, save_weights

if TYPE_CHECKING:
    import argparse

CARD = """\
# Weights of the `{preset}` preset

A diffusion policy, a value function and a belief filter for grids of any size. Made for
`vgdp_planner.ValueGuidedPlanner.from_pretrained()`. They see the partial map and the belief,
nothing else.

{trained_on}
Neither was trained on maps of real places.

`model.safetensors` holds the tensors, `config.json` the configuration and the training settings.

## How they were made

```
{commands}
```

Everything random comes from the seeds in these commands; `make setup` installs the versions they
ran with. Losses at the end: {losses}.

## Scores

{scores}
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument('--value', type=Path, default=Path('runs/value'), help='trained value')
    parser.add_argument('--policy', type=Path, default=Path('runs/policy'), help='trained policy')
    parser.add_argument('--out', type=Path, required=True, help='folder to write')
    parser.add_argument('--results', type=Path, help='JSON of `vgdp eval gridmaze` for the card')


def run(arguments: argparse.Namespace) -> int:
    """Write the joined weights and their model card; returns the exit code.

    Raises:
        ValueError: If the parts are of two presets, with one sentence that says so.
    """
    value_config, value_tensors = load_weights(arguments.value)
    policy_config, policy_tensors = load_weights(arguments.policy)
    training = read_record(arguments.value)['training'] | read_record(arguments.policy)['training']
    name = training['policy']['preset']
    if value_config.value.unseen != preset(name).value.unseen:
        msg = (
            f'{arguments.policy} holds a policy of the preset {name!r} and {arguments.value} a '
            'value function of another.'
        )
        raise ValueError(msg)
    config = Config(policy_config.policy, value_config.value, preset(name).planner)
    save_weights(arguments.out, config, value_tensors | policy_tensors, training)
    card = CARD.format(
        preset=name,
        trained_on=trained_on(
            name, training['policy']['demonstrations'], training['value'].get('worlds', '')
        ),
        commands='\n'.join(commands(training, arguments)),
        losses=', '.join(
            f'{name} {value:.4g}'
            for part in ('value', 'policy')
            for name, value in training[part]['losses'].items()
        ),
        scores=markdown(Report.load(arguments.results)) if arguments.results else 'Not evaluated.',
    )
    (arguments.out / 'README.md').write_text(card, encoding='utf-8')
    print(f'Weights written to {arguments.out}.')  # noqa: T201
    return 0


def trained_on(name: str, demonstrations: dict[str, Any], worlds_of_value: str = '') -> str:
    """Return the worlds that a preset is trained on, in a sentence or two."""
    size, view_range = demonstrations.get('size'), demonstrations.get('view_range')
    seen = f'view range {view_range}' if view_range else 'view ranges 1 to 3'
    if name == 'paper':
        return f'Trained on Wilson mazes of {size} x {size} with {seen}.'
    worlds = chosen_worlds(worlds_of_value)
    kinds = list(dict.fromkeys(world.kind for world in worlds))
    sizes = [world.size for world in worlds]
    ranges = [world.view_range for world in worlds]
    return (
        f'The value function was trained on worlds of {min(sizes)} to {max(sizes)} cells a side '
        f'with\nview ranges {min(ranges)} to {max(ranges)} ({", ".join(kinds)}), the policy\non '
        f'such worlds of {size} x {size} with {seen}.'
    )


def command(words: str, settings: dict[str, Any]) -> str:
    """Return a command with all the settings that a record holds."""
    options = ' '.join(
        f'--{name.replace("_", "-")} {value}'
        for name, value in settings.items()
        if name not in ('losses', 'demonstrations') and value != ''
    )
    return f'vgdp {words} {options}'


def commands(training: dict[str, Any], arguments: argparse.Namespace) -> list[str]:
    """Return the commands that trained the weights, with all their settings."""
    words = 'train value-paper' if training['policy']['preset'] == 'paper' else 'train value'
    return [
        command(words, training['value']),
        command('data expert', training['policy']['demonstrations']),
        command('train policy', training['policy']),
        (
            f'vgdp train join --value {arguments.value} --policy {arguments.policy} '
            f'--out {arguments.out}'
        ),
    ]
