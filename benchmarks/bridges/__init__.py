"""Bridges between two hosts: latency and loss on a good cable, a slow one, one that loses packets, and after a cut.

Ten sensors' forces and two pictures at 60 Hz are published on one host and received on the other.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.harness.declaration import Benchmark, Result, argument
from benchmarks.harness.report import columns, in_turn, opening, percentiles, shown
from benchmarks.harness.running import Run
from tactile_nodes.clock import NS_PER_S, SystemClock
from tactile_nodes.paths import share_directory

if TYPE_CHECKING:
    from benchmarks.bridges.hosts import Contender, Pair, Seen
    from benchmarks.bridges.network import Network
    from tactile_nodes.learning.progress import Progress

OURS, FOUND, DDS = 'bridge', 'bridge, found by multicast', 'DDS bridge'
CUT_S, LATEST_S, SETTLING_S = 5.0, 30.0, 2.0
GOOD = 'good: 1 Gbit/s'
ABOUT = """\
The two hosts are network namespaces with a virtual cable. The kernel limits its rate and drops packets (`tc tbf`,
`iptables`, in each direction); it adds no delay. One host publishes the forces of ten sensors (81 bins) and two
pictures (440x440, grey) at 60 Hz, 195 Mbit/s together; a process on the other receives them. Each host runs a bridge,
with keys if it supports them. Latency is from publishing to receiving, over both bridges. *received* is the share of
published messages that arrived. *CPU* is the sum of both bridges. The bridges are measured in turn, {rounds} times
{seconds:g} s each; values are medians of the rounds."""
TROUBLES = """\
The cable is pulled for 5 s and put back. The sending bridge is killed and restarted. A stranger tries to join with a
key that is not allowed. Times are until the first force arrives that was published after the event; after a kill they
include the start of the program. Memory is the sum of both bridges, before and after the cut."""
CABLES: Mapping[str, tuple[float, float]] = {
    GOOD: (1000.0, 0.0),
    'slow: 50 Mbit/s': (50.0, 0.0),
    'lossy: 1 Gbit/s, 2 % of the packets lost each way': (1000.0, 2.0),
}


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """All numbers of the page.

    Raises:
        ConfigurationError: this machine cannot make the network of two hosts.
    """
    from benchmarks.bridges.hosts import Contender
    from benchmarks.bridges.network import network

    contenders = [Contender(OURS, share_directory()), Contender(FOUND, share_directory(), found=True)]
    contenders += [Contender(DDS, share_directory(), dds=True)] if not arguments.no_dds else []
    contenders += [Contender(f'bridge of {tree.name}', tree.resolve()) for tree in arguments.beside]
    found: dict[str, dict[str, list[Any]]] = {each.name: {'cables': [], 'troubles': []} for each in contenders}
    with network() as made:
        for number in range(arguments.rounds):
            for each in in_turn(contenders, number):
                measure = partial(_round, each, made, arguments.seconds, run.progress)
                part = run.part(f'{each.name}, round {number + 1}', measure)
                for kind, values in part.items():
                    found[each.name][kind].append(values)
    used = ['eclipse-zenoh', *(['cyclonedds'] if not arguments.no_dds else [])]
    run.about['versions'] |= {name: version(name) for name in used}
    return {'rounds': arguments.rounds, 'seconds': arguments.seconds, 'contenders': found}


def _round(contender: Contender, made: Network, seconds: float, progress: Progress) -> dict[str, Any]:
    from benchmarks.bridges.hosts import pair
    from benchmarks.bridges.network import Cable

    cables = {}
    made.lay(Cable(*CABLES[GOOD]))
    with pair(contender, made) as running:
        running.wait()
        for name, values in CABLES.items():
            made.lay(Cable(*values))
            running.measured(SETTLING_S)  # do not count messages from before
            cables[name] = _summary(*running.measured(seconds))
            progress.say(f'{contender.name}, {name}: {cables[name]["forces"]}')
        made.lay(Cable(*CABLES[GOOD]))
        running.measured(SETTLING_S)
        troubles = _troubles(contender, made, running, seconds)
        progress.say(f'{contender.name}: {troubles}')
    return {'cables': cables, 'troubles': troubles}


def _troubles(contender: Contender, made: Network, running: Pair, seconds: float) -> dict[str, Any]:
    from benchmarks.bridges.hosts import stranger_hears

    clock = SystemClock()
    before_mb = running.robot.memory_mb() + running.lab.memory_mb()
    made.plug(on=False)
    clock.sleep_until(clock.now_ns() + round(CUT_S * NS_PER_S))
    made.plug(on=True)
    back_s = running.first_after(clock.now_ns(), LATEST_S)
    after_mb = running.robot.memory_mb() + running.lab.memory_mb()
    running.robot.kill()
    running.robot.start()
    again_s = running.first_after(clock.now_ns(), LATEST_S)
    running.measured(SETTLING_S)
    stranger = stranger_hears(contender, made, running, seconds)
    return {'back_s': back_s, 'before_mb': before_mb, 'after_mb': after_mb, 'again_s': again_s, 'stranger': stranger}


def _summary(sent: int, seen: Seen, cores: float) -> dict[str, Any]:
    kinds = {}
    for kind, word in (('forces', 'force'), ('pictures', 'image')):
        found = [each for name, each in seen.items() if word in name]
        late_ms = [late_ns / 1e6 for each in found for _, late_ns in each]
        times = percentiles(late_ms) if late_ms else {}
        kinds[kind] = {**times, 'came': sum(map(len, found)) / (sent * len(found))}
    return {**kinds, 'cores': cores}


def page(result: Mapping[str, Any]) -> str:
    """The whole page in Markdown."""
    parts = opening('Between machines', result, ABOUT.format(**result))
    for cable in CABLES:
        entries = [
            {'name': name, **{kind: _middle([each[cable][kind] for each in rounds['cables']])
             for kind in ('forces', 'pictures')}, 'cores': _median([each[cable]['cores'] for each in rounds['cables']])}
            for name, rounds in result['contenders'].items()
        ]  # fmt: skip
        parts += [f'## {cable[0].upper()}{cable[1:]}', columns(
            entries, ('', '{name}'),
            *((f'{kind[:-1]}, {head}', partial(_cell, kind, value, form)) for kind in ('forces', 'pictures')
              for head, value, form in (('p50 [ms]', 'p50', '{:.1f}'), ('p99 [ms]', 'p99', '{:.1f}'),
                                        ('received', 'came', '{:.1%}'))),
            ('CPU [cores]', '{cores:.2f}'),
        )]  # fmt: skip
    troubles = [{'name': name, **_middle(rounds['troubles'])} for name, rounds in result['contenders'].items()]
    parts += ['## A cut, a restart, a stranger', TROUBLES, columns(
        troubles, ('', '{name}'), ('after the cut [s]', partial(_shown, 'back_s', '{:.1f}')),
        ('memory before [MB]', '{before_mb:.0f}'), ('memory after [MB]', '{after_mb:.0f}'),
        ('after a kill [s]', partial(_shown, 'again_s', '{:.1f}')),
        ('messages that a stranger gets', '{stranger:.0f}'),
    )]  # fmt: skip
    return '\n\n'.join(parts)


def _cell(kind: str, value: str, form: str, entry: Mapping[str, Any]) -> str:
    return shown(entry[kind].get(value), form)


def _shown(value: str, form: str, entry: Mapping[str, Any]) -> str:
    return shown(entry[value], form, 'never')


def _middle(rounds: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The median over the rounds of each value; None if one round lacks it."""
    names = dict.fromkeys(name for each in rounds for name in each)
    return {name: _median([each.get(name) for each in rounds]) for name in names}


def _median(values: Sequence[float | None]) -> float | None:
    there = sorted(value for value in values if value is not None)
    return there[len(there) // 2] if len(there) == len(values) else None


BENCHMARK = Benchmark(
    name='bridges',
    about=__doc__,
    sources=('benchmarks/bridges/**', 'benchmarks/streams.py', 'tactile_nodes/bus/**', 'tactile_nodes/dds/**'),
    page=page,
    measure=measured,
    arguments=(
        argument('--seconds', type=float, above=0, default=10.0, help='duration for each cable (default: %(default)s)'),
        argument('--rounds', type=int, least=1, default=3, help='rounds for each bridge (default: %(default)s)'),
        argument('--no-dds', action='store_true', help='without the bridge over DDS'),
        argument('--beside', nargs='+', type=Path, default=[], metavar='FOLDER',
                 help='other checkouts of this project, whose bridges are measured too'),
    ),
    example="""\
examples (as root):
  tactile bench bridges -o docs/results
  git worktree add ../before v0.1; tactile bench bridges --beside ../before""",
)  # fmt: skip
