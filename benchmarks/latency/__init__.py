"""Latency of live sensing as seen by a subscriber in another process, and the highest rate without a lost frame.

First, minutes of live sensing at 60 frames a second; latency is from capture stamp to force. Then frames from memory,
on one core.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import psutil

from benchmarks.gaps import Arrivals, arrived
from benchmarks.harness.declaration import LIVE, Benchmark, Result, argument
from benchmarks.harness.report import columns, opening, shown
from benchmarks.harness.running import Run
from benchmarks.harness.workers import processor_s
from benchmarks.latency import relay
from benchmarks.latency.pictures import recorded_camera
from benchmarks.latency.rates import highest
from benchmarks.page.launch import Sensing, longest, sensing
from tactile_nodes.clock import monotonic_s

if TYPE_CHECKING:
    from tactile_nodes.learning.progress import Progress

STAGES = ('acquire', 'flow', 'features', 'predict', 'transport')
SETTLES_S = 3.0
"""The first frames are delayed by the initialization of each process."""
MESSAGE_WITHIN_S = 4.0
"""Time in which the relay's messages are recorded from real sensing: two presses of the pictures."""
RELAY = 'a relay in their place'
ARRANGEMENTS: Mapping[str, tuple[str, ...]] = {
    'motion and force in one process': (),
    RELAY: (),
    'a process each': ('separate:=true',),
}
ABOUT = """\
Two parts, with simulated frames. First `tactile launch live` with its page, for {minutes:g} minutes per row. Times are
from the stamp of an image's capture to the arrival of its force in another process. *skipped* images were replaced by
newer ones and have no force; *lost* forces were published but did not arrive. The camera replays pictures of four
presses from files, because rendering would cost more than sensing. The *relay* replaces the nodes for motion and force
in the same launch. It computes nothing and answers each picture with a recorded message, so its times are the cost of
processes and transport on this machine.

Second, the highest of {tried_hz} frames a second at which every image gets its force for {seconds:g} s, in at least one
of three attempts. Images come from memory; publisher, flow features, force estimator and subscriber share one process
and one core. *in contact*: a press in every frame, so that motion is measured in each. *mixed*: nothing touches in half
of the frames. *CPU per frame* is the time of publisher, both nodes and subscriber.

CPU shares of the nodes are sums over all cores. Other work on the machine makes everything slower."""


@dataclass
class Stream(Arrivals):
    """Received forces, with the time of each stage."""

    stages_ms: list[tuple[float, ...]] = field(default_factory=list)


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """All numbers of the page.

    Raises:
        ConfigurationError: sensing does not start.
    """
    extra = (f'compiled:={str(arguments.compiled).lower()}',)
    with tempfile.TemporaryDirectory(prefix='tactile_latency') as folder:
        camera = recorded_camera(Path(folder)) if arguments.minutes else ()
        runs = [
            {'model': model, 'arrangement': name, **run.part(f'{model}, {name}', partial(
                _relayed if name == RELAY else _live,
                60 * arguments.minutes, (f'model:={model}', *words, *extra, *camera), run.progress
            ))}
            for model in arguments.models for name, words in ARRANGEMENTS.items() if camera
        ]  # fmt: skip
    rates = [
        {'model': model, 'compiled': compiled, 'frames': kind, **held}
        for model in arguments.models
        for compiled in ((False, True) if arguments.compiled else (False,))
        for kind, held in run.part(
            f'rates {model} {compiled}', partial(_rates, model, compiled, arguments, run)
        ).items()
    ]
    return {'minutes': arguments.minutes, 'seconds': arguments.seconds, 'tried': sorted(arguments.rates),
            'live': runs, 'rates': rates}  # fmt: skip


def _rates(model: str, compiled: bool, arguments: argparse.Namespace, run: Run) -> dict[str, Any]:
    found = highest(model, compiled, sorted(arguments.rates), arguments.seconds, run.progress)
    return {
        kind: {'held': held.rate_hz, 'p99_ms': held.p99_ms, 'cpu_ms': held.cpu_ms, 'next': held.next_hz}
        for kind, held in found.items()
    }


def _relayed(seconds: float, words: Sequence[str], progress: Progress) -> dict[str, Any]:
    """As `_live`, with a relay that repeats messages recorded from real sensing."""
    with tempfile.TemporaryDirectory(prefix='tactile_relay') as name:
        folder = Path(name)
        with sensing(*words) as running:
            running.watch_for(SETTLES_S)
            for topic in relay.RELAYED:
                relay.keep(folder, topic, longest(running.bus, f'/{topic.name}', topic, MESSAGE_WITHIN_S))
        with relay.relaying(folder):
            return _live(seconds, words, progress, file=str(relay.relayed(folder)))


def _live(seconds: float, words: Sequence[str], progress: Progress, file: str = 'live') -> dict[str, Any]:
    with sensing(*words, file=file) as running, progress.bar(' '.join(words[:-2]), round(seconds)) as bar:
        running.watch_for(SETTLES_S)
        processes = {name: psutil.Process(pid) for name, pid in running.pids.items()}
        before = {name: processor_s(each) for name, each in processes.items()}
        begun_s, stream = monotonic_s(), Stream()
        for second in range(1, round(seconds) + 1):
            _listen(running, max(0.0, begun_s + second - monotonic_s()), stream)
            bar.advance(1, f'{len(stream.late_ms)} forces, {stream.skipped} images without one')
        took_s = monotonic_s() - begun_s
        cpu = {name: (processor_s(each) - before[name]) / took_s for name, each in processes.items()}
    return _summary(stream, cpu)


def _listen(running: Sensing, seconds: float, stream: Stream) -> None:
    for received in running.forces(seconds, fresh=not stream.begun):
        stream.take(received)
        stream.stages_ms.append(tuple(1e3 * getattr(received.message.stages, stage) for stage in STAGES))


def _summary(stream: Stream, cpu: Mapping[str, float]) -> dict[str, Any]:
    stages = np.nanmedian(np.array(stream.stages_ms or [(math.nan,) * len(STAGES)]), axis=0)
    return {
        **arrived([stream]),
        'stages_p50_ms': dict(zip(STAGES, stages.tolist(), strict=True)), 'cpu_share': dict(cpu),
    }  # fmt: skip


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    about = ABOUT.format(**result, tried_hz=', '.join(map(str, result['tried'])))
    parts = opening('From capture to force, live', result, about)
    if result['live']:
        parts += ['## Sixty frames a second', _live_table(result['live']), _stage_table(result['live'])]
    return '\n\n'.join([*parts, '## The highest rate', _rate_table(result['rates'])])


def _live_table(runs: Sequence[Mapping[str, Any]]) -> str:
    floors = {each['model']: each['p99_ms'] for each in runs if each['arrangement'] == RELAY}
    return columns(
        [{**each, 'over_ms': each['p99_ms'] - floors.get(each['model'], math.nan)} for each in runs],
        ('model', '{model}'), ('processes', '{arrangement}'), ('forces', '{forces}'), ('skipped', '{skipped}'),
        ('lost', '{lost}'), ('p50 [ms]', '{p50_ms:.2f}'), ('p99 [ms]', '{p99_ms:.2f}'),
        ('p99 - relay [ms]', '{over_ms:.2f}'), ('worst [ms]', '{worst_ms:.2f}'),
        ('longest gap [ms]', '{longest_ms:.2f}'),
    )  # fmt: skip


def _stage_table(runs: Sequence[Mapping[str, Any]]) -> str:
    names = sorted({name for each in runs for name in each['cpu_share']})
    rows = [
        {**each, 'cpu': {name: shown(each['cpu_share'].get(name), '{:.0%}') for name in names},
         'medians': {stage: shown(_own(each, stage), '{:.2f}') for stage in STAGES}}
        for each in runs
    ]  # fmt: skip
    return columns(
        rows, ('model', '{model}'), ('processes', '{arrangement}'),
        *((f'{stage} p50 [ms]', f'{{medians[{stage}]}}') for stage in STAGES),
        *((f'CPU of {name}', f'{{cpu[{name}]}}') for name in names),
    )  # fmt: skip


def _own(run: Mapping[str, Any], stage: str) -> float | None:
    """The time of a stage; None for a relay, whose messages have the times of other frames."""
    return None if run['arrangement'] == RELAY else run['stages_p50_ms'][stage]


def _rate_table(rates: Sequence[Mapping[str, Any]]) -> str:
    return columns(
        [{**each, 'loops': 'compiled' if each['compiled'] else 'numpy', 'next': each['next'] or '–'} for each in rates],
        ('model', '{model}'), ('loops', '{loops}'), ('frames', '{frames}'), ('highest rate [Hz]', '{held}'),
        ('p99 [ms]', '{p99_ms:.2f}'), ('CPU per frame [ms]', '{cpu_ms:.2f}'), ('failed at [Hz]', '{next}'),
    )  # fmt: skip


BENCHMARK = Benchmark(
    name='latency',
    about=__doc__,
    sources=('benchmarks/latency/**', 'benchmarks/page/launch.py', 'benchmarks/gaps.py', *LIVE),
    page=page,
    measure=measured,
    files=('latency.json', 'latency.md', 'live.md'),
    arguments=(
        argument(
            '--minutes', least=0, type=float, default=10.0, metavar='N', help='duration of each run (default: 10)'
        ),
        argument('--models', nargs='+', default=['fast'], metavar='NAME', help='models (default: fast)'),
        argument('--compiled', action='store_true', help='compile the inner loops; rates with and without'),
        argument('--seconds', above=0, type=float, default=5.0, metavar='N', help='duration of each rate (default: 5)'),
        argument(
            '--rates',
            above=0,
            nargs='+',
            type=int,
            default=[100, 200, 300, 400, 500, 600, 800, 1000],
            metavar='HZ',
            help='frame rates to try',
        ),
    ),
)
