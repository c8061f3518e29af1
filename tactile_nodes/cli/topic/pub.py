"""``tactile topic pub``: publish messages from the command line."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from tactile_nodes.bus.names import absolute
from tactile_nodes.cli.completion import completers
from tactile_nodes.cli.running.session import (
    Verbs,
    compare_types,
    completed,
    count,
    duration,
    full_type,
    joined,
    own_name,
    positive_float,
    positive_int,
    read_values,
)
from tactile_nodes.errors import BusError

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import ProcessBus, Publisher
    from tactile_nodes.clock import Clock

NS_PER_S = 1_000_000_000
_LOOK_EVERY_S = 0.02
_SAY_EVERY = 50  # polls: once a second

_EXAMPLES = """\
  tactile topic pub -1 /greeting std_msgs/msg/String "{data: hello}"
  tactile topic pub -r 10 /wrench geometry_msgs/msg/WrenchStamped "{header: auto, wrench: {force: {z: 0.5}}}"
  tactile topic pub -t 3 -w 2 /greeting std_msgs/String "{data: 'for two subscribers'}"

`header: auto` and `stamp: now` are replaced by the time of each publication.
"""


def add(verbs: Verbs) -> None:
    verb = verbs.add('pub', publish, 'publish messages', _EXAMPLES)
    completed(verb.add_argument('topic', help='a topic, /greeting for example'), completers.topics)
    completed(verb.add_argument('type', help='its type, std_msgs/msg/String for example'), completers.topic_types)
    verb.add_argument(
        'values',
        nargs='?',
        default='{}',
        help="its fields as YAML; others have ROS 2's defaults: zero, and no rotation",
    )
    verb.add_argument(
        '-r', '--rate', type=positive_float, default=1.0, metavar='HZ', help='publishing rate (default: 1)'
    )
    verb.add_argument('-p', '--print', type=count, default=1, metavar='N', help='print every Nth message (default: 1)')
    often = verb.add_mutually_exclusive_group()
    often.add_argument('-1', '--once', action='store_true', help='publish one message and exit')
    often.add_argument('-t', '--times', type=positive_int, metavar='N', help='publish N messages and exit')
    verb.add_argument(
        '-w',
        '--wait-matching-subscriptions',
        type=count,
        metavar='N',
        help='first wait for N subscribing processes (default: 1 with --once or --times, else 0)',
    )
    verb.add_argument('--max-wait-time-secs', type=positive_float, metavar='S', help='wait S seconds at most')
    verb.add_argument(
        '--keep-alive', type=duration, default=0.1, metavar='S', help='stay S seconds after the last message (0.1)'
    )
    verb.add_argument('-n', '--node-name', metavar='NAME', help='the name of the publishing node')


def publish(arguments: argparse.Namespace) -> int:
    from tactile_nodes.bus.topics import default_qos

    topic, type_name = absolute(arguments.topic), full_type(arguments.type)
    values = read_values(arguments.values)
    node = absolute(arguments.node_name, 'a node') if arguments.node_name else own_name()
    with joined() as bus:
        make_message(type_name, values, bus.clock)  # report wrong fields before waiting for subscribers
        publisher = bus.advertise(topic, type_name, default_qos(topic), node)
        if arguments.node_name:
            bus.add_node(node)
        wanted = arguments.wait_matching_subscriptions
        if wanted is None:
            wanted = int(bool(arguments.once or arguments.times))
        if wanted:
            compare_types(bus.graph().subscriptions(topic), type_name)
            _wait_for_listeners(publisher, bus.clock, wanted, arguments.max_wait_time_secs)
        print('publisher: beginning loop', flush=True)
        _publish_all(bus, publisher, values, arguments)
    return 0


def make_message(type_name: str, values: dict[str, Any], clock: Clock) -> Any:
    """The message with these fields, its stamps filled in.

    Raises:
        MessageError: no such type or field, or a value that does not fit.
    """
    from tactile_nodes import messages

    now_ns = clock.now_ns()
    now = {'sec': now_ns // NS_PER_S, 'nanosec': now_ns % NS_PER_S}
    return messages.from_dict(type_name, _stamped(values, now))


def _stamped(value: Any, now: dict[str, int]) -> Any:
    if isinstance(value, list):
        return [_stamped(each, now) for each in value]
    if not isinstance(value, dict):
        return value
    words = {('header', 'auto'): {'stamp': now}, ('stamp', 'now'): now}
    return {name: words.get((name, str(part))) or _stamped(part, now) for name, part in value.items()}


def _wait_for_listeners(publisher: Publisher, clock: Clock, wanted: int, longest_s: float | None) -> None:
    start_ns = clock.now_ns()
    looks = 0
    while (found := publisher.listeners) < wanted:
        if longest_s is not None and clock.now_ns() - start_ns > longest_s * NS_PER_S:
            raise BusError(
                f'nothing was published: {found} of {wanted} subscribers appeared within {longest_s:g} s; '
                'use -w 0 to publish without waiting'
            )
        looks += 1
        if looks % _SAY_EVERY == 0:
            print(f'Waiting for at least {wanted} matching subscription(s)...', flush=True)
        _pause(clock, _LOOK_EVERY_S)


def _publish_all(bus: ProcessBus, publisher: Publisher, values: dict[str, Any], arguments: argparse.Namespace) -> None:
    from tactile_nodes.cli.running.text import to_python

    times = 1 if arguments.once else arguments.times
    next_ns = bus.clock.now_ns()
    number = 0
    while times is None or number < times:
        bus.clock.sleep_until(next_ns)
        number += 1
        message = make_message(publisher.type_name, values, bus.clock)
        if arguments.print and number % arguments.print == 0:
            print(f'publishing #{number}: {to_python(message)}\n', flush=True)
        publisher.publish(message)
        next_ns = max(next_ns + round(NS_PER_S / arguments.rate), bus.clock.now_ns())  # no burst after a pause
    _pause(bus.clock, max(0.0, arguments.keep_alive))


def _pause(clock: Clock, seconds: float) -> None:
    clock.sleep_until(clock.now_ns() + round(seconds * NS_PER_S))
