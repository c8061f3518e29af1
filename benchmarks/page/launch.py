"""A real ``tactile launch live`` with its page, on a separate bus, with a subscriber to its forces."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.faults.launch import Launch
from benchmarks.harness.workers import own_bus
from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Bus, Qos, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.topics import Topic
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import NS_PER_S, Clock, SystemClock, monotonic_s
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.messages import encode

PATIENCE_S, STOP_WITHIN_S = 60.0, 15.0
LOOK_NS = NS_PER_S // 10
_SERVED = re.compile(r'the live view is at (http://\S+)')


@dataclass(frozen=True)
class Sensing:
    """A running sensor: the address of its page, its launch, the subscriber's bus, and its forces."""

    url: str
    launch: Launch
    bus: Bus
    _forces: Subscription

    @property
    def pids(self) -> dict[str, int]:
        """Its processes by name."""
        return self.launch.pids

    def forces(self, seconds: float, *, fresh: bool = True) -> Iterator[Received]:
        """The forces of the next `seconds`; with `fresh`, without those that are already in the queue."""
        end_s = monotonic_s() + seconds
        while fresh and self._forces.take() is not None:
            pass
        while (left_s := end_s - monotonic_s()) > 0:
            if (received := self._forces.get(left_s)) is not None:
                yield received

    def watch_for(self, seconds: float) -> None:
        """Wait for `seconds`.

        Raises:
            ConfigurationError: no force came.
        """
        if not sum(1 for _ in self.forces(seconds)):
            raise ConfigurationError('the launch senses nothing; see what it says: tactile launch live')


def longest(bus: Bus, name: str, topic: Topic, seconds: float) -> Any:
    """The message with the most bytes among those received within `seconds`.

    Raises:
        ConfigurationError: no message came.
    """
    subscription = bus.subscribe(name, topic.type_name, Qos('queue', 1000))
    end_s, found = monotonic_s() + seconds, []
    while (left_s := end_s - monotonic_s()) > 0:
        if (received := subscription.get(left_s)) is not None:
            found.append(received.message)
    subscription.close()
    if not found:
        raise ConfigurationError(f'nothing came on {name} within {seconds:g} s')
    return max(found, key=lambda message: len(encode(message)))


@contextmanager
def sensing(*words: str, file: str = 'live', log: Path | None = None) -> Iterator[Sensing]:
    """Start a launch with arguments such as `model:=portable`; at the end, stop it with all its processes.

    `file` is the launch file, `log` the file for its output, which is otherwise deleted.

    Raises:
        ConfigurationError: the launch did not start.
    """
    with tempfile.TemporaryDirectory(prefix='tp') as folder, own_bus(Path(folder)):
        clock, chosen = SystemClock(), ('page_port:=0', *words, '--noninteractive')
        launch, bus = Launch(chosen, log or Path(folder) / 'said.txt', clock, file), ZmqBus()
        try:
            topic = topics.FORCE_DISTRIBUTION
            forces = bus.subscribe(f'/{topic.name}', topic.type_name, Qos('queue', 1000))
            if forces.get(PATIENCE_S) is None:
                raise ConfigurationError(f'no force within {PATIENCE_S:g} s; the launch says: {launch.output}')
            yield Sensing(_served(launch, clock), launch, bus, forces)
        finally:
            bus.close()
            launch.interrupt(STOP_WITHIN_S)


def _served(launch: Launch, clock: Clock) -> str:
    """The address of the page, which may start later than the first force."""
    end_s = monotonic_s() + PATIENCE_S
    while (found := _SERVED.search(launch.output)) is None and monotonic_s() < end_s:
        clock.sleep_until(clock.now_ns() + LOOK_NS)
    if found is None:
        raise ConfigurationError(f'the launch serves no page; it says: {launch.output}')
    return found[1]
