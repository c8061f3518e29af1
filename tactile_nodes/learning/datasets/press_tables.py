"""A table of pictures and of what is known of each, as people write such tables: names and units of columns vary.

A column is known by its name, its unit stands in the header: `force_n`, `Force [mN]`, `grams`, `x (mm)`. What a name
leaves open is asked, not guessed; how every column was read is said.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from tactile_nodes.errors import DatasetError
from tactile_nodes.files import read_text

NEWTON_PER_GRAM = 9.81e-3
MILLIMETRES = {'um': 1e-3, 'mm': 1.0, 'cm': 10.0, 'm': 1e3}
NEWTONS = {'n': 1.0, 'mn': 1e-3, 'g': NEWTON_PER_GRAM, 'kg': 1e3 * NEWTON_PER_GRAM}
SPELT = {
    'newton': 'n', 'newtons': 'n', 'millinewton': 'mn', 'millinewtons': 'mn', 'gram': 'g', 'grams': 'g',
    'gramme': 'g', 'grammes': 'g', 'kilogram': 'kg', 'kilograms': 'kg', 'millimetre': 'mm', 'millimetres': 'mm',
    'millimeter': 'mm', 'millimeters': 'mm',
}  # fmt: skip
SHOWN = {'n': 'N', 'mn': 'mN'}
NAMES = {
    'picture': {
        'picture', 'pictures', 'image', 'img', 'photo', 'file', 'filename', 'file name', 'image file', 'picture file',
        'path',
    },
    'x': {'x', 'pos x', 'x pos', 'position x', 'x position', 'place x', 'contact x'},
    'y': {'y', 'pos y', 'y pos', 'position y', 'y position', 'place y', 'contact y'},
    'force': {'force', 'normal force', 'weight', 'mass', 'load', 'f', 'fz', 'force z', 'fn'},
}  # fmt: skip
EXAMPLE = 'picture,x_mm,y_mm,force_n'
DELIMITERS = ',;\t'
SURFACE_MM = 16.0


@dataclass(frozen=True)
class Column:
    """What a column tells, what one of its units is in mm or N, and how it was understood, in words."""

    name: str
    times: float
    told: str


def read_table(table: Path) -> tuple[str, list[tuple[str, tuple[float, float, float]]]]:
    """How the columns were read, and by row a picture with x, y (mm) and force (N), NaN where nobody knows.

    Raises:
        DatasetError: it cannot be read or understood; says where.
    """
    try:
        # The mark that spreadsheets begin their tables with is no part of the first name.
        text = read_text(table, encoding='utf-8-sig')
    except OSError as error:
        raise DatasetError(f'cannot read {table} ({error.strerror}); give a table of pictures') from error
    except UnicodeDecodeError as error:
        raise DatasetError(
            f'{table} is no table of pictures; its first line names columns, as {EXAMPLE}, in UTF-8'
        ) from error
    try:
        rows = list(_rows(text, table))
    except csv.Error as error:
        raise DatasetError(f'{table} is no table of pictures ({error}); begin it with {EXAMPLE}') from error
    header, cells = (rows[0][1], rows[1:]) if rows else ([], [])
    columns = columns_of(header, table)
    told = '; '.join([f'{name} from {column.told}' for name, column in columns.items()])
    unread = [each for each in header if each.strip() and each not in {column.name for column in columns.values()}]
    told += f'; not read: {", ".join(unread)}' if unread else ''
    decimal_comma = _delimiter(text) != ','
    return told, [
        _press(dict(zip(header, row, strict=True)), columns, f'{table}, line {line}', decimal_comma)
        for line, row in cells
    ]


def _delimiter(text: str) -> str:
    first = next(iter(text.splitlines()), '')
    return max(DELIMITERS, key=first.count)


def _rows(text: str, table: Path) -> Iterator[tuple[int, list[str]]]:
    """Lines by number, with as many cells as the first one; empty ones are passed over."""
    reader, width = csv.reader(text.splitlines(), delimiter=_delimiter(text), strict=True), 0
    for row in reader:
        if not any(cell.strip() for cell in row):
            continue
        width = width or len(row)
        if len(row) != width:
            raise DatasetError(f'{table}, line {reader.line_num} has {len(row)} cells, and the first line has {width}')
        yield reader.line_num, row


def columns_of(header: list[str], table: Path) -> Mapping[str, Column]:
    """Which column tells what, by their names.

    Raises:
        DatasetError: one is missing, there twice, or does not say its unit.
    """
    found: dict[str, Column] = {}
    for each in header:
        if (known := column_of(each, table)) is None:
            continue
        what, column = known
        if what in found:
            raise DatasetError(
                f'{table}: {found[what].name!r} and {each!r} may both be the {what}; rename the one that is not'
            )
        found[what] = column
    if lacking := [what for what in NAMES if what not in found]:
        raise DatasetError(f'{table} has no column for {" and ".join(lacking)}; its first line may be {EXAMPLE}')
    return {what: found[what] for what in NAMES}


def column_of(name: str, table: Path) -> tuple[str, Column] | None:
    """What a column tells, by its name; None of one that is not known.

    Raises:
        DatasetError: a force without unit, or a unit that none of it can be.
    """
    bare, unit = _name_and_unit(name)
    what = 'force' if unit and not bare else next((what for what, names in NAMES.items() if bare in names), None)
    if what is None:
        return None
    if what == 'picture':
        return what, Column(name, math.nan, repr(name))
    units = NEWTONS if what == 'force' else MILLIMETRES
    if what != 'force':
        unit = unit or 'mm'
    if unit not in units:
        allowed = ', '.join(SHOWN.get(each, each) for each in units)
        fault = f'is in {unit!r}' if unit else 'does not say its unit'
        raise DatasetError(f'{table}: column {name!r} {fault}; write one of {allowed} behind its name, as in {EXAMPLE}')
    return what, Column(name, units[unit], f'{name!r} in {SHOWN.get(unit, unit)}')


def _name_and_unit(name: str) -> tuple[str, str]:
    """'Force [mN]', 'force_mn' and 'force in mN' are a force in mN, 'grams' is a unit alone, 'x' has none."""
    plain = name.strip().lower().replace('µ', 'u')
    words = [SPELT.get(word, word) for word in re.split(r'[^a-z0-9]+', plain) if word and word != 'in']
    whole = ' '.join(words)
    if plain != 'n' and whole in NEWTONS:  # 'n' alone may be a number of something
        return '', whole
    if len(words) < 2 or any(whole in names for names in NAMES.values()):
        return whole, ''
    return ' '.join(words[:-1]), words[-1]


def _press(
    row: Mapping[str, str], columns: Mapping[str, Column], where: str, decimal_comma: bool
) -> tuple[str, tuple[float, float, float]]:
    x, y, force = (_number(row, columns[name], where, decimal_comma) for name in ('x', 'y', 'force'))
    picture = row[columns['picture'].name].strip()
    if not picture:
        raise DatasetError(f'{where}: no picture is named')
    if force < 0:
        raise DatasetError(f'{where}: {columns["force"].name} must not be negative')
    if max(abs(x), abs(y)) > SURFACE_MM:
        raise DatasetError(f'{where}: places lie within {SURFACE_MM:g} mm of the middle; check the unit')
    return picture, (x, y, force)


def _number(row: Mapping[str, str], column: Column, where: str, decimal_comma: bool) -> float:
    """In mm or N; NaN where nothing is written."""
    text = row[column.name].strip()
    if not text:
        return math.nan
    try:
        number = float(text.replace(',', '.') if decimal_comma else text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise DatasetError(f'{where}: {column.name} is {text!r}, and must be a number, or empty where nobody knows it')
    return number * column.times
