"""A search of a scene: in one process, and over DDS with the same steps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import UInt8
from tests.avd_player.tiny_scene import write_scene
from tests.ros_helpers import wait_for

from avd_player.scene import Scene
from avd_player.simulation import ActiveVisionSimulation, SearchRules
from gridnav import DONE
from gridnav.metrics import Outcome
from gridnav.ros.qos import EPISODE_QOS, RELIABLE_QOS
from vgdp_bringup.bags import only_namespace
from vgdp_bringup.home_demo import RECORDED, mapper_parameters, planner_parameters
from vgdp_bringup.replay import replay_plan
from vgdp_experiments.search.loop import SearchStep, search
from vgdp_experiments.search.searchers import FrontierSearcher, PlannerSearcher, Searcher
from vgdp_planner import ValueGuidedPlanner

if TYPE_CHECKING:
    from pathlib import Path

    from tests.ros_helpers import Probe, StartNode

# A strip through the room, from one end of it to the bottle.
CELLS = [(col, row) for row in (1, 2) for col in range(-5, 4)]
RULES = SearchRules(min_expert_steps=2, reach=1.0, max_range=1.8, max_steps=30)


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a scene with few positions."""
    return write_scene(tmp_path_factory.mktemp('home') / 'Home_001_1', cells=CELLS).folder


def searched(
    folder: Path, searcher: Searcher, max_steps: int = RULES.max_steps
) -> tuple[Outcome, list[int], list[SearchStep]]:
    """Search in this process; returns the outcome, the actions and what was planned on."""
    simulation = ActiveVisionSimulation(Scene.open(folder), replace(RULES, max_steps=max_steps))
    steps: list[SearchStep] = []
    result = search(simulation, searcher, 3, start=0, on_step=steps.append)
    return result.outcome, [action for step in steps for action in step.committed], steps


@pytest.mark.filterwarnings('ignore:Home_001_1')
def test_a_search_in_one_process(folder: Path) -> None:
    """Frontier exploration finds the bottle; the goal is on no map before it was seen."""
    outcome, actions, steps = searched(folder, FrontierSearcher(), max_steps=300)
    assert outcome is Outcome.SUCCESS
    assert actions[-1] == DONE
    assert steps[0].observation.grid.goal == 'none'
    assert steps[-1].observation.grid.goal == 'ok'


@pytest.mark.filterwarnings('ignore:Home_001_1')
def test_same_actions_over_dds(
    node_process: StartNode, probe: Probe, folder: Path, tmp_path: Path
) -> None:
    """Player, mapper and planner as processes take the steps of one process; so does the bag."""
    outcome, expected, _ = searched(folder, PlannerSearcher(ValueGuidedPlanner.from_pretrained()))
    actions = probe.record(UInt8, 'action', RELIABLE_QOS)
    episode = probe.record(DiagnosticStatus, 'episode', EPISODE_QOS)
    bag = tmp_path / 'bag'
    recorder = node_process('vgdp_bringup.node', {'bag': bag, 'topics': f"'{RECORDED}'"})
    recorder.wait_output('Recording')
    node_process('bev_mapper.node', mapper_parameters(folder, 'geometric'))
    planner = node_process('vgdp_planner.node', planner_parameters(3))
    planner.wait_output('Planning')
    node_process(
        'avd_player.node',
        {
            'source': str(folder),
            'mode': 'closed_loop',
            'width': 0,
            'seed': 3,
            'start_position': 0,
            'reach': RULES.reach,
            'max_range': RULES.max_range,
            'min_expert_steps': RULES.min_expert_steps,
            'max_steps': RULES.max_steps,
        },
    )
    wait_for(lambda: any(status.message == outcome for status in episode), 90)
    wait_for(lambda: len(actions) == len(expected))
    assert [message.data for message in actions] == expected
    recorder.end()
    comparison = replay_plan(bag, only_namespace(bag))
    assert comparison.compared > 3
    assert comparison.differences == []
