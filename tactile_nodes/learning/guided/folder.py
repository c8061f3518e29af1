"""The folder of presses by hand: images, and the table that `dataset import` and `calibrate` read.

An image is written before its row, and each row is written at once, so no press is lost if the session ends abruptly.
"""

from __future__ import annotations

import codecs
import math
import os
from itertools import islice
from pathlib import Path

import numpy as np

from tactile_nodes.drivers.camera.pictures import read_grey, write_png
from tactile_nodes.errors import DatasetError
from tactile_nodes.files import TEXT_BYTES, read_plain
from tactile_nodes.learning.guided.targets import Target
from tactile_nodes.learning.tables.columns import NEWTONS
from tactile_nodes.learning.tables.presses import TablePress, read_table, require_possible
from tactile_nodes.paths import flush
from tactile_nodes.shapes import UInt8

TABLE = 'presses.csv'


class PressFolder:
    """A folder of presses, new or continued; the presses to come are with one indenter.

    A last line that a full disk or a power cut left incomplete is taken out of the table; `left_out` then says so.

    Args:
        folder: its path; created with the first image.
        unit: of the scale: 'g', 'kg', 'N', 'mN'.
        indenter: what presses.
        reach_mm: from the centre of the gel to the rims of its bins.

    Raises:
        DatasetError: the existing table cannot be read, has another unit, or is of another sensor; or a name that would
            break it.
    """

    def __init__(self, folder: Path, unit: str, indenter: str, reach_mm: tuple[float, float]) -> None:
        self.folder, self.table = folder, folder / TABLE
        self.unit, self.newton = unit, NEWTONS[unit.lower()]
        self._indenter, self._reach_mm = indenter.strip(), reach_mm
        if set(indenter) & set(',;"\t\r\n'):
            raise DatasetError(
                f'the indenter {indenter!r} holds a comma or another separator of cells; use another name'
            )
        self._header = f'picture,x_mm,y_mm,force_{unit.lower()},indenter\n'
        self.left_out = self._leave_out_incomplete_line() if self.table.exists() else ''
        self.rows = self._read() if self.table.exists() else list[TablePress]()

    def _leave_out_incomplete_line(self) -> str:
        try:
            content = read_plain(self.table, TEXT_BYTES)
            complete = content[: content.rfind(b'\n') + 1]
            cut = content.removeprefix(complete).rstrip(b'\0')  # zeros: what was never written after a power cut
            self._require_same_header(complete, cut)
            if content and complete == content:
                return ''
            if complete:
                os.truncate(self.table, len(complete))
            else:
                self.table.unlink()
        except OSError as error:
            raise DatasetError(f'cannot read or mend {self.table} ({error.strerror}); use another folder') from error
        text = cut.decode(errors='backslashreplace')
        return f'the last line of {self.table} was incomplete and was left out: {text!r}; its picture stays there'

    def _require_same_header(self, complete: bytes, cut: bytes) -> None:
        # A spreadsheet that has saved the table may have added a byte order mark and carriage returns.
        first = complete.removeprefix(codecs.BOM_UTF8).partition(b'\n')[0].rstrip(b'\r')
        wanted = self._header.strip().encode()
        if first != wanted and (complete or not wanted.startswith(cut)):
            raise DatasetError(
                f'{self.table} does not begin with {self._header.strip()}; use the unit and the commas that it had, or '
                'another folder'
            )

    @property
    def done(self) -> list[Target]:
        """The finished presses with this indenter."""
        return [
            Target(row.x_mm, row.y_mm, row.force_n)
            for row in self.rows
            if row.touches and row.indenter == self._indenter
        ]

    def rests(self, most: int) -> list[UInt8[np.ndarray, 'h w']]:
        """The first images of the untouched gel. Raises ConfigurationError: one cannot be read."""
        untouched = (row for row in self.rows if not row.touches)
        return [read_grey(self.folder / row.picture) for row in islice(untouched, most)]

    def add_rest(self, picture: UInt8[np.ndarray, 'h w']) -> None:
        """Save an image of the untouched gel."""
        self._add(self._write('rest', picture), ',,0,')

    def add_press(self, picture: UInt8[np.ndarray, 'h w'], place_mm: tuple[float, float], reading: float) -> None:
        """Save a press; the reading is in the unit of the scale.

        Raises:
            DatasetError, ConfigurationError: it cannot be written.
        """
        x, y = place_mm
        self._add(self._write('press', picture), f'{x:g},{y:g},{reading:g},{self._indenter}')

    def fault(self, reading: float, place_mm: tuple[float, float]) -> str:
        """Why this reading and place cannot be of a press; empty if they can."""
        unknown = np.nan
        row = TablePress(
            0, '', unknown, *place_mm, reading * self.newton, (unknown,) * 2, (unknown,) * 3, unknown, self._indenter
        )
        try:
            require_possible(row, self._reach_mm, {'x': 'x', 'y': 'y', 'force': 'the reading'})
        except DatasetError as error:
            return str(error)
        return ''

    def _write(self, kind: str, picture: UInt8[np.ndarray, 'h w']) -> str:
        number = 1
        while (file := self.folder / f'{kind}_{number:04}.png').exists():
            number += 1
        write_png(file, picture)
        return file.name

    def _add(self, picture: str, row: str) -> None:
        new = not self.table.exists()
        try:
            flush(self.folder / picture)
            with self.table.open('ab') as opened:
                opened.write(f'{self._header if new else ""}{picture},{row}\n'.encode())
                opened.flush()
                os.fsync(opened.fileno())
        except OSError as error:
            raise DatasetError(f'cannot write {self.table} ({error.strerror}); make room, and start again') from error
        self.rows = self._read()

    def _read(self) -> list[TablePress]:
        rows = list(read_table(self.table, (math.inf, math.inf)).rows)
        for row in rows:
            if abs(row.x_mm) > self._reach_mm[0] + 1e-9 or abs(row.y_mm) > self._reach_mm[1] + 1e-9:
                raise DatasetError(
                    f'{self.table}, line {row.line}: {row.x_mm:g}, {row.y_mm:g} mm lies beyond the bins of this '
                    'sensor; give the --sensor of the other presses, correct the line, or use another folder'
                )
        return rows
