"""The parts of the ``vgdp`` command that experiments need."""

from __future__ import annotations

import argparse
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from vgdp_experiments.options import refuse

if TYPE_CHECKING:
    from collections.abc import Callable

GROUPS: dict[str, tuple[str, dict[str, tuple[str, str]]]] = {
    'data': (
        'make training data',
        {
            'expert': ('vgdp_experiments.data', 'expert episodes in mazes'),
            'homes-expert': (
                'vgdp_experiments.search.learned.demonstrations',
                'searches of homes, with what an expert would do',
            ),
            'homes-views': (
                'vgdp_experiments.home_views',
                'views of synthetic homes with the classes of their pixels',
            ),
        },
    ),
    'train': (
        'train the networks',
        {
            'policy': ('vgdp_experiments.train_policy', 'the diffusion policy'),
            'value': ('vgdp_experiments.train_value', 'the value function'),
            'value-paper': (
                'vgdp_experiments.train_value_paper',
                "the paper's value function",
            ),
            'calvin': ('vgdp_experiments.train_calvin', 'CALVIN, to compare the planner with'),
            'segmentation': (
                'vgdp_experiments.train_segmentation',
                'the segmentation of RGB-D frames',
            ),
            'search-object': (
                'vgdp_experiments.search.learned.train_object',
                'what the unseen is worth in a search, by what stands in view',
            ),
            'search-rgbd': (
                'vgdp_experiments.search.learned.train_rgbd',
                'the planner that reads the images of a search, too',
            ),
            'search-calvin-2d': (
                'vgdp_experiments.search.learned.train_calvin_2d',
                'CALVIN on the maps of a search',
            ),
            'search-no-projector': (
                'vgdp_experiments.search.learned.train_no_projector',
                'the planner on a learned lattice',
            ),
            'search-calvin-3d': (
                'vgdp_experiments.search.learned.train_calvin_3d',
                'CALVIN on a learned lattice, with headings',
            ),
            'join': ('vgdp_experiments.join', 'join both into the weights of a planner'),
        },
    ),
    'eval': (
        'evaluate methods',
        {
            'gridmaze': ('vgdp_experiments.evaluate', 'on mazes, all methods on the same'),
            'table': ('vgdp_experiments.suites.table', "the mazes of the paper's table"),
            'ablation': ('vgdp_experiments.suites.ablation', 'what each part of the planner adds'),
            'worlds': ('vgdp_experiments.suites.worlds', 'rooms, caves and other worlds'),
            'generators': (
                'vgdp_experiments.suites.generators',
                'mazes and obstacles that nothing is trained on',
            ),
            'avd': ('vgdp_experiments.suites.avd', 'searching a bottle in homes'),
            'curves': ('vgdp_experiments.suites.curves', 'quality against sampling'),
            'belief': ('vgdp_experiments.suites.belief', 'slipping steps and noisy poses'),
            'localisation': (
                'vgdp_experiments.suites.localisation',
                'how fast the belief filter finds the robot',
            ),
            'exploration': (
                'vgdp_experiments.suites.exploration',
                'values of the unseen, over all goals that a world may have',
            ),
            'looks': (
                'vgdp_experiments.search.learned.evaluate_looks',
                'what values of the unseen make of the same choices in homes',
            ),
            'segmentation': (
                'vgdp_experiments.evaluate_segmentation',
                'the segmentation of RGB-D frames, on homes that it has not seen',
            ),
            'mapping': (
                'vgdp_experiments.evaluate_mapping',
                'maps that RGB-D frames make of synthetic homes, against the true plans',
            ),
            'merge': ('vgdp_experiments.merge', 'join the parts of one of these into a page'),
        },
    ),
    'avd': (
        'scenes of the Active Vision Dataset',
        {
            'check': ('avd_player.check', 'say what is present, missing or broken in them'),
            'synth': ('avd_player.homes.synth', 'write synthetic homes as such scenes'),
        },
    ),
    'bench': (
        'measure speed',
        {
            'planner': ('vgdp_experiments.bench_planner', 'of a decision, by the size of the map'),
            'mapper': ('vgdp_experiments.bench_mapper', 'of mapping RGB-D frames, beside open3d'),
            'sim': ('maze_sim.benchmark', 'of drawing mazes and stepping in them'),
        },
    ),
}
"""What each group and each command in it does, and the module behind the command.

Such a module has `add_arguments(parser) -> None` and `run(args) -> int`. A program of another
package, with a `main(argv) -> int` instead, is handed the rest of the command line.
"""


class CommandParser(argparse.ArgumentParser):
    """Parser of a command whose module is imported only when the command is used."""

    def __init__(self, *, module: str, **settings: Any) -> None:  # noqa: ANN401 - argparse's own
        """Take the module's name and what `argparse.ArgumentParser` takes."""
        super().__init__(**settings)
        self._module = module
        self._complete = False

    def parse_known_args(  # type: ignore[override]
        self,
        args: Any = None,  # noqa: ANN401 - argparse's own
        namespace: Any = None,  # noqa: ANN401
    ) -> tuple[argparse.Namespace, list[str]]:
        """Import the module and parse with its options."""
        module = import_module(self._module)
        if not hasattr(module, 'add_arguments'):
            return argparse.Namespace(run=lambda _args: module.main(args)), []
        if not self._complete:
            module.add_arguments(self)
            self.set_defaults(run=partial(_run, module.run))
            self._complete = True
        parsed: tuple[argparse.Namespace, list[str]] = super().parse_known_args(args, namespace)
        return parsed


def _run(run: Callable[[argparse.Namespace], int], args: argparse.Namespace) -> int:
    """Run a command; what it can't use is said in one sentence."""
    try:
        return run(args)
    except (ValueError, OSError) as error:
        return refuse(error)


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands to a parser; its arguments then hold `run`, to be called with them."""
    for group, (purpose, commands) in GROUPS.items():
        group_parser = subparsers.add_parser(group, help=purpose, description=purpose)
        members = group_parser.add_subparsers(
            dest=f'{group}_command', required=True, parser_class=CommandParser
        )
        for name, (module, what) in commands.items():
            members.add_parser(name, module=module, help=what, description=f'{purpose}: {what}')
