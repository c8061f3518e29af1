"""``tactile topic echo``: print a topic's messages as they come."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from tactile_nodes.bus.names import absolute
from tactile_nodes.cli.completion import completers
from tactile_nodes.cli.running.session import (
    Verbs,
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
"""How long a topic may take to appear: a launch has its first forces after some 4 s."""

_EXAMPLES = """\
  tactile topic echo /force_distribution                      every message, arrays cut after 128 elements
  tactile topic echo /force_distribution --field total --csv  one number a line, for plotting
  tactile topic echo /image_raw --once --no-arr
  tactile topic echo /skin/wrench --field wrench.force.z --timeout 5
"""


def add(verbs: Verbs) -> None:
    """The command and its arguments."""
    made = verbs.add('echo', echo, "print a topic's messages", _EXAMPLES)
    completed(made.add_argument('topic', help='a topic, /force_distribution for example'), completers.topics)
    kind = made.add_argument('type', nargs='?', help='its type; needed only for a topic that nobody uses within 10 s')
    completed(kind, completers.topic_types)
    made.add_argument('--once', action='store_true', help='print the first message and end')
    made.add_argument('--timeout', type=positive_float, metavar='N', help='end after N seconds')
    made.add_argument('--field', metavar='PATH', help='print this field alone: header.stamp, normal_force[40]')
    made.add_argument('--csv', action='store_true', help='one line a message, its values separated by commas')
    made.add_argument('--flow-style', action='store_true', help='lists and maps on one line')
    made.add_argument('--no-arr', action='store_true', help='say the length of arrays instead of printing them')
    made.add_argument('--no-str', action='store_true', help='say the length of texts instead of printing them')
    made.add_argument('-f', '--full-length', action='store_true', help='cut no array and no text')
    made.add_argument('-l', '--truncate-length', type=count, metavar='N', help='cut arrays and texts after N (128)')
    made.add_argument('-i', '--include-message-info', action='store_true', help='say when it was sent and came in')
    made.add_argument('--no-lost-messages', action='store_true', help='do not report messages that were lost')
    made.add_argument('--raw', action='store_true', help='print the bytes that travelled')


def echo(arguments: argparse.Namespace) -> int:
    """Print until interrupted; 1 when nothing came within ``--timeout``."""
    from tactile_nodes.clock import monotonic_s

    topic, begun_s, timeout_s = absolute(arguments.topic), monotonic_s(), arguments.timeout
    printed = 0
    with joined() as bus:
        type_name = full_type(arguments.type) if arguments.type else awaited_type(bus, topic, timeout_s)
        subscription = bus.subscribe(topic, type_name, queue_of(topic), own_name())
        gaps = SequenceGaps()
        for received in arriving(subscription, timeout_s and max(0.0, begun_s + timeout_s - monotonic_s())):
            if not arguments.no_lost_messages:
                report_lost(gaps, received)
            printed += _print_one(received, arguments)
            if arguments.once and printed:
                return 0
    if not printed:
        raise BusError(f'nothing came on {topic} within {arguments.timeout:g} s')
    return 0


def awaited_type(bus: Bus, topic: str, timeout_s: float | None = None) -> str:
    """The one type of a topic, which nodes that are still starting may announce within `timeout_s` (usually 10 s).

    Raises:
        BusError: nobody publishes or subscribes it even then, or the types differ.
    """
    wait_s, said = timeout_s or WAIT_S, False
    end_ns = bus.clock.now_ns() + round(wait_s * NS_PER_S)
    while topic not in bus.graph().topics() and (now_ns := bus.clock.now_ns()) < end_ns:
        if not said:
            told = f'nobody publishes or subscribes {topic} yet; waiting {wait_s:g} s for it'
            print(told, file=sys.stderr, flush=True)
        said = True
        bus.clock.sleep_until(min(now_ns + LOOK_EVERY_NS, end_ns))
    return type_of_topic(bus.graph(), topic)


def queue_of(topic: str) -> Any:
    """A queue deep enough that a person who looks at a topic misses nothing; latched as the topic table has it."""
    from tactile_nodes.bus.protocol import Qos
    from tactile_nodes.bus.topics import default_qos

    return Qos('queue', QUEUE, default_qos(topic).latched)


def arriving(subscription: Subscription, timeout_s: float | None = None) -> Iterator[Received]:
    """Messages as they come, until `timeout_s` is over."""
    from tactile_nodes.clock import monotonic_s

    end_s = monotonic_s() + timeout_s if timeout_s is not None else None
    with interruptible(subscription.get) as get:
        while True:
            received = get(max(0.0, end_s - monotonic_s()) if end_s is not None else None)
            if received is None:
                return
            yield received


def report_lost(gaps: SequenceGaps, received: Received) -> None:
    """Say on the error stream that messages are missing before this one, if they are."""
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
    from tactile_nodes.cli.running.text import TRUNCATE_LENGTH, Shown

    length = TRUNCATE_LENGTH if arguments.truncate_length is None else arguments.truncate_length
    return Shown(None if arguments.full_length else length, not arguments.no_arr, not arguments.no_str)
