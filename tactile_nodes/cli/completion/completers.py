"""Completers for the shell: names of what runs now. They are silent if they fail."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from tactile_nodes.bus.names import absolute
from tactile_nodes.cli.running import session
from tactile_nodes.errors import TactileError

if TYPE_CHECKING:
    from tactile_nodes.bus.protocol import ProcessBus

CALL_TIMEOUT_S = 2.0
"""A node that is busy answers within a second or so; only one that hangs makes the shell wait this long."""

Completer = Callable[..., list[str]]


def _live(names: Callable[[ProcessBus, argparse.Namespace], Iterable[str]]) -> Completer:
    """A completer that looks at the bus. Errors give no completions, since a message would disturb the command line."""

    def complete(prefix: str, parsed_args: argparse.Namespace, **_: object) -> list[str]:
        try:
            with session.joined() as bus:
                return _as_typed(sorted(set(names(bus, parsed_args))), prefix)
        except (TactileError, OSError):
            return []

    return complete


def _as_typed(names: list[str], prefix: str) -> list[str]:
    """The names that start with `prefix`, with a leading slash only if it was typed or nothing was."""
    return [name for name in names if name.startswith(prefix)] or [
        name[1:] for name in names if name.startswith(f'/{prefix}')
    ]


def _visible(names: Iterable[str]) -> list[str]:
    return [name for name in names if not session.is_hidden(name)]


topics = _live(lambda bus, _: _visible(bus.graph().topics()))
nodes = _live(lambda bus, _: _visible(bus.graph().nodes()))
services = _live(lambda bus, _: [end.name for end in bus.graph().services()])


def _topic_types(bus: ProcessBus, arguments: argparse.Namespace) -> list[str]:
    topic = getattr(arguments, 'topic', None)
    if topic and (found := bus.graph().topics().get(absolute(topic))):
        return found
    from tactile_nodes.messages.store import store

    return [name for name in store().fielddefs if '/msg/' in name]


def _service_types(bus: ProcessBus, arguments: argparse.Namespace) -> list[str]:
    wanted = absolute(arguments.service) if getattr(arguments, 'service', None) else None
    return [end.type_name for end in bus.graph().services(wanted)]


def _parameters(bus: ProcessBus, arguments: argparse.Namespace) -> list[str]:
    from tactile_nodes.bus.node.parameter_client import ParameterClient

    return ParameterClient(bus, absolute(arguments.node), CALL_TIMEOUT_S).names()


topic_types = _live(_topic_types)
service_types = _live(_service_types)
parameters = _live(_parameters)
namespaces = _live(lambda bus, _: {name.rpartition('/')[0] or '/' for name in _visible(bus.graph().nodes())})
