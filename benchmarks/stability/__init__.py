"""The failure bench: each disturbance from none to far too much, for each profile. Does it hold, and if not, does it
say so?

A simulated sensor takes its rest image, then something goes wrong, and forty presses come and go meanwhile. What the
live nodes would publish is compared with the truth: force errors, contacts told while nothing touches, contacts missed,
and the status of every message. Everything is simulation; docs/results/stability.md has the results.

    tactile bench stability --only shifted
    tactile bench stability --only time --profiles fast
    tactile bench stability --only blur --seed 12
    tactile bench stability -o docs/results
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import cv2

from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Part, Result, argument, at_once
from benchmarks.harness.running import Run
from benchmarks.stability.cases import CASES, Case, named
from benchmarks.stability.chain import Chain
from benchmarks.stability.floor import floor_n
from benchmarks.stability.page import FAMILIES, page
from benchmarks.stability.plots import draw
from benchmarks.stability.scores import Answer, Score, score
from benchmarks.stability.stream import Change, Plan, World, force_n
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Bar, Progress

PROFILES = ('paper', 'fast', 'field')
QUICK = Plan(presses=3, before=2, coming=6, after=12)


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """The disturbances that were asked for."""
    cv2.setNumThreads(1)
    cases = named(arguments.only) if arguments.only else list(CASES)
    if not cases:
        known = ', '.join(dict.fromkeys(each.family for each in CASES))
        raise ConfigurationError(f'no disturbance is called {arguments.only!r}; families are: {known}')
    plan = replace(QUICK if arguments.quick else Plan(), seed=arguments.seed)
    return measure(
        cases, arguments.profiles, plan, run.progress,
        largest_only=arguments.quick, part=run.part,
    )  # fmt: skip


def measure(
    cases: Sequence[Case],
    profiles: Sequence[str],
    plan: Plan,
    progress: Progress,
    *,
    largest_only: bool = False,
    part: Part = at_once,
) -> Result:
    """All numbers of the page."""
    world = World()
    levels = {case: case.levels[-1:] if largest_only else case.levels for case in cases}
    read_by = partial(follow, world, profiles=profiles, plan=plan)
    with progress.bar('disturbances', 1 + sum(map(len, levels.values()))) as bar:
        undisturbed, floor = read_by(Change()), floor_n(world, Change(), plan)
        bar.advance(1)
        found = [
            {'family': case.family, 'name': case.name, 'unit': case.unit, 'held_at': case.held_at,
             'points': part(f'{case.family} {case.name} {case.unit}', partial(
                 _points, case, levels[case], read_by, lambda change: floor_n(world, change, plan), bar
             ))}
            for case in cases
        ]  # fmt: skip
    return {
        'plan': asdict(plan),
        'profiles': list(profiles),
        'undisturbed': {name: asdict(each) for name, each in undisturbed.items()},
        'floor_n': floor,
        'cases': found,
    }


def _points(
    case: Case,
    levels: Sequence[float],
    read_by: Callable[[Change], dict[str, Score]],
    floor_of: Callable[[Change], float],
    bar: Bar,
) -> list[dict[str, Any]]:
    """One disturbance at each level."""
    points: list[dict[str, Any]] = []
    for level in levels:
        change = case.at(level)
        points.append({'level': level, 'scores': {name: asdict(each) for name, each in read_by(change).items()}})
        if level in case.held_at:
            points[-1]['floor_n'] = floor_of(change)
        bar.advance(1, f'{case.name} {level:g} {case.unit}')
    return points


def follow(world: World, change: Change, profiles: Sequence[str], plan: Plan) -> dict[str, Score]:
    """One stream, read by every profile."""
    answers = read(world, change, profiles, plan)
    return {name: score(each, change) for name, each in answers.items()}


def read(world: World, change: Change, profiles: Sequence[str], plan: Plan) -> dict[str, list[Answer]]:
    """What every profile says of every frame."""
    chains = {name: Chain(name) for name in profiles}
    answers: dict[str, list[Answer]] = {name: [] for name in profiles}
    for moment, picture in world.frames(change, plan):
        values = change.values if change.acts(moment) else None
        for name, chain in chains.items():
            message = chain.read(moment.stamp_ns, picture, moment.age_s, values)
            nominal_n = chain.nominal_n(force_n(moment, world.tables))
            answers[name].append(Answer.of(moment, message, world.tables, nominal_n))
    return answers


BENCHMARK = Benchmark(
    name='stability',
    about=__doc__,
    sources=('benchmarks/stability/**', *SENSING, *SIMULATED),
    page=page,
    measure=measured,
    draw=draw,
    seed=Plan.seed,
    quick=True,
    files=('stability.json', 'stability.md', *(f'stability_{family.replace(" ", "_")}.png' for family in FAMILIES)),
    arguments=(
        argument('--only', metavar='NAME', help='only disturbances whose name holds this, or of this family'),
        argument(
            '--profiles',
            nargs='+',
            default=list(PROFILES),
            metavar='MODEL',
            help='models that ship, or files of models of the simulated gel (default: paper fast field)',
        ),
    ),
)
