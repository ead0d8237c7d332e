"""Write the tables of README.md from the code: topics, parameters and results."""

from __future__ import annotations

import re
from pathlib import Path

from avd_player.node import AvdPlayerParameters
from bev_mapper.node import MapperParameters
from gridnav.ros import qos
from gridnav.ros.parameters import parameter_rows
from maze_sim.kinematic_node import KinematicParameters
from maze_sim.node import MazeSimParameters
from vgdp_bringup.node import RecorderParameters
from vgdp_bringup.topics import TOPICS
from vgdp_experiments.report import Report, markdown
from vgdp_planner.node import PlannerParameters
from vgdp_planner.waypoint_follower_node import FollowerParameters

ROOT = Path(__file__).parents[1]
FILE = ROOT / 'README.md'
RESULTS = ROOT / 'docs' / 'results'

NODES = {
    'maze_sim_node': MazeSimParameters,
    'avd_player_node': AvdPlayerParameters,
    'bev_mapper_node': MapperParameters,
    'planner_node': PlannerParameters,
    'waypoint_follower_node': FollowerParameters,
    'kinematic_node': KinematicParameters,
    'recorder_node': RecorderParameters,
}


def topics() -> str:
    """Return the table of topics."""
    lines = ['| topic | type | QoS | meaning |', '| --- | --- | --- | --- |']
    for topic in TOPICS:
        profile = getattr(qos, f'{topic.qos}_QOS')
        kept = ', transient local' if profile.durability.name == 'TRANSIENT_LOCAL' else ''
        described = f'{profile.reliability.name.lower().replace("_", " ")}{kept}, {profile.depth}'
        lines.append(f'| `{topic.name}` | {topic.type} | {described} | {topic.meaning} |')
    return '\n'.join(lines)


def parameters() -> str:
    """Return a table of parameters for each node."""
    parts = []
    for node, table in NODES.items():
        lines = [
            f'**`{node}`**',
            '',
            '| parameter | type | default | allowed | meaning |',
            '| --- | --- | --- | --- | --- |',
        ]
        for row in parameter_rows(table):
            fixed = ' (fixed once the node runs)' if row.read_only else ''
            default = f"`'{row.default}'`" if row.type == 'str' else f'`{row.default}`'
            lines.append(
                f'| `{row.name}` | {row.type} | {default} | {row.allowed or row.unit} | '
                f'{row.description}{fixed} |'
            )
        parts.append('\n'.join(lines))
    return '\n\n'.join(parts)


def results() -> str:
    """Return the results of the shipped weights, from the reports in docs/results."""
    paths = sorted(RESULTS.glob('gridmaze_*.json'))
    return '\n\n'.join(markdown(Report.load(path)) for path in paths)


def render(text: str) -> str:
    """Return the README's text with its tables brought up to date."""
    for name, make in (('topics', topics), ('parameters', parameters), ('results', results)):
        pattern = rf'(<!-- {name} -->\n).*?(<!-- end -->)'
        table = make()
        text = re.sub(
            pattern, lambda m, t=table: f'{m[1]}{t}\n{m[2]}', text, count=1, flags=re.DOTALL
        )
    return text


if __name__ == '__main__':
    FILE.write_text(render(FILE.read_text(encoding='utf-8')), encoding='utf-8')
