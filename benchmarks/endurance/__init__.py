"""Hours of sensing: growth of memory, files, threads and queues, and lost frames.

Two parts. `stepped`: hours at 60 frames a second through the nodes of live sensing on the bus in one process, with a
simulated clock, so that eight hours take half an hour of CPU time. `live`: a whole ``tactile launch live`` in real
time, with all its processes. Memory, open files, threads, queues and counters are monitored.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import Any

import cv2

from benchmarks.endurance.live import live
from benchmarks.endurance.stepped import stepped
from benchmarks.harness.declaration import LIVE, Benchmark, Result, argument
from benchmarks.harness.report import columns, machine_and_commit, named
from benchmarks.harness.running import Run

PARTS = ('stepped', 'live')
MOST_MB_PER_HOUR = 2.0
"""Faster growth of a process is reported as a leak; at this rate a week of sensing costs 336 MiB."""
LEAST_MB = 1.0
"""Total growth of a process below which its rate is not checked."""


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure one part."""
    cv2.setNumThreads(1)
    if arguments.only == ['stepped']:
        return stepped(arguments.hours, run.progress)
    return live(arguments.seconds, arguments.every, run.progress)


def complaints(name: str, part: Mapping[str, Any]) -> list[str]:
    """The problems of a part, as sentences."""
    processes = {'the nodes': part} if name == 'stepped' else part['processes']
    found = [text for who, held in processes.items() for text in _leaks(who, held)]
    if name == 'stepped':
        if part['forces'] != part['images']:
            found.append(f'{part["images"] - part["forces"]} of {part["images"]} images were not answered')
        if part['drift_n'] > 0:
            found.append(f'an answer to the same picture changed by {part["drift_n"]:.3g} N')
        found += part['problems']
    elif not part['frames']['received']:
        found.append('no force came')
    return found


def page(parts: Mapping[str, Mapping[str, Any]]) -> str:
    """The page with the tables of all measured parts."""
    texts = ['# Endurance', str(__doc__).partition('\n')[2].strip()]
    if 'stepped' in parts:
        texts += _stepped_page(parts['stepped'])
    if 'live' in parts:
        texts += _live_page(parts['live'])
    return '\n\n'.join(texts)


def _stepped_page(part: Mapping[str, Any]) -> list[str]:
    counts, status = part['subscriptions'], part['status']
    return [
        f'## {part["hours"]:g} hours of a simulated clock',
        f'```console\n$ {part["command"]}\n```',
        f'{part["images"]} images of {part["side_px"]}x{part["side_px"]} pixels, with a press of one second each '
        f'minute, through flow features, force estimator and drift monitor gave {part["forces"]} forces '
        f'({", ".join(f"{count} {name}" for name, count in status.items())}). Dropped messages: {counts["dropped"]}, '
        f'malformed: {counts["malformed"]}; longest queue of messages: {part["longest_queue"]}, of work: '
        f'{part["longest_work"]}. Python objects after a fifth of the time: {part["objects"]["first"]}, at the end: '
        f'{part["objects"]["last"]}. Change of the force for the same picture: {part["drift_n"]:.3g} N.',
        _held({'all nodes, one process': part}),
        _verdict('stepped', part),
        f'{machine_and_commit(part)}.',
    ]


def _live_page(part: Mapping[str, Any]) -> list[str]:
    frames = part['frames']
    late_ms = frames['late_ms'] or [math.nan]
    total = frames['received'] + frames['skipped']
    return [
        f'## {part["seconds"] / 60:g} minutes of real time',
        f'```console\n$ {part["command"]}\n```',
        f'{frames["received"]} forces ({", ".join(f"{count} {name}" for name, count in frames["status"].items())}); of '
        f'{total} images {frames["skipped"]} ({frames["skipped"] / total:.2%}) have no force. The longest time between '
        f'two forces is {frames["longest_ms"]:.0f} ms. Latency from image to force, 99th percentile over '
        f'{part["every_s"]:g} s: {min(late_ms):.0f} to {max(late_ms):.0f} ms. The machine had other load: '
        f'{part["load"]["low"]:.1f} to {part["load"]["high"]:.1f} runnable processes.',
        _held(part['processes']),
        _verdict('live', part),
        f'{machine_and_commit(part)}.',
    ]


def _verdict(name: str, part: Mapping[str, Any]) -> str:
    if wrong := complaints(name, part):
        return f'Wrong: {"; ".join(wrong)}.'
    return (
        f'No leaks, by these limits: steady growth below {MOST_MB_PER_HOUR:g} MiB an hour (median over ten parts '
        'of the time), and not more files or threads at the end than after a fifth of the time.'
    )


def _held(processes: Mapping[str, Mapping[str, Any]]) -> str:
    return columns(
        named(processes),
        ('process', '{name}'), ('MiB first', '{memory_mb[first]:.1f}'), ('last', '{memory_mb[last]:.1f}'),
        ('most', '{memory_mb[most]:.1f}'), ('MiB/h', '{mb_per_hour:+.2f}'), ('steadily', '{steady_mb_per_hour:+.2f}'),
        ('files first', '{files[first]}'), ('last', '{files[last]}'), ('threads first', '{threads[first]}'),
        ('last', '{threads[last]}'), ('core', '{cpu_share:.1%}'),
    )  # fmt: skip


def _leaks(who: str, held: Mapping[str, Any]) -> list[str]:
    found = []
    memory = held['memory_mb']
    if held['steady_mb_per_hour'] > MOST_MB_PER_HOUR and memory['last'] - memory['first'] > LEAST_MB:
        found.append(f'{who}: {held["steady_mb_per_hour"]:.1f} MiB more each hour')
    more = (kind for kind in ('files', 'threads') if held[kind]['last'] > held[kind]['first'])
    return [*found, *(f'{who}: {held[kind]["last"]} {kind} at the end, after {held[kind]["first"]}' for kind in more)]


def failed(result: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether any part has a problem."""
    return any(complaints(name, part) for name, part in result.items())


BENCHMARK = Benchmark(
    name='endurance',
    about=__doc__,
    sources=('benchmarks/endurance/**', *LIVE),
    page=page,
    measure=measured,
    cases=PARTS,
    in_parts=True,
    failed=failed,
    arguments=(
        argument(
            '--hours', above=0, type=float, default=8.0, help='hours of the simulated clock (default: %(default)s)'
        ),
        argument('--seconds', above=0, type=float, default=3600.0, help='seconds of real time (default: %(default)s)'),
        argument('--every', above=0, type=float, default=10.0, help='sampling interval in s (default: %(default)s)'),
    ),
)
