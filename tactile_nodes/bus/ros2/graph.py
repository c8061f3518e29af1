"""Who is there, as rclpy knows it, in the words of the other buses."""

from __future__ import annotations

import threading
from typing import Any

from tactile_nodes.bus.protocol import Endpoint, Graph, Participant
from tactile_nodes.bus.ros2.qos import is_latched
from tactile_nodes.clock import monotonic_s

_LOOK_EVERY_S = 0.05
_QUIET_S = 1.0
_ALONE_S = 4.0
LONGEST_S = 8.0


def read_graph(looker: Any) -> Graph:
    """The graph that the rclpy node `looker` sees. ROS 2 knows nodes, not processes, so each is a participant."""
    nodes = sorted(_full(name, namespace) for name, namespace in looker.get_node_names_and_namespaces())
    found = {name: Participant(name, 0, '', (name,)) for name in nodes}
    publishers, subscriptions = _topic_ends(looker)
    services = _service_ends(looker)
    participants = [
        Participant(
            name,
            0,
            '',
            (name,) * nodes.count(name),
            *(_of(name, ends) for ends in (publishers, subscriptions, services)),
        )
        for name in found
    ]
    return Graph(tuple(participants))


def wait_until_settled(looker: Any, opened_s: float, longest_s: float) -> None:
    """Wait until the graph as the node `looker` sees it, since `opened_s`, is likely to be the whole.

    It comes in steps: of 12 nodes Cyclone DDS had shown all within 0.21 s, Fast DDS the first after 0.2 to 2.6 s and
    all within another 0.9 s. So it has to stay as it is for a second, and for four while it shows this node alone;
    after `longest_s` it is taken as it is.
    """
    own, last_shown, changed_s = looker.get_fully_qualified_name(), set[Any](), opened_s
    while (now_s := monotonic_s()) < opened_s + longest_s:
        nodes = {_full(*each) for each in looker.get_node_names_and_namespaces()}
        ends = [*looker.get_topic_names_and_types(), *looker.get_service_names_and_types()]
        shown = {*nodes, *((name, *types) for name, types in ends)}
        if shown != last_shown:
            last_shown, changed_s = shown, now_s
        if now_s - changed_s >= (_QUIET_S if nodes - {own} else _ALONE_S):
            return
        threading.Event().wait(_LOOK_EVERY_S)


def _topic_ends(looker: Any) -> tuple[list[Endpoint], list[Endpoint]]:
    publishers: list[Endpoint] = []
    subscriptions: list[Endpoint] = []
    for topic, _ in looker.get_topic_names_and_types():
        publishers += [_endpoint(topic, info) for info in looker.get_publishers_info_by_topic(topic)]
        subscriptions += [_endpoint(topic, info) for info in looker.get_subscriptions_info_by_topic(topic)]
    return publishers, subscriptions


def _service_ends(looker: Any) -> list[Endpoint]:
    found = []
    for name, namespace in set(looker.get_node_names_and_namespaces()):
        try:
            offered = looker.get_service_names_and_types_by_node(name, namespace)
        except RuntimeError:  # NodeNameNonExistentError: it has gone since
            continue
        found += [Endpoint(service, kinds[0], _full(name, namespace)) for service, kinds in offered if kinds]
    return found


def _endpoint(topic: str, info: Any) -> Endpoint:
    node = _full(info.node_name, info.node_namespace)
    return Endpoint(topic, info.topic_type, node, is_latched(info.qos_profile))


def _of(node: str, ends: list[Endpoint]) -> tuple[Endpoint, ...]:
    return tuple(end for end in ends if end.node == node)


def _full(name: str, namespace: str) -> str:
    return f'{namespace.rstrip("/")}/{name}'
