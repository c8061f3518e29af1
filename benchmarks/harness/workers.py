"""Processes of a benchmark, which get requests and return measurements through a pipe."""

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
"""A fork would inherit threads, sockets and imported modules."""
LONGEST_S = 60.0


class Worker:
    """A process that runs `body` with its end of the pipe and the other arguments."""

    def __init__(self, body: Callable[..., None], *arguments: Any) -> None:
        self._pipe, theirs = SPAWN.Pipe()
        self.process = SPAWN.Process(target=body, args=(theirs, *arguments), daemon=True)
        self.process.start()
        theirs.close()

    def send(self, what: Any) -> None:
        """Send a request without waiting."""
        self._pipe.send(what)

    def ask(self, what: Any, within_s: float = LONGEST_S) -> Any:
        """Send a request and wait for the answer; see `answer`."""
        self.send(what)
        return self.answer(within_s)

    def answer(self, within_s: float = LONGEST_S) -> Any:
        """The next answer.

        Raises:
            TactileError: no answer in time, or the process has ended, or it reports an error.
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
        """End the process, by closing its pipe."""
        self._pipe.close()
        self.process.join(5.0)
        self.process.kill()


def asked(pipe: Connection) -> Iterator[Any]:
    """In the process: all requests, until the pipe is closed."""
    while True:
        try:
            yield pipe.recv()
        except EOFError:
            return


def own_bus(folder: Path) -> AbstractContextManager[None]:
    """A separate bus for this process and its child processes, whose logs are also in `folder`."""
    return environment(TACTILE_RUN_DIR=str(folder), ROS_LOG_DIR=str(folder / 'log'))


@contextmanager
def environment(**values: str) -> Iterator[None]:
    """Set environment variables during the block, also for processes started in it."""
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
    """CPU time used by a process [s]."""
    times = process.cpu_times()
    return float(times.user + times.system)
