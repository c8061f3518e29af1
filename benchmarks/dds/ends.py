"""The processes of the DDS benchmark: a publisher and a subscriber on the bus, the bridge, a reader in the graph."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any

import psutil

from benchmarks.harness.workers import Worker, processor_s
from benchmarks.streams import ANSWER_WITHIN_S, SENT, Lateness, Times, answer, late, listen, publish, streams
from tactile_nodes import messages
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.dds.opening import open_participant
from tactile_nodes.dds.settings import Discovery

_SETTLE_S = 1.0


class Bridge:
    """The process of the bridge."""

    def __init__(self, folder: str, domain: int) -> None:
        place = {**os.environ, 'TACTILE_RUN_DIR': folder, 'ROS_DOMAIN_ID': str(domain)}
        program = [sys.executable, '-m', 'tactile_nodes.nodes.composed', 'dds_bridge']
        self._process = subprocess.Popen([*program, '--ros-args', '--log-level', 'warn'], env=place)
        self._meter = psutil.Process(self._process.pid)

    def cpu_s(self) -> float:
        """CPU time since its start."""
        return processor_s(self._meter)

    def close(self) -> None:
        self._process.terminate()
        self._process.wait()


class Ends:
    """All processes; `watch` measures."""

    def __init__(self, folder: str, domain: int, rate_hz: float) -> None:
        self.bridge: Bridge | None = None
        self._folder, self._domain = folder, domain
        self._source = Worker(publish, folder, domain, rate_hz, streams([''], ['']))
        self._listener = Worker(listen, folder, domain, streams([''], ['']))
        self._reader: Worker | None = None
        self._stuck: Worker | None = None

    def start_reader(self) -> None:
        self._reader = Worker(_read, self._folder, self._domain)

    def start_stuck(self) -> None:
        """Start a reader that stops reading after the bridge has found it."""
        self._stuck = Worker(_read, self._folder, self._domain)
        self._stuck.ask('wait')
        _signal(self._stuck, signal.SIGSTOP)

    def watch(self, seconds: float) -> tuple[int, dict[str, Times], dict[str, Times] | None, float | None]:
        """Frames sent; delays on the bus, and over DDS; CPU load of the bridge [% of a core]."""
        SystemClock().sleep_until(SystemClock().now_ns() + round(_SETTLE_S * NS_PER_S))
        for end in filter(None, (self._listener, self._reader)):
            end.ask('wait')
        before_s = self.bridge.cpu_s() if self.bridge else 0.0
        first_ns, last_ns, sent = self._source.ask(seconds, ANSWER_WITHIN_S + seconds)
        spent_s = self.bridge.cpu_s() - before_s if self.bridge else None
        listened = _times(self._listener.ask((first_ns, last_ns)))
        read = _times(self._reader.ask((first_ns, last_ns))) if self._reader else None
        return sent, listened, read, None if spent_s is None else 100.0 * spent_s / seconds

    def close(self) -> None:
        if self._stuck:
            _signal(self._stuck, signal.SIGCONT)
        for end in (self.bridge, self._reader, self._stuck, self._listener, self._source):
            if end is not None:
                end.close()


def _times(seen: Mapping[str, list[tuple[int, int]]]) -> dict[str, Times]:
    return {name.lstrip('/'): late(each) for name, each in seen.items()}


def _signal(worker: Worker, number: int) -> None:
    assert worker.process.pid is not None
    os.kill(worker.process.pid, number)


def _read(pipe: Connection, folder: str, domain: int) -> None:
    del folder
    participant, clock = open_participant(domain, Discovery()), SystemClock()
    lateness = Lateness([topic.name for topic in SENT])
    readers: dict[str, Any] = {}

    def take(name: str, type_name: str) -> None:
        for _, data in readers[name].take():
            now_ns = clock.now_ns()
            lateness.add(name, messages.stamp_ns(messages.decode(data, type_name).header.stamp), now_ns)

    def on_data(name: str, type_name: str) -> Callable[[], None]:
        return lambda: take(name, type_name) if name in readers else None

    for topic in SENT:
        ready = on_data(topic.name, topic.type_name)
        readers[topic.name] = participant.reader('/' + topic.name, topic.type_name, Qos('queue', 100), ready)
    answer(pipe, lateness)
    readers.clear()
    participant.close()
