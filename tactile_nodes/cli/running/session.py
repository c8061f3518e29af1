"""Code shared by the commands that inspect a running system: joining the bus, names and types as typed."""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import BusError, MessageError

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import Endpoint, Graph, ProcessBus, Received

Number = TypeVar('Number', int, float)
LOOK_S = 0.1
"""How often a loop that waits for messages checks for Ctrl-C."""
_MOST = 1e9  # seconds or counts; in seconds, thirty years
Action = Callable[[argparse.Namespace], int]


class Verbs:
    """The subcommands of a command (``topic list``, ``topic echo``), each with its arguments and its function."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self._commands = parser.add_subparsers(dest='command', metavar='command', title='commands')
        parser.set_defaults(action=_show_help(parser))

    def add(self, name: str, action: Action, line: str, examples: str = '') -> argparse.ArgumentParser:
        """A subcommand; `line` is its description, `examples` are shown below its help."""
        verb = self._commands.add_parser(
            name,
            help=line,
            epilog=f'examples:\n{examples}' if examples else None,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        verb.set_defaults(action=action)
        return verb


def _show_help(parser: argparse.ArgumentParser) -> Action:
    def show(_: argparse.Namespace) -> int:
        parser.print_help()
        return 0

    return show


@contextmanager
def ended_by_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C, SIGTERM and a closed terminal set within the context."""
    from tactile_nodes.bus.node.signals import handling, that_end

    done = threading.Event()
    with handling(that_end(), lambda _: done.set()):
        yield done


@contextmanager
def interruptible(get: Callable[[float], Received | None]) -> Iterator[Callable[[float | None], Received | None]]:
    """A subscription's `get` during which Ctrl-C always raises KeyboardInterrupt, after `LOOK_S` at the latest.

    Python's own handler raises it at once, but it may be lost: exceptions are only printed while the memory of a
    picture is returned to ZeroMQ. A second Ctrl-C raises at once, for a program that waits for the reader of its
    output.
    """
    came: list[int] = []

    def interrupt(number: int, _: object) -> None:
        if came:
            raise KeyboardInterrupt
        came.append(number)

    def got(timeout_s: float | None = None) -> Received | None:
        end_s = math.inf if timeout_s is None else monotonic_s() + timeout_s
        while True:
            received = get(max(0.0, min(LOOK_S, end_s - monotonic_s())))
            if came:
                raise KeyboardInterrupt
            if received is not None or monotonic_s() >= end_s:
                return received

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield got
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def joined() -> Iterator[ProcessBus]:
    """Join the bus with this process.

    Raises:
        BusError, ConfigurationError: joining failed.
    """
    from tactile_nodes.bus.node.runtime import open_bus

    bus = open_bus()
    try:
        yield bus
    finally:
        bus.close()


def own_name() -> str:
    """The node name of this command in the graph; hidden (it begins with an underscore), like that of ros2."""
    return f'/_tactile_cli_{os.getpid()}'


def is_hidden(name: str) -> bool:
    """Whether a name is hidden: one of its parts begins with an underscore."""
    return any(word.startswith('_') for word in name.split('/'))


def full_type(name: str, kind: str = 'msg') -> str:
    """A type's full name, from the full name or from the short form that ros2 also accepts.

    >>> full_type('std_msgs/String'), full_type('std_srvs/Trigger', 'srv')
    ('std_msgs/msg/String', 'std_srvs/srv/Trigger')
    """
    package, _, short = name.partition('/')
    return f'{package}/{kind}/{short}' if short and '/' not in short else name


def type_of_topic(graph: Graph, topic: str) -> str:
    """The type with which `topic` is published or subscribed.

    Raises:
        BusError: the topic has no publisher and no subscriber, or the types differ.
    """
    found = graph.topics().get(topic)
    if not found:
        raise BusError(f'there is no topic {topic}: it has no publisher and no subscriber; see tactile topic list')
    if len(found) > 1:
        raise BusError(f'{topic} is used with several types: {", ".join(found)}; give the type that you mean')
    return found[0]


def compare_types(ends: list[Endpoint], type_name: str) -> None:
    """Say on stderr that the other `ends` of a topic have other types alone: nothing is exchanged with them."""
    found = sorted({end.type_name for end in ends})
    if found and type_name not in found:
        print(f'{ends[0].name} has the type {", ".join(found)}, not {type_name}', file=sys.stderr, flush=True)


def type_of_service(graph: Graph, service: str) -> str:
    """The type of `service`.

    Raises:
        BusError: no node offers it.
    """
    found = graph.services(service)
    if not found:
        raise BusError(f'no node offers the service {service}; see tactile service list')
    return found[0].type_name


def read_values(text: str) -> dict[str, Any]:
    """The fields of a message, written as a YAML mapping on the command line.

    Raises:
        MessageError: the text is not a mapping.
    """
    import yaml

    try:
        found = yaml.safe_load(text) or {}
    except yaml.YAMLError as error:
        raise MessageError(f'{text!r} is not valid YAML: {getattr(error, "problem", None) or error}') from error
    if not isinstance(found, dict):
        raise MessageError(f'{text!r} has no field names; write the fields as YAML, for example "{{data: hello}}"')
    return found


def completed(argument: argparse.Action, completer: Any) -> None:
    """Let the shell complete `argument` with the results of `completer`."""
    argument.completer = completer  # type: ignore[attr-defined]


def positive_float(text: str) -> float:
    """An argument above zero; values too large for clocks and counters are refused as typing errors."""
    return _checked(text, float, lambda value: 1 / _MOST <= value <= _MOST, 'a number above 0')


def positive_int(text: str) -> int:
    return _checked(text, int, lambda value: 0 < value <= _MOST, 'a whole number above 0')


def count(text: str) -> int:
    return _checked(text, int, lambda value: 0 <= value <= _MOST, 'a whole number, 0 or more')


def duration(text: str) -> float:
    return _checked(text, float, lambda value: 0 <= value <= _MOST, 'a time in seconds, 0 or more')


def _checked(text: str, kind: Callable[[str], Number], fits: Callable[[Number], bool], wish: str) -> Number:
    try:
        value = kind(text)
    except ValueError:
        value = None
    if value is None or not fits(value):
        raise argparse.ArgumentTypeError(f'{text!r} is not {wish}')
    return value
