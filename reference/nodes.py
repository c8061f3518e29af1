"""The nodes of this package, and the topics and services in the source of each."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any

from tactile_nodes.bus import topics
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import SteppedClock
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.launching import packages

_FIRST = (
    'camera', 'flow_features', 'force_estimator', 'drift_monitor', 'force_views', 'live_view', 'recorder', 'player',
    'hand_sensors', 'hand_wrench', 'guarded_grasp', 'simulated_gripper', 'rig', 'guarded_approach',
)  # fmt: skip
"""The first nodes of a table: those that a frame passes, those that display it, the rig. Others follow by name."""
_PUBLISHES, _RECEIVES, _SERVES = (
    {'create_publisher'},
    {'create_subscription', 'add'},
    {'create_trigger', 'create_service'},
)

Bound = Mapping[str, Sequence[Any]]
"""The values of a loop variable: topics, or names of methods."""


@dataclass(frozen=True)
class NodeKind:
    """One of our nodes: the name of its module, and its class."""

    module: str
    kind: type[Node]

    @property
    def program(self) -> str:
        """The program that starts it: 'camera_node'."""
        return f'{self.module}_node'

    @property
    def line(self) -> str:
        """Its purpose: the first paragraph of the docstring of its module."""
        text = inspect.getdoc(inspect.getmodule(self.kind)) or ''
        return text.partition('\n\n')[0].replace('\n', ' ').replace('``', '`')


@dataclass(frozen=True)
class Ends:
    """The topics in the source of a node, and its services as written there ('~/pause')."""

    publishes: tuple[str, ...]
    receives: tuple[str, ...]
    services: tuple[str, ...]


@cache
def node_kinds() -> tuple[NodeKind, ...]:
    """All nodes: each module of `tactile_nodes.nodes` that defines one."""
    modules = {module.rpartition('.')[2]: module for module in packages.own_executables().values()}
    ordered = sorted(modules, key=lambda name: (_FIRST.index(name) if name in _FIRST else len(_FIRST), name))
    return tuple(NodeKind(name, kind) for name in ordered for kind in _classes(modules[name]))


def ends_of(kind: type[Node]) -> Ends:
    """The topics and services in the source of a node. Topics chosen at run time, such as those of a bag, are missing.

    Raises:
        ConfigurationError: a publisher or a subscription of a topic that is not in the topic table.
    """
    return _ends_in(kind.__module__)


@cache
def _ends_in(name: str) -> Ends:
    module = importlib.import_module(name)
    calls = list(_calls(ast.parse(inspect.getsource(module)), {}, module))
    publishes, receives = (
        tuple(dict.fromkeys(topic.name for topic in _named(module, calls, words, _topics)))
        for words in (_PUBLISHES, _RECEIVES)
    )
    return Ends(publishes, receives, tuple(dict.fromkeys(_named(module, calls, _SERVES, _service))))


@cache
def ends_of_every_node() -> Ends:
    """The topics and services that every node has with simulated time; read from a node on a separate bus."""
    bus = InProcessBus(SteppedClock())
    node = Node(bus, parse_arguments(['--ros-args', '-p', 'use_sim_time:=true']))
    try:
        graph = bus.graph()
        publishes, receives, services = (
            tuple(sorted({end.name for end in found if end.node == node.full_name}))
            for found in (graph.publishers(), graph.subscriptions(), graph.services())
        )
        return Ends(publishes, receives, tuple(name.replace(node.full_name, '~', 1) for name in services))
    finally:
        node.close()
        bus.close()


def _classes(name: str) -> list[type[Node]]:
    module = importlib.import_module(name)
    found = [entry for entry in vars(module).values() if inspect.isclass(entry) and issubclass(entry, Node)]
    return [entry for entry in found if entry.__module__ == module.__name__]


def _calls(tree: ast.AST, bound: Bound, module: ModuleType) -> Iterator[tuple[ast.Call, Bound]]:
    """Each call of a method with an argument, and the values of the loop variables there."""
    for loop in [*getattr(tree, 'generators', ()), *([tree] if isinstance(tree, ast.For) else ())]:
        if isinstance(loop.target, ast.Name):
            bound = {**bound, loop.target.id: _values(loop.iter, module)}
    if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Attribute) and tree.args:
        yield tree, bound
    for child in ast.iter_child_nodes(tree):
        yield from _calls(child, bound, module)


def _values(expression: ast.expr, module: ModuleType) -> Sequence[Any]:
    if isinstance(expression, ast.Name):
        found = getattr(module, expression.id, ())
        return found if isinstance(found, tuple) else ()
    written = expression.elts if isinstance(expression, ast.Tuple) else []
    return [entry.attr for entry in written if isinstance(entry, ast.Attribute)]


def _named(
    module: ModuleType,
    calls: list[tuple[ast.Call, Bound]],
    words: set[str],
    read: Callable[[ast.expr, Bound], Sequence[Any] | None],
) -> Iterator[Any]:
    for call, bound in calls:
        assert isinstance(call.func, ast.Attribute)
        if call.func.attr not in words:
            continue
        found = read(call.args[0], bound)
        if found is None and call.func.attr.startswith('create_'):
            raise ConfigurationError(
                f'{module.__file__}:{call.lineno}: {ast.unparse(call.args[0])} cannot be told from the source; '
                'write it as one of tactile_nodes.bus.topics, or a text'
            )
        yield from found or ()


def _topics(expression: ast.expr, bound: Bound) -> Sequence[Topic] | None:
    """The topics of an expression: `topics.X`, `replace(topics.X, ...)`, or the variable of a loop over topics."""
    if isinstance(expression, ast.Call) and ast.unparse(expression.func) == 'replace':
        expression = expression.args[0]
    if isinstance(expression, ast.Name):
        return bound.get(expression.id)
    text = ast.unparse(expression)
    return [getattr(topics, text.removeprefix('topics.'))] if text.startswith('topics.') else None


def _service(expression: ast.expr, bound: Bound) -> Sequence[str] | None:
    """The services of an expression: a text, or one that a loop over names of methods fills in."""
    if isinstance(expression, ast.Constant):
        return [str(expression.value)]
    if not isinstance(expression, ast.JoinedStr):
        return None
    (start,) = (part.value for part in expression.values if isinstance(part, ast.Constant))
    assert isinstance(start, str)
    return [f'{start}{name}' for names in bound.values() for name in names]
