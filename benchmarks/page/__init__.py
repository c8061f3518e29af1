"""Effect of the live view in the browser on the sensor: no viewer, one, five, and one that hangs.

A whole ``tactile launch live`` runs with the simulated gel. Latency is from a frame's capture to the publication of its
force, by the stamps of the messages, so that it includes neither the page nor this benchmark. Viewers are programs that
use the page's protocol and read everything; the one that hangs has connected and never reads. Conditions run in turn,
in a different order in each round.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import psutil

from benchmarks.harness.declaration import LIVE, Benchmark, Result, argument
from benchmarks.harness.report import columns, named, shown, spread
from benchmarks.harness.running import Run
from benchmarks.harness.workers import processor_s
from benchmarks.page.launch import Sensing, sensing
from benchmarks.page.viewers import Viewers
from tactile_nodes.clock import monotonic_s
from tactile_nodes.messages import stamp_ns
from tactile_nodes.viewing.measures import StampGaps

SETTLE_S = 2.0
PROCESSES = {'composed_node': 'motion and force', 'camera_node': 'camera', 'live_view_node': 'page'}


@dataclass(frozen=True)
class Condition:
    """The viewers in one condition."""

    title: str
    viewers: int = 0
    hanging: int = 0
    browsers: int = 0


CONDITIONS = (
    Condition('nobody watches'),
    Condition('one viewer', viewers=1),
    Condition('five viewers', viewers=5),
    Condition('five, and one that hangs', viewers=5, hanging=1),
)
BROWSER = Condition('a real browser on this machine', browsers=1)


@dataclass
class Seen:
    """Measurements under one condition, over all rounds."""

    latencies_ms: list[list[float]] = field(default_factory=list)
    skipped: int = 0
    cpu_percent: dict[str, list[float]] = field(default_factory=dict)
    shown_hz: list[float] = field(default_factory=list)
    load: list[float] = field(default_factory=list)


def measured(arguments: argparse.Namespace, _: Run) -> Result:
    """Measure all conditions."""
    conditions = [*CONDITIONS, *([BROWSER] if arguments.browser else [])]
    found = measure(conditions, arguments.seconds, arguments.rounds)
    return {'conditions': {each.title: summed_up(seen) for each, seen in found.items()}}


def too_slow(result: Mapping[str, Any]) -> bool:
    """Whether a viewer that reads everything got fewer than 20 packets per second."""
    return any(each['shown_hz'] < 20 for each in result['conditions'].values())


def measure(
    conditions: Sequence[Condition], seconds: float, rounds: int, settle_s: float = SETTLE_S
) -> dict[Condition, Seen]:
    """Measure each condition in each round; the order is rotated by one from round to round."""
    with sensing() as running:
        return measure_on(running, conditions, seconds, rounds, settle_s)


def measure_on(
    running: Sensing, conditions: Sequence[Condition], seconds: float, rounds: int, settle_s: float
) -> dict[Condition, Seen]:
    """The same with a sensor that runs already."""
    found = {each: Seen() for each in conditions}
    running.watch_for(settle_s)
    for number in range(rounds):
        for condition in _turned(conditions, number):
            _measure_one(running, condition, seconds, settle_s, found[condition])
    return found


def _turned(conditions: Sequence[Condition], by: int) -> Iterator[Condition]:
    for place in range(len(conditions)):
        yield conditions[(place + by) % len(conditions)]


def _measure_one(running: Sensing, condition: Condition, seconds: float, settle_s: float, seen: Seen) -> None:
    with Viewers(running.url, condition.viewers, condition.hanging, condition.browsers) as viewers:
        running.watch_for(settle_s)
        counted, used, began_s = viewers.packets(), _cpu_s(running.pids), monotonic_s()
        gaps, latencies = StampGaps(), []
        for received in running.forces(seconds):
            captured_ns = stamp_ns(received.message.header.stamp)
            latencies.append((received.source_ns - captured_ns) / 1e6)
            gaps.add(captured_ns, received.received_ns)
        took_s = monotonic_s() - began_s
        seen.latencies_ms.append(latencies)
        seen.skipped += gaps.total
        for name, cpu_s in _cpu_s(running.pids).items():
            seen.cpu_percent.setdefault(name, []).append(100 * (cpu_s - used[name]) / took_s)
        if condition.viewers:
            seen.shown_hz.append((viewers.packets() - counted) / took_s / condition.viewers)
        seen.load.append(psutil.getloadavg()[0])


def _cpu_s(pids: Mapping[str, int]) -> dict[str, float]:
    return {PROCESSES[name]: processor_s(psutil.Process(pid)) for name, pid in pids.items() if name in PROCESSES}


def summed_up(seen: Seen) -> dict[str, Any]:
    """The numbers of one condition: percentiles over all frames, and the range over the rounds."""
    every = np.concatenate([np.array(each) for each in seen.latencies_ms])
    p50, p99 = np.percentile(every, [50, 99])
    return {
        'frames': len(every),
        'skipped': seen.skipped,
        'latency_ms': {'p50': float(p50), 'p99': float(p99)},
        'p50_of_rounds_ms': spread([float(np.median(each)) for each in seen.latencies_ms]),
        'cpu_percent': {name: float(np.mean(values)) for name, values in seen.cpu_percent.items()},
        'shown_hz': float(np.mean(seen.shown_hz)) if seen.shown_hz else math.nan,
        'load': spread(seen.load),
    }


def conditions_table(result: Mapping[str, Any]) -> str:
    """The table with a row for each condition."""
    spent = [(f'CPU of {name} [%]', f'{{cpu_percent[{name}]:.1f}}') for name in PROCESSES.values()]
    return columns(
        named(result['conditions']),
        ('viewers', '{name}'), ('p50 [ms]', '{latency_ms[p50]:.2f}'),
        ('p50 of the rounds', '{p50_of_rounds_ms[low]:.2f} to {p50_of_rounds_ms[high]:.2f}'),
        ('p99 [ms]', '{latency_ms[p99]:.2f}'), ('frames', '{frames}'), ('skipped', '{skipped}'), *spent,
        ('packets/s each', lambda each: shown(each['shown_hz'], '{:.1f}', '')),
        ('load', '{load[low]:.1f} to {load[high]:.1f}'),
    )  # fmt: skip


BENCHMARK = Benchmark(
    name='page',
    about=__doc__,
    sources=('benchmarks/page/**', 'tactile_nodes/web/**', 'tactile_nodes/viewing/**', *LIVE),
    page=conditions_table,
    measure=measured,
    failed=too_slow,
    by_hand=True,
    arguments=(
        argument(
            '--seconds', type=float, default=10.0, help='duration of each condition in a round (default: %(default)s)'
        ),
        argument('--rounds', type=int, default=4, help='number of rounds (default: %(default)s)'),
        argument('--browser', action='store_true', help='also with a headless Chromium that renders the page'),
    ),
)
