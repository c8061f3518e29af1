"""All sensors of a hand on one machine: lost frames, latency, and whether a failing sensor disturbs the others.

For comparison, a relay with the same processes and messages, which computes nothing, shows the cost of transport.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.harness.declaration import LIVE, Benchmark, Result, argument
from benchmarks.harness.report import columns, opening
from benchmarks.harness.running import Run
from tactile_nodes.errors import ConfigurationError

if TYPE_CHECKING:
    from tactile_nodes.learning.progress import Progress

SENSED, RELAYED = 'sensing', 'a relay in its place'
ABOUT = """\
`tactile launch hand` with its page, {seconds:g} s per row. The cameras replay pictures of presses from files. The inner
loops are compiled. Times are from the stamp of an image's capture to the arrival of its force in another process, over
all sensors. The *relay* has the same processes, but computes nothing and answers each picture with a recorded message.
*skipped* images have no force; *lost* forces were published but did not arrive. *CPU* is the time of all processes of
the hand in cores, divided by the number of sensors."""
DISTURBED = """\
The same with one sensor that fails; the table shows the *others*. `hangs`: its process for motion and force is stopped
(SIGSTOP) all the time. `dies`: that process is killed every two seconds and restarted by the launch. `floods`: its
camera sends ten times as many pictures. If the longest gap is one frame time, no other sensor lost a frame."""


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """All numbers of the page.

    Raises:
        ConfigurationError: the numbers of rates and hands differ, or a hand does not start.
    """
    from benchmarks.hand.sensing import TROUBLES

    if len(arguments.sensors) != len(arguments.hz):
        raise ConfigurationError('--hz wants a rate for each of --sensors, as in --sensors 4 8 --hz 60 30')
    ways = [(count, hz, model) for count, hz in zip(arguments.sensors, arguments.hz, strict=True)
            for model in arguments.models]  # fmt: skip
    rows = [
        {'sensors': count, 'hz': hz, 'model': model, 'way': way, **run.part(
            f'{count} {hz} {model} {way}', partial(_hand, count, hz, model, way, '', arguments.seconds, run.progress)
        )}
        for count, hz, model in ways for way in (SENSED, RELAYED)
    ]  # fmt: skip
    count, hz, model = ways[0]
    troubles = [
        {'trouble': trouble, **run.part(
            f'{count} {hz} {model} {trouble}',
            partial(_hand, count, hz, model, SENSED, trouble, arguments.seconds, run.progress)
        )}
        for trouble in (() if arguments.no_troubles else TROUBLES)
    ]  # fmt: skip
    return {'seconds': arguments.seconds, 'hands': rows, 'disturbed': {'sensors': count, 'hz': hz, 'model': model},
            'troubles': troubles}  # fmt: skip


def _hand(
    count: int, hz: float, model: str, way: str, trouble: str, seconds: float, progress: Progress
) -> dict[str, float]:
    from benchmarks.gaps import arrived
    from benchmarks.hand.sensing import disturbed, hand, relayed_hand, written

    with tempfile.TemporaryDirectory(prefix='tactile_hand') as name:
        file = written(Path(name), count, hz, model, floods=trouble == 'floods')
        with relayed_hand(Path(name), file) if way == RELAYED else hand(file) as running:
            with (
                disturbed(running, trouble),
                progress.bar(f'{count} sensors, {way} {trouble}'.rstrip(), round(seconds)) as bar,
            ):
                arrivals = running.listen(seconds, hz, bar, without=1 if trouble else 0)
            return {**arrived(arrivals.streams), 'cores': arrivals.cores / count}


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    parts = opening('A hand of sensors', result, ABOUT.format(**result))
    floors = {(each['sensors'], each['hz'], each['model']): each['p99_ms'] for each in result['hands']
              if each['way'] == RELAYED}  # fmt: skip
    rows = [
        {**each, 'over': each['p99_ms'] - floors[each['sensors'], each['hz'], each['model']]}
        for each in result['hands']
    ]
    parts += ['## All sensors working', _table(
        rows, ('sensors', '{sensors}'), ('Hz', '{hz:g}'), ('model', '{model}'), ('', '{way}'),
        over=('p99 - relay [ms]', '{over:.2f}'),
    )]  # fmt: skip
    if result['troubles']:
        asked = '{sensors} sensors at {hz:g} Hz, `{model}`.'.format(**result['disturbed'])
        parts += ['## One sensor fails', f'{DISTURBED} {asked}']
        parts += [_table(result['troubles'], ('fault', '{trouble}'))]
    return '\n\n'.join(parts)


def _table(rows: Sequence[Mapping[str, Any]], *first: tuple[str, str], over: tuple[str, str] | None = None) -> str:
    return columns(
        rows, *first, ('forces', '{forces}'), ('skipped', '{skipped}'), ('lost', '{lost}'),
        ('p50 [ms]', '{p50_ms:.2f}'), ('p99 [ms]', '{p99_ms:.2f}'), *([over] if over else []),
        ('worst [ms]', '{worst_ms:.1f}'), ('longest gap [ms]', '{longest_ms:.1f}'), ('CPU per sensor', '{cores:.1%}'),
    )  # fmt: skip


BENCHMARK = Benchmark(
    name='hand',
    about=__doc__,
    sources=(
        'benchmarks/hand/**', 'benchmarks/latency/relay.py', 'benchmarks/gaps.py', 'tactile_nodes/launching/**', *LIVE,
    ),
    page=page,
    measure=measured,
    arguments=(
        argument('--sensors', nargs='+', type=int, above=0, default=[4, 8], metavar='N',
                 help='sensors of each hand (default: 4 8)'),
        argument('--hz', nargs='+', type=float, above=0, default=[60.0, 30.0], metavar='HZ',
                 help='frames a second of each hand (default: 60 30)'),
        argument('--models', nargs='+', default=['field', 'fast'], metavar='NAME', help='models (default: field fast)'),
        argument('--seconds', type=float, above=0, default=30.0, metavar='N', help='length of each run (default: 30)'),
        argument('--no-troubles', action='store_true', help='without the runs in which one sensor fails'),
    ),
    example="""\
examples:
  tactile bench hand -o docs/results
  tactile bench hand --sensors 2 --hz 60 --models fast --seconds 10 --no-troubles""",
)  # fmt: skip
