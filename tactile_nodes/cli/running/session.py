"""What the verbs that look at a running system share: joining the bus, names as a person types them, types."""

from __future__ import annotations

import argparse
import math
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import BusError, MessageError

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import Graph, ProcessBus, Received

Number = TypeVar('Number', int, float)
LOOK_S = 0.1
"""How often what waits for messages looks whether Ctrl-C came."""
_MOST = 1e9  # seconds or counts: thirty years
Action = Callable[[argparse.Namespace], int]


class Verbs:
    """The second words of a verb (``topic list``, ``topic echo``), each with its arguments and its function."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self._commands = parser.add_subparsers(dest='command', metavar='command', title='commands')
        parser.set_defaults(action=_show_help(parser))

    def add(self, name: str, action: Action, line: str, examples: str = '') -> argparse.ArgumentParser:
        """A command; `line` says what it does, `examples` are shown below its help."""
        made = self._commands.add_parser(
            name,
            help=line,
            description=f'{line[0].upper()}{line[1:]}.',
            epilog=f'examples:\n{examples}' if examples else None,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        made.set_defaults(action=action)
        return made


def _show_help(parser: argparse.ArgumentParser) -> Action:
    def show(_: argparse.Namespace) -> int:
        parser.print_help()
        return 0

    return show


@contextmanager
def ended_by_signals() -> Iterator[threading.Event]:
    """Set by Ctrl-C and by SIGTERM, for as long as this is held."""
    from tactile_nodes.bus.node.signals import heard

    done = threading.Event()
    with heard({signal.SIGINT, signal.SIGTERM}, lambda _: done.set()):
        yield done


@contextmanager
def interruptible(get: Callable[[float], Received | None]) -> Iterator[Callable[[float | None], Received | None]]:
    """A subscription's `get` during which Ctrl-C always raises KeyboardInterrupt, at the latest after `LOOK_S`.

    Python's own handler raises it at once, and it may be lost: exceptions are only printed where the memory of a
    picture is given back to ZeroMQ. A second Ctrl-C raises at once, for a program that waits for the reader of its
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
    """This process on the bus.

    Raises:
        BusError, ConfigurationError: it cannot be joined.
    """
    from tactile_nodes.bus.node.runtime import open_bus

    bus = open_bus()
    try:
        yield bus
    finally:
        bus.close()


def own_name() -> str:
    """What our ends are called in the graph; hidden, because it begins with an underscore, as that of ros2 does."""
    return f'/_tactile_cli_{os.getpid()}'


def is_hidden(name: str) -> bool:
    """Whether a name is not meant for people: one of its words begins with an underscore."""
    return any(word.startswith('_') for word in name.split('/'))


def full_type(name: str, kind: str = 'msg') -> str:
    """A type's full name, from that or from the short form that ros2 takes as well.

    >>> full_type('std_msgs/String'), full_type('std_srvs/Trigger', 'srv')
    ('std_msgs/msg/String', 'std_srvs/srv/Trigger')
    """
    package, _, short = name.partition('/')
    return f'{package}/{kind}/{short}' if short and '/' not in short else name


def type_of_topic(graph: Graph, topic: str) -> str:
    """The one type that `topic` is published or subscribed as.

    Raises:
        BusError: nobody publishes or subscribes it, or the types differ.
    """
    found = graph.topics().get(topic)
    if not found:
        raise BusError(f'there is no topic {topic}: nobody publishes or subscribes it; see tactile topic list')
    if len(found) > 1:
        raise BusError(f'{topic} is used with several types: {", ".join(found)}; name the one that you mean')
    return found[0]


def type_of_service(graph: Graph, service: str) -> str:
    """The type that `service` is served as.

    Raises:
        BusError: nobody serves it.
    """
    found = graph.services(service)
    if not found:
        raise BusError(f'there is no service {service}: nobody serves it; see tactile service list')
    return found[0].type_name


def read_values(text: str) -> dict[str, Any]:
    """The fields of a message, written as a YAML mapping on the command line.

    Raises:
        MessageError: no mapping.
    """
    import yaml

    try:
        found = yaml.safe_load(text) or {}
    except yaml.YAMLError as error:
        raise MessageError(f'{text!r} is no YAML: {getattr(error, "problem", None) or error}') from error
    if not isinstance(found, dict):
        raise MessageError(f'{text!r} names no fields; write them as YAML, for example "{{data: hello}}"')
    return found


def completed(argument: argparse.Action, completer: Any) -> None:
    """Have the shell complete `argument` with what `completer` gives."""
    argument.completer = completer  # type: ignore[attr-defined]


def positive_float(text: str) -> float:
    """An argument that must be above zero; so much of it that no clock or counter holds it is an error of typing."""
    return _checked(text, float, lambda value: 1 / _MOST <= value <= _MOST, 'a number above 0')


def positive_int(text: str) -> int:
    """A count of at least one."""
    return _checked(text, int, lambda value: 0 < value <= _MOST, 'a whole number above 0')


def count(text: str) -> int:
    """A count, or zero."""
    return _checked(text, int, lambda value: 0 <= value <= _MOST, 'a whole number, 0 or more')


def duration(text: str) -> float:
    """Seconds, or zero."""
    return _checked(text, float, lambda value: 0 <= value <= _MOST, 'a time in seconds, 0 or more')


def _checked(text: str, kind: Callable[[str], Number], fits: Callable[[Number], bool], wish: str) -> Number:
    try:
        value = kind(text)
    except ValueError:
        value = None
    if value is None or not fits(value):
        raise argparse.ArgumentTypeError(f'{text!r} is not {wish}')
    return value
