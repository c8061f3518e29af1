"""Programs made of nodes: from a command line to a process that ends cleanly, and soon."""

from __future__ import annotations

import gc
import importlib.util
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace

from tactile_nodes.bus.node.arguments import NodeArguments, parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.node.priority import restore_priority, take_priority
from tactile_nodes.bus.node.signals import handling, that_end
from tactile_nodes.bus.protocol import Bus, ProcessBus
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import monotonic_s
from tactile_nodes.errors import NOT_AGAIN, AskedToEndError, ConfigurationError, ModelError, TactileError

NodeFactory = Callable[[Bus, NodeArguments], Node]

_FINISH_WITHIN_S = 1.0  # for the callback that runs
_END_WITHIN_S = 1.8  # for everything, closing devices included
_LOOKS = 8  # at whether it has ended: a process that stands still, as on a busy computer, loses an eighth of its time
_FOR_A_PERSON = (ConfigurationError, ModelError)  # starting again would not help, however long it took to find out
_ONE_SIGNAL_S = 1.0  # a terminal and a launcher may both send the one that a person meant, a busy launcher its own late


def open_bus() -> ProcessBus:
    """The bus of this process, in the domain that ``ROS_DOMAIN_ID`` names.

    ``TACTILE_BUS`` chooses: ``zeromq`` (the default), ``ros2``, or ``auto``, which is ROS 2 where rclpy is found.

    Raises:
        BusError, ConfigurationError: it cannot be joined.
    """
    chosen = os.environ.get('TACTILE_BUS') or 'zeromq'
    if chosen == 'auto':
        chosen = 'ros2' if importlib.util.find_spec('rclpy') else 'zeromq'
    if chosen not in {'zeromq', 'ros2'}:
        raise ConfigurationError(f'TACTILE_BUS is {chosen!r}; set it to zeromq, ros2 or auto')
    return ZmqBus() if chosen == 'zeromq' else _ros2_bus()


def _ros2_bus() -> ProcessBus:
    try:
        from tactile_nodes.bus.ros2.graph_bus import Ros2Bus
    except ImportError as error:
        raise ConfigurationError(
            f'TACTILE_BUS=ros2 needs rclpy, which this Python cannot import ({error}); source ROS 2 first '
            '(source /opt/ros/jazzy/setup.bash), or set TACTILE_BUS=zeromq'
        ) from error
    return Ros2Bus()


def run_node(node: NodeFactory) -> int:
    """The body of a node's program: run it until a signal ends it. Returns the exit status."""
    return run_nodes([node], sys.argv[1:])


def run_nodes(factories: Sequence[NodeFactory], argv: Sequence[str]) -> int:
    """Run several nodes in one process, each in a thread of its own; messages between them are not copied.

    The first signal of `that_end` ends them: 0, within 2 s, or what a class asks for by END_WITHIN_S. One that is
    still busy then is given up: 1, or 0 if it was still being made. A second signal, a second later or more, ends the
    process at once.
    """
    try:
        arguments = parse_arguments(argv)
        if arguments.rest and len(factories) == 1:
            raise ConfigurationError(
                f'{arguments.rest[0]!r} is not a known argument; give parameters as --ros-args -p NAME:=VALUE'
            )
        return _run(factories, arguments)
    except AskedToEndError:
        return 0
    except _FOR_A_PERSON as error:
        sys.stderr.write(f'{error}\n')
        return NOT_AGAIN
    except TactileError as error:
        sys.stderr.write(f'{error}\n')
        return 1


def _run(factories: Sequence[NodeFactory], arguments: NodeArguments) -> int:
    ending = _Ending(max(getattr(factory, 'END_WITHIN_S', _END_WITHIN_S) for factory in factories))
    arguments = replace(arguments, ending=ending.done)
    nodes: list[Node] = []
    take_priority()
    with handling(that_end(), ending.on_signal), ExitStack() as opened:
        opened.callback(ending.over, nodes)
        bus = open_bus()
        opened.callback(bus.close)
        for factory in factories:
            if ending.asked:
                return 0
            nodes.append(_create_node(factory, bus, arguments))
            opened.callback(_close, nodes[-1])
        opened.callback(ending.begin)
        ending.late_status = 1
        settle()
        status = run_until(nodes, ending.done)
    if any(node.outlived for node in nodes):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    return status


def settle() -> None:
    """Take all that is there by now out of garbage collection, once nodes are made and before frames come.

    Libraries leave some hundred thousand objects, and looking through them all holds up every thread for 0.1 s. What
    is made from now on is looked through as ever.
    """
    gc.collect()
    gc.freeze()


def run_until(nodes: Sequence[Node], done: threading.Event) -> int:
    """Spin `nodes` until `done` is set or one of them fails, and close them.

    Returns the exit status: 0, 1 after a bug or when a node would not end; else of one that failed NOT_AGAIN, if its
    settings cannot be used, or its FAILURE_STATUS.
    """
    failed: list[Node] = []

    def spin(node: Node) -> None:
        try:
            node.spin()
        except Exception:  # noqa: BLE001 - a bug: say all we know, end the process, let the launcher decide
            failed.append(node)
            node.failure = TactileError('a bug in a callback')
            node.log.fatal(f'a bug in a callback ends this node:\n{traceback.format_exc()}')
        finally:
            done.set()

    threads = {node: threading.Thread(target=spin, args=(node,), name=node.full_name, daemon=True) for node in nodes}
    for thread in threads.values():
        thread.start()
    done.wait()
    for node in nodes:
        node.stop()
    deadline_s = monotonic_s() + _FINISH_WITHIN_S
    for node, thread in threads.items():
        thread.join(timeout=max(0.0, deadline_s - monotonic_s()))
        if thread.is_alive():
            node.log.error('a callback is still busy; not waiting for it')
            failed.append(node)
    for node in nodes:
        _close(node)
    return 1 if failed else max((_status(node) for node in nodes if node.failure), default=0)


def _status(node: Node) -> int:
    return NOT_AGAIN if isinstance(node.failure, _FOR_A_PERSON) else node.FAILURE_STATUS


def _close(node: Node) -> None:
    if not node.spinning:  # else its callback still uses what would be closed
        node.close()


class _Ending:
    """The end of the process: asked for once, forced the second time or when it takes too long."""

    def __init__(self, within_s: float) -> None:
        self.done = threading.Event()
        self._begun = threading.Event()
        self._over = threading.Event()
        self._since_s = 0.0
        self._within_s = within_s
        self.late_status = 0  # until nodes run: on a busy computer, making them takes longer than they may take to end
        threading.Thread(target=self._end, name='ending', daemon=True).start()

    @property
    def asked(self) -> bool:
        """Whether anybody has asked for it."""
        return self._since_s > 0

    def on_signal(self, number: signal.Signals) -> None:
        if not self.asked:
            self.begin()
        elif monotonic_s() - self._since_s > _ONE_SIGNAL_S:
            os._exit(128 + number)

    def begin(self) -> None:
        """From now on it must not take long."""
        self._since_s = self._since_s or monotonic_s()
        self._begun.set()
        self.done.set()

    def over(self, nodes: Sequence[Node]) -> None:
        """All is closed, in time; only a callback that does not return can still keep the process from ending."""
        if not any(node.spinning for node in nodes):
            self._over.set()
            self._begun.set()

    def _end(self) -> None:
        self._begun.wait()
        restore_priority()
        if not any(self._over.wait(self._within_s / _LOOKS) for _ in range(_LOOKS)):
            with suppress(OSError):  # the terminal has closed
                if self.late_status:
                    sys.stderr.write(f'not ended within {self._within_s} s after the request; giving up\n')
                sys.stderr.flush()
            os._exit(self.late_status)


def _create_node(factory: NodeFactory, bus: Bus, arguments: NodeArguments) -> Node:
    try:
        return factory(bus, arguments)
    except TactileError as error:
        raise type(error)(f'{getattr(factory, "NAME", "node")}: {error}') from error
