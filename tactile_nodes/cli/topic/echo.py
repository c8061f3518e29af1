"""``tactile topic echo``: print a topic's messages as they arrive."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from tactile_nodes.bus.names import absolute
from tactile_nodes.cli.completion import completers
from tactile_nodes.cli.running.session import (
    Verbs,
    compare_types,
    completed,
    count,
    full_type,
    interruptible,
    joined,
    own_name,
    positive_float,
    type_of_topic,
)
from tactile_nodes.errors import BusError, MessageError
from tactile_nodes.viewing.gaps import SequenceGaps

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import Bus, Received
    from tactile_nodes.bus.subscription import Subscription
    from tactile_nodes.cli.running.text import Shown

QUEUE = 1000
NS_PER_S, LOOK_EVERY_NS = 1_000_000_000, 50_000_000
WAIT_S = 10.0
"""How long a topic may take to appear: a launch takes some 4 s to its first forces."""

_EXAMPLES = """\
  tactile topic echo /force_distribution                      every message, arrays cut after 128 elements
  tactile topic echo /force_distribution --field total --csv  one number per line, for plotting
  tactile topic echo /image_raw --once --no-arr
  tactile topic echo /skin/wrench --field wrench.force.z --timeout 5
"""


def add(verbs: Verbs) -> None:
    verb = verbs.add('echo', echo, "print a topic's messages", _EXAMPLES)
    completed(verb.add_argument('topic', help='a topic, /force_distribution for example'), completers.topics)
    kind = verb.add_argument('type', nargs='?', help='its type; needed only if the topic does not appear within 10 s')
    completed(kind, completers.topic_types)
    verb.add_argument('--once', action='store_true', help='print the first message and exit')
    verb.add_argument('--timeout', type=positive_float, metavar='N', help='exit after N seconds')
    verb.add_argument('--field', metavar='PATH', help='print this field alone: header.stamp, normal_force[40]')
    verb.add_argument('--csv', action='store_true', help='one line per message, values separated by commas')
    verb.add_argument('--flow-style', action='store_true', help='YAML lists and maps on one line')
    verb.add_argument('--no-arr', action='store_true', help='print the length of arrays instead of their elements')
    verb.add_argument('--no-str', action='store_true', help='print the length of strings instead of their text')
    verb.add_argument('-f', '--full-length', action='store_true', help='do not truncate arrays and strings')
    verb.add_argument(
        '-l',
        '--truncate-length',
        type=count,
        default=128,
        metavar='N',
        help='truncate arrays and strings after N (128)',
    )
    verb.add_argument(
        '-i', '--include-message-info', action='store_true', help='print the times of sending and arrival'
    )
    verb.add_argument('--no-lost-messages', action='store_true', help='do not report messages that were lost')
    verb.add_argument('--raw', action='store_true', help='print the serialized bytes')


def echo(arguments: argparse.Namespace) -> int:
    """Print until interrupted; 1 if nothing arrived within ``--timeout``."""
    from tactile_nodes.clock import monotonic_s

    topic, begun_s, timeout_s = absolute(arguments.topic), monotonic_s(), arguments.timeout
    printed = 0
    with joined() as bus:
        type_name = full_type(arguments.type) if arguments.type else awaited_type(bus, topic, timeout_s)
        compare_types(bus.graph().publishers(topic), type_name)
        subscription = bus.subscribe(topic, type_name, queue_of(topic), own_name())
        gaps = SequenceGaps()
        for received in arriving(subscription, timeout_s and max(0.0, begun_s + timeout_s - monotonic_s())):
            if not arguments.no_lost_messages:
                report_lost(gaps, received)
            printed += _print_one(received, arguments)
            if arguments.once and printed:
                return 0
    if not printed:
        raise BusError(f'no message on {topic} within {arguments.timeout:g} s')
    return 0


def awaited_type(bus: Bus, topic: str, timeout_s: float | None = None) -> str:
    """The type of a topic, waiting up to `timeout_s` (default 10 s) for nodes that are still starting.

    Raises:
        BusError: the topic still has no publisher and no subscriber, or the types differ.
    """
    wait_s, noticed = timeout_s or WAIT_S, False
    end_ns = bus.clock.now_ns() + round(wait_s * NS_PER_S)
    while topic not in bus.graph().topics() and (now_ns := bus.clock.now_ns()) < end_ns:
        if not noticed:
            notice = f'no publisher and no subscriber of {topic} yet; waiting up to {wait_s:g} s'
            print(notice, file=sys.stderr, flush=True)
        noticed = True
        bus.clock.sleep_until(min(now_ns + LOOK_EVERY_NS, end_ns))
    return type_of_topic(bus.graph(), topic)


def queue_of(topic: str) -> Any:
    """A queue that is deep enough to show every message; latched if the topic table says so."""
    from tactile_nodes.bus.protocol import Qos
    from tactile_nodes.bus.topics import default_qos

    return Qos('queue', QUEUE, default_qos(topic).latched)


def arriving(subscription: Subscription, timeout_s: float | None = None) -> Iterator[Received]:
    """Messages as they arrive, until `timeout_s` has passed."""
    from tactile_nodes.clock import monotonic_s

    end_s = monotonic_s() + timeout_s if timeout_s is not None else None
    with interruptible(subscription.get) as get:
        while True:
            received = get(max(0.0, end_s - monotonic_s()) if end_s is not None else None)
            if received is None:
                return
            yield received


def report_lost(gaps: SequenceGaps, received: Received) -> None:
    """Report on stderr that messages before this one were lost, if any were."""
    missing = gaps.add(received.publisher, received.sequence)
    if missing:
        text = f'A message was lost!!!\n\ttotal count change:{missing}\n\ttotal count: {gaps.total}'
        print(text, file=sys.stderr, flush=True)


def _print_one(received: Received, arguments: argparse.Namespace) -> bool:
    try:
        shown = received.data if arguments.raw else received.message
    except MessageError as error:
        print(f'dropped a message: {error}', file=sys.stderr, flush=True)
        return False
    info = _info(received) if arguments.include_message_info else {}
    print(_text(shown, info, arguments), end='', flush=True)
    return True


def _info(received: Received) -> dict[str, Any]:
    return {
        'source_timestamp': received.source_ns,
        'received_timestamp': received.received_ns,
        'publication_sequence_number': received.sequence,
        'publisher': received.publisher,
    }


def _text(message: Any, info: dict[str, Any], arguments: argparse.Namespace) -> str:
    from tactile_nodes.cli.running import text

    if arguments.raw:
        return f'{message!r}\n---\n'
    shown = _shown(arguments)
    value = text.field_of(message, arguments.field) if arguments.field else message
    if arguments.csv:
        return ','.join([*map(str, info.values()), text.to_csv(value, shown)]) + '\n'
    head = f'{text.to_yaml(info, shown)}---\n' if info else ''
    return f'{head}{text.to_yaml(value, shown, arguments.flow_style)}---\n'


def _shown(arguments: argparse.Namespace) -> Shown:
    from tactile_nodes.cli.running.text import Shown

    length = None if arguments.full_length else arguments.truncate_length
    return Shown(length, not arguments.no_arr, not arguments.no_str)
