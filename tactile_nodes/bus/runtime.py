"""Programs made of nodes: from a command line to a process that ends cleanly."""

from __future__ import annotations

import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence

from tactile_nodes.bus.arguments import NodeArguments, parse_arguments
from tactile_nodes.bus.node import Node
from tactile_nodes.bus.protocol import Bus
from tactile_nodes.bus.zeromq import ZmqBus
from tactile_nodes.errors import ConfigurationError, TactileError

NodeFactory = Callable[[Bus, NodeArguments], Node]


def open_bus() -> ZmqBus:
    """The bus of this process, in the domain that ``ROS_DOMAIN_ID`` names.

    Raises:
        BusError, ConfigurationError: it cannot be joined.
    """
    return ZmqBus()


def run_node(node: NodeFactory, argv: Sequence[str] | None = None) -> int:
    """The body of a node's program: run it until SIGINT or SIGTERM. Returns the exit status."""
    return run_nodes([node], sys.argv[1:] if argv is None else argv)


def run_nodes(factories: Sequence[NodeFactory], argv: Sequence[str]) -> int:
    """Run several nodes in one process, each in a thread of its own; messages between them are not copied."""
    try:
        arguments = parse_arguments(argv)
        if arguments.rest and len(factories) == 1:
            raise ConfigurationError(f'{arguments.rest[0]!r} is not understood; parameters follow --ros-args -p')
        return _run(factories, arguments)
    except TactileError as error:
        sys.stderr.write(f'{error}\n')
        return 1


def _run(factories: Sequence[NodeFactory], arguments: NodeArguments) -> int:
    done = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: done.set())
    bus = open_bus()
    try:
        return run_until([_made(factory, bus, arguments) for factory in factories], done)
    finally:
        bus.close()


def run_until(nodes: Sequence[Node], done: threading.Event) -> int:
    """Spin `nodes` until `done` is set or one of them fails; 1 when one failed."""
    failed: list[Node] = []

    def spin(node: Node) -> None:
        try:
            node.spin()
        except Exception:  # noqa: BLE001 - a bug: say all we know, end the process, let the launcher decide
            traceback.print_exc()
            failed.append(node)
        finally:
            done.set()

    threads = [threading.Thread(target=spin, args=(node,), name=node.full_name, daemon=True) for node in nodes]
    for thread in threads:
        thread.start()
    done.wait()
    for node in nodes:
        node.stop()
    for thread in threads:
        thread.join(timeout=1.0)
    for node in nodes:
        node.close()
    return 1 if failed else 0


def _made(factory: NodeFactory, bus: Bus, arguments: NodeArguments) -> Node:
    try:
        return factory(bus, arguments)
    except TactileError as error:
        raise type(error)(f'{getattr(factory, "NAME", "node")}: {error}') from error
