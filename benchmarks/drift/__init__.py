"""When the drift monitor says that a calibration is ageing, and how wrong forces are by then: all of it simulated.

A camera that is knocked, a light that fades, a gel that stiffens with and without a force to compare with, another gel,
a sensor that warms up, and hours of presses in which nothing is wrong. Time is computed, not waited for.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.report import keep, surroundings, table

if TYPE_CHECKING:
    from benchmarks.drift.cases import Course, Effort, Point
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.model_file import LoadedModel

ENOUGH = {'ageing': ('ageing', 'invalid'), 'invalid': ('invalid',)}


@dataclass(frozen=True)
class Hours:
    """Hours in which nothing was wrong, and what the monitor said: how often it alarmed, and for how long."""

    hours: float
    pictures: int
    alarms: int
    alarmed_s: float
    largest_px: float
    unlike_share: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``tactile bench drift``."""
    parser.add_argument('--model', default='fast', help='a model of a simulated gel (default: fast)')
    parser.add_argument('--hours', type=float, default=4.0, help='of presses with nothing wrong (default: 4)')
    parser.add_argument('-o', '--output', type=Path, metavar='FOLDER', help='write drift.json and drift.md there')


def run(arguments: argparse.Namespace) -> int:
    """Measure, print, and keep."""
    from benchmarks.drift.cases import COURSES
    from tactile_nodes.learning.progress import TerminalProgress
    from tactile_nodes.model_file import find_model, load_model

    command = f'tactile bench drift --model {arguments.model} --hours {arguments.hours:g}'
    plain = surroundings(command)
    found, hours = measure(load_model(find_model(arguments.model)), COURSES, arguments.hours, TerminalProgress())
    text = page(command, found, hours)
    print(text)
    if arguments.output:
        told = {course.name: [asdict(each) for each in points] for course, points in found.items()}
        keep(arguments.output, 'drift', text, {**plain, 'courses': told, 'hours': asdict(hours)})
    return 0


def measure(
    loaded: LoadedModel, courses: Sequence[Course], hours: float, progress: Progress
) -> tuple[dict[Course, list[Point]], Hours]:
    """Every course, and the hours in which nothing is wrong.

    Raises:
        ModelError: the model is not of a simulated gel.
    """
    from benchmarks.drift.cases import follow
    from tactile_nodes.learning.evaluation.evaluate import config_of

    gel, found = config_of(loaded).gel, {}
    with progress.bar('changes', len(courses)) as bar:
        for course in courses:
            found[course] = follow(course, loaded, gel)
            bar.advance(1, course.name)
    return found, undisturbed(loaded, hours, progress)


def undisturbed(loaded: LoadedModel, hours: float, progress: Progress, effort: Effort | None = None) -> Hours:
    """Presses by many bodies, and nothing wrong."""
    from benchmarks.drift.cases import PER_S, Bench
    from tactile_nodes.learning.evaluation.evaluate import config_of
    from tactile_nodes.sensing.judge.drift_alarm import Level

    bench, alarms, alarmed, pictures, largest_px, was = (
        Bench(loaded, config_of(loaded).gel, effort),
        0,
        0,
        0,
        0.0,
        False,
    )
    with progress.bar('minutes in which nothing is wrong', round(hours * 60)) as bar:
        for at_s, verdict in bench.rest_for_hours(hours):
            now = verdict.level > Level.VALID
            alarms, alarmed, pictures, was = alarms + (now and not was), alarmed + now, pictures + 1, now
            if not math.isnan(verdict.moved_px):
                largest_px = max(largest_px, verdict.moved_px)
            if at_s % 60 == 0:
                bar.advance(1, f'{alarms} alarms')
    share = bench.monitor.verdict.unlike_share
    return Hours(hours, pictures, alarms, alarmed / PER_S, largest_px, share)


def page(command: str, found: Mapping[Course, Sequence[Point]], hours: Hours) -> str:
    """The results as a page of documentation."""
    heads = ['', 'ageing at', 'force RMSE, N', 'invalid at', 'force RMSE, N', 'seconds']
    return '\n'.join([
        '# Drift of a calibration',
        '',
        f'`{command}`',
        '',
        'Where the monitor first says ageing and invalid, and how wrong the forces of that sensor are there. Seconds:',
        'from the change to the higher level, where changes come at once; two pictures a second are looked at.',
        '',
        table(heads, [_summary(course, points) for course, points in found.items()]),
        '',
        f'**Nothing wrong** for {hours.hours:g} simulated hours of presses by tips, balls and punches, alone, in pairs',
        f'and dragged ({hours.pictures} pictures): {hours.alarms} alarms, {hours.alarmed_s:g} s of them. The largest',
        f'motion told was {hours.largest_px:.4f} px; of the last contacts {hours.unlike_share:.0%} were unlike the',
        'training.',
        *[line for course, points in found.items() for line in _detail(course, points)],
    ])  # fmt: skip


def _summary(course: Course, points: Sequence[Point]) -> list[str]:
    row = [course.name]
    for level in ('ageing', 'invalid'):
        first = next((each for each in points if each.level in ENOUGH[level]), None)
        row += ['never', ''] if first is None else [f'{first.extent:g} {course.unit}', _newtons(first)]
    times = [each.after_s for each in points if each.after_s is not None]
    told = f'{min(times):g} to {max(times):g}' if times and course.apart and not course.again else ''
    return [*row, told]


def _detail(course: Course, points: Sequence[Point]) -> list[str]:
    heads = [course.unit, 'force RMSE, N', 'place, mm', 'flagged by the model', 'monitor', 'reasons']
    rows = [
        [
            f'{each.extent:g}', _newtons(each), _or_dash(each.place_median_mm, '.3f'), f'{each.flagged:.0%}',
            each.level, each.reasons,
        ]
        for each in points
    ]  # fmt: skip
    return ['', f'## {course.name[0].upper()}{course.name[1:]}', '', table(heads, rows)]


def _newtons(point: Point) -> str:
    return _or_dash(point.force_rmse_n, '.4f')


def _or_dash(value: float, form: str) -> str:
    """A dash for what the model does not tell: a force without a number."""
    return '-' if math.isnan(value) else format(value, form)
