"""The processes of the bus benchmark, which are controlled through a pipe."""

from __future__ import annotations

from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from benchmarks.bus.ends import Inside, Receiver, Sender
from benchmarks.harness.workers import Worker, asked
from tactile_nodes.bus.zeromq.host_bus import ZmqBus

_ROLES: dict[str, Callable[[ZmqBus, str], Any]] = {
    'send': Sender,
    'receive': Receiver,
    'inside': lambda bus, _: Inside(bus),
}
_INSIDE_DOMAIN = 1  # so that it does not receive from the sending process


class End(Worker):
    """One of the processes. A request is the name of a method of its sender or receiver, and its arguments."""

    def __init__(self, role: str, folder: str) -> None:
        super().__init__(_serve, role, folder)
        self.answer()


def _serve(pipe: Connection, role: str, folder: str) -> None:
    bus = ZmqBus(_INSIDE_DOMAIN if role == 'inside' else 0, folder=Path(folder))
    end = _ROLES[role](bus, f'ipc://{folder}/floor')
    pipe.send('ready')
    for verb, *arguments in asked(pipe):
        pipe.send(getattr(end, verb)(*arguments))
    end.close()
    bus.close()
