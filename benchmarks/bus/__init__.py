"""How long a message takes from one node to another, and how many a second pass, beside plain pyzmq.

One-way latency: from just before `publish` to the user having the decoded message, paced like a sensor. The floor is
a pyzmq PUB and a blocking SUB over ipc with the same bytes, neither encoded nor decoded. In each round every contender
has its turn with every payload, in an order that alternates; ratios are of the medians of the same round, so that
what else runs on the machine weighs on both.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.bus.ends import CONTENDERS, FLOORS, NODE, PAYLOADS, payload
from benchmarks.bus.processes import Worker
from benchmarks.report import percentiles, spread, surroundings, table, write_json
from tactile_nodes import messages
from tactile_nodes.clock import NS_PER_S
from tactile_nodes.errors import BusError

AIM_RATIO = 2.5
AIM_INSIDE_US = 50.0
_IDLE_S = 3.0  # a machine that is shared may hold a process up for a second
_TRIES = 5


@dataclass(frozen=True)
class Plan:
    """How much to measure."""

    rounds: int = 10
    messages: int = 100
    rate_hz: float = 150.0
    flood: int = 2000


QUICK = Plan(rounds=2, messages=40, rate_hz=200.0, flood=300)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench bus``."""
    parser.add_argument('--quick', action='store_true', help='a few seconds, to see that it runs; too little to quote')
    parser.add_argument('-o', '--output', type=Path, metavar='FILE.json', help='keep the result')


def run(arguments: argparse.Namespace) -> int:
    """Measure, print, and keep."""
    result = measure(QUICK if arguments.quick else Plan())
    print(text(result))
    if arguments.output:
        write_json(arguments.output, result)
    return 0


def measure(plan: Plan) -> dict[str, Any]:
    """All latencies and rates of one run, as plain data."""
    result: dict[str, Any] = {**surroundings('tactile bench bus'), 'plan': asdict(plan)}
    between, inside = Latencies(plan), Latencies(plan)
    with tempfile.TemporaryDirectory(prefix='tb') as folder, ExitStack() as running:
        ends = Ends(*(Worker(role, folder) for role in ('send', 'receive', 'inside')))
        running.callback(ends.close)
        ends.warm_up()
        for number in range(plan.rounds):
            turns = CONTENDERS if number % 2 == 0 else CONTENDERS[::-1]
            for name, contender in itertools.product(PAYLOADS, turns):
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
    result['aims'] = _aims(result)
    return result


@dataclass(frozen=True)
class Ends:
    """The processes between and in which is measured."""

    sender: Worker
    receiver: Worker
    both: Worker

    def one_way(self, contender: str, name: str, count: int, period_ns: int) -> tuple[list[int], list[int]]:
        """When each message was handed over in one process, and when the user had it in the other."""
        self.receiver.ask('begin', contender, name)
        arrived = self.receiver.begin('arrivals', contender, name, count, _IDLE_S)
        sent = self.sender.ask('send', contender, name, count, period_ns)
        return sent, arrived()

    def inside(self, contender: str, name: str, count: int, period_ns: int) -> tuple[list[int], list[int]]:
        """The same inside one process."""
        sent, arrived = self.both.ask('measure', contender, name, count, period_ns, _IDLE_S)
        return sent, arrived

    def warm_up(self) -> None:
        """Connect, and let what is compiled on first use be compiled.

        Raises:
            BusError: nothing comes through.
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
        """Take in one round; when something was lost it cannot be paired, and only the loss counts."""
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


def text(result: dict[str, Any]) -> str:
    """The result as a person reads it."""
    machine, plan = result['machine'], result['plan']
    lines = [
        f'{machine["processor"]}, {machine["cores_allowed"]} cores, load before {machine["load_before"][0]}; '
        f'commit {result["commit"]}; ' + ', '.join(f'{name} {version}' for name, version in result['versions'].items()),
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
    ]
    lines += [f'{"reached" if aim["reached"] else "MISSED"}: {aim["text"]}' for aim in result['aims']]
    return '\n'.join(lines)


def _latency_table(latencies: dict[str, Any]) -> str:
    heads = ['payload', 'contender', 'p50', 'p90', 'p99', 'p50 of the rounds', 'lost', 'ratio']
    rows = []
    for name, contenders in latencies.items():
        for contender in [known for known in CONTENDERS if known in contenders]:
            entry = contenders[contender]
            over = entry['p50_by_round']
            ratio = entry.get('ratio_to_floor')
            rows.append(
                [
                    name,
                    contender,
                    *(f'{entry[level]:.0f}' for level in ('p50', 'p90', 'p99')),
                    f'{over["low"]:.0f} to {over["high"]:.0f}',
                    f'{entry["lost"]}',
                    f'{ratio["median"]:.2f} ({ratio["low"]:.2f} to {ratio["high"]:.2f})' if ratio else '',
                ]
            )
    return table(heads, rows)


def _rate_table(rates: dict[str, Any]) -> str:
    rows = [
        [name, contender, f'{entry["per_s"]:.0f}', f'{entry["megabytes_per_s"]:.0f}', f'{entry["lost_share"]:.0%}']
        for name, contenders in rates.items()
        for contender, entry in contenders.items()
    ]
    return table(['payload', 'contender', 'messages/s received', 'MB/s', 'dropped'], rows)


def _aims(result: dict[str, Any]) -> list[dict[str, Any]]:
    ratio = result['between_processes_us']['image'][NODE]['ratio_to_floor']['median']
    inside = result['inside_one_process_us']['image'][NODE]['p50']
    return [
        _aim(
            f'image between processes, node to node: {ratio:.2f} of the floor, at most {AIM_RATIO}', ratio <= AIM_RATIO
        ),
        _aim(
            f'image inside one process, node to node: {inside:.0f} µs, at most {AIM_INSIDE_US:.0f}',
            inside <= AIM_INSIDE_US,
        ),
    ]


def _aim(words: str, reached: bool) -> dict[str, Any]:
    return {'text': words, 'reached': reached}


def _period_ns(plan: Plan) -> int:
    return round(NS_PER_S / plan.rate_hz)


def _flooded(ends: Ends, contender: str, name: str, count: int) -> dict[str, float]:
    sent, arrived = ends.one_way(contender, name, count, 0)
    rate = len(arrived) * NS_PER_S / (max(arrived) - min(sent)) if arrived else 0.0
    size = len(messages.encode(payload(name)))
    return {'per_s': rate, 'megabytes_per_s': rate * size / 1e6, 'lost_share': 1 - len(arrived) / count}
