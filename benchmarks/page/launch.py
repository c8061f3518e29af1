"""A real ``tactile launch live`` with its page, on a bus of its own, and somebody who listens to its forces."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import NS_PER_S, SystemClock, monotonic_s
from tactile_nodes.errors import ConfigurationError

PATIENCE_S, STOP_WITHIN_S = 60.0, 15.0
LOOK_NS = NS_PER_S // 10
_STARTED = re.compile(r'\[(\w+)-\d+\]: process started with pid \[(\d+)\]')
_SERVED = re.compile(r'the live view is at (http://\S+)')


@dataclass(frozen=True)
class Sensing:
    """A running sensor: its processes by name, the address of its page, and its forces."""

    url: str
    pids: dict[str, int]
    _forces: Subscription

    def forces(self, seconds: float, *, fresh: bool = True) -> Iterator[Received]:
        """Those that come in the next `seconds`; with `fresh` without those that wait already."""
        end_s = monotonic_s() + seconds
        while fresh and self._forces.take() is not None:
            pass
        while (left_s := end_s - monotonic_s()) > 0:
            if (received := self._forces.get(left_s)) is not None:
                yield received

    def watch_for(self, seconds: float) -> None:
        """Let time pass.

        Raises:
            ConfigurationError: not one force came.
        """
        if not sum(1 for _ in self.forces(seconds)):
            raise ConfigurationError('the launch senses nothing; see what it says: tactile launch live')


@contextmanager
def sensing(*words: str) -> Iterator[Sensing]:
    """Start it, with launch arguments (`model:=accurate`), and end it with all its processes.

    Raises:
        ConfigurationError: it did not come up.
    """
    with tempfile.TemporaryDirectory(prefix='tp') as folder:
        environment = {**os.environ, 'TACTILE_RUN_DIR': folder, 'ROS_LOG_DIR': f'{folder}/log'}
        command = [sys.executable, '-m', 'tactile_nodes', 'launch', 'live', 'page_port:=0', *words, '--noninteractive']
        log = Path(folder) / 'said.txt'
        with log.open('w') as said:
            process = subprocess.Popen(command, env=environment, stdout=said, stderr=subprocess.STDOUT, text=True)
        bus = ZmqBus(folder=Path(folder))
        try:
            topic = topics.FORCE_DISTRIBUTION
            forces = bus.subscribe(f'/{topic.name}', topic.type_name, Qos('queue', 1000))
            if forces.get(PATIENCE_S) is None:
                raise ConfigurationError(f'no force within {PATIENCE_S:g} s; the launch says: {log.read_text()}')
            _await(lambda: _SERVED.search(log.read_text()) is not None)
            yield _described(log.read_text(), forces)
        finally:
            bus.close()
            _end(process)


def _await(ready: Callable[[], bool]) -> None:
    """The page may come up later than the first force."""
    clock, end_s = SystemClock(), monotonic_s() + PATIENCE_S
    while not ready() and monotonic_s() < end_s:
        clock.sleep_until(clock.now_ns() + LOOK_NS)


def _described(said: str, forces: Subscription) -> Sensing:
    served = _SERVED.search(said)
    if served is None:
        raise ConfigurationError(f'the launch serves no page; it says: {said}')
    return Sensing(served[1], {name: int(pid) for name, pid in _STARTED.findall(said)}, forces)


def _end(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGINT)
    try:
        process.wait(STOP_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
