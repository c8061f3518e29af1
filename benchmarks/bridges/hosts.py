"""The programs on the two hosts: a publisher, both bridges, a subscriber, and a stranger without a key."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from benchmarks.bridges.network import ADDRESSES, Network
from benchmarks.harness.workers import Worker, processor_s
from benchmarks.streams import ANSWER_WITHIN_S, listen, publish, streams
from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.errors import TactileError

PORT = 7460
SENSORS, PICTURES, RATE_HZ = 10, 2, 60.0
DOMAIN = 97
_PICTURES = [f'/s{number}' for number in range(PICTURES)]
_FORCES = [f'/s{number}' for number in range(SENSORS)]
STREAMS = streams(_PICTURES, _FORCES)
Seen = dict[str, list[tuple[int, int]]]


@dataclass(frozen=True)
class Contender:
    """A bridge between hosts: the bridge node of a checkout of this project, or its DDS bridge."""

    name: str
    tree: Path
    dds: bool = False
    found: bool = False
    """Whether the hosts get no addresses and must find each other."""


class Side:
    """One host: a folder of sockets, and its bridge."""

    def __init__(self, host: str, folder: Path, words: list[str], contender: Contender, keys: Path) -> None:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self.folder = folder
        node = 'dds_bridge' if contender.dds else 'bridge'
        settings = [word for value in words for word in ('-p', value)]
        program = [sys.executable, '-m', f'tactile_nodes.nodes.{node}', '--ros-args', '--log-level', 'error', *settings]
        self._words = ['ip', 'netns', 'exec', host, *program]
        self._tree = contender.tree
        self._environment = {
            **os.environ, 'TACTILE_RUN_DIR': str(folder), 'TACTILE_KEYS': str(keys), 'ROS_DOMAIN_ID': str(DOMAIN),
            'PYTHONPATH': str(contender.tree),
        }  # fmt: skip
        self.start()

    def start(self) -> None:
        """Start the bridge; also again after `kill`."""
        self._process = subprocess.Popen(self._words, env=self._environment, cwd=self._tree)
        self._meter = psutil.Process(self._process.pid)  # `ip netns exec` becomes the program

    def kill(self) -> None:
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()

    def cpu_s(self) -> float:
        """CPU time of the bridge since its start."""
        return processor_s(self._meter)

    def memory_mb(self) -> float:
        return float(self._meter.memory_info().rss) / 1e6

    def close(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.kill()


class Pair:
    """Both running hosts."""

    def __init__(self, robot: Side, lab: Side, source: Worker, listener: Worker) -> None:
        self.robot, self.lab = robot, lab
        self._source, self._listener = source, listener

    def wait(self) -> None:
        """Wait until a message was received on every topic."""
        self._listener.ask('wait', ANSWER_WITHIN_S)

    def measured(self, seconds: float) -> tuple[int, Seen, float]:
        """Measure for `seconds`: published frames (number), received messages, CPU load of both bridges (cores)."""
        before_s = self.robot.cpu_s() + self.lab.cpu_s()
        first_ns, last_ns, sent = self._source.ask(seconds, ANSWER_WITHIN_S + seconds)
        cores = (self.robot.cpu_s() + self.lab.cpu_s() - before_s) / seconds
        return sent, self.since(first_ns, last_ns), cores

    def since(self, first_ns: int, last_ns: int) -> Seen:
        """The received messages of those published in this interval."""
        seen: Seen = self._listener.ask((first_ns, last_ns))
        return seen

    def first_after(self, start_ns: int, within_s: float) -> float | None:
        """Seconds until a force published after `start_ns` is received; None if none comes in time."""
        clock = SystemClock()
        while clock.now_ns() < start_ns + within_s * NS_PER_S:
            found = self.since(start_ns, start_ns + round(within_s * NS_PER_S))
            times = [
                stamp_ns + late_ns for name, seen in found.items() if 'force' in name for stamp_ns, late_ns in seen
            ]
            if times:
                return (min(times) - start_ns) / NS_PER_S
            clock.sleep_until(clock.now_ns() + NS_PER_S // 5)
        return None


@contextmanager
def pair(contender: Contender, made: Network) -> Iterator[Pair]:
    """Both hosts, which know each other's keys."""
    with tempfile.TemporaryDirectory(prefix='tb') as name, ExitStack() as stack:
        folder = Path(name)
        _make_keys(contender, folder)
        robot, lab = (Side(host, folder / end, words, contender, folder / 'keys') for host, end, words in zip(
            made.hosts, ('a', 'b'), _settings(contender), strict=True
        ))  # fmt: skip
        for side in (robot, lab):
            stack.callback(side.close)
        source = Worker(publish, str(robot.folder), DOMAIN, RATE_HZ, STREAMS)
        listener = Worker(listen, str(lab.folder), DOMAIN, STREAMS)
        for worker in (source, listener):
            stack.callback(worker.close)
        yield Pair(robot, lab, source, listener)


def stranger_hears(contender: Contender, made: Network, running: Pair, seconds: float) -> int:
    """Number of messages that a stranger without an accepted key gets from the second host."""
    folder = running.lab.folder.parent
    side = Side(made.hosts[1], folder / 'c', _settings(contender, name='stranger')[1], contender, folder / 'keys')
    listener = Worker(listen, str(side.folder), DOMAIN, STREAMS)
    try:
        running.measured(seconds)
        return sum(map(len, listener.ask((0, 1 << 62)).values()))
    finally:
        listener.close()
        side.close()


def _settings(contender: Contender, name: str = 'lab') -> tuple[list[str], list[str]]:
    """The parameters of the two bridges."""
    if contender.dds:
        wanted = ', '.join(f'{topic}@{entry.type_name}' for topic, entry in STREAMS)
        return (
            ['discovery_range:=SUBNET', "send:=['/**']"],
            ['discovery_range:=SUBNET', "send:=['/nothing']", f'take:=[{wanted}]'],
        )
    theirs = [f'key:={name}', 'peers:=[robot]']
    if contender.found and name == 'lab':
        looking = [f'listen:=0.0.0.0:{PORT}', 'discover:=true']
        return [*looking, 'key:=robot', 'peers:=[lab]'], [*looking, *theirs]
    return (
        [f'listen:={ADDRESSES[0]}:{PORT}', 'key:=robot', 'peers:=[lab]'],
        [f'connect:={ADDRESSES[0]}:{PORT}', *theirs],
    )


def _make_keys(contender: Contender, folder: Path) -> None:
    if contender.dds:
        return
    environment: Mapping[str, Any] = {
        **os.environ, 'TACTILE_KEYS': str(folder / 'keys'), 'PYTHONPATH': str(contender.tree)
    }  # fmt: skip
    for name in ('robot', 'lab', 'stranger'):
        words = [sys.executable, '-m', 'tactile_nodes', 'keys', 'create', name]
        made = subprocess.run(
            words, env=environment, cwd=contender.tree, capture_output=True, text=True, check=False
        )  # fmt: skip
        if made.returncode:
            raise TactileError(f'no keys for {contender.name}: {made.stderr.strip()}')
