"""The failure bench: each disturbance from none to far too much, for each profile. Does it hold, and if not, does it
say so?

A simulated sensor takes its rest image, then something goes wrong, and forty presses come and go meanwhile. What the
live nodes would publish is compared with the truth: force errors, contacts told while nothing touches, contacts missed,
and the status of every message. Everything is simulation; docs/results/stability.md has the results.

    tactile bench stability --only shifted
    tactile bench stability --only time --profiles fast
    tactile bench stability --only blur --seed 12
    tactile bench stability --only slowly --single
    tactile bench stability -o docs/results
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2

from benchmarks.report import keep, surroundings
from benchmarks.stability.cases import CASES, Case, named
from benchmarks.stability.chain import Chain
from benchmarks.stability.floor import floor_n
from benchmarks.stability.scores import Answer, Score, score
from benchmarks.stability.stream import Change, Plan, World
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.learning.progress import Progress, TerminalProgress

PROFILES = ('paper', 'fast', 'accurate')
QUICK = Plan(presses=3, before=2, coming=6, after=12)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench stability``."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument('--only', metavar='NAME', help='only disturbances whose name holds this, or of this family')
    parser.add_argument(
        '--profiles', nargs='+', default=list(PROFILES), metavar='MODEL',
        help='models that ship, or files of models of the simulated gel (default: paper fast accurate)',
    )  # fmt: skip
    parser.add_argument('--seed', type=int, default=Plan.seed, help='of places and depths of the presses (default: 11)')
    parser.add_argument('--single', action='store_true', help='every force of its own frame: averages over no others')
    parser.add_argument('--quick', action='store_true', help='three presses and the largest level: to see that it runs')
    parser.add_argument('-o', '--output', type=Path, metavar='FOLDER', help='write stability.json, .md and .png there')


def run(arguments: argparse.Namespace) -> int:
    """Measure, print, and keep."""
    from benchmarks.stability.page import page
    from benchmarks.stability.plots import draw

    cv2.setNumThreads(1)
    cases = named(arguments.only) if arguments.only else list(CASES)
    if not cases:
        known = ', '.join(dict.fromkeys(each.family for each in CASES))
        raise ConfigurationError(f'no disturbance is called {arguments.only!r}; families are: {known}')
    plan = replace(QUICK if arguments.quick else Plan(), seed=arguments.seed)
    result = surroundings(_command(arguments))
    result |= measure(
        cases, arguments.profiles, plan, TerminalProgress(), largest_only=arguments.quick, single=arguments.single
    )
    text = page(result)
    print(text)
    if arguments.output:
        keep(arguments.output, 'stability', text, result)
        draw(result, arguments.output)
    return 0


def measure(
    cases: Sequence[Case],
    profiles: Sequence[str],
    plan: Plan,
    progress: Progress,
    *,
    largest_only: bool = False,
    single: bool = False,
) -> dict[str, Any]:
    """All numbers of the page; `single`: of forces that are averaged over no frames."""
    world = World()
    found: list[dict[str, Any]] = []
    levels = {case: case.levels[-1:] if largest_only else case.levels for case in cases}
    with progress.bar('disturbances', 1 + sum(map(len, levels.values()))) as bar:
        undisturbed, floor = follow(world, Change(), profiles, plan, single=single), floor_n(world, Change(), plan)
        bar.advance(1)
        for case in cases:
            points: list[dict[str, Any]] = []
            for level in levels[case]:
                scores = follow(world, case.at(level), profiles, plan, single=single)
                points.append({'level': level, 'scores': {name: asdict(each) for name, each in scores.items()}})
                if level in case.held_at:
                    points[-1]['floor_n'] = floor_n(world, case.at(level), plan)
                bar.advance(1, f'{case.name} {level:g} {case.unit}')
            about = {'family': case.family, 'name': case.name, 'unit': case.unit, 'held_at': case.held_at}
            found.append({**about, 'points': points})
    return {
        'plan': asdict(plan),
        'profiles': list(profiles),
        'undisturbed': {name: asdict(each) for name, each in undisturbed.items()},
        'floor_n': floor,
        'cases': found,
    }


def follow(
    world: World, change: Change, profiles: Sequence[str], plan: Plan, *, single: bool = False
) -> dict[str, Score]:
    """One stream, read by every profile."""
    answers = read(world, change, profiles, plan, single=single)
    return {name: score(each, change) for name, each in answers.items()}


def read(
    world: World, change: Change, profiles: Sequence[str], plan: Plan, *, single: bool = False
) -> dict[str, list[Answer]]:
    """What every profile says of every frame."""
    chains = {name: Chain(name, average_noise=not single) for name in profiles}
    answers: dict[str, list[Answer]] = {name: [] for name in profiles}
    for moment, picture in world.frames(change, plan):
        values = change.values if change.acts(moment) else None
        for name, chain in chains.items():
            message = chain.read(moment.stamp_ns, picture, moment.age_s, values)
            answers[name].append(Answer.of(moment, message, world.tables))
    return answers


def _command(arguments: argparse.Namespace) -> str:
    words = ['tactile bench stability', *['--quick'] * arguments.quick, *['--single'] * arguments.single]
    words += [f'--only "{arguments.only}"'] if arguments.only else []
    words += [] if arguments.seed == Plan.seed else ['--seed', str(arguments.seed)]
    words += [] if arguments.profiles == list(PROFILES) else ['--profiles', *arguments.profiles]
    return ' '.join([*words, *(['-o', str(arguments.output)] if arguments.output else [])])
