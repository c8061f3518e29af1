"""The processes of the bus benchmark: what they do is asked of them through a pipe."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from benchmarks.bus.ends import Inside, Receiver, Sender
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.errors import BusError

_ROLES: dict[str, Callable[[ZmqBus, str], Any]] = {
    'send': Sender,
    'receive': Receiver,
    'inside': lambda bus, _: Inside(bus),
}
_LONGEST_S = 60.0
_INSIDE_DOMAIN = 1  # so that it does not hear the sending process


class Worker:
    """One of the processes."""

    def __init__(self, role: str, folder: str) -> None:
        context = multiprocessing.get_context('spawn')  # a fork would inherit threads and sockets
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, role, folder), daemon=True)
        self._process.start()
        theirs.close()
        self._answer()

    def ask(self, verb: str, *arguments: Any) -> Any:
        """Have it call a method of its end; the result."""
        return self.begin(verb, *arguments)()

    def begin(self, verb: str, *arguments: Any) -> Callable[[], Any]:
        """The same without waiting; gives the function that waits for the result."""
        self._pipe.send((verb, *arguments))
        return self._answer

    def close(self) -> None:
        """End it."""
        if self._process.is_alive():
            self._pipe.send(None)
        self._process.join(5.0)
        self._process.kill()

    def _answer(self) -> Any:
        try:
            if not self._pipe.poll(_LONGEST_S):
                raise BusError(f'a process of the benchmark did not answer for {_LONGEST_S:g} s; is the machine idle?')
            return self._pipe.recv()
        except (EOFError, ConnectionResetError) as error:
            raise BusError('a process of the benchmark has ended; what it said stands above') from error


def _serve(pipe: Connection, role: str, folder: str) -> None:
    bus = ZmqBus(_INSIDE_DOMAIN if role == 'inside' else 0, folder=Path(folder))
    end = _ROLES[role](bus, f'ipc://{folder}/floor')
    pipe.send('ready')
    while (asked := pipe.recv()) is not None:
        verb, *arguments = asked
        pipe.send(getattr(end, verb)(*arguments))
    end.close()
    bus.close()
