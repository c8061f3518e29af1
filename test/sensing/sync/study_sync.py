"""The figures of docs/sync.md, whose section on tests has the command: whole|broken|random|camera|step [runs]

Each takes a few minutes on one core. These are measurements, not tests; the tests check the same in small.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from light_runs import light_edges

from benchmarks.devices.sync_line import RecorderFaults, recorded
from tactile_nodes.collection.press.sync_pattern import pattern_gaps
from tactile_nodes.collection.settings import SyncSettings
from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.world import Edge
from tactile_nodes.learning.recorded.clocks import Edges, fitted
from tactile_nodes.sensing.sync.clocks import ClockFit, Refusal

START_NS = 1_795_000_000_000_000_000
SECOND_NS = 1_000_000_000
PERIOD_S, WINDOW_S = 4.1, 0.12
FAULTY = 0.05  # of the edges are missing, and as many doubled
SYNC = SyncSettings()
RIG = RecorderFaults(jitter_s=0.0005)
CAMERAS = ((30, 0.008, 0.02), (60, 0.008, 0.02), (30, 0.008, 0.0005), (60, 0.008, 0.0005))
HOST = DeviceClock(1e9, bits=64)


@dataclass
class Outcome:
    """What became of some runs."""

    label: str
    runs: int = 0
    errors_s: list[float] = field(default_factory=list)
    refused: Counter[str] = field(default_factory=Counter)

    def describe(self) -> str:
        """'whole: 600 runs, 600 fitted, worst 0.55 ms off, refused: none'"""
        reasons = ', '.join(f'{count} x {reason}' for reason, count in self.refused.items()) or 'none'
        worst_ms = 1e3 * max(self.errors_s, default=float('nan'))
        over = sum(error > 0.002 for error in self.errors_s)
        return (
            f'{self.label}: {self.runs} runs, {len(self.errors_s)} fitted, worst {worst_ms:.2f} ms off, '
            f'{over} over 2 ms; refused: {reasons}'
        )


def whole(runs: int) -> None:
    """Campaigns of 9 to 450 alike presses, with the patterns as they are shipped: at start, every 200, and end."""
    rng, outcome = np.random.default_rng(0), Outcome('whole')
    for number in range(runs):
        presses = int(rng.integers(9, 450))
        observe(outcome, campaign(f'plan {number}', presses), rng, jitter_s=rng.uniform(0, 0.002))
    print(outcome.describe())


def broken(runs: int) -> None:
    """Campaigns that were broken off after so many alike presses, so that no pattern is at their end."""
    for pulses in (SYNC.pulses, 10):
        for presses in (9, 30, 60, 100, 150):
            rng, outcome = np.random.default_rng(0), Outcome(f'{pulses} pulses, broken off after {presses} presses')
            for number in range(runs):
                edges = campaign(f'plan {number}', presses, pulses, ends=False)
                observe(outcome, edges, rng, jitter_s=rng.uniform(0, 0.002))
            print(outcome.describe(), flush=True)


def random(runs: int) -> None:
    """Lines that are irregular all the time: 20 to 500 edges 0.5 to 3 s apart, both recorders with all faults."""
    rng, outcome = np.random.default_rng(0), Outcome('random')
    for _ in range(runs):
        gaps = rng.uniform(0.5, 3.0, rng.integers(20, 500))
        jitter_s = rng.uniform(0, 0.004)
        observe(outcome, line(gaps), rng, jitter_s, RecorderFaults(FAULTY, FAULTY, jitter_s))
    print(outcome.describe())


def camera(runs: int) -> None:
    """The light in the view of a camera: how many presses it takes until its clock can be fitted.

    They differ by up to 50 ms, as they do when the machine is asked every 50 ms whether it has arrived: presses in step
    with the frames would all be seen alike, and the fit takes errors for independent. Stamps are of the beginning of an
    exposure, and late by chance where a network is in between.
    """
    for fps, exposure_s, late_s in CAMERAS:
        for presses in (9, 40, 147, 500):
            label = f'{fps} images/s, {1e3 * exposure_s:g} ms exposed, {1e3 * late_s:g} ms late, {presses} presses'
            rng, outcome = np.random.default_rng(0), Outcome(label)
            for number in range(runs):
                edges = campaign(f'plan {number}', presses, longer_s=rng.uniform(0, 0.05, presses))
                watch(outcome, edges, rng, fps, exposure_s, late_s)
            print(outcome.describe(), flush=True)


def step(runs: int) -> None:
    """The same with presses in step with the frames: 4.1 s are 246 frames of 60 a second, 123 of 30."""
    for fps, exposure_s, late_s in CAMERAS[2:]:
        rng, outcome = np.random.default_rng(0), Outcome(f'{fps} images/s, in step, 147 presses')
        for number in range(runs):
            watch(outcome, campaign(f'plan {number}', 147), rng, fps, exposure_s, late_s)
        print(outcome.describe(), flush=True)


def watch(
    outcome: Outcome, edges: Sequence[Edge], rng: np.random.Generator, fps: int, exposure_s: float, late_s: float
) -> None:
    """Fit the clock of a camera, which starts at any time before the first edge."""
    begin_s = rng.uniform(-2.0, -1.0)
    start_s = begin_s + np.arange(round((edges[-1].stamp_ns - START_NS) / SECOND_NS + 4 - begin_s) * fps) / fps
    bright = 20 + 200 * lit_share(edges, start_s, exposure_s) + rng.normal(0, 2, len(start_s))
    clock = other_clock(rng)
    stamped_s = start_s + rng.uniform(0, late_s, len(start_s)) - late_s / 2
    stamps = np.array([clock.offset + clock.count(START_NS + round(each * 1e9)) for each in stamped_s], np.int64)
    found = light_edges(np.maximum.accumulate(stamps), bright, exposure_s)
    rig = seen_edges(recorded(edges, HOST, RIG), RIG.jitter_s)
    seen = {'rig': rig, 'other': Edges(found.stamp_ns, found.level, found.uncertainty_s)}
    judge(outcome, fitted(seen, 'rig').others[0].outcome, clock, edges)


def lit_share(edges: Sequence[Edge], start_s: np.ndarray, exposure_s: float) -> np.ndarray:
    """Of each exposure, the share during which the line was high."""
    times_s = np.array([(edge.stamp_ns - START_NS) / 1e9 for edge in edges])
    high_s = np.concatenate([[0.0], np.cumsum(np.diff(times_s) * np.array([edge.level for edge in edges[:-1]]))])
    until = [np.interp(start_s + after, times_s, high_s) for after in (0.0, exposure_s)]
    return np.asarray((until[1] - until[0]) / exposure_s)


def campaign(
    plan_id: str, presses: int, pulses: int = SYNC.pulses, ends: bool = True, longer_s: Sequence[float] = ()
) -> list[Edge]:
    """What the rig switches, if all presses take the same time to the nanosecond, or some longer by so much."""
    gaps: list[float] = []
    patterns = 0
    for press in range(presses):
        if press % SYNC.every == 0:
            gaps += pattern_gaps(plan_id, press + patterns, 2 * pulses)
            patterns += 1
        gaps += (PERIOD_S - WINDOW_S + (longer_s[press] if len(longer_s) else 0.0), WINDOW_S)
    return line([*gaps, *(pattern_gaps(plan_id, presses + patterns, 2 * pulses) if ends else ())])


def line(gaps_s: Iterable[float]) -> list[Edge]:
    """Edges after these gaps."""
    times = START_NS + np.round(np.cumsum(list(gaps_s)) * 1e9).astype(np.int64)
    return [Edge(int(time_ns), number % 2 == 0) for number, time_ns in enumerate(times)]


def observe(
    outcome: Outcome,
    edges: Sequence[Edge],
    rng: np.random.Generator,
    jitter_s: float,
    rig: RecorderFaults = RIG,
) -> None:
    """Fit the clock of a recorder, and compare it with the truth each second."""
    clock, seed = other_clock(rng), int(rng.integers(2**31))
    ours = recorded(edges, HOST, rig, seed + 1)
    theirs = recorded(edges, clock, RecorderFaults(FAULTY, FAULTY, jitter_s), seed)
    seen = {'rig': seen_edges(ours, rig.jitter_s), 'other': seen_edges(theirs, jitter_s)}
    judge(outcome, fitted(seen, 'rig').others[0].outcome, clock, edges)


def other_clock(rng: np.random.Generator) -> DeviceClock:
    """Up to 0.3 s off, and 100 ppm too fast or too slow."""
    return DeviceClock(1e9, START_NS, START_NS + round(rng.uniform(-0.3, 0.3) * 1e9), rng.choice([-100.0, 100.0]), 64)


def judge(outcome: Outcome, found: ClockFit | Refusal, clock: DeviceClock, edges: Sequence[Edge]) -> None:
    """Note it."""
    outcome.runs += 1
    if isinstance(found, Refusal):
        outcome.refused[found.reason.value] += 1
    else:
        outcome.errors_s.append(worst_s(found, clock, edges))


def seen_edges(seen: Sequence[tuple[int, bool]], half_s: float) -> Edges:
    """With what the recorder knows of its jitter, a tenth of a millisecond at least."""
    stamps, levels = zip(*seen, strict=True)
    return Edges(np.array(stamps, np.int64), np.array(levels, bool), np.full(len(stamps), max(half_s, 1e-4)))


def worst_s(fit: ClockFit, clock: DeviceClock, edges: Sequence[Edge]) -> float:
    """Anywhere from the first edge to the last."""
    times = np.arange(edges[0].stamp_ns, edges[-1].stamp_ns, SECOND_NS)
    read = np.array([clock.offset + clock.count(int(time_ns)) for time_ns in times])
    return float(np.abs(fit.host_ns(read) - times).max()) / SECOND_NS


if __name__ == '__main__':
    study = {'whole': whole, 'broken': broken, 'random': random, 'camera': camera, 'step': step}[sys.argv[1]]
    study(int(sys.argv[2]) if len(sys.argv) > 2 else 600)
