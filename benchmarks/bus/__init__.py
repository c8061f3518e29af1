"""Latency and throughput of messages between nodes, compared with plain pyzmq.

One-way latency is from the call of `publish` until the user has the decoded message, at the rate of a sensor. The
baseline is a pyzmq PUB and a blocking SUB over ipc with the same bytes, without encoding and decoding. In each round
all contenders send all payloads, in alternating order. Ratios are between medians of the same round, so that other load
on the machine affects both.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.bus.ends import CONTENDERS, FLOORS, NODE, PAYLOADS, payload
from benchmarks.bus.processes import End
from benchmarks.harness.declaration import Aim, Benchmark, Result, reached
from benchmarks.harness.report import (
    columns,
    in_turn,
    machine_and_commit,
    named,
    named_versions,
    percentiles,
    ranged,
    spread,
)  # fmt: skip
from benchmarks.harness.running import Run
from tactile_nodes import messages
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import BusError

_IDLE_S = 3.0  # a shared machine may stop a process for a second
_TRIES = 5


@dataclass(frozen=True)
class Plan:
    """The amount of measurements."""

    rounds: int = 10
    messages: int = 100
    rate_hz: float = 150.0
    flood: int = 2000


QUICK = Plan(rounds=2, messages=40, rate_hz=200.0, flood=300)


def measured(arguments: argparse.Namespace, _: Run) -> Result:
    """Measure as requested on the command line."""
    return measure(QUICK if arguments.quick else Plan())


def measure(plan: Plan) -> Result:
    """All latencies and rates of one run, as plain data."""
    result: Result = {'plan': asdict(plan)}
    between, inside = Latencies(plan), Latencies(plan)
    with tempfile.TemporaryDirectory(prefix='tb') as folder, ExitStack() as running:
        ends = Ends(*(End(role, folder) for role in ('send', 'receive', 'inside')))
        running.callback(ends.close)
        ends.warm_up()
        for number in range(plan.rounds):
            for name, contender in itertools.product(PAYLOADS, in_turn(CONTENDERS, number)):
                between.add(contender, name, *ends.one_way(contender, name, plan.messages, _period_ns(plan)))
                if contender not in FLOORS:
                    inside.add(contender, name, *ends.inside(contender, name, plan.messages, _period_ns(plan)))
        flooded = {name: {turn: _flooded(ends, turn, name, plan.flood) for turn in CONTENDERS} for name in PAYLOADS}
    result['between_processes_us'] = between.summary(ratios=True)
    result['inside_one_process_us'] = inside.summary(ratios=False)
    result['flooded'] = flooded
    result['threads'] = (
        'sending: main; receiving: main (pyzmq, subscription), one a node; ZeroMQ: 1 io thread a context'
    )
    return result


@dataclass(frozen=True)
class Ends:
    """The processes of the measurement: a sender, a receiver, and one with both."""

    sender: End
    receiver: End
    both: End

    def one_way(self, contender: str, name: str, count: int, period_ns: int) -> tuple[list[int], list[int]]:
        """Times when each message was passed to `publish` in one process, and reached the user in the other."""
        self.receiver.ask(('begin', contender, name))
        self.receiver.send(('arrivals', contender, name, count, _IDLE_S))
        sent = self.sender.ask(('send', contender, name, count, period_ns))
        return sent, self.receiver.answer()

    def inside(self, contender: str, name: str, count: int, period_ns: int) -> tuple[list[int], list[int]]:
        """As `one_way`, inside one process."""
        sent, arrived = self.both.ask(('measure', contender, name, count, period_ns, _IDLE_S))
        return sent, arrived

    def warm_up(self) -> None:
        """Connect, and run once the code that is compiled on first use.

        Raises:
            BusError: no messages arrive.
        """
        for name, contender in itertools.product(PAYLOADS, CONTENDERS):
            for _ in range(_TRIES):
                _, arrived = self.one_way(contender, name, 10, NS_PER_S // 500)
                if len(arrived) == 10:
                    break
            else:
                raise BusError(f'{contender} does not bring a {name} from one process to the other')
            if contender not in FLOORS:
                self.inside(contender, name, 10, NS_PER_S // 500)

    def close(self) -> None:
        """End the processes."""
        for worker in (self.sender, self.receiver, self.both):
            worker.close()


class Latencies:
    """The latencies of all rounds, in microseconds."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._rounds: dict[tuple[str, str], list[list[float]]] = {}
        self._lost: dict[tuple[str, str], int] = {}

    def add(self, contender: str, name: str, sent: list[int], arrived: list[int]) -> None:
        """Add one round. If a message was lost, its times cannot be paired, and only the loss is counted."""
        key = (contender, name)
        self._lost[key] = self._lost.get(key, 0) + len(sent) - len(arrived)
        if len(sent) == len(arrived):
            pairs = zip(sent, arrived, strict=True)
            self._rounds.setdefault(key, []).append([(end - begin) / 1000 for begin, end in pairs])

    def summary(self, *, ratios: bool) -> dict[str, Any]:
        """By payload and contender: percentiles of all samples, spread of the rounds' medians, ratio to the floor."""
        found: dict[str, Any] = {}
        for (contender, name), rounds in self._rounds.items():
            medians = [percentiles(samples)['p50'] for samples in rounds]
            entry = {
                **percentiles([sample for samples in rounds for sample in samples]),
                'p50_by_round': spread(medians),
                'messages': sum(map(len, rounds)),
                'lost': self._lost[contender, name],
            }
            if ratios:
                entry['ratio_to_floor'] = spread(self._ratios(name, medians))
            found.setdefault(name, {})[contender] = entry
        return found

    def _ratios(self, name: str, medians: list[float]) -> list[float]:
        floors = [[percentiles(samples)['p50'] for samples in self._rounds[floor, name]] for floor in FLOORS]
        return [median / min(both) for median, *both in zip(medians, *floors, strict=False)]


def text(result: Mapping[str, Any]) -> str:
    """The result as text for the user."""
    plan = result['plan']
    lines = [
        f'{machine_and_commit(result)}; {named_versions(result)}',
        f'{plan["rounds"]} rounds of {plan["messages"]} messages at {plan["rate_hz"]:g} Hz, contenders interleaved',
        '',
        'Between processes, one way [µs]; ratio of the medians of a round to the faster floor of that round',
        _latency_table(result['between_processes_us']),
        '',
        'Inside one process, one way [µs]',
        _latency_table(result['inside_one_process_us']),
        '',
        'As fast as it can, between processes',
        _rate_table(result['flooded']),
        '',
        reached(AIMS, result),
    ]
    return '\n'.join(lines)


def _latency_table(latencies: dict[str, Any]) -> str:
    return columns(
        [
            {'payload': name, 'contender': known, **contenders[known]}
            for name, contenders in latencies.items() for known in CONTENDERS if known in contenders
        ],
        ('payload', '{payload}'), ('contender', '{contender}'), ('p50', '{p50:.0f}'), ('p90', '{p90:.0f}'),
        ('p99', '{p99:.0f}'), ('p50 of the rounds', '{p50_by_round[low]:.0f} to {p50_by_round[high]:.0f}'),
        ('lost', '{lost}'), ('ratio', lambda each: ranged(each['ratio_to_floor']) if 'ratio_to_floor' in each else ''),
    )  # fmt: skip


def _rate_table(rates: dict[str, Any]) -> str:
    return columns(
        [{'payload': name, **each} for name, contenders in rates.items() for each in named(contenders)],
        ('payload', '{payload}'), ('contender', '{name}'), ('messages/s received', '{per_s:.0f}'),
        ('MB/s', '{megabytes_per_s:.0f}'), ('dropped', '{lost_share:.0%}'),
    )  # fmt: skip


def _period_ns(plan: Plan) -> int:
    return round(NS_PER_S / plan.rate_hz)


def _flooded(ends: Ends, contender: str, name: str, count: int) -> dict[str, float]:
    sent, arrived = ends.one_way(contender, name, count, 0)
    rate = len(arrived) * NS_PER_S / (max(arrived) - min(sent)) if arrived else 0.0
    size = len(messages.encode(payload(name)))
    return {'per_s': rate, 'megabytes_per_s': rate * size / 1e6, 'lost_share': 1 - len(arrived) / count}


def _ratio_reached(result: Mapping[str, Any]) -> dict[str, str]:
    return {'reached': ranged(result['between_processes_us']['image'][NODE]['ratio_to_floor'])}


def _inside_reached(result: Mapping[str, Any]) -> dict[str, str]:
    return {'reached': f'{result["inside_one_process_us"]["image"][NODE]["p50"]:.0f} µs'}


AIMS = (
    Aim('440x440 image between processes, node to node', 'at most 2.5 times the floor', _ratio_reached),
    Aim('440x440 image inside one process, node to node', 'at most 50 µs', _inside_reached),
)
BENCHMARK = Benchmark(
    name='bus',
    about=__doc__,
    sources=('benchmarks/bus/**', 'tactile_nodes/bus/**', 'tactile_nodes/messages/**', 'msg/**'),
    page=text,
    measure=measured,
    quick=True,
    by_hand=True,
)
