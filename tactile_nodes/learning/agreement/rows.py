"""Faults of table rows that show before any motion is measured: places out of view, one image in two rows."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tables.faults import RowFaults
from tactile_nodes.learning.tables.presses import PressTable, TablePress
from tactile_nodes.sensing.elasticity.view import View
from tactile_nodes.sensors import Sensor


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
