"""A running hand, or a relay in its place; a subscriber to all its forces; and disturbances of one sensor."""

from __future__ import annotations

import os
import signal
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil
import yaml

from benchmarks.faults.launch import Launch
from benchmarks.gaps import Arrivals
from benchmarks.harness.workers import own_bus, processor_s
from benchmarks.latency import relay
from benchmarks.latency.pictures import recorded_camera
from benchmarks.page.launch import longest
from tactile_nodes.bus import topics
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import NS_PER_S, SystemClock, monotonic_s
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.launching.hand import arguments_of, parameter_text
from tactile_nodes.learning.progress import Bar
from tactile_nodes.sensors import load_hand

PATIENCE_S, MESSAGE_WITHIN_S, STOP_WITHIN_S, STEP_S = 90.0, 4.0, 20.0, 1.0
SETTLES_S = 10.0  # from the first forces until eight sensors on two slow cores have started
TROUBLES = 'hangs', 'dies', 'floods'
DIES_EVERY_S, FLOODS = 2.0, 10.0


@dataclass(frozen=True)
class HandArrivals:
    """The forces of the observed sensors, and the CPU load (cores) of the processes of all sensors."""

    streams: list[Arrivals]
    cores: float


@dataclass(frozen=True)
class RunningHand:
    """The names of the sensors, their forces, and their launch."""

    names: tuple[str, ...]
    forces: dict[str, Subscription]
    launch: Launch
    bus: ZmqBus

    def processes(self) -> list[psutil.Process]:
        """All processes of the launch, including their child processes."""
        return psutil.Process(self.launch.pid).children(recursive=True)

    def sensing_process(self, name: str) -> int | None:
        """The process for motion and force of a sensor; None while it restarts."""
        for each in self.processes():
            words = _words(each)
            if f'__ns:=/{name}' in words and 'flow_features' in words:
                return each.pid
        return None

    def listen(self, seconds: float, hz: float, bar: Bar, without: int = 0) -> HandArrivals:
        """Receive from all sensors but the first `without`."""
        streams = {name: Arrivals(frame_ns=NS_PER_S / hz) for name in self.names[without:]}
        for each in self.forces.values():
            while each.take() is not None:
                pass
        before, begun_s = {each.pid: processor_s(each) for each in self.processes()}, monotonic_s()
        while (left_s := begun_s + seconds - monotonic_s()) > 0:
            threading.Event().wait(min(STEP_S, left_s))
            for name, stream in streams.items():
                while (received := self.forces[name].take()) is not None:
                    stream.take(received)
            bar.advance(1, f'{sum(each.skipped for each in streams.values())} images without a force')
        took_s = monotonic_s() - begun_s
        spent = sum(processor_s(each) - before.get(each.pid, 0.0) for each in self.processes())
        if not all(each.late_ms for each in streams.values()):
            raise ConfigurationError(f'a sensor brought no force for {seconds:g} s; {self.launch.output[-2000:]}')
        return HandArrivals(list(streams.values()), spent / took_s)


@contextmanager
def disturbed(hand: RunningHand, trouble: str) -> Iterator[None]:
    """During the block the first sensor hangs, or dies repeatedly; any other trouble is ignored."""
    first, over = hand.names[0], threading.Event()
    with ExitStack() as ended:
        if trouble == 'hangs' and (pid := hand.sensing_process(first)) is not None:
            os.kill(pid, signal.SIGSTOP)
            ended.callback(os.kill, pid, signal.SIGCONT)
        if trouble == 'dies':
            killer = threading.Thread(target=_kill, args=(hand, first, over), name='killer', daemon=True)
            killer.start()
            ended.callback(killer.join)
            ended.callback(over.set)
        yield


def _kill(hand: RunningHand, name: str, over: threading.Event) -> None:
    while not over.wait(DIES_EVERY_S):
        if (pid := hand.sensing_process(name)) is not None:
            os.kill(pid, signal.SIGKILL)


def written(folder: Path, count: int, hz: float, model: str, *, floods: bool) -> Path:
    """A hand file in `folder`, with pictures and parameters for each sensor.

    Raises:
        ConfigurationError: the pictures cannot be written.
    """
    pictures, config = recorded_camera(folder)
    text = Path(config.removeprefix('config:=')).read_text(encoding='ascii')
    sensors = []
    for number in range(count):
        own = folder / f's{number}.yaml'
        own.write_text(text, encoding='ascii')
        place = {'position_mm': [0.0, 0.0, 40.0 * number]}
        source = pictures.removeprefix('source:=')
        sensors.append({'name': f's{number}', 'source': source, 'model': model, 'config': str(own), 'frame': place})
    file = folder / 'hand.yaml'
    file.write_text(yaml.safe_dump({'frame': 'hand', 'fps': hz, 'sensors': sensors}), encoding='utf-8')
    if floods:
        (folder / 's0.yaml').write_text(f'{text}/s0/camera: {{ros__parameters: {{fps: {FLOODS * hz}}}}}\n', 'ascii')
    return file


@contextmanager
def hand(file: Path) -> Iterator[RunningHand]:
    """Start a hand as users do.

    Raises:
        ConfigurationError: it did not start.
    """
    with _launched('hand', load_hand(file).names, f'hand:={file}', 'page_port:=0') as running:
        yield running


@contextmanager
def relayed_hand(folder: Path, file: Path) -> Iterator[RunningHand]:
    """Start a relay for each sensor, which repeats messages recorded from the real hand before.

    Raises:
        ConfigurationError: it did not start.
    """
    with hand(file) as real:
        for topic in relay.RELAYED:
            relay.keep(folder, topic, longest(real.bus, f'/{real.names[0]}/{topic.name}', topic, MESSAGE_WITHIN_S))
    whole = load_hand(file)
    launch = relay.relayed(folder)
    parts: list[dict[str, object]] = []
    for sensor in whole.sensors:
        own = folder / f'{sensor.name}_whole.yaml'
        own.write_text(parameter_text(sensor, whole, open_within_s=0.0), encoding='utf-8')
        words = [{'name': name, 'value': value} for name, value in arguments_of(sensor, '', own).items()]
        parts.append({'group': [{'include': {'file': str(launch), 'arg': words}}]})
    for program, more in (('hand_wrench_node', {}), ('live_view_node', {'port': 0})):
        parameters = [{'name': name, 'value': value} for name, value in {'hand': str(file), **more}.items()]
        parts.append({'node': {'pkg': 'tactile_nodes', 'exec': program, 'output': 'screen', 'param': parameters}})
    document = folder / 'relayed_hand.launch.yaml'
    document.write_text(yaml.safe_dump({'launch': parts}), encoding='utf-8')
    with relay.relaying(folder), _launched(str(document), whole.names) as running:
        yield running


@contextmanager
def _launched(file: str, names: Sequence[str], *words: str) -> Iterator[RunningHand]:
    with tempfile.TemporaryDirectory(prefix='th') as folder, own_bus(Path(folder)):
        launch, bus = Launch((*words, '--noninteractive'), Path(folder) / 'said.txt', SystemClock(), file), ZmqBus()
        try:
            topic, forces = topics.FORCE_DISTRIBUTION, {}
            for name in names:
                forces[name] = bus.subscribe(f'/{name}/{topic.name}', topic.type_name, Qos('queue', 10_000))
            for name, each in forces.items():
                if each.get(PATIENCE_S) is None:
                    raise ConfigurationError(
                        f'no force of {name} within {PATIENCE_S:g} s; it says: {launch.output[-2000:]}'
                    )
            threading.Event().wait(SETTLES_S)
            yield RunningHand(tuple(names), forces, launch, bus)
        finally:
            bus.close()
            launch.interrupt(STOP_WITHIN_S)


def _words(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:
        return []
