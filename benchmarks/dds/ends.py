"""The processes of the benchmark of DDS: who publishes, who listens on the bus, the bridge, who reads in the graph."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.harness.workers import Worker, asked, processor_s
from tactile_nodes import conversions, messages
from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.topics import Topic
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.dds.opening import open_participant
from tactile_nodes.dds.settings import Discovery
from tactile_nodes.messages import types

Times = list[int]
"""How late each message was [ns]."""
SENT = (topics.IMAGE, topics.FORCE_DISTRIBUTION)
_ANSWER_WITHIN_S = 60.0
_SETTLE_S = 1.0
_DEEP = 10_000


class Bridge:
    """The bridge, as a program."""

    def __init__(self, folder: str, domain: int) -> None:
        place = {**os.environ, 'TACTILE_RUN_DIR': folder, 'ROS_DOMAIN_ID': str(domain)}
        words = [sys.executable, '-m', 'tactile_nodes.nodes.dds_bridge', '--ros-args', '--log-level', 'warn']
        self._process = subprocess.Popen(words, env=place)
        self._meter = psutil.Process(self._process.pid)

    def cpu_s(self) -> float:
        """Processor time since its start."""
        return processor_s(self._meter)

    def close(self) -> None:
        self._process.terminate()
        self._process.wait()


class Ends:
    """All of them; `watch` measures."""

    def __init__(self, folder: str, domain: int, rate_hz: float) -> None:
        self.bridge: Bridge | None = None
        self._folder, self._domain = folder, domain
        self._source = Worker(_publish, folder, domain, rate_hz)
        self._listener = Worker(_listen, folder, domain)
        self._reader: Worker | None = None
        self._stuck: Worker | None = None

    def start_reader(self) -> None:
        self._reader = Worker(_read, self._folder, self._domain)

    def start_stuck(self) -> None:
        """One that has been found by the bridge, and reads no more."""
        self._stuck = Worker(_read, self._folder, self._domain)
        self._stuck.ask('wait')
        _signal(self._stuck, signal.SIGSTOP)

    def watch(self, seconds: float) -> tuple[int, dict[str, Times], dict[str, Times] | None, float | None]:
        """Frames sent; how late each was on the bus, and over DDS; processor time of the bridge [% of a core]."""
        SystemClock().sleep_until(SystemClock().now_ns() + round(_SETTLE_S * NS_PER_S))
        for end in filter(None, (self._listener, self._reader)):
            end.ask('wait')
        before_s = self.bridge.cpu_s() if self.bridge else 0.0
        first_ns, last_ns, sent = self._source.ask(seconds, _ANSWER_WITHIN_S + seconds)
        spent_s = self.bridge.cpu_s() - before_s if self.bridge else None
        heard = self._listener.ask((first_ns, last_ns))
        read = self._reader.ask((first_ns, last_ns)) if self._reader else None
        return sent, heard, read, None if spent_s is None else 100.0 * spent_s / seconds

    def close(self) -> None:
        if self._stuck:
            _signal(self._stuck, signal.SIGCONT)
        for end in (self.bridge, self._reader, self._stuck, self._listener, self._source):
            if end is not None:
                end.close()


def _signal(worker: Worker, number: int) -> None:
    assert worker.process.pid is not None
    os.kill(worker.process.pid, number)


def _publish(pipe: Connection, folder: str, domain: int, rate_hz: float) -> None:
    """Publish all the time; asked with seconds: stamps of the first and last frame of that time, and their number."""
    bus, clock = ZmqBus(domain, folder=Path(folder)), SystemClock()
    ends = [bus.advertise('/' + topic.name, topic.type_name, topic.qos, '/source') for topic in SENT]
    stamps: list[int] = []
    ending = threading.Event()

    def work() -> None:
        due_ns = clock.now_ns()
        while not ending.is_set():
            clock.sleep_until(due_ns)
            stamps.append(clock.now_ns())
            for end, message in zip(ends, _frame(stamps[-1]), strict=True):
                end.publish(message)
            due_ns += round(NS_PER_S / rate_hz)

    worker = threading.Thread(target=work)
    worker.start()
    for seconds in asked(pipe):
        begin = len(stamps)
        clock.sleep_until(clock.now_ns() + round(seconds * NS_PER_S))
        end_of = len(stamps) - 1
        pipe.send((stamps[begin], stamps[end_of - 1], end_of - begin))
        clock.sleep_until(clock.now_ns() + NS_PER_S // 2)  # what is under way still arrives
    ending.set()
    worker.join()
    bus.close()


def _frame(stamp_ns: int) -> tuple[types.Image, types.ForceDistribution]:
    head = conversions.header(stamp_ns, 'gel')
    pixels = np.full((440, 440), stamp_ns % 251, np.uint8)
    force = types.ForceDistribution(header=head, rows=9, cols=9, normal_force=np.zeros(81, np.float32))
    return conversions.image_message(pixels, head), force


def _listen(pipe: Connection, folder: str, domain: int) -> None:
    bus, clock = ZmqBus(domain, folder=Path(folder)), SystemClock()
    times = _Lateness()
    inboxes = {
        topic.name: bus.subscribe('/' + topic.name, topic.type_name, Qos('queue', _DEEP), '/listener') for topic in SENT
    }

    def work(topic: Topic) -> None:
        while (received := inboxes[topic.name].get(_ANSWER_WITHIN_S)) is not None:
            times.add(topic.name, messages.stamp_ns(received.message.header.stamp), clock.now_ns())

    for topic in SENT:
        threading.Thread(target=work, args=(topic,), daemon=True).start()
    _answer(pipe, times)
    bus.close()


def _read(pipe: Connection, folder: str, domain: int) -> None:
    del folder
    participant, clock, times = open_participant(domain, Discovery()), SystemClock(), _Lateness()
    readers: dict[str, Any] = {}

    def take(name: str, type_name: str) -> None:
        for data in readers[name].take():
            now_ns = clock.now_ns()
            times.add(name, messages.stamp_ns(messages.decode(data, type_name).header.stamp), now_ns)

    def on_data(name: str, type_name: str) -> Callable[[], None]:
        return lambda: take(name, type_name) if name in readers else None

    for topic in SENT:
        ready = on_data(topic.name, topic.type_name)
        readers[topic.name] = participant.reader('/' + topic.name, topic.type_name, Qos('queue', 100), ready)
    _answer(pipe, times)
    readers.clear()
    participant.close()


class _Lateness:
    def __init__(self) -> None:
        self._seen: dict[str, list[tuple[int, int]]] = {topic.name: [] for topic in SENT}

    def add(self, topic: str, stamp_ns: int, now_ns: int) -> None:
        self._seen[topic].append((stamp_ns, now_ns - stamp_ns))

    @property
    def complete(self) -> bool:
        return all(self._seen.values())

    def between(self, first_ns: int, last_ns: int) -> dict[str, Times]:
        return {
            topic: [late_ns for stamp_ns, late_ns in seen if first_ns <= stamp_ns <= last_ns]
            for topic, seen in self._seen.items()
        }


def _answer(pipe: Connection, times: _Lateness) -> None:
    """'wait': until something of every topic has come. (first, last): how late each message of that time was."""
    clock = SystemClock()
    for what in asked(pipe):
        while what == 'wait' and not times.complete:
            clock.sleep_until(clock.now_ns() + NS_PER_S // 50)
        pipe.send(True if what == 'wait' else times.between(*what))
