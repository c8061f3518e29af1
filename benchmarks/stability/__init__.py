"""Robustness to disturbances: force errors, false contacts and status for each disturbance, level and profile.

A simulated sensor captures its rest image. Then a disturbance begins, and forty presses follow. The messages that the
live nodes would publish are compared with the truth: force errors, contacts reported while nothing touches, missed
contacts, and the status of every message. Results are in docs/results/stability.md.

    tactile bench stability --only shifted
    tactile bench stability --only time --profiles fast
    tactile bench stability --only blur --seed 12
    tactile bench stability -o docs/results
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache
from typing import Any, NamedTuple

import cv2

from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Result, argument
from benchmarks.harness.running import Run
from benchmarks.stability.cases import CASES, Case, named
from benchmarks.stability.chain import Chain
from benchmarks.stability.floor import floor_n
from benchmarks.stability.page import FAMILIES, page
from benchmarks.stability.plots import draw
from benchmarks.stability.scores import Answer, Score, score
from benchmarks.stability.stream import Change, Plan, World, force_n
from tactile_nodes.errors import ConfigurationError

PROFILES = ('paper', 'fast', 'field')
Parts = Callable[[Callable[['Stream'], Any], Mapping[str, 'Stream'], str], dict[str, Any]]
QUICK = Plan(presses=3, before=2, coming=6, after=12)


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure the requested disturbances."""
    cases = named(arguments.only) if arguments.only else list(CASES)
    if not cases:
        known = ', '.join(dict.fromkeys(each.family for each in CASES))
        raise ConfigurationError(f'no disturbance is called {arguments.only!r}; families are: {known}')
    plan = replace(QUICK if arguments.quick else Plan(), seed=arguments.seed)
    return measure(cases, arguments.profiles, plan, run.parts, largest_only=arguments.quick)


def measure(
    cases: Sequence[Case], profiles: Sequence[str], plan: Plan, parts: Parts, *, largest_only: bool = False
) -> Result:
    """All numbers of the page; `parts`, such as `Run.parts`, measures the streams."""
    levels = {case: case.levels[-1:] if largest_only else case.levels for case in cases}
    jobs = {'undisturbed': Stream('', 0.0, tuple(profiles), plan)} | {
        f'{case.key} {level:g}': Stream(case.key, float(level), tuple(profiles), plan)
        for case in cases for level in levels[case]
    }  # fmt: skip
    found = parts(_followed, jobs, 'disturbances')
    return {
        'plan': asdict(plan),
        'profiles': list(profiles),
        'undisturbed': found['undisturbed']['scores'],
        'floor_n': found['undisturbed']['floor_n'],
        'cases': [
            {'family': case.family, 'name': case.name, 'unit': case.unit, 'held_at': case.held_at,
             'points': [found[f'{case.key} {level:g}'] for level in levels[case]]}
            for case in cases
        ],
    }  # fmt: skip


class Stream(NamedTuple):
    """A disturbance, by its key, at a level; '' is none. Each is a task."""

    case: str
    level: float
    profiles: tuple[str, ...]
    plan: Plan


def _followed(stream: Stream) -> dict[str, Any]:
    """Scores of each profile on a stream, and the lower bound of the error where errors must stay small."""
    cv2.setNumThreads(1)
    world = _world()
    case = next((each for each in CASES if each.key == stream.case), None)
    change = Change() if case is None else case.at(stream.level)
    scores = follow(world, change, stream.profiles, stream.plan)
    entry: dict[str, Any] = {'level': stream.level, 'scores': {name: asdict(each) for name, each in scores.items()}}
    if case is None or stream.level in case.held_at:
        entry['floor_n'] = floor_n(world, change, stream.plan)
    return entry


@cache
def _world() -> World:
    """The gel of the models, once for all streams of a process."""
    return World()


def follow(world: World, change: Change, profiles: Sequence[str], plan: Plan) -> dict[str, Score]:
    """Scores of every profile on one stream."""
    answers = read(world, change, profiles, plan)
    return {name: score(each, change) for name, each in answers.items()}


def read(
    world: World,
    change: Change,
    profiles: Sequence[str],
    plan: Plan,
    chains: Mapping[str, Chain] | None = None,
    begin: int = 0,
) -> dict[str, list[Answer]]:
    """The answers of every profile for every frame; `chains` that have read the first ones go on with `begin`."""
    chains = chains or {name: Chain(name) for name in profiles}
    answers: dict[str, list[Answer]] = {name: [] for name in profiles}
    for moment, picture in world.frames(change, plan, begin):
        values = change.values if change.acts(moment) else None
        for name, chain in chains.items():
            message = chain.read(moment.stamp_ns, picture, moment.age_s, values)
            nominal_n = chain.nominal_n(force_n(moment, world.tables))
            answers[name].append(Answer.of(moment, message, world.tables, nominal_n))
    return answers


BENCHMARK = Benchmark(
    name='stability',
    about=__doc__,
    sources=('benchmarks/stability/**', 'benchmarks/disturbances.py', *SENSING, *SIMULATED),
    page=page,
    measure=measured,
    draw=draw,
    seed=Plan.seed,
    quick=True,
    tasks=True,
    files=('stability.json', 'stability.md', *(f'stability_{family.replace(" ", "_")}.png' for family in FAMILIES)),
    arguments=(
        argument('--only', metavar='NAME', help='only disturbances whose name contains this, or of this family'),
        argument(
            '--profiles',
            nargs='+',
            default=list(PROFILES),
            metavar='MODEL',
            help='names of models that ship, or model files for the simulated gel (default: paper fast field)',
        ),
    ),
)
