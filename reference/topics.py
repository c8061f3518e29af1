"""The parts of the documentation from the topic table, the nodes and ``msg/``."""

from __future__ import annotations

from reference.nodes import ends_of, ends_of_every_node, node_kinds
from reference.pages import code, table
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.topics import TOPICS, Topic
from tactile_nodes.paths import share_directory

NOTHING = '–'


def topics() -> str:
    """Every topic of the table."""
    head = ['topic', 'type', 'description', 'unit, sign, content', 'frame', 'Hz', 'kept']
    return table(head, [_row(topic) for topic in TOPICS.values()])


def ends() -> str:
    """The publishers and subscribers of each topic."""
    every, found = ends_of_every_node(), {node.module: ends_of(node.kind) for node in node_kinds()}
    rows = [
        [
            code(name),
            _nodes([node for node, ends in found.items() if name in ends.publishes], name in every.publishes),
            _nodes([node for node, ends in found.items() if name in ends.receives], name in every.receives),
        ]
        for name in TOPICS
    ]
    return table(['topic', 'published by', 'received by'], rows)


def services() -> str:
    """The services of each node, and those that every node has."""
    rows = [
        [code(f'/{node.kind.NAME}/{service.removeprefix("~/")}'), code(node.program)]
        for node in node_kinds()
        for service in ends_of(node.kind).services
    ]
    rows += [[code(service), 'every node'] for service in ends_of_every_node().services]
    return table(['service', 'of'], rows)


def messages() -> str:
    """The definitions of our own message types."""
    files = sorted((share_directory() / 'msg').glob('*.msg'))
    return '\n\n'.join(
        f'### tactile_nodes/{file.stem}\n\n```msg\n{file.read_text(encoding="utf-8").strip()}\n```' for file in files
    )


def kept(qos: Qos) -> str:
    """The queue for a slow subscriber, and whether late subscribers get the last message."""
    words = f'newest {qos.depth}' if qos.keep == 'latest' else f'queue of {qos.depth}'
    return f'{words}, latched' if qos.latched else words


def _row(topic: Topic) -> list[str]:
    return [
        code(topic.name),
        topic.type_name.replace('/msg/', '/'),
        topic.description,
        topic.holds or NOTHING,
        topic.frame if ' ' in topic.frame else code(topic.frame) or NOTHING,
        f'{topic.rate_hz:g}' if topic.rate_hz else NOTHING,
        kept(topic.qos) if topic.recorded else f'{kept(topic.qos)}, not in bags',
    ]


def _nodes(names: list[str], all_of_them: bool) -> str:
    return ', '.join([*(['every node'] if all_of_them else []), *map(code, names)]) or NOTHING
