"""``tactile node``: list nodes, show what each offers, and whether it responds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from tactile_nodes.bus.names import absolute
from tactile_nodes.cli.completion import completers
from tactile_nodes.cli.running.session import Verbs, completed, is_hidden, joined, positive_float
from tactile_nodes.errors import BusError, ServiceError

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import Endpoint, Participant, ProcessBus

DESCRIPTION = 'List nodes, show what each offers and receives, and whether it responds.'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    verbs = Verbs(parser)
    verb = verbs.add('list', list_nodes, 'list the nodes', '  tactile node list\n')
    verb.add_argument('-a', '--all', action='store_true', help='list hidden nodes as well')
    verb.add_argument('-c', '--count-nodes', action='store_true', help='only print how many there are')
    verb = verbs.add('info', show_info, 'show topics and services of a node', '  tactile node info /camera\n')
    completed(verb.add_argument('node', help='a node, /camera for example'), completers.nodes)
    verb.add_argument('--include-hidden', action='store_true', help='show hidden topics and services as well')
    verb.add_argument(
        '--timeout', type=positive_float, default=1.0, metavar='S', help='wait S seconds for its response'
    )


def list_nodes(arguments: argparse.Namespace) -> int:
    with joined() as bus:
        found = bus.graph().nodes()
    shown = [name for name in found if arguments.all or not is_hidden(name)]
    if arguments.count_nodes:
        print(len(shown))
        return 0
    if len(set(shown)) < len(shown):
        print('WARNING: several nodes share a name; give each its own with -r __node:=NAME', file=sys.stderr)
    for name in shown:
        print(name)
    return 0


def show_info(arguments: argparse.Namespace) -> int:
    node = absolute(arguments.node, 'a node')
    with joined() as bus:
        owners = [peer for peer in bus.graph().participants if node in peer.nodes]
        if not owners:
            raise BusError(f'there is no node {node}; see tactile node list')
        if len(owners) > 1:
            print(f'WARNING: {len(owners)} processes have a node {node}; all of them are shown', file=sys.stderr)
        for owner in owners:
            print(_info_text(node, owner, arguments.include_hidden))
            print(f'  Answers: {_answer(bus, node, owner, arguments.timeout)}')
    return 0


def _info_text(node: str, owner: Participant, hidden_too: bool) -> str:
    lines = [node]
    for title, ends in (
        ('Subscribers', owner.subscriptions),
        ('Publishers', owner.publishers),
        ('Service Servers', owner.services),
    ):
        lines += [f'  {title}:', *_lines(ends, node, hidden_too)]
    if owner.pid:  # ROS 2 does not report it
        lines.append(f'  Process: {owner.pid} on {owner.host}')
    return '\n'.join(lines)


def _lines(ends: Sequence[Endpoint], node: str, hidden_too: bool) -> list[str]:
    mine = [end for end in ends if end.node == node and (hidden_too or not is_hidden(end.name))]
    return [f'    {end.name}: {end.type_name}' for end in sorted(mine, key=lambda end: end.name)]


def _answer(bus: ProcessBus, node: str, owner: Participant, timeout_s: float) -> str:
    from tactile_nodes.messages import types
    from tactile_nodes.messages.services import LIST_PARAMETERS

    took_s = bus.ping(owner.uid, timeout_s)
    if took_s is None:
        return f'no; its process exists, but did not respond within {timeout_s:g} s'
    process = f'its process in {took_s * 1000:.1f} ms'
    if not any(end.name == f'{node}/list_parameters' for end in owner.services):
        return process
    try:  # its process answers pings even if the node's own thread is blocked
        bus.call(f'{node}/list_parameters', LIST_PARAMETERS, types.ListParameters_Request(), timeout_s)
    except ServiceError:
        return f'{process}, but the node itself did not respond within {timeout_s:g} s: it is busy or stuck'
    return f'{process}, and the node itself'
