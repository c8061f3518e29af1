"""Overload: a hundred nodes, each in its own process, and sixteen sensors, on one bus."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.endurance.stepped import SIDE_PX, drawn_model
from benchmarks.harness.workers import processor_s
from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.node.node import Node
from tactile_nodes.bus.protocol import Qos
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress
from tactile_nodes.messages import stamp_ns
from tactile_nodes.nodes.flow_features import FlowFeaturesNode
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode

PATIENCE_S, IDLE_S = 120.0, 5.0
_CONTEXT = multiprocessing.get_context('forkserver')
_CONTEXT.set_forkserver_preload(['benchmarks.system_faults.crowd'])


class LightNode(Node):
    """A node with only the common functions: diagnostics, log, parameters."""

    NAME = 'light'


def many_nodes(count: int, idle_s: float, progress: Progress) -> dict[str, Any]:
    """Start `count` processes of one node each; measures the time until all are known, and their cost at rest."""
    clock, bus = SystemClock(), ZmqBus()
    try:
        start_ns = clock.now_ns()
        with (
            _children([(_be_light, (number,)) for number in range(count)]) as children,
            progress.bar('nodes', 1) as bar,
        ):
            ready_ns = clock.now_ns()
            wanted = {f'/crowd/n{number:03d}' for number in range(count)}
            _until(clock, lambda: wanted <= {name for each in bus.graph().participants for name in each.nodes})
            known_ns = clock.now_ns()
            before_s = _cpu_s(children)
            clock.sleep_until(known_ns + round(idle_s * NS_PER_S))
            spent_s = (_cpu_s(children) - before_s) / (clock.now_ns() - known_ns) * NS_PER_S
            memory_mb = [psutil.Process(child.pid).memory_full_info().uss / 2**20 for child in children]
            bar.advance()
    finally:
        bus.close()
    return {
        'nodes': count, 'started_s': (ready_ns - start_ns) / NS_PER_S, 'known_s': (known_ns - ready_ns) / NS_PER_S,
        'cores': spent_s, 'own_mb': float(np.median(memory_mb)), 'load': os.getloadavg()[0],
    }  # fmt: skip


def many_sensors(count: int, rates_hz: Sequence[float], seconds: float, progress: Progress) -> list[dict[str, Any]]:
    """Run `count` sensors in separate namespaces, in two processes; measures the share of images with a force."""
    clock, bus = SystemClock(), ZmqBus()
    kind = topics.FORCE_DISTRIBUTION
    ends = [bus.subscribe(f'/s{number:02d}/{kind.name}', kind.type_name, Qos('queue', 4000)) for number in range(count)]
    found = []
    with tempfile.TemporaryDirectory(prefix='tm') as folder, progress.bar('rates', len(rates_hz)) as bar:
        model = str(drawn_model(Path(folder) / 'drawn.safetensors'))
        halves = [range(first, count, 2) for first in range(2)]
        try:
            with _children([(_sense, (tuple(half), model)) for half in halves]):
                for rate_hz in rates_hz:
                    with _children([(_film, (count, rate_hz, seconds))]) as (camera,):
                        camera.join(seconds * 4 + 60)
                    clock.sleep_until(clock.now_ns() + NS_PER_S)
                    found.append({'rate_hz': rate_hz, 'load': os.getloadavg()[0], **_answered(ends, rate_hz * seconds)})
                    bar.advance(text=f'{rate_hz:g} Hz: {found[-1]["answered"]:.1%}')
        finally:
            bus.close()
    return found


def _answered(ends: Sequence[Any], images: float) -> dict[str, Any]:
    """Shares of images with a force, over all and for the worst sensor; `mixed` counts forces for a wrong sensor."""
    counts, mixed, late_ms = [], 0, []
    for number, end in enumerate(ends):
        count = 0
        while (received := end.take()) is not None:
            at_ns = stamp_ns(received.message.header.stamp)
            count += 1
            mixed += at_ns % 100 != number
            late_ms.append((received.source_ns - at_ns) / 1e6)
        counts.append(count / images)
    return {
        'answered': float(np.mean(counts)), 'least': min(counts), 'mixed': mixed,
        'late_ms': {f'p{level}': float(np.percentile(late_ms or [np.nan], level)) for level in (50, 99)},
    }  # fmt: skip


def _place() -> dict[str, str]:
    """The environment of this process's bus; the fork server may have started with another one."""
    return {name: os.environ[name] for name in ('TACTILE_RUN_DIR', 'ROS_DOMAIN_ID') if name in os.environ}


def _there(place: dict[str, str], target: Any, *arguments: Any) -> None:
    os.environ.update(place)
    target(*arguments)


def _be_light(pipe: Connection, number: int) -> None:
    words = ['--ros-args', '-r', f'__node:=n{number:03d}', '-r', '__ns:=/crowd', '--log-level', 'ERROR']
    node = LightNode(ZmqBus(), parse_arguments(words))
    pipe.send('ready')
    node.spin()


def _sense(pipe: Connection, numbers: Sequence[int], model: str) -> None:
    bus, nodes = ZmqBus(), []
    for number in numbers:
        space = ['-r', f'__ns:=/s{number:02d}', '-p', f'model:={model}', '--log-level', 'ERROR']
        nodes += [kind(bus, parse_arguments(['--ros-args', *space])) for kind in (FlowFeaturesNode, ForceEstimatorNode)]
    for node in nodes:
        threading.Thread(target=node.spin, daemon=True).start()
    pipe.send('ready')
    threading.Event().wait()


def _film(pipe: Connection, count: int, rate_hz: float, seconds: float) -> None:
    """Cameras with a random pattern; the last two digits of a stamp identify the sensor."""
    clock, bus, rng = SystemClock(), ZmqBus(), np.random.default_rng(3)
    pattern = np.kron(rng.integers(40, 200, (SIDE_PX // 4, SIDE_PX // 4)), np.ones((4, 4))).astype(np.uint8)
    kind = topics.IMAGE
    ends = [bus.advertise(f'/s{number:02d}/{kind.name}', kind.type_name, kind.qos) for number in range(count)]
    _until(clock, lambda: all(end.listeners for end in ends))
    start_ns = clock.now_ns()
    for frame in range(round(rate_hz * seconds)):
        clock.sleep_until(start_ns + round(frame * NS_PER_S / rate_hz))
        for number, end in enumerate(ends):
            at_ns = clock.now_ns() // 100 * 100 + number
            end.publish(conversions.image_message(pattern + frame % 3, conversions.header(at_ns, 'camera')))
    clock.sleep_until(clock.now_ns() + NS_PER_S // 2)  # for messages that are still on their way
    bus.close()
    pipe.send('done')


@contextmanager
def _children(tasks: Sequence[tuple[Any, tuple[Any, ...]]]) -> Iterator[list[BaseProcess]]:
    """Start processes, and wait until each has reported that it is ready or done; kill them at the end."""
    children: list[BaseProcess] = []
    pipes = []
    for target, arguments in tasks:
        ours, theirs = _CONTEXT.Pipe()
        process_arguments = (_place(), target, theirs, *arguments)
        children.append(_CONTEXT.Process(target=_there, args=process_arguments, daemon=True))
        children[-1].start()
        pipes.append(ours)
    try:
        for end in pipes:
            if not end.poll(PATIENCE_S):
                raise ConfigurationError(f'a process did not come up within {PATIENCE_S:g} s')
            end.recv()
        yield children
    finally:
        for child in children:
            child.kill()
        for child in children:
            child.join()


def _cpu_s(children: Sequence[BaseProcess]) -> float:
    return sum(processor_s(psutil.Process(child.pid)) for child in children)


def _until(clock: SystemClock, condition: Any) -> None:
    deadline_ns = clock.now_ns() + round(PATIENCE_S * NS_PER_S)
    while not condition():
        if clock.now_ns() > deadline_ns:
            raise ConfigurationError(f'waited {PATIENCE_S:g} s in vain')
        clock.sleep_until(clock.now_ns() + NS_PER_S // 50)
