"""Processes of a benchmark, which are asked through a pipe what to do and what they have measured."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import psutil

from tactile_nodes.errors import TactileError

SPAWN = multiprocessing.get_context('spawn')
"""A fork would inherit threads, sockets and what the parent has imported."""
LONGEST_S = 60.0


class Worker:
    """A process that runs `body`, which gets its end of the pipe and the other arguments."""

    def __init__(self, body: Callable[..., None], *arguments: Any) -> None:
        self._pipe, theirs = SPAWN.Pipe()
        self.process = SPAWN.Process(target=body, args=(theirs, *arguments), daemon=True)
        self.process.start()
        theirs.close()

    def send(self, what: Any) -> None:
        """Ask without waiting."""
        self._pipe.send(what)

    def ask(self, what: Any, within_s: float = LONGEST_S) -> Any:
        """Ask, and wait for the answer; see `answer`."""
        self.send(what)
        return self.answer(within_s)

    def answer(self, within_s: float = LONGEST_S) -> Any:
        """What it says next.

        Raises:
            TactileError: it says nothing in time, has ended, or says why it could not.
        """
        try:
            if not self._pipe.poll(within_s):
                raise TactileError(
                    f'a process of the benchmark did not answer for {within_s:g} s; is the machine idle?'
                )
            answer = self._pipe.recv()
        except (EOFError, ConnectionResetError) as error:
            raise TactileError('a process of the benchmark has ended; what it said stands above') from error
        if isinstance(answer, TactileError):
            raise answer
        return answer

    def close(self) -> None:
        """End it: it hears of it as the end of what it is asked."""
        self._pipe.close()
        self.process.join(5.0)
        self.process.kill()


def asked(pipe: Connection) -> Iterator[Any]:
    """In the process: all that it is asked, until nobody asks any more."""
    while True:
        try:
            yield pipe.recv()
        except EOFError:
            return


def own_bus(folder: Path) -> AbstractContextManager[None]:
    """A bus that nobody else hears, for this process and those that it starts, whose logs are kept there too."""
    return environment(TACTILE_RUN_DIR=str(folder), ROS_LOG_DIR=str(folder / 'log'))


@contextmanager
def environment(**values: str) -> Iterator[None]:
    """For as long as the block runs, and for processes that begin meanwhile."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def processor_s(process: psutil.Process) -> float:
    """Processor time that a process has taken."""
    times = process.cpu_times()
    return float(times.user + times.system)
