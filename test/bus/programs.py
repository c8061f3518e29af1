"""Nodes that behave well and badly, run as programs of their own."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_nodes
from tactile_nodes.errors import DeviceLostError, DeviceNotFoundError
from tactile_nodes.nodes.bridge import BridgeNode
from tactile_nodes.params import parameter

CONTEXT = multiprocessing.get_context('forkserver')
CONTEXT.set_forkserver_preload(['agents', 'programs', 'tactile_nodes.bus.node.runtime'])


__all__ = ['CONTEXT', 'BridgeNode', 'Program', 'Ready', 'run']


class Ready(Node):
    """Says when it runs and when it is closed."""

    NAME = 'ready'

    def __init_subclass__(cls) -> None:
        cls.NAME = cls.__name__.lower()

    def __init__(self, bus: Any, arguments: Any) -> None:
        super().__init__(bus, arguments)
        self.post(self.begin)

    def begin(self) -> None:
        self.log.info('running')

    def on_close(self) -> None:
        self.log.info('closed')


@dataclass(frozen=True)
class TunableParams(NodeParams):
    """Something to set."""

    rate: float = parameter(1.0, 'a rate', minimum=0.0)


class Tunable(Ready):
    """Has a parameter."""

    PARAMS = TunableParams


class Second(Ready):
    """Another one."""


class Busy(Ready):
    """Its callback never returns."""

    def begin(self) -> None:
        super().begin()
        while True:
            time.sleep(0.01)


class SlowToClose(Ready):
    """Its device hangs when it is closed."""

    def on_close(self) -> None:
        super().on_close()
        time.sleep(60.0)


class MayBeSlowToClose(SlowToClose):
    """It is given the time."""

    END_WITHIN_S = 60.0


class TakesAMomentToClose(Ready):
    """It has something to write, say."""

    def on_close(self) -> None:
        super().on_close()
        time.sleep(0.7)


class StandsStill(Ready):
    """Gets no processor while it closes its device."""

    def on_close(self) -> None:
        super().on_close()
        os.kill(os.getpid(), signal.SIGSTOP)
        time.sleep(0.3)


class SlowToStart(Ready):
    """Its device hangs when it is opened."""

    def __init__(self, bus: Any, arguments: Any) -> None:
        super().__init__(bus, arguments)
        self.log.info('running')
        time.sleep(60.0)


class AskedToEnd(Ready):
    """Ctrl-C comes while it is made."""

    def __init__(self, bus: Any, arguments: Any) -> None:
        super().__init__(bus, arguments)
        signal.raise_signal(signal.SIGINT)
        arguments.ending.wait()


class SignalsItsThread(Ready):
    """Linux gives the signal to the thread of its callbacks, and the main thread waits on."""

    def begin(self) -> None:
        super().begin()
        self.create_timer(0.3, lambda: signal.pthread_kill(threading.get_ident(), signal.SIGINT))


class Waiting(Ready):
    """Waits for somebody who never comes before it begins."""

    def __init__(self, bus: Any, arguments: Any) -> None:
        super().__init__(bus, arguments)
        self.log.info('running')
        while True:
            self.still_wanted()
            time.sleep(0.01)


class Buggy(Ready):
    """Has a bug in a callback."""

    def begin(self) -> None:
        super().begin()
        raise ZeroDivisionError('the bug')


class Troubled(Ready):
    """Has trouble that it is made for."""

    def begin(self) -> None:
        super().begin()
        self.create_timer(0.01, self._fail)

    def _fail(self) -> None:
        raise DeviceLostError('the camera is gone; plug it in')


class NoDevice(Ready):
    """Cannot start."""

    def __init__(self, bus: Any, arguments: Any) -> None:
        super().__init__(bus, arguments)
        raise DeviceNotFoundError('there is no camera 7; see: tactile doctor')


def run(names: list[str], argv: list[str], output: str, environment: dict[str, str]) -> None:
    """The body of a program that runs the nodes of these classes; its output goes to a file."""
    os.environ.update(environment)
    descriptor = os.open(output, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
    os.dup2(descriptor, 2)
    sys.stderr = open(2, 'w', buffering=1, closefd=False)  # noqa: SIM115 - it lasts as long as the program
    sys.exit(run_nodes([globals()[name] for name in names], argv))


class Program:
    """A running program, and what it has written."""

    def __init__(self, folder: Path, names: list[str], argv: list[str], environment: dict[str, str]) -> None:
        self._output = folder / 'output'
        self._output.touch()
        place = {'TACTILE_RUN_DIR': str(folder), **environment}
        self.process = CONTEXT.Process(target=run, args=(names, argv, str(self._output), place))
        self.process.start()

    @property
    def output(self) -> str:
        return self._output.read_text()

    def signal(self, number: int) -> None:
        """Of one that has ended meanwhile nobody is left to hear it."""
        assert self.process.pid is not None
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.process.pid, number)

    def ended(self, within_s: float) -> int | None:
        """The exit status; None when it still runs after `within_s`."""
        self.process.join(within_s)
        return self.process.exitcode
