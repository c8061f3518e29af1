"""Speed against accuracy of all methods to measure motion, on several grids, with the same training and test frames.

Each simulated frame is rendered once and measured by all methods, in an order that is reversed for every other frame.
The readout of each method is fitted on the first frames, with the same effort. It is scored and timed on the others,
which have other rest images: CPU and wall time of one thread from image to force. Memory is measured in a separate
process. The Pareto front consists of the methods that no other method beats in both time and error.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

from benchmarks.front.contenders import WAYS, Way, contenders, one_thread
from benchmarks.front.frames import Plan, frames
from benchmarks.front.page import page
from benchmarks.front.shelf import Shelf
from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Part, Result, argument, at_once
from benchmarks.harness.running import Run
from benchmarks.speed_accuracy import draw_tips as draw
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.sensing.metrics import pareto_front

if TYPE_CHECKING:
    from tactile_nodes.learning.progress import Progress

ERRORS = ('armse_n', 'd_loc_mm', 'rmse_mc_n')
QUICK = Plan(train=300, test=16, slow=False, compiled=False)


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure as requested on the command line."""
    plan = _plan(arguments)
    ways = [way for way in WAYS if (arguments.only or '') in way.name and (plan.slow or not way.slow)]
    if not ways:
        raise ConfigurationError(f'no way is called {arguments.only!r}; there are: {", ".join(w.name for w in WAYS)}')
    return measure(ways, plan, run.progress, run.part)


def measure(ways: Sequence[Way], plan: Plan, progress: Progress, part: Part = at_once) -> Result:
    """All numbers of the page.

    Raises:
        DatasetError: there are too few frames for training.
    """
    from benchmarks.front.profiles import measure_profiles

    one_thread()
    table = part('contenders', partial(_contenders, ways, plan, progress))
    shipped = part('profiles', partial(measure_profiles, plan, progress))
    return {'threads': 1, 'plan': asdict(plan), 'contenders': table, 'fronts': fronts(table), **shipped}


def _contenders(ways: Sequence[Way], plan: Plan, progress: Progress) -> dict[str, Any]:
    from benchmarks.front.fit import fitted
    from benchmarks.front.memory import memory_mb

    taking_part = contenders(ways, plan.networks)
    shelf = Shelf(ways, taking_part)
    with progress.bar('measuring frames', plan.train + plan.test) as bar:
        for frame in frames(plan):
            shelf.take(frame)
            bar.advance()
    found = fitted(shelf, taking_part, plan.train, progress)
    memory = {way.name: memory_mb(way.name) for way in ways}
    return {name: {**each, 'memory_mb': memory[each['way']]} for name, each in found.items()}


def fronts(table: dict[str, Any]) -> dict[str, list[str]]:
    """By error, the contenders that no other beats, the fastest first."""
    names = list(table)
    costs = [table[name]['cpu_ms']['median'] for name in names]
    return {error: [names[i] for i in pareto_front(costs, [table[name][error] for name in names])] for error in ERRORS}


def _plan(arguments: argparse.Namespace) -> Plan:
    plan = QUICK if arguments.quick else Plan()
    train = plan.train if arguments.train is None else arguments.train
    test = plan.test if arguments.test is None else arguments.test
    return Plan(train, test, plan.slow and not arguments.no_slow, arguments.networks, plan.compiled)


BENCHMARK = Benchmark(
    name='front',
    about=__doc__,
    sources=(
        'benchmarks/front/**',
        'benchmarks/stability/chain.py',
        'tactile_nodes/learning/**',
        *SENSING,
        *SIMULATED,
    ),
    page=page,
    measure=measured,
    draw=draw,
    quick=True,
    files=('front.json', 'front.md', 'speed_accuracy.png'),
    arguments=(
        argument('--train', least=300, type=int, metavar='N', help='training frames (default: 1500)'),
        argument('--test', least=1, type=int, metavar='N', help='test frames (default: 400)'),
        argument('--only', metavar='TEXT', help='only methods whose name contains this, such as "DIS"'),
        argument('--networks', action='store_true', help='also networks, on four of the features (needs torch)'),
        argument('--no-slow', action='store_true', help='without methods that take hundreds of ms per frame (TV-L1)'),
    ),
)
