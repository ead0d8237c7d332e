"""The table of topics against what the nodes really offer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from tests.ros_helpers import wait_for

from vgdp_bringup.node import message_class, qos_of
from vgdp_bringup.topics import TOPICS

if TYPE_CHECKING:
    from tests.ros_helpers import Probe, StartNode

NODES = ('maze_sim', 'bev_mapper', 'vgdp_planner')


def test_the_table_is_what_the_nodes_offer(
    probe: Probe, node_process: StartNode, namespace: str
) -> None:
    """Every topic of the table is offered with its type and QoS, and none is missing in it."""
    for name in NODES:
        node_process(f'{name}.node')
    # Cameras come with other worlds.
    known = [topic for topic in TOPICS if topic.qos != 'SENSOR']
    expected = {probe.node.resolve_topic_name(topic.name): topic for topic in known}

    def offered() -> dict[str, list[str]]:
        found: dict[str, list[str]] = {}
        for name in NODES:
            if name in probe.node.get_node_names():
                found |= dict(probe.node.get_publisher_names_and_types_by_node(name, namespace))
        return {key: types for key, types in found.items() if key in expected or namespace in key}

    wait_for(lambda: set(offered()) >= set(expected), timeout=60)
    assert offered() == {name: [topic.type] for name, topic in expected.items()}
    for name, topic in expected.items():
        for info in probe.node.get_publishers_info_by_topic(name):
            qos = qos_of(topic)
            assert info.qos_profile.reliability == qos.reliability, name
            assert info.qos_profile.durability == qos.durability, name


@pytest.mark.parametrize('topic', TOPICS, ids=lambda topic: topic.name)
def test_every_type_exists(topic: object) -> None:
    """The recorder can subscribe to it."""
    matching = [known for known in TOPICS if known is topic]
    assert message_class(matching[0]).__name__ == matching[0].type.rsplit('/', 1)[1]
