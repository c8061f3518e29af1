"""Inject each fault during a collection on the emulated rig, and count lost, doubled and wrong presses.

For each fault, `tactile launch collect rig:=emulated` runs a plan of four presses. When two presses are reported and
the tip moves down into the gel for the third, the fault is injected, by the parameter service of the emulated rig or as
a signal. If the launch ends, it is started again without the fault, as a user would do, until the plan is done. If the
rig asks for confirmation, it gets it. Then the bags are compared with the journal, and both with the true positions of
the tip.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.faults.audit import DONE, Ledger, Stop, Trace, journal_steps, ledger
from benchmarks.faults.cases import CASES, Case
from benchmarks.faults.launch import GEL_MM, LIMITS, SAFE_MM, START_MM, Bench, Launch, Watcher, answer
from benchmarks.harness.declaration import RIG, Benchmark, Result, argument
from benchmarks.harness.report import table
from benchmarks.harness.running import Run
from benchmarks.harness.workers import own_bus
from tactile_nodes.bus.zeromq.host_bus import ZmqBus
from tactile_nodes.clock import NS_PER_S, Clock, SystemClock
from tactile_nodes.collection.plan.plan import Plan, load_plan_settings, make_plan
from tactile_nodes.errors import ConfigurationError

LAUNCHES = 4
BEGIN_S, LASTS_S, LEAVE_S = 90.0, 150.0, 12.0
END, LONGEST_TEXT = 'collection: ', 150


@dataclass
class Outcome:
    """A row of the table."""

    name: str
    text: str
    statuses: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    told: list[str] = field(default_factory=list)
    stop: Stop | None = None
    ledger: Ledger | None = None
    problem: str = ''


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Inject each fault in turn, on a separate bus; earlier results of other faults are kept."""
    assert run.folder is not None
    folder = run.folder.absolute()
    rows: dict[str, Any] = run.earlier().get('faults', {})
    with tempfile.TemporaryDirectory(prefix='tactile-') as run_folder, own_bus(Path(run_folder)):
        for case in (each for each in CASES if each.name in run.cases):
            outcome = try_fault(case, folder / case.name, arguments.limits)
            load = round(os.getloadavg()[0], 2)
            rows[case.name] = {**asdict(outcome), 'load': load, 'commit': run.about['commit']}
            run.progress.say(line_of(outcome))
            run.keep({'faults': rows})
    return {'faults': rows}


def try_fault(case: Case, folder: Path, limits: str = LIMITS, size: tuple[int, int] = (2, 2)) -> Outcome:
    """Test one fault, from the first launch to the audit.

    Raises:
        ConfigurationError: the folder is not empty.
    """
    if folder.exists() and any(folder.iterdir()):
        raise ConfigurationError(f'{folder} is not empty; remove it, or choose another folder with -o')
    clock, bench = SystemClock(), Bench(folder, case.sensor, size, limits, case.anchor)
    outcome = Outcome(case.name, case.text)
    bench.write()
    plan = make_plan(load_plan_settings(folder / 'plan.yaml'))
    start_mm = START_MM
    for number in range(1, LAUNCHES + 1):
        begun_ns = clock.now_ns()
        launch = Launch(bench.write(start_mm), folder / f'launch{number}.log', clock)
        try:
            fault_ns = _first(case, launch, clock, outcome) if number == 1 else begun_ns
            _await(launch, clock, LASTS_S, answer)
        finally:
            launch.end(LEAVE_S)
        outcome.statuses.append(-1 if launch.status is None else launch.status)
        outcome.seconds.append(round((clock.now_ns() - begun_ns) / NS_PER_S, 1))
        if number == 1:
            outcome.told = [line.replace(f'{folder}/', '') for line in launch.lines_since(fault_ns)]
            outcome.stop = Trace(bench.trace, GEL_MM).stop(fault_ns, clock.now_ns(), SAFE_MM)
        start_mm = _last_place(bench)
        if _is_done(folder, plan):
            break
    outcome.ledger = ledger(folder, plan.points, plan.plan_id, Trace(bench.trace, GEL_MM))
    return outcome


def _first(case: Case, launch: Launch, clock: Clock, outcome: Outcome) -> int:
    """Inject the fault, and remove it again; returns the time of the injection."""
    bus = ZmqBus()
    watcher = Watcher(bus, clock)
    try:
        watcher.await_press(2, BEGIN_S, lambda: launch.status is None)
        fault_ns = clock.now_ns()
        if case.full_disk:
            launch.fill_disk(case.process)
        elif case.process:
            launch.send(case.process, case.number)
        elif case.switch:
            watcher.switch(case.switch)
        if case.lasts_s:
            clock.sleep_until(fault_ns + round(case.lasts_s * NS_PER_S))
            watcher.switch_off(case.switch)
    except ConfigurationError as error:
        outcome.problem = str(error)
        fault_ns = clock.now_ns()
    finally:
        watcher.close()
        bus.close()
    return fault_ns


def _await(launch: Launch, clock: Clock, patience_s: float, answer: Callable[[], None]) -> None:
    deadline_ns = clock.now_ns() + round(patience_s * NS_PER_S)
    answered = 0
    while launch.status is None and clock.now_ns() < deadline_ns:
        if launch.questions > answered:
            answered = launch.questions
            answer()
        clock.sleep_until(clock.now_ns() + NS_PER_S // 20)


def _last_place(bench: Bench) -> tuple[float, float, float]:
    """The last place of the tip, where the next launch begins: a machine keeps its place without commands."""
    tips = Trace(bench.trace, GEL_MM).tip_mm
    if not len(tips):
        return START_MM
    x, y, z = (float(value) for value in tips[-1])
    return x, y, z


def _is_done(folder: Path, plan: Plan) -> bool:
    last = journal_steps(folder / f'{plan.plan_id}.jsonl').last
    return all(last.get(point.press) in DONE for point in plan.points)


def is_good(row: dict[str, Any]) -> bool:
    """Whether nothing was lost, doubled or wrong, and the plan was finished."""
    kept = row['ledger'] or {}
    flaws = ('lost', 'left', 'doubled', 'wrong', 'faint')
    return bool(kept) and not row['problem'] and not any(kept[flaw] for flaw in flaws)


def line_of(outcome: Outcome) -> str:
    """A line for the terminal."""
    kept, stop = outcome.ledger, outcome.stop
    flaws = 'no audit' if kept is None else ', '.join(
        f'{name} {len(getattr(kept, name))}' for name in ('lost', 'doubled', 'wrong', 'faint', 'left')
    )  # fmt: skip
    rest = '' if stop is None else f'rest {stop.rest_s:.2f} s, {stop.way_mm:.2f} mm further, up {stop.up_s} s; '
    return (
        f'{outcome.name}: {outcome.statuses} in {outcome.seconds} s; {rest}{flaws}; {outcome.problem}{outcome.told[:2]}'
    )


def markdown(result: Mapping[str, Any]) -> str:
    """The table, in the order of the cases."""
    rows = result['faults']
    heads = ('fault', 'at rest', 'deeper', 'up', 'launches, exit status', 'lost', 'doubled', 'wrong', 'message')
    cells = [_cells(case, rows[case.name]) for case in CASES if case.name in rows]
    return table(heads, cells)


def gist(lines: Sequence[str]) -> str:
    """The most important line after a fault: the reason why the run ended, or else the first line."""
    lines = [line for line in lines if not line.startswith(('the plan is done', 'going on'))]
    ends = [line.removeprefix(END) for line in lines if line.startswith(END)]
    text = next(iter([*ends, *lines]), 'nothing')
    return text if len(text) <= LONGEST_TEXT else f'{text[: LONGEST_TEXT - 2]} …'


def _cells(case: Case, row: dict[str, Any]) -> list[str]:
    stop, kept = row['stop'], row['ledger'] or {}
    shown = case.stops and stop is not None
    up = '–' if not shown else 'stays' if stop['up_s'] is None else f'{stop["up_s"]:.1f} s'
    flaws = (('lost', 'left'), ('doubled',), ('wrong', 'faint'))
    counts = [str(len({press for name in names for press in kept.get(name, ())})) for names in flaws]
    text = row['problem'] or gist(row['told'])
    return [
        case.text,
        f'{1000 * stop["rest_s"]:.0f} ms' if shown else '–',
        f'{stop["way_mm"]:.2f} mm' if shown else '–',
        up,
        f'{len(row["statuses"])}: {", ".join(map(str, row["statuses"]))}',
        *counts,
        text.replace('|', '/'),
    ]


BENCHMARK = Benchmark(
    name='faults',
    about=__doc__,
    sources=('benchmarks/faults/**', 'tactile_nodes/nodes/**', 'tactile_nodes/bus/**', *RIG),
    page=markdown,
    measure=measured,
    cases=tuple(case.name for case in CASES),
    failed=lambda result: not all(map(is_good, result['faults'].values())),
    by_hand=True,
    output=Path('faults'),
    arguments=(argument('--limits', default=LIMITS, help=f'limits of the rig, default: {LIMITS!r}'),),
)
