"""When the drift monitor reports that a calibration is ageing or invalid, and how large the force errors are then.

Simulated cases: a knocked camera, a fading light, a gel that stiffens (with and without a force to compare with),
another gel, a sensor that warms up, and hours of presses without a fault. Time is simulated too.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from benchmarks.drift.cases import COURSES, PERIOD_S, Bench, Course, Effort, Point, follow
from benchmarks.harness.declaration import SENSING, SIMULATED, Benchmark, Part, Result, argument, at_once
from benchmarks.harness.report import opening, shown, table
from benchmarks.harness.running import Run

if TYPE_CHECKING:
    from tactile_nodes.learning.progress import Progress
    from tactile_nodes.model_file import LoadedModel
    from tactile_nodes.simulation.gel import Gel

ABOUT = """\
The change at which the monitor first reports `ageing` or `invalid`, and the force error there. *seconds*: time from a
sudden change to the higher level. The monitor checks a picture every two seconds, and every half second while it
suspects a fault."""
NOTHING_WRONG = """\
**No fault**: {hours:g} simulated hours of presses by tips, balls and punches, alone, in pairs and dragged
({pictures} pictures) gave {alarms} alarms, {alarmed_s:g} s in total. The largest reported motion was
{largest_px:.4f} px. Of the last contacts, {unlike_share:.0%} were unlike the training."""
ENOUGH = {'ageing': ('ageing', 'invalid'), 'invalid': ('invalid',)}


@dataclass(frozen=True)
class Hours:
    """Hours without a fault, and the monitor's reports: number and duration of the alarms."""

    hours: float
    pictures: int
    alarms: int
    alarmed_s: float
    largest_px: float
    unlike_share: float


def measured(arguments: argparse.Namespace, run: Run) -> Result:
    """Measure every course, and the hours without a fault."""
    from tactile_nodes.model_file import find_model, load_model

    return measure(load_model(find_model(arguments.model)), COURSES, arguments.hours, run.progress, run.part)


def measure(
    loaded: LoadedModel, courses: Sequence[Course], hours: float, progress: Progress, part: Part = at_once
) -> Result:
    """Measure every course, and the hours without a fault.

    Raises:
        ModelError: the model is not for a simulated gel.
    """
    from tactile_nodes.learning.evaluation.evaluate import config_of

    gel, found = config_of(loaded).gel, {}
    with progress.bar('changes', len(courses)) as bar:
        for course in courses:
            found[course.name] = part(course.name, partial(_followed, course, loaded, gel))
            bar.advance(1, course.name)
    return {'courses': found, 'hours': asdict(undisturbed(loaded, hours, progress))}


def _followed(course: Course, loaded: LoadedModel, gel: Gel) -> list[dict[str, Any]]:
    return [asdict(each) for each in follow(course, loaded, gel)]


def undisturbed(loaded: LoadedModel, hours: float, progress: Progress, effort: Effort | None = None) -> Hours:
    """Measure hours of presses by many bodies, without a fault."""
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
    return Hours(hours, pictures, alarms, alarmed * PERIOD_S, largest_px, share)


def _summary(course: Course, points: Sequence[Point]) -> list[str]:
    row = [course.name]
    for level in ('ageing', 'invalid'):
        first = next((each for each in points if each.level in ENOUGH[level]), None)
        row += ['never', ''] if first is None else [f'{first.extent:g} {course.unit}', _newtons(first)]
    times = [each.after_s for each in points if each.after_s is not None]
    delays = f'{min(times):g} to {max(times):g}' if times and course.apart and not course.again else ''
    return [*row, delays]


def _detail(course: Course, points: Sequence[Point]) -> list[str]:
    heads = [course.unit, 'force RMSE, N', 'place, mm', 'flagged by the model', 'monitor', 'reasons']
    rows = [
        [
            f'{each.extent:g}', _newtons(each), shown(each.place_median_mm, '{:.3f}', '-'), f'{each.flagged:.0%}',
            each.level, each.reasons,
        ]
        for each in points
    ]  # fmt: skip
    return [f'## {course.name[0].upper()}{course.name[1:]}', table(heads, rows)]


def _newtons(point: Point) -> str:
    return shown(point.force_rmse_n, '{:.4f}', '-')


def page(result: Mapping[str, Any]) -> str:
    """The results as a page of documentation."""
    heads = ['', 'ageing at', 'force RMSE, N', 'invalid at', 'force RMSE, N', 'seconds']
    courses = result['courses']
    found = {course: [Point(**each) for each in courses[course.name]] for course in COURSES if course.name in courses}
    parts = opening('Drift of a calibration', result, ABOUT)
    parts.append(table(heads, [_summary(course, points) for course, points in found.items()]))
    parts.append(NOTHING_WRONG.format(**result['hours']))
    return '\n\n'.join([*parts, *(line for course, points in found.items() for line in _detail(course, points))])


BENCHMARK = Benchmark(
    name='drift',
    about=__doc__,
    sources=('benchmarks/drift/**', 'benchmarks/disturbances.py', *SENSING, *SIMULATED),
    page=page,
    measure=measured,
    arguments=(
        argument('--model', default='fast', help='a model of a simulated gel (default: fast)'),
        argument('--hours', type=float, default=4.0, help='hours of presses without a fault (default: 4)'),
    ),
)
