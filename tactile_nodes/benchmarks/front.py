"""Speed against accuracy: every way to measure motion, on several grids, trained alike and timed on the same frames.

Each frame of simulated presses is rendered once and measured by all, in an order that turns round from frame to frame.
From the first frames each contender's readout is fitted, with the same budget; on the others, with rest images of their
own, it is scored and timed: CPU and wall time of one thread from image to force. Memory is what a process of its own
grows by. The front is of those that no other beats in both time and error. All of it is simulation.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_nodes.benchmarks.front_contenders import WAYS, Contender, Measuring, Way, contenders, one_thread
from tactile_nodes.benchmarks.report import keep, surroundings
from tactile_nodes.clock import perf_ns
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.gel_tables import contact_table
from tactile_nodes.sensing.geometry import centre_crop
from tactile_nodes.sensing.metrics import pareto_front
from tactile_nodes.sensing.reference import average
from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.optics import Optics, Press

if TYPE_CHECKING:
    from tactile_nodes.learning.progress import Progress

ERRORS = ('armse_n', 'd_loc_mm', 'rmse_mc_n')
SIDE = 440
STILL_SHARE = 0.1
ACROSS_REST_IMAGES = 100
"""Frames that are measured against one rest image."""
Time = tuple[float, float]
"""CPU and wall time, ms."""


@dataclass(frozen=True)
class Plan:
    """Frames to learn from and to be scored by, and whether slow ways, networks and compiled loops take part."""

    train: int = 1500
    test: int = 400
    slow: bool = True
    networks: bool = False
    compiled: bool = True


QUICK = Plan(train=300, test=16, slow=False, compiled=False)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench front``."""
    parser.add_argument('--train', type=int, metavar='N', help='frames to learn from (default: 1500)')
    parser.add_argument('--test', type=int, metavar='N', help='frames to score and time by (default: 400)')
    parser.add_argument('--only', metavar='TEXT', help='only ways whose name holds this, such as "DIS"')
    parser.add_argument('--networks', action='store_true', help='also networks, on four of the features (needs torch)')
    parser.add_argument('--no-slow', action='store_true', help='leave out what takes hundreds of ms a frame (TV-L1)')
    parser.add_argument('--quick', action='store_true', help='few frames, no slow ways: to see that it runs')
    parser.add_argument(
        '-o', '--output', type=Path, metavar='FOLDER', help='write front.json, front.md and front.png there'
    )


def run(arguments: argparse.Namespace) -> int:
    """Measure, print, and keep."""
    from tactile_nodes.benchmarks.front_page import draw, page
    from tactile_nodes.learning.progress import TerminalProgress

    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    plan = _plan(arguments)
    ways = [way for way in WAYS if (arguments.only or '') in way.name and (plan.slow or not way.slow)]
    if not ways:
        raise ConfigurationError(f'no way is called {arguments.only!r}; there are: {", ".join(w.name for w in WAYS)}')
    result = measure(ways, plan, TerminalProgress(), _command(arguments))
    text = page(result)
    print(text)
    if arguments.output:
        keep(arguments.output, 'front', text, result)
        draw(result, arguments.output / 'front.png')
    return 0


def measure(
    ways: Sequence[Way], plan: Plan, progress: Progress, command: str = 'tactile bench front'
) -> dict[str, Any]:
    """All numbers of the page.

    Raises:
        DatasetError: there are too few frames to learn from.
    """
    from tactile_nodes.benchmarks.front_fit import fitted
    from tactile_nodes.benchmarks.front_memory import memory_mb
    from tactile_nodes.benchmarks.front_profiles import measure_profiles

    about = surroundings(command)
    one_thread()
    taking_part = contenders(ways, plan.networks)
    shelf = Shelf(ways, taking_part)
    with progress.bar('measuring frames', plan.train + plan.test) as bar:
        for frame in frames(plan):
            shelf.take(frame)
            bar.advance()
    found = fitted(shelf, taking_part, plan.train, progress)
    memory = {way.name: memory_mb(way.name) for way in ways}
    table = {name: {**each, 'memory_mb': memory[each['way']]} for name, each in found.items()}
    shipped = measure_profiles(plan, progress)
    return {**about, 'threads': 1, 'plan': asdict(plan), 'contenders': table, 'fronts': fronts(table), **shipped}


def fronts(table: dict[str, Any]) -> dict[str, list[str]]:
    """By error, which contenders no other beats, the cheapest first."""
    names = list(table)
    costs = [table[name]['cpu_ms']['median'] for name in names]
    return {error: [names[i] for i in pareto_front(costs, [table[name][error] for name in names])] for error in ERRORS}


@dataclass(frozen=True)
class Frame:
    """An image, the rest image it is measured against, where and how deep the tip was, and with which force."""

    image: np.ndarray
    rest: np.ndarray
    press: tuple[float, float, float, float]


def frames(plan: Plan, seed: int = 11) -> Iterator[Frame]:
    """Presses anywhere within 27x27 mm and to 2 mm, and frames at rest; rest images of training serve no test."""
    gel = Gel()
    table = contact_table(gel)
    optics, random = Optics(gel, table), np.random.default_rng(seed)
    for phase, count in enumerate((plan.train, plan.test)):
        for number in range(count):
            noise = 1_000_000 * (phase + 1) + 100 * number
            if number % ACROSS_REST_IMAGES == 0:
                rest = average([_crop(optics.render((), noise + 1 + i)) for i in range(16)])
            x_mm, y_mm, depth_mm = random.uniform((-13.5, -13.5, 0.05 if phase == 0 else 0.25), (13.5, 13.5, 2.0))
            if random.random() < STILL_SHARE:
                depth_mm = -1.0
            image = _crop(optics.render((Press(float(x_mm), float(y_mm), float(depth_mm)),), noise))
            yield Frame(image, rest, (x_mm, y_mm, depth_mm, table.force_at(float(depth_mm))))


def _crop(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(centre_crop(image, SIDE, SIDE))


class Shelf:
    """What all ways measured of all frames, and how long each took over it.

    `values` and `confidence` are by way, grid and encoding; `times_ms` (CPU, wall) of flow and features together.
    """

    def __init__(self, ways: Sequence[Way], taking_part: Sequence[Contender]) -> None:
        keys = sorted({(each.way, each.regions, each.encoding) for each in taking_part})
        self.values: dict[tuple[str, int, str], list[np.ndarray]] = {key: [] for key in keys}
        self.confidence: dict[tuple[str, int, str], list[np.ndarray]] = {key: [] for key in keys}
        self.times_ms: dict[tuple[str, int, str], list[Time]] = {key: [] for key in keys}
        self.presses: list[tuple[float, float, float, float]] = []
        self._measuring = [Measuring(way, [key[1:] for key in keys if key[0] == way.name]) for way in ways]
        self._rest: np.ndarray | None = None

    def take(self, frame: Frame) -> None:
        """Measure one frame by all ways."""
        if frame.rest is not self._rest:
            self._rest = frame.rest
            for each in self._measuring:
                each.set_reference(frame.rest)
                for _, flow in each.flows():
                    flow(frame.rest)
        for each in self._measuring[:: 1 if len(self.presses) % 2 else -1]:
            self._take(each, frame.image)
        self.presses.append(frame.press)

    def _take(self, measuring: Measuring, image: np.ndarray) -> None:
        for grid, flow in measuring.flows():
            begun = _now()
            measured = flow(image)
            flow_ms = _since(begun)
            for regions, encoding in measuring.wanted:
                if grid not in (0, regions):
                    continue
                begun = _now()
                features = measuring.encode(regions, encoding, measured)
                took = _since(begun)
                key = measuring.way.name, regions, encoding
                self.values[key].append(features.values.astype(np.float16))
                self.confidence[key].append(features.confidence)
                self.times_ms[key].append((flow_ms[0] + took[0], flow_ms[1] + took[1]))


def _now() -> tuple[int, int]:
    return time.process_time_ns(), perf_ns()


def _since(begun: tuple[int, int]) -> Time:
    cpu, wall = time.process_time_ns() - begun[0], perf_ns() - begun[1]
    return cpu / 1e6, wall / 1e6


def _plan(arguments: argparse.Namespace) -> Plan:
    plan = QUICK if arguments.quick else Plan()
    train = plan.train if arguments.train is None else arguments.train
    test = plan.test if arguments.test is None else arguments.test
    if train < 300 or test < 1:
        raise ConfigurationError('--train must be at least 300, and --test at least 1')
    return Plan(train, test, plan.slow and not arguments.no_slow, arguments.networks, plan.compiled)


def _command(arguments: argparse.Namespace) -> str:
    switches = ('quick', 'no-slow', 'networks')
    words = ['tactile bench front', *(f'--{each}' for each in switches if getattr(arguments, each.replace('-', '_')))]
    words += [f'--{name} {value}' for name in ('train', 'test') if (value := getattr(arguments, name)) is not None]
    words += [f'--only "{arguments.only}"'] if arguments.only else []
    return ' '.join([*words, *(['-o', str(arguments.output)] if arguments.output else [])])
