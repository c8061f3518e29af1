"""Processes that publish pictures and forces of simulated sensors, and processes that measure their delay."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from benchmarks.harness.workers import asked
from tactile_nodes import conversions, messages
from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.topics import Topic
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.messages import types

Stream = tuple[str, Topic]
"""The full name of a topic, and its entry in the topic table."""
Times = list[int]
"""Delay of each message [ns]."""
SENT = (topics.IMAGE, topics.FORCE_DISTRIBUTION)
ANSWER_WITHIN_S = 60.0
_DEEP = 10_000


def streams(pictures: Sequence[str], forces: Sequence[str]) -> list[Stream]:
    """The topics of pictures and forces of the sensors in these namespaces ('' or '/left')."""
    return [(f'{space}/{topics.IMAGE.name}', topics.IMAGE) for space in pictures] + [
        (f'{space}/{topics.FORCE_DISTRIBUTION.name}', topics.FORCE_DISTRIBUTION) for space in forces
    ]


def publish(pipe: Connection, folder: str, domain: int, rate_hz: float, sent: list[Stream]) -> None:
    """Publish continuously. A request of some seconds is answered with first stamp, last stamp and number of frames."""
    bus, clock = ZmqBus(domain, folder=Path(folder)), SystemClock()
    ends = [(bus.advertise(name, topic.type_name, topic.qos, '/source'), topic) for name, topic in sent]
    stamps: list[int] = []
    ending = threading.Event()

    def work() -> None:
        due_ns = clock.now_ns()
        while not ending.is_set():
            clock.sleep_until(due_ns)
            stamps.append(clock.now_ns())
            frame = dict(zip((topic.name for topic in SENT), _frame(stamps[-1]), strict=True))
            for end, topic in ends:
                end.publish(frame[topic.name])
            due_ns += round(NS_PER_S / rate_hz)

    worker = threading.Thread(target=work)
    worker.start()
    for seconds in asked(pipe):
        begin = len(stamps)
        clock.sleep_until(clock.now_ns() + round(seconds * NS_PER_S))
        end_of = len(stamps) - 1
        pipe.send((stamps[begin], stamps[end_of - 1], end_of - begin))
        clock.sleep_until(clock.now_ns() + NS_PER_S // 2)  # for messages that are still on their way
    ending.set()
    worker.join()
    bus.close()


def listen(pipe: Connection, folder: str, domain: int, wanted: list[Stream]) -> None:
    """Receive continuously, and answer requests as in `answer`."""
    bus, clock = ZmqBus(domain, folder=Path(folder)), SystemClock()
    lateness = Lateness([name for name, _ in wanted])
    inboxes = {name: bus.subscribe(name, topic.type_name, Qos('queue', _DEEP), '/listener') for name, topic in wanted}

    def work(name: str) -> None:
        while (received := inboxes[name].get(ANSWER_WITHIN_S)) is not None:
            lateness.add(name, messages.stamp_ns(received.message.header.stamp), clock.now_ns())

    for name in inboxes:
        threading.Thread(target=work, args=(name,), daemon=True).start()
    answer(pipe, lateness)
    bus.close()


class Lateness:
    """Stamps and delays of the received messages, by topic."""

    def __init__(self, names: Sequence[str]) -> None:
        self._seen: dict[str, list[tuple[int, int]]] = {name: [] for name in names}

    def add(self, name: str, stamp_ns: int, now_ns: int) -> None:
        self._seen[name].append((stamp_ns, now_ns - stamp_ns))

    @property
    def complete(self) -> bool:
        """Whether a message was received on every topic."""
        return all(self._seen.values())

    def between(self, first_ns: int, last_ns: int) -> dict[str, list[tuple[int, int]]]:
        """Stamps and delays of the messages captured in this interval."""
        return {
            name: [(stamp_ns, late_ns) for stamp_ns, late_ns in seen if first_ns <= stamp_ns <= last_ns]
            for name, seen in self._seen.items()
        }


def answer(pipe: Connection, lateness: Lateness) -> None:
    """Answer 'wait' once every topic has a message, and (first, last) with the messages of that interval."""
    clock = SystemClock()
    for what in asked(pipe):
        while what == 'wait' and not lateness.complete:
            clock.sleep_until(clock.now_ns() + NS_PER_S // 50)
        pipe.send(True if what == 'wait' else lateness.between(*what))


def late(seen: Sequence[tuple[int, int]]) -> Times:
    """The delay of each message."""
    return [late_ns for _, late_ns in seen]


def _frame(stamp_ns: int) -> tuple[types.Image, types.ForceDistribution]:
    head = conversions.header(stamp_ns, 'gel')
    pixels = np.full((440, 440), stamp_ns % 251, np.uint8)
    force = types.ForceDistribution(header=head, rows=9, cols=9, normal_force=np.zeros(81, np.float32))
    return conversions.image_message(pixels, head), force
