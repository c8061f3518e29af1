"""The presses to make: places on the gel and depths, with fixed numbers, identified by their hash.

A plan is a grid, random places, places spread over the gel, or a list from a file. The number of a press never
changes, and `plan_id` depends on the points alone, so that a journal and a bag can name their plan.
"""

from __future__ import annotations

import csv
import hashlib
import math
import random
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.files import read_text, separator_of
from tactile_nodes.params import from_mapping, load_mapping, parameter
from tactile_nodes.paths import described_in

ID_DIGITS = 12
UM_PER_MM = 1000
Triple = tuple[float, float, float]


class Point(NamedTuple):
    """One press.

    Attributes:
        press: its number in the plan, from 1.
        x_mm: on the gel's surface, from its centre.
        y_mm: likewise.
        depth_mm: of the tip below the untouched surface, along the surface's normal.
    """

    press: int
    x_mm: float
    y_mm: float
    depth_mm: float


MOST_POINTS = 200_000
MOST_MM = 1e6
CANDIDATES = 2000
"""Random places from which those of a spread plan are chosen."""


@dataclass(frozen=True)
class PlanSettings:
    """How the points of a plan are generated."""

    kind: str = parameter('grid', 'how points are generated', choices=('grid', 'random', 'spread', 'list'))
    columns: int = parameter(37, 'places along x', minimum=1)
    rows: int = parameter(37, 'places along y', minimum=1)
    pitch_mm: float = parameter(0.75, 'distance between neighbouring places of the grid', minimum=0.01)
    depths_mm: tuple[float, ...] = parameter((0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0), 'depths at each place')
    count: int = parameter(1000, 'number of presses of a random or spread plan', minimum=1)
    reach_mm: float = parameter(
        13.5, 'largest distance of random and spread places from the centre, in x and y', minimum=0.0
    )
    seed: int = parameter(1, 'seed of random and spread places')
    file: str = parameter('', 'CSV of points: x_mm, y_mm, depth_mm')
    rest_mm: float = parameter(4.0, 'presses closer than this to the last ones are postponed', minimum=0.0)
    rest_presses: int = parameter(8, 'number of last presses to keep this distance from', minimum=0)

    def __post_init__(self) -> None:
        if self.kind != 'list' and not self.depths_mm:
            raise ValueError('depths_mm is empty; give at least one depth')
        by_chance = self.kind in ('random', 'spread')
        points = self.count if by_chance else self.columns * self.rows * len(self.depths_mm)
        if self.kind != 'list' and points > MOST_POINTS:
            raise ValueError(f'that makes {points} presses, more than the limit of {MOST_POINTS}')
        if self.kind == 'spread' and self.count > CANDIDATES:
            raise ValueError(f'a spread plan has {CANDIDATES} presses at most; use random for {self.count}')


@dataclass(frozen=True)
class Plan:
    """Points, numbered 1, 2, 3, …

    Raises:
        ConfigurationError: no points, an invalid depth, or the same point twice.
    """

    points: tuple[Point, ...]

    def __post_init__(self) -> None:
        if not self.points:
            raise ConfigurationError('the plan holds no points; set rows and columns, a count, or a file')
        for point in self.points:
            if not all(abs(value) <= MOST_MM for value in point[1:]) or point.depth_mm <= 0:
                raise ConfigurationError(
                    f'press {point.press} of the plan has a depth of {point.depth_mm:g} mm at x {point.x_mm:g}, '
                    f'y {point.y_mm:g} mm; all must be numbers, and the depth above 0'
                )
        if len({_text(point).split(' ', 1)[1] for point in self.points}) < len(self.points):
            raise ConfigurationError('the plan holds the same place and depth twice; all presses must differ')

    @cached_property
    def plan_id(self) -> str:
        """The first 12 hexadecimal digits of a SHA-256 over a line ``press x y depth`` (in µm) for each point."""
        text = '\n'.join(_text(point) for point in self.points)
        return hashlib.sha256(text.encode('ascii')).hexdigest()[:ID_DIGITS]

    @property
    def deepest_mm(self) -> float:
        return max(point.depth_mm for point in self.points)

    @property
    def box_mm(self) -> tuple[float, float, float, float]:
        """The least x and y and the greatest x and y."""
        xs, ys = [point.x_mm for point in self.points], [point.y_mm for point in self.points]
        return min(xs), min(ys), max(xs), max(ys)


def make_plan(settings: PlanSettings) -> Plan:
    """The plan that the settings describe; the same settings give the same plan on every machine.

    Raises:
        ConfigurationError: a file is missing or has other content, or the plan has no points.
    """
    if settings.kind == 'list':
        return numbered(read_points(settings.file))
    if settings.kind == 'grid':
        return numbered(_grid(settings))
    chance = random.Random(settings.seed)  # noqa: S311  (for places, not for security)
    return numbered((_random if settings.kind == 'random' else _spread)(settings, chance))


def plan_path(name: str) -> Path:
    """The YAML file of the plan of that name in config/plans, or with that path.

    Raises:
        ConfigurationError: there is neither.
    """
    return described_in('plans', name, 'plan')


def load_plan_settings(path: Path) -> PlanSettings:
    """Plan settings from a YAML file; a list file is searched for in the same folder.

    Raises:
        ConfigurationError: no such file, one without entries, or an entry that is not a setting of a plan.
    """
    if not (written := load_mapping(path)):
        raise ConfigurationError(f'the plan {path} has no entries, of which at least one is needed, such as kind: grid')
    settings = from_mapping(PlanSettings, written, source=str(path), exact=False)
    if settings.file and not Path(settings.file).is_absolute():
        values = {**settings.__dict__, 'file': str(path.parent / settings.file)}
        settings = PlanSettings(**values)
    return settings


def numbered(points: Iterable[Triple]) -> Plan:
    """A plan of (x, y, depth) in mm, in this order, rounded to µm, the resolution of the machine."""
    return Plan(tuple(Point(i, *(round(value, 3) + 0.0 for value in point)) for i, point in enumerate(points, start=1)))


def read_points(path: str | Path) -> list[Triple]:
    """(x, y, depth) in mm from a CSV with these columns, separated by commas, semicolons or tabs.

    Raises:
        ConfigurationError: names the file and the row.
    """
    file = Path(path)
    try:
        text = read_text(file, encoding='utf-8-sig')  # spreadsheets write a byte order mark
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f'cannot read the list of points {str(path)!r}: {error}') from error
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith('#')]
    separator = separator_of(next(iter(lines), ''))
    rows = csv.DictReader(lines, delimiter=separator, skipinitialspace=True)
    point = '.' if separator == ',' else ','
    try:
        return [_triple(row, number, file, point) for number, row in enumerate(rows, start=1)]
    except csv.Error as error:
        raise ConfigurationError(f'{file} is not a list of points ({error}); check its quotation marks') from error


def _grid(settings: PlanSettings) -> Iterable[Triple]:
    for row in range(settings.rows):
        for column in range(settings.columns):
            x = (column - (settings.columns - 1) / 2) * settings.pitch_mm
            y = (row - (settings.rows - 1) / 2) * settings.pitch_mm
            for depth in settings.depths_mm:
                yield x, y, depth


def _random(settings: PlanSettings, chance: random.Random) -> Iterable[Triple]:
    low, high = min(settings.depths_mm), max(settings.depths_mm)
    for _ in range(settings.count):
        x, y = (settings.reach_mm * chance.uniform(-1, 1) for _ in range(2))
        yield x, y, chance.uniform(low, high)


def _spread(settings: PlanSettings, chance: random.Random) -> Iterable[Triple]:
    """Each place as far as possible from all before it, starting at the centre, so that any first part covers the gel.

    Gonzalez, Theoretical Computer Science 38, 1985: the furthest-first traversal. Many of the places are on the rim.
    """
    low, high, reach = min(settings.depths_mm), max(settings.depths_mm), settings.reach_mm
    places = [(reach * chance.uniform(-1, 1), reach * chance.uniform(-1, 1)) for _ in range(CANDIDATES)]
    place = min(places, key=lambda each: math.hypot(*each))
    distances_mm = [math.inf] * len(places)
    for _ in range(settings.count):
        yield *place, chance.uniform(low, high)
        distances_mm = [min(far, math.dist(place, each)) for far, each in zip(distances_mm, places, strict=True)]
        place = places[max(range(len(places)), key=distances_mm.__getitem__)]


def _triple(row: Mapping[str | None, Any], number: int, file: Path, point: str) -> Triple:
    if any(row.get(None, ())):
        raise ConfigurationError(
            f'point {number} of {file} has more values than columns: {", ".join(row[None])}; if its decimal separator '
            'is a comma, separate the values by semicolons'
        )
    try:
        x, y, depth = (row[name].replace(point, '.') for name in ('x_mm', 'y_mm', 'depth_mm'))
        return float(x), float(y), float(depth)
    except (KeyError, AttributeError, ValueError) as error:
        raise ConfigurationError(f'point {number} of {file} has no x_mm, y_mm and depth_mm: {row}') from error


def _text(point: Point) -> str:
    x, y, depth = (round(value * UM_PER_MM) for value in point[1:])
    return f'{point.press} {x} {y} {depth}'
