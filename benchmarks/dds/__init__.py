"""CPU time of the bridge to a ROS 2 graph over DDS, and the latency of messages there.

A process publishes images of 440x440 and a force of 81 bins with each, stamped when they are published. Publisher,
bridge and a reader in the DDS domain are separate processes; the CPU time of the bridge is read from the kernel.
Latency is from the stamp to receiving the bytes. A subscriber on the bus shows the effect on the sensor's own nodes.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from typing import Any

from benchmarks.dds.ends import Bridge, Ends
from benchmarks.harness.declaration import Benchmark, Result, argument
from benchmarks.harness.report import columns, opening, percentiles
from benchmarks.harness.running import Run
from benchmarks.streams import Times
from tactile_nodes.errors import from_extra

DEFAULT_DOMAIN = 99
HANGING = """\
The bridge subscribes only to topics that have a reader. For a reader that hangs (stopped with SIGSTOP, reliable) it
keeps the newest messages of each topic, and never blocks."""
CASES = {
    'no bridge': (),
    'nobody reads': ('bridge',),
    'a reader': ('bridge', 'reader'),
    'a reader, and one that hangs': ('bridge', 'reader', 'stuck'),
}


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure each case, with separate processes."""
    with from_extra('dds', 'speaking DDS'):
        import tactile_nodes.dds.participant  # noqa: F401
    cases = {}
    for name, parts in CASES.items():
        with _running(parts, arguments.domain, arguments.rate) as ends:
            cases[name] = _measured(ends, arguments.seconds)
        run.progress.say(f'{name}: measured')
    run.about['versions']['cyclonedds'] = version('cyclonedds')
    return {'rate_hz': arguments.rate, 'seconds': arguments.seconds, 'cases': cases}


def topics_table(result: Mapping[str, Any]) -> str:
    """A row for each case and topic."""
    entries = [
        {**ends, 'name': name, 'topic': topic, 'percent': case['bridge_percent']}
        for name, case in result['cases'].items() for topic, ends in case['topics'].items()
    ]  # fmt: skip
    return columns(
        entries,
        ('case', '{name}'), ('topic', '{topic}'), ('on the bus, p50 [ms]', _of('bus', 'p50')),
        ('p99', _of('bus', 'p99')), ('lost', _of('bus', 'lost')), ('over DDS, p50 [ms]', _of('dds', 'p50')),
        ('p99', _of('dds', 'p99')), ('lost', _of('dds', 'lost')),
        ('bridge [% of a core]', lambda each: '' if each['percent'] is None else f'{each["percent"]:.0f}'),
    )  # fmt: skip


def _of(end: str, what: str) -> Callable[[Mapping[str, Any]], str]:
    form = '{}' if what == 'lost' else '{:.2f}'
    return lambda each: form.format(each[end][what]) if each[end] else ''


@contextmanager
def _running(parts: Sequence[str], domain: int, rate_hz: float) -> Iterator[Ends]:
    with tempfile.TemporaryDirectory(prefix='td') as folder, ExitStack() as stack:
        ends = Ends(folder, domain, rate_hz)
        stack.callback(ends.close)
        if 'bridge' in parts:
            ends.bridge = Bridge(folder, domain)
        if 'reader' in parts:
            ends.start_reader()
        if 'stuck' in parts:
            ends.start_stuck()
        yield ends


def _measured(ends: Ends, seconds: float) -> dict[str, Any]:
    sent, bus, dds, percent = ends.watch(seconds)
    return {
        'bridge_percent': percent,
        'topics': {
            topic: {'bus': _summary(bus[topic], sent), 'dds': _summary(dds[topic], sent) if dds else None}
            for topic in bus
        },
    }


def _summary(times: Times, sent: int) -> dict[str, Any]:
    """Latency (ms) and losses of the frames published during the measurement."""
    return {**percentiles([late_ns / 1e6 for late_ns in times]), 'received': len(times), 'lost': sent - len(times)}


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    assert __doc__ is not None
    more = f'{result["rate_hz"]:g} Hz, {result["seconds"]:g} s each'
    return '\n\n'.join(
        [*opening('Cost of DDS', result, __doc__.partition('\n\n')[2], more), topics_table(result), HANGING]
    )


BENCHMARK = Benchmark(
    name='dds',
    about=__doc__,
    sources=(
        'benchmarks/dds/**',
        'benchmarks/streams.py',
        'tactile_nodes/dds/**',
        'tactile_nodes/bus/**',
        'tactile_nodes/messages/**',
    ),
    page=page,
    measure=measured,
    arguments=(
        argument('--seconds', type=float, default=20.0, help='duration of each case (default: %(default)s)'),
        argument('--rate', type=float, default=60.0, help='images a second (default: %(default)s)'),
        argument('--domain', type=int, default=DEFAULT_DOMAIN, help='an unused DDS domain (default: %(default)s)'),
    ),
)
