"""``tactile topic``: topics of the bus, with the commands, flags and output of ``ros2 topic``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from tactile_nodes.bus.names import absolute
from tactile_nodes.cli.completion import completers
from tactile_nodes.cli.running.session import Verbs, completed, full_type, is_hidden, joined, type_of_topic
from tactile_nodes.cli.topic import echo as topic_echo
from tactile_nodes.cli.topic import pub as topic_pub
from tactile_nodes.cli.topic import rate as topic_rate
from tactile_nodes.errors import BusError, MessageError

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import Endpoint, Graph

DESCRIPTION = 'List, print, measure and publish topics.'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = Verbs(parser)
    _add_list(verbs)
    topic_echo.add(verbs)
    topic_rate.add(verbs)
    _add_info(verbs)
    topic_pub.add(verbs)
    _add_find(verbs)
    _add_type(verbs)


def _add_list(verbs: Verbs) -> None:
    verb = verbs.add('list', list_topics, 'list the topics', '  tactile topic list -t\n  tactile topic list -v\n')
    verb.add_argument('-t', '--show-types', action='store_true', help='show the types too')
    verb.add_argument('-c', '--count-topics', '--count', action='store_true', help='only print how many there are')
    verb.add_argument('-a', '--include-hidden-topics', '--all', action='store_true', help='list hidden topics as well')
    verb.add_argument('-v', '--verbose', action='store_true', help='show publishers and subscribers')


def _add_info(verbs: Verbs) -> None:
    verb = verbs.add(
        'info',
        show_info,
        'show type, publishers and subscribers of a topic',
        '  tactile topic info /force_distribution -v\n',
    )
    completed(verb.add_argument('topic', help='a topic, /force_distribution for example'), completers.topics)
    verb.add_argument('-v', '--verbose', action='store_true', help='show each publisher and subscription')


def _add_find(verbs: Verbs) -> None:
    verb = verbs.add('find', find, 'list the topics of a type', '  tactile topic find sensor_msgs/msg/Image\n')
    completed(verb.add_argument('type', help='a message type, sensor_msgs/msg/Image'), completers.topic_types)
    verb.add_argument('-c', '--count-topics', '--count', action='store_true', help='only print how many there are')
    verb.add_argument('-a', '--include-hidden-topics', '--all', action='store_true', help='list hidden topics as well')


def _add_type(verbs: Verbs) -> None:
    verb = verbs.add('type', show_type, "print a topic's type", '  tactile topic type /wrench\n')
    completed(verb.add_argument('topic', help='a topic'), completers.topics)


def list_topics(arguments: argparse.Namespace) -> int:
    with joined() as bus:
        graph = bus.graph()
    topics = _visible(graph, arguments.include_hidden_topics)
    if arguments.count_topics:
        print(len(topics))
    elif arguments.verbose:
        print(_ends_of(topics, 'Published topics:', graph.publishers(), 'publisher'))
        print(_ends_of(topics, 'Subscribed topics:', graph.subscriptions(), 'subscriber'))
    else:
        for name, types in topics.items():
            print(f'{name} [{", ".join(types)}]' if arguments.show_types else name)
    return 0


def show_info(arguments: argparse.Namespace) -> int:
    topic = absolute(arguments.topic)
    with joined() as bus:
        graph = bus.graph()
    types = graph.topics().get(topic)
    if not types:
        raise BusError(f'there is no topic {topic}; see tactile topic list')
    publishers, subscriptions = graph.publishers(topic), graph.subscriptions(topic)
    print(f'Type: {types[0] if len(types) == 1 else types}\n')
    _print_ends('Publisher count', publishers, 'PUBLISHER', arguments.verbose)
    _print_ends('Subscription count', subscriptions, 'SUBSCRIPTION', arguments.verbose)
    return 0


def find(arguments: argparse.Namespace) -> int:
    with joined() as bus:
        topics = _visible(bus.graph(), arguments.include_hidden_topics)
    wanted = full_type(arguments.type)
    found = [name for name, types in topics.items() if wanted in types]
    for line in [len(found)] if arguments.count_topics else found:
        print(line)
    return 0


def show_type(arguments: argparse.Namespace) -> int:
    with joined() as bus:
        print(type_of_topic(bus.graph(), absolute(arguments.topic)))
    return 0


def _visible(graph: Graph, hidden_too: bool) -> dict[str, list[str]]:
    return {name: types for name, types in graph.topics().items() if hidden_too or not is_hidden(name)}


def _ends_of(topics: dict[str, list[str]], title: str, ends: list[Endpoint], kind: str) -> str:
    lines = [title]
    for name, types in topics.items():
        number = sum(end.name == name for end in ends)
        if number:
            lines.append(f' * {name} [{", ".join(types)}] {number} {kind}{"s" if number > 1 else ""}')
    return '\n'.join(lines) + '\n'


def _print_ends(title: str, ends: list[Endpoint], kind: str, verbose: bool) -> None:
    print(f'{title}: {len(ends)}' + ('\n' if verbose else ''))
    for end in ends if verbose else ():
        print(_end_text(end, kind) + '\n')


def _end_text(end: Endpoint, kind: str) -> str:
    from tactile_nodes import messages
    from tactile_nodes.bus.topics import default_qos

    namespace, _, name = end.node.rpartition('/')
    try:
        type_hash = messages.type_hash(end.type_name)
    except MessageError:  # of another package of a ROS 2 graph
        type_hash = 'not known here'
    qos = default_qos(end.name)
    latched = end.latched if kind == 'PUBLISHER' else qos.latched
    return '\n'.join(
        [
            f'Node name: {name}',
            f'Node namespace: {namespace or "/"}',
            f'Topic type: {end.type_name}',
            f'Topic type hash: {type_hash}',
            f'Endpoint type: {kind}',
            'QoS profile by the topic table:',
            f'  History (Depth): KEEP_LAST ({qos.depth})',
            f'  Durability: {"TRANSIENT_LOCAL" if latched else "VOLATILE"}',
        ]
    )
