"""The presses in a table: image, place, force and indenter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.tables.cells import Cells, read_cells
from tactile_nodes.learning.tables.columns import UNITS, Column, columns_of
from tactile_nodes.learning.tables.faults import RowFaults

REACH_MM = (16.0, 16.0)
"""From the middle of the usual gel to its rims, along x and y."""
NOISE_TIMES = 4.0
"""A force within this many standard deviations of the gauge's noise at rest counts as zero."""
NOISE_SHARE = 0.1
"""Largest noise of a gauge at rest, as a share of the median force of presses."""
MOST_N = 200.0
"""A larger force on a soft gel means that the unit is wrong."""


@dataclass(frozen=True)
class TablePress:
    """A row of a table. Lengths in mm, places in the surface frame; forces in N on the gel, `force_n` into it.

    Unknown numbers are NaN. A force of 0 means that the gel is untouched. A row names an image, or a time in a video.
    """

    line: int
    picture: str
    time_s: float
    x_mm: float
    y_mm: float
    force_n: float
    shear_n: tuple[float, float]
    torque_nm: tuple[float, float, float]
    depth_mm: float
    indenter: str

    @property
    def touches(self) -> bool:
        """Whether anything touches the gel, including contacts of unknown force."""
        return self.force_n != 0

    @property
    def held(self) -> tuple[object, ...]:
        """A key that is equal for images of one press."""
        numbers = self.x_mm, self.y_mm, self.force_n, *self.shear_n, *self.torque_nm, self.depth_mm
        return *(None if math.isnan(each) else each for each in numbers), self.indenter  # NaN equals nothing


@dataclass(frozen=True)
class PressTable:
    """The rows of a table, and how its columns were interpreted, as text."""

    file: Path
    description: str
    rows: tuple[TablePress, ...]
    counted: str = 'line'

    @property
    def faults(self) -> RowFaults:
        """An empty collection for faults of its rows."""
        return RowFaults(self.file, self.counted)

    @property
    def of_video(self) -> bool:
        """Whether rows give times instead of images."""
        return any(not row.picture for row in self.rows)


def read_table(table: Path, reach_mm: tuple[float, float] = REACH_MM, untouched_n: float = 0.0) -> PressTable:
    """A table of presses, CSV or Parquet.

    Args:
        table: the file.
        reach_mm: from the middle to the rims of the gel along x and y; no place lies beyond.
        untouched_n: forces up to this size, of either sign, mean that the gel is untouched. Noise of a gauge at rest,
            estimated from forces below 0, is always treated so.

    Raises:
        DatasetError: it cannot be read or understood; says where.
        ConfigurationError: it is a Parquet file, and pyarrow is not installed.
    """
    cells = read_cells(table)
    columns = columns_of(cells.header, table)
    description = '; '.join([f'{name} from {column.description}' for name, column in columns.items()])
    unread = [each for each in cells.header if each.strip() and each not in {one.name for one in columns.values()}]
    description += f'; not read: {", ".join(unread)}' if unread else ''
    faults, rows = RowFaults(table), []
    if cells.decimal_comma:
        _require_one_decimal_mark(table, cells, columns)
    for line, row in cells.rows:
        with faults.row(line):
            values = _Row(dict(zip(cells.header, row, strict=True)), columns, cells)
            rows.append(values.press(line, untouched_n))
    noise_n = noise_at_rest_n(rows)
    if noise_n:
        rows = [replace(row, force_n=0.0) if _is_noise(row, noise_n) else row for row in rows]
        description += (
            f'; rows up to {noise_n:.2g} N without a place, or below 0, count as the untouched gel, by their noise'
        )
    names = {quantity: column.name for quantity, column in columns.items()}
    for press in rows:
        with faults.row(press.line):
            require_possible(press, reach_mm, names)
    faults.require_none()
    return PressTable(table, description, tuple(rows))


def _require_one_decimal_mark(table: Path, cells: Cells, columns: Mapping[str, Column]) -> None:
    """Refuse a table with 1,250 beside 0.5: its commas may separate thousands. Raises DatasetError."""
    numbers = {columns[quantity].name for quantity in columns.keys() & UNITS.keys()}
    first: dict[str, tuple[int, str]] = {}
    for line, row in cells.rows:
        for name, text in zip(cells.header, row, strict=True):
            for mark in ',.' if name in numbers else '':
                if mark in text:
                    first.setdefault(mark, (line, f'{name} is {text.strip()!r}'))
    if len(first) > 1:
        (before, text), (line, now) = sorted(first.values())
        raise DatasetError(
            f'{table}, line {line}: {now}, but in line {before} {text}: the comma may separate thousands; write '
            'decimals one way, and thousands without a separator'
        )


def noise_at_rest_n(rows: Sequence[TablePress]) -> float:
    """Largest noise of a gauge at rest, from forces below 0; 0 if there are none, or they are not noise.

    Ten forces of -0.01 N beside presses of 1 N give 0.04 N.
    """
    forces = np.array([row.force_n for row in rows])
    below, pressed = forces[forces < 0], forces[forces > 0]
    if not below.size or not pressed.size:
        return 0.0
    noise_n = NOISE_TIMES * float(np.sqrt(np.mean(below**2)))
    pressed = pressed[pressed > noise_n]
    return noise_n if pressed.size and noise_n <= NOISE_SHARE * np.median(pressed) else 0.0


def _is_noise(row: TablePress, noise_n: float) -> bool:
    """Whether a row shows the untouched gel: no press has a negative force."""
    return abs(row.force_n) <= noise_n and (row.force_n < 0 or not np.isfinite((row.x_mm, row.y_mm)).any())


def require_possible(press: TablePress, reach_mm: tuple[float, float], names: Mapping[str, str]) -> None:
    """Refuse values that no press can have. `names` gives the table's names of columns.

    Raises:
        DatasetError: describes the value.
    """
    if press.time_s < 0:
        raise DatasetError(f'{names["time"]} must not be negative: a video begins at 0')
    if press.force_n < 0:
        raise DatasetError(
            f'{names["force"]} must not be negative: force into the gel is positive; if a gauge shows noise on the '
            'untouched gel, use --untouched-below N'
        )
    if press.touches and press.depth_mm <= 0:
        raise DatasetError(f'{names["depth"]} must be above 0, or empty if it is unknown')
    for name, value, most, condition in (
        ('force', press.force_n, MOST_N, f'forces must be below {MOST_N:g} N'),
        ('x', press.x_mm, reach_mm[0], f'places must be within {reach_mm[0]:g} mm of the middle'),
        ('y', press.y_mm, reach_mm[1], f'places must be within {reach_mm[1]:g} mm of the middle'),
    ):
        if abs(value) > most + 1e-9:
            unit = 'N' if name == 'force' else 'mm'
            raise DatasetError(
                f'{names[name]} is read as {value:g} {unit}: {condition}; check the unit and the order of the columns'
            )


@dataclass(frozen=True)
class _Row:
    """The cells of one row by the names of their columns."""

    texts: Mapping[str, str]
    columns: Mapping[str, Column]
    cells: Cells

    def press(self, line: int, untouched_n: float) -> TablePress:
        picture, time_s, force_n = self.text('picture'), self.number('time'), self.number('force')
        if not picture and math.isnan(time_s):
            raise DatasetError('no image is named' if 'picture' in self.columns else 'no time in the video is given')
        if abs(force_n) <= untouched_n:
            force_n = 0.0
        return TablePress(
            line, picture, time_s, self.number('x'), self.number('y'), force_n, (self.number('fx'), self.number('fy')),
            (self.number('tx'), self.number('ty'), self.number('tz')), self.number('depth'), self.text('indenter'),
        )  # fmt: skip

    def text(self, name: str) -> str:
        """The text of a cell; empty without such a column."""
        return self.texts[self.columns[name].name].strip() if name in self.columns else ''

    def number(self, name: str) -> float:
        """The number in mm, N, N m or s; NaN for an empty cell."""
        text = self.text(name)
        if not text:
            return math.nan
        try:
            number = float(text.replace(',', '.') if self.cells.decimal_comma else text)
        except ValueError:
            number = math.nan
        column = self.columns[name]
        if not math.isfinite(number):
            raise DatasetError(f'{column.name} is {text!r}, but must be a number, or empty if unknown')
        return number * column.times
