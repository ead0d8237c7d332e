"""Write src/vgdp_bringup/config/maze.yaml from the parameter tables of the nodes."""

from __future__ import annotations

from pathlib import Path

from bev_mapper.node import MapperParameters
from gridnav.ros.parameters import parameter_rows
from maze_sim.node import MazeSimParameters
from vgdp_planner.node import PlannerParameters

FILE = Path(__file__).parents[1] / 'src' / 'vgdp_bringup' / 'config' / 'maze.yaml'

TABLES = {
    'bev_mapper': MapperParameters,
    'maze_sim': MazeSimParameters,
    'vgdp_planner': PlannerParameters,
}

GIVEN_BY_ARGUMENTS = {
    'bev_mapper': {'width', 'height'},
    'maze_sim': {'size', 'view_range', 'seed', 'rate', 'max_steps'},
    'vgdp_planner': {'seed'},
}

HEADER = """\
# The parameters of the nodes with their defaults, for maze.launch.py params_file:=...
# Those that the launch file has arguments for are not here, as the arguments win.
# Written by scripts/write_config.py; change a copy.
"""


def render() -> str:
    """Return the text of the file."""
    lines = [HEADER]
    for node, table in TABLES.items():
        lines += [f'/**/{node}:', '  ros__parameters:']
        for row in parameter_rows(table):
            if row.name in GIVEN_BY_ARGUMENTS[node]:
                continue
            facts = [row.description, row.allowed or row.unit]
            if row.read_only:
                facts.append('fixed once the node runs')
            default = f'"{row.default}"' if row.type == 'str' else row.default
            lines += [f'    # {"; ".join(filter(None, facts))}', f'    {row.name}: {default}']
        lines.append('')
    return '\n'.join(lines)


if __name__ == '__main__':
    FILE.write_text(render(), encoding='utf-8')
