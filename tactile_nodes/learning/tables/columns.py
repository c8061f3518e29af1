"""Identifies the columns of a table by the names and units that users give them.

The column's name gives its quantity, and the header its unit: `force_n`, `Force [mN]`, `grams`, `x (mm)`. An ambiguous
name is an error, not a guess. The interpretation of every column is reported.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.tables.cells import EXAMPLE

NEWTON_PER_GRAM = 9.81e-3
MILLIMETRES = {'um': 1e-3, 'mm': 1.0, 'cm': 10.0, 'm': 1e3, 'in': 25.4}
NEWTONS = {'n': 1.0, 'mn': 1e-3, 'g': NEWTON_PER_GRAM, 'kg': 1e3 * NEWTON_PER_GRAM}
NEWTON_METRES = {'nm': 1.0, 'nmm': 1e-3, 'mnm': 1e-3}
SECONDS = {'s': 1.0, 'ms': 1e-3}
SPELT = {
    'newton': 'n', 'newtons': 'n', 'millinewton': 'mn', 'millinewtons': 'mn', 'gram': 'g', 'grams': 'g',
    'gramme': 'g', 'grammes': 'g', 'kilogram': 'kg', 'kilograms': 'kg', 'millimetre': 'mm', 'millimetres': 'mm',
    'millimeter': 'mm', 'millimeters': 'mm', 'second': 's', 'seconds': 's', 'sec': 's',
    'inch': 'in', 'inches': 'in',
}  # fmt: skip
SHOWN = {'n': 'N', 'mn': 'mN', 'nm': 'Nm', 'nmm': 'Nmm', 'mnm': 'mNm'}
NAMES = {
    'picture': {
        'picture', 'pictures', 'image', 'img', 'photo', 'file', 'filename', 'file name', 'image file', 'picture file',
        'path',
    },
    'time': {'time', 't', 'video time'},
    'x': {'x', 'pos x', 'x pos', 'position x', 'x position', 'place x', 'contact x'},
    'y': {'y', 'pos y', 'y pos', 'position y', 'y position', 'place y', 'contact y'},
    'force': {
        'force', 'normal force', 'weight', 'mass', 'load', 'scale', 'reading', 'scale reading', 'f', 'fz', 'force z',
        'fn',
    },
    'fx': {'fx', 'force x', 'shear x'},
    'fy': {'fy', 'force y', 'shear y'},
    'tx': {'tx', 'torque x', 'mx'},
    'ty': {'ty', 'torque y', 'my'},
    'tz': {'tz', 'torque z', 'mz'},
    'depth': {'depth', 'indentation'},
    'indenter': {'indenter', 'tip', 'body', 'tool'},
}  # fmt: skip
UNITS: dict[str, Mapping[str, float]] = {
    'time': SECONDS, 'x': MILLIMETRES, 'y': MILLIMETRES, 'depth': MILLIMETRES,
    **dict.fromkeys(('force', 'fx', 'fy'), NEWTONS), **dict.fromkeys(('tx', 'ty', 'tz'), NEWTON_METRES),
}  # fmt: skip
"""Factors from each unit to mm, N, N m or s, for columns with numbers."""
USUAL = {'time': 's', 'x': 'mm', 'y': 'mm', 'depth': 'mm'}
"""Default units of columns whose header has none."""
NEEDED = 'x', 'y', 'force'
MOST_SHOWN, LONGEST_SHOWN = 20, 40
"""Number of columns that an error names, and characters of each."""


@dataclass(frozen=True)
class Column:
    """A column's name, the factor from its unit to mm, N, N m or s, and its interpretation as text."""

    name: str
    times: float
    description: str


def columns_of(header: list[str], table: Path) -> Mapping[str, Column]:
    """The column of each quantity, by name.

    Raises:
        DatasetError: one is missing, occurs twice, or has no unit.
    """
    found: dict[str, Column] = {}
    for each in header:
        if (found_column := column_of(each, table)) is None:
            continue
        quantity, column = found_column
        if quantity in found:
            raise DatasetError(
                f'{table}: both {found[quantity].name!r} and {each!r} may be the {quantity}; rename the one that is not'
            )
        found[quantity] = column
    if 'picture' in found:
        found.pop('time', None)  # the time of each image is not used
    lacking = [quantity for quantity in NEEDED if quantity not in found]
    if not found.keys() & {'picture', 'time'}:
        lacking.insert(0, 'picture')
    if lacking:
        raise DatasetError(
            f'{table} has no column for {" and ".join(lacking)}; {_describe_header(header)}; '
            f'it needs picture (or time), x, y and force with its unit, as in {EXAMPLE}'
        )
    return {quantity: found[quantity] for quantity in NAMES if quantity in found}


def _describe_header(header: list[str]) -> str:
    """The names of a table's columns as text, shortened in case the file is not a table."""
    names = [repr(each[:LONGEST_SHOWN]) for each in header[:MOST_SHOWN]]
    more = len(header) - len(names)
    return f'its columns are {", ".join(names)}{f" and {more} more" if more else ""}' if names else 'it is empty'


def column_of(name: str, table: Path) -> tuple[str, Column] | None:
    """The quantity of a column, by its name; None if the name is unknown.

    Raises:
        DatasetError: a force without unit, or a unit that does not fit the quantity.
    """
    bare, unit = _name_and_unit(name)
    quantity = (
        'force' if unit and not bare else next((quantity for quantity, names in NAMES.items() if bare in names), None)
    )
    if quantity is None:
        return None
    if quantity not in UNITS:
        return quantity, Column(name, math.nan, repr(name))
    units, unit = UNITS[quantity], unit or USUAL.get(quantity, '')
    if unit not in units:
        allowed = ', '.join(SHOWN.get(each, each) for each in units)
        fault = f'is in {unit!r}' if unit else 'has no unit'
        raise DatasetError(f'{table}: column {name!r} {fault}; write one of {allowed} after its name, as in {EXAMPLE}')
    return quantity, Column(name, units[unit], f'{name!r} in {SHOWN.get(unit, unit)}')


def _name_and_unit(name: str) -> tuple[str, str]:
    """'Force [mN]', 'force_mn' and 'force in mN' are a force in mN, 'grams' is a unit alone, 'x' has none.

    A final 'in', or a separate quotation mark, means inches: 'x_in', 'x (\")'.
    """
    plain = name.strip().lower().replace('µ', 'u').replace('\u03bc', 'u')  # the sign for micro, and the Greek letter
    plain = re.sub(r'(?<![a-z])(m?n)[ ·*.]+(m?m)(?![a-z])', r'\1\2', plain)
    plain = re.sub(r'(?<![a-z])["″]+(?=\W*$)', ' in', plain)
    words = [SPELT.get(word, word) for word in re.split(r'[^a-z0-9]+', plain) if word]
    words = [word for word in words[:-1] if word != 'in'] + words[-1:]
    phrase = ' '.join(words)
    if plain != 'n' and phrase in NEWTONS:  # 'n' alone may be a count
        return '', phrase
    if len(words) < 2 or any(phrase in names for names in NAMES.values()):
        return phrase, ''
    return ' '.join(words[:-1]), words[-1]
