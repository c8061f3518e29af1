"""The command line of a node: ROS 2's ``--ros-args``, so that any launcher can start it."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field

from tactile_nodes.bus.names import absolute, absolute_namespace
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.params import NodeParameters, load_parameter_file, parse_value

_REMAP = re.compile(r'(?:(?P<node>[A-Za-z_]\w*):)?(?P<source>[^:=]+):=(?P<target>.+)', re.ASCII)
LEVELS = {'debug': 10, 'info': 20, 'warn': 30, 'error': 40, 'fatal': 50}


@dataclass(frozen=True)
class Remap:
    """One rule ``[node:]from:=to``."""

    source: str
    target: str
    node: str | None = None


@dataclass(frozen=True)
class NodeArguments:
    """What a command line says to the nodes of its process.

    `parameters` are the blocks of all ``--params-file`` and ``-p`` in the order given; `rest` is what stood outside
    ``--ros-args`` and belongs to the program itself. `ending` is set when the process is to end.
    """

    remaps: tuple[Remap, ...] = ()
    parameters: tuple[NodeParameters, ...] = ()
    log_level: int = LEVELS['info']
    rest: tuple[str, ...] = ()
    ending: threading.Event = field(default_factory=threading.Event, compare=False, repr=False)


@dataclass
class _Reading:
    remaps: list[Remap] = field(default_factory=list)
    parameters: list[NodeParameters] = field(default_factory=list)
    log_level: int = LEVELS['info']
    rest: list[str] = field(default_factory=list)


def parse_arguments(argv: Sequence[str]) -> NodeArguments:
    """Read a node's command line.

    Raises:
        ConfigurationError: an unknown flag after ``--ros-args``, a rule of the wrong form, a file that cannot be read.
    """
    found = _Reading()
    words = list(argv)
    in_ros = False
    while words:
        word = words.pop(0)
        if word == '--ros-args':
            in_ros = True
        elif word == '--' and in_ros:
            in_ros = False
        elif in_ros:
            _read_flag(word, words, found)
        else:
            found.rest.append(word)
    return NodeArguments(tuple(found.remaps), tuple(found.parameters), found.log_level, tuple(found.rest))


def _read_flag(flag: str, words: list[str], found: _Reading) -> None:
    if flag in {'--enable-rosout-logs', '--disable-rosout-logs', '--enable-stdout-logs', '--disable-stdout-logs'}:
        return
    if flag not in {'-r', '--remap', '-p', '--param', '--params-file', '--log-level'}:
        raise ConfigurationError(f'{flag!r} is not a flag of --ros-args; available: -r, -p, --params-file, --log-level')
    if not words:
        raise ConfigurationError(f'{flag} needs a value')
    value = words.pop(0)
    if flag in {'-r', '--remap'}:
        found.remaps.append(parse_remap(value))
    elif flag == '--params-file':
        found.parameters += load_parameter_file(value)
    elif flag == '--log-level':
        found.log_level = _level(value)
    else:
        found.parameters += _parse_parameter(value)


def parse_remap(rule: str) -> Remap:
    """One rule of ``-r``: 'from:=to', 'node:from:=to', '__node:=name', '__ns:=/name'.

    Raises:
        ConfigurationError: not of that form.
    """
    match = _REMAP.fullmatch(rule)
    if not match:
        raise ConfigurationError(f'the remap {rule!r} is not of the form from:=to')
    return Remap(match['source'], match['target'], match['node'])


def _parse_parameter(rule: str) -> list[NodeParameters]:
    name, separator, value = rule.partition(':=')
    if not separator or not name:
        raise ConfigurationError(f'the parameter {rule!r} is not of the form name:=value')
    node, _, name = name.rpartition(':')
    return [NodeParameters(node or '/**', {name: parse_value(value, f'-p {rule}', name)})]


def _level(text: str) -> int:
    name = text.rpartition(':=')[2].lower()
    if name not in LEVELS:
        raise ConfigurationError(f'the log level {text!r} is not one of {", ".join(LEVELS)}')
    return LEVELS[name]


@dataclass(frozen=True)
class Names:
    """A node's own name and namespace, and how it resolves the names of topics and services."""

    name: str
    namespace: str
    remaps: tuple[Remap, ...]

    @classmethod
    def of(cls, default_name: str, arguments: NodeArguments) -> Names:
        """Name and namespace after the rules ``__node`` and ``__ns`` that apply to the node.

        Raises:
            ConfigurationError: a name that ROS 2 would not allow.
        """
        rules = [rule for rule in arguments.remaps if rule.node in {None, default_name}]
        name = _first(rules, '__node') or default_name
        if not re.fullmatch(r'[A-Za-z_]\w*', name, re.ASCII):
            raise ConfigurationError(f'{name!r} is not a valid node name: use letters, digits and _')
        around = absolute_namespace(_first(rules, '__ns') or '/')
        return cls(name, around, tuple(rule for rule in arguments.remaps if rule.node in {None, default_name, name}))

    @property
    def full_name(self) -> str:
        """'/skin/camera'"""
        return f'{self.namespace.rstrip("/")}/{self.name}'

    def resolve(self, name: str) -> str:
        """The full name of a topic or service: expanded, then remapped by the first rule that fits.

        Raises:
            ConfigurationError: a name that ROS 2 would not allow.
        """
        full = self._expand(name)
        for rule in self.remaps:
            if not rule.source.startswith('__') and self._expand(rule.source) == full:
                return self._expand(rule.target)
        return full

    def _expand(self, name: str) -> str:
        if name.startswith('~/'):
            return f'{self.full_name}{absolute(name[1:])}'
        expanded = absolute(name)
        return expanded if name.startswith('/') else f'{self.namespace.rstrip("/")}{expanded}'


def _first(rules: Sequence[Remap], source: str) -> str | None:
    return next((rule.target for rule in rules if rule.source == source), None)
