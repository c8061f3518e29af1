"""Compare tables with their images: one image in two rows, places out of view, and the motion of the gel."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.agreement.known import Known
from tactile_nodes.learning.agreement.objections import (
    aside,
    description_objection,
    middles,
    places_objection,
    strength_of,
)
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tables.faults import SHOWN_ROWS, RowFaults
from tactile_nodes.learning.tables.presses import PressTable, TablePress
from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensors import Sensor
from tactile_nodes.shapes import Float, Float32, Int


class Row(NamedTuple):
    """A row of a table, and the key of its image."""

    table: PressTable
    press: TablePress
    picture: str

    def beside(self, other: Row) -> str:
        """Where the row is, for a reader of the other row."""
        line = f'{self.table.counted} {self.press.line}'
        return line if self.table is other.table else f'{line} of {self.table.file}'

    def describe(self) -> str:
        """What the row states about its image."""
        press = self.press
        if not press.touches:
            return 'the gel untouched'
        return f'{press.force_n:.3g} N at {press.x_mm:g}, {press.y_mm:g} mm'

    def contradicts(self, other: Row) -> bool:
        """Whether both cannot be true of one image."""
        one, two = self.press, other.press
        if one.touches != two.touches:
            return True
        pairs = ((one.x_mm, two.x_mm), (one.y_mm, two.y_mm), (one.force_n, two.force_n))
        return any(abs(mine - theirs) > 0 for mine, theirs in pairs)  # no number differs from nothing


def require_seen(rows: Iterable[TablePress], sensor: Sensor | None, faults: RowFaults) -> None:
    """Record a fault for each row whose place is outside the camera's view, by the sensor's description."""
    if sensor is None:
        return
    view = View(sensor)
    for row in rows:
        with faults.row(row.line):
            place = np.array([[row.x_mm, row.y_mm]])
            if np.isfinite(place).all() and not (np.abs(view.shares_of(place) - 0.5) <= 0.5).all():
                raise DatasetError(
                    f'{row.x_mm:g}, {row.y_mm:g} mm lies outside the view of the camera in the description of the '
                    'sensor; check the unit, or press further in'
                )


def require_single(rows: Iterable[Row], progress: Progress, *, forced: bool = False) -> None:
    """Refuse an image that several rows describe differently, unless forced; name one that is described twice alike.

    Tables may share images of the untouched gel.

    Raises:
        DatasetError: names both rows.
    """
    first: dict[str, Row] = {}
    wrong, twice = [], []
    for row in rows:
        before = first.setdefault(row.picture, row)
        if before is row or (row.table is not before.table and not (row.press.touches or before.press.touches)):
            continue
        sentence = f'{row.table.file}, {row.table.counted} {row.press.line} has the image of {before.beside(row)}'
        if row.contradicts(before):
            wrong.append(f'{sentence}, but gives {row.describe()} instead of {before.describe()}')
        else:
            twice.append(f'{sentence} again')
    if twice:
        progress.say(_first_of(twice))
    if wrong and not forced:
        raise DatasetError(f'{_first_of(wrong)} (--force uses the table as it is)')
    if wrong:
        progress.say(f'used because of --force: {_first_of(wrong)}')


def _first_of(sentences: list[str]) -> str:
    return sentences[0] + (f'; likewise {len(sentences) - 1} more' if len(sentences) > 1 else '')


LEAST = 8
"""Fewer presses cannot judge a table."""
PRESSED = 0.25
"""Share of the median press's motion: an image of the untouched gel that moves more shows a press."""


@dataclass(frozen=True)
class StatedPresses:
    """Presses of one table, by their line numbers (or those of what `counted` names).

    `motion` (px) and `confidence` are what the regions of their images show. `rest_lines` are the lines of the
    untouched gel, `rest_motion` the motion in their images.
    """

    table: Path
    lines: Int[np.ndarray, ' n']
    place_mm: Float[np.ndarray, 'n 2']
    force_n: Float[np.ndarray, ' n']
    motion: Float32[np.ndarray, 'n rows cols 2']
    confidence: Float32[np.ndarray, 'n rows cols']
    rest_lines: Int[np.ndarray, ' rests']
    rest_motion: Float32[np.ndarray, 'rests rows cols 2']
    counted: str = 'line'

    def rows(self, lines: Sequence[int]) -> str:
        """Some rows as text."""
        shown = ', '.join(map(str, lines[:SHOWN_ROWS])) + ' …' * (len(lines) > SHOWN_ROWS)
        return f'{self.counted}{"s" * (len(lines) > 1)} {shown}'

    @property
    def strength(self) -> Float[np.ndarray, 'n rows cols']:
        return strength_of(self.motion, self.confidence)


def require_agreement(
    tables: Sequence[StatedPresses], progress: Progress, known: Known, *, forced: bool = False
) -> None:
    """Refuse tables, or rows of them, that contradict their images, unless forced.

    `known` describes the pressed sensor, if a description exists.

    Raises:
        DatasetError: says what contradicts, and the likely cause.
        ConfigurationError: by the description hardly any region sees the gel.
    """
    for table in tables:
        faults = _objection(table, known) or _presses_aside(table), _rests_pressed(table)
        if objection := '; '.join(filter(None, faults)):
            if not forced:
                raise DatasetError(f'{table.table}: {objection} (--force uses the table as it is)')
            progress.say(f'{table.table}: used because of --force: {objection}')


def _objection(table: StatedPresses, known: Known) -> str:
    """What is wrong with a table; empty if nothing is, or if it has too few presses."""
    if len(table.lines) < LEAST:
        return ''
    seen = middles(table.strength)
    objection = places_objection(table.place_mm, seen)
    objection = objection or (description_objection(table.place_mm, seen, known.sensor) if known.sensor else '')
    return objection or known.force_objection(table.force_n, table.motion, table.confidence)


def _rests_pressed(table: StatedPresses) -> str:
    """Which rows of the untouched gel have images that show a press; empty if none has."""
    if not (len(table.lines) and len(table.rest_lines)):
        return ''
    sure = table.confidence.mean(axis=0)
    moved = (np.square(table.rest_motion).sum(axis=-1) * sure).sum(axis=(1, 2))
    usual = float(np.median(table.strength.sum(axis=(1, 2))))
    if not (lines := table.rest_lines[moved > PRESSED * usual].tolist()):
        return ''
    return f'the gel is said to be untouched, but the image moves as under a press, in {table.rows(lines)}'


def _presses_aside(table: StatedPresses) -> str:
    """Which presses have images that move elsewhere; empty if none has, or if there are too few to know."""
    if len(table.lines) < LEAST:
        return ''
    if not (lines := table.lines[aside(table.place_mm, middles(table.strength))].tolist()):
        return ''
    return (
        f'the image does not move at the given place in {table.rows(lines)}: correct images or places, or leave these '
        'presses out'
    )
