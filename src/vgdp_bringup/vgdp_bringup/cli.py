"""The command ``vgdp``. What a command needs is imported when it is used."""

from __future__ import annotations

import argparse
import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vgdp_experiments import commands
from vgdp_experiments.options import refuse

if TYPE_CHECKING:
    from collections.abc import Sequence


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        argv: The command line without the program's name; that of the process if None.

    Returns:
        The exit status.
    """
    parser = argparse.ArgumentParser(
        prog='vgdp', description='Plan with values and diffusion where nobody has a map.'
    )
    parser.add_argument('--version', action='version', version=version('vgdp_bringup'))
    groups = parser.add_subparsers(required=True, metavar='COMMAND')
    _add_info(groups)
    _add_demo(groups)
    _add_home_demo(groups)
    _add_bag(groups)
    _add_view(groups)
    _add_map(groups)
    commands.register(groups)
    args = parser.parse_args(argv)
    status: int = args.run(args)
    return status


BAG_COMMANDS = {
    'report': ('vgdp_bringup.report', 'write a page and JSON about one bag or many'),
    'replay': ('vgdp_bringup.replay', 'map or plan again and say where the outputs differ'),
    'recover': ('vgdp_bringup.recovery', 'make a readable bag of what a killed recorder left'),
}
"""What is done with bags: the module behind each command, and what it does."""


def _add_bag(groups: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    what = 'look at recorded runs'
    parser = groups.add_parser('bag', help=what, description=f'vgdp bag: {what}.')
    members = parser.add_subparsers(
        required=True, metavar='COMMAND', parser_class=commands.CommandParser
    )
    for name, (module, purpose) in BAG_COMMANDS.items():
        members.add_parser(
            name, module=module, help=purpose, description=f'vgdp bag {name}: {purpose}.'
        )


def _add_view(groups: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    what = 'see a run in the browser, live or from a bag'
    parser = groups.add_parser('view', help=what, description=f'vgdp view: {what}.')
    add = parser.add_argument
    add('bag', type=Path, nargs='?', metavar='BAG', help='folder of a bag (default: live topics)')
    add(
        '--namespace',
        default='',
        help='where the robot has its topics (default: where the bag has one, or /)',
    )
    add('--port', type=int, default=9090, metavar='N', help='of the page (default: %(default)s)')
    add(
        '--data-port',
        type=int,
        default=9877,
        metavar='N',
        help='from which the page gets what it shows (default: %(default)s)',
    )
    add('--no-open', action='store_true', help="don't open a browser")
    parser.set_defaults(run=_run_view)


def _run_view(args: argparse.Namespace) -> int:
    from vgdp_bringup.view import ViewOptions, run  # noqa: PLC0415 - loads matplotlib

    try:
        return run(
            ViewOptions(
                bag=args.bag,
                namespace=args.namespace,
                port=args.port,
                data_port=args.data_port,
                open_browser=not args.no_open,
            )
        )
    except (ValueError, OSError) as error:
        return refuse(error)


def _add_map(groups: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    what = 'make a floor plan and a point cloud of RGB-D images'
    parser = groups.add_parser(
        'map',
        help=what,
        description=f'vgdp map: {what}, offline as the node bev_mapper does it online.',
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add = parser.add_argument
    add(
        'source',
        type=Path,
        metavar='BAG|SCENE|SEQUENCE',
        help='folder of a bag, of a scene of the Active Vision Dataset, or of posed images',
    )
    add('-o', '--out', type=Path, required=True, metavar='FOLDER', help='where the files go')
    add(
        '--segmenter',
        default='geometric',
        metavar='NAME',
        help='what tells floor from obstacles: geometric, learned, dgcnn, swin3d, ground_truth',
    )
    add('--weights', type=Path, metavar='FILE', help='weights of the segmenter')
    add('--resolution', type=float, default=0.1, metavar='M', help='side of a cell')
    add(
        '--mode',
        default='evidence',
        choices=('evidence', 'majority'),
        help='add up what frames say about a cell, or count the points of the cloud',
    )
    add('--max-range', type=float, default=5.0, metavar='M', help='depth beyond it is left out')
    add('--voxel', type=float, default=0.04, metavar='M', help="side of the cloud's voxels")
    add('--width', type=int, default=0, metavar='PIXELS', help='of frames of scenes, 0 for all')
    add('--namespace', default='', help='where the robot has its topics in a bag')
    add(
        '--mount',
        type=float,
        nargs=6,
        metavar=('X', 'Y', 'Z', 'ROLL', 'PITCH', 'YAW'),
        help='where the camera is on the robot, for bags: metres and radians, as the parameters '
        'camera_x to camera_yaw of the node; from /tf_static if not given',
    )
    add(
        '--image-slop', type=float, default=0.0, metavar='S', help="the node's parameter, for bags"
    )
    add('--pose-slop', type=float, default=0.1, metavar='S', help="the node's parameter, for bags")
    parser.set_defaults(run=_run_map)


def _run_map(args: argparse.Namespace) -> int:
    from gridnav.rgbd import CameraMount  # noqa: PLC0415 - loads NumPy
    from vgdp_bringup.mapping import MapOptions, run  # noqa: PLC0415

    given = _given(args)
    given['mount'] = args.mount and CameraMount(*args.mount)
    try:
        return run(MapOptions(**given))
    except (ValueError, OSError) as error:
        return refuse(error)


def _add_info(groups: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    what = 'say what is installed here'
    parser = groups.add_parser('info', help=what, description=f'vgdp info: {what}.')
    parser.set_defaults(run=_run_info)


def _run_info(_: argparse.Namespace) -> int:
    from vgdp_bringup.info import report  # noqa: PLC0415 - loads PyTorch

    sys.stdout.write(f'{report()}\n')
    return 0


def _add_demo(groups: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    what = 'watch a robot find its way out of a maze'
    parser = _demo_parser(groups, 'demo', what)
    add = parser.add_argument
    add('--kind', default='maze', metavar='KIND', help='maze, loops, rooms, caves or obstacles')
    add('--size', type=int, default=15, metavar='N', help='side of the world in cells')
    add('--seed', type=int, default=3, metavar='N', help='seed of maze and planner')
    add('--view-range', type=int, default=2, metavar='N', help='cells seen to each side')
    _add_run_options(parser, rate=10.0, timeout=30.0, out=Path('out/demo'))
    parser.set_defaults(run=_run_demo)


def _run_demo(args: argparse.Namespace) -> int:
    from vgdp_bringup.demo import DemoOptions, run  # noqa: PLC0415 - loads ROS and matplotlib

    return run(DemoOptions(**_given(args)))


def _add_home_demo(groups: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    what = 'watch a robot with a camera find a bottle in a home'
    parser = _demo_parser(groups, 'demo-home', what)
    add = parser.add_argument
    add('--seed', type=int, default=0, metavar='N', help='which home, which start')
    add('--scene', type=Path, metavar='FOLDER', help='scene to use instead of a synthetic home')
    add('--segmenter', default='geometric', metavar='NAME', help='geometric or learned')
    add('--images', action='store_true', help='record images and points, too')
    add(
        '--homes',
        type=Path,
        default=Path('out/homes'),
        metavar='FOLDER',
        help='where the synthetic homes are, and are made',
    )
    _add_run_options(parser, rate=0.0, timeout=60.0, out=Path('out/demo-home'))
    parser.set_defaults(run=_run_home_demo)


def _run_home_demo(args: argparse.Namespace) -> int:
    from vgdp_bringup.home_demo import HomeDemoOptions, run  # noqa: PLC0415 - loads ROS

    return run(HomeDemoOptions(**_given(args)))


def _demo_parser(
    groups: argparse._SubParsersAction[argparse.ArgumentParser], name: str, what: str
) -> argparse.ArgumentParser:
    return groups.add_parser(
        name,
        help=what,
        description=f'vgdp {name}: {what}. The nodes run as processes of their own.',
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )


def _add_run_options(
    parser: argparse.ArgumentParser, *, rate: float, timeout: float, out: Path
) -> None:
    """Add what every demo can be told about its run, with its own defaults."""
    add = parser.add_argument
    add('--rate', type=float, default=rate, metavar='HZ', help='steps a second, 0 for no limit')
    add('--max-steps', type=int, default=500, metavar='N', help='steps until the end')
    add('--timeout', type=float, default=timeout, metavar='S', help='longest time without a step')
    add(
        '--out',
        type=Path,
        default=out,
        metavar='FOLDER',
        help='where the bag, the logs and the pictures go',
    )


def _given(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options by name."""
    return {name: value for name, value in vars(args).items() if name != 'run'}


if __name__ == '__main__':
    sys.exit(main())
