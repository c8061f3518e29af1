"""The calibrations of a lab in one SQLite file: time, number of presses, and last known state of each."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from tactile_nodes import paths
from tactile_nodes.clock import Clock, SystemClock
from tactile_nodes.errors import ConfigurationError

NS_PER_DAY = 86_400_000_000_000
TOO_LATE_NS = 2**63
"""The year 2262; SQLite stores no later times."""

_NUMBERS: dict[str, Any] = {'made_ns': int, 'presses': int, 'error_n': (float, int, type(None)), 'looked_ns': int}


@dataclass(frozen=True)
class Calibration:
    """One calibration; times are ns since 1970, 0 if not known.

    `error_n` is the force RMSE (N) on held-out presses. `level` is the drift monitor's last state ('valid', 'ageing',
    'invalid'; empty: none yet), `looked_ns` its time, and `remedy` the same in words, with what to do.
    """

    model_id: str
    gel: str = ''
    sensor: str = ''
    file: str = ''
    source: str = ''
    made_ns: int = 0
    presses: int = 0
    error_n: float | None = None
    level: str = ''
    looked_ns: int = 0
    remedy: str = ''

    def due(self, now_ns: int, after_days: float) -> str:
        """Why a new calibration is needed; empty if none is."""
        if self.level in {'ageing', 'invalid'}:
            return self.remedy or self.level
        days = (now_ns - self.made_ns) / NS_PER_DAY
        return f'older than {after_days:g} days' if self.made_ns and days > after_days else ''


_CREATE = """
CREATE TABLE IF NOT EXISTS calibrations (
    model_id TEXT PRIMARY KEY, gel TEXT, sensor TEXT, file TEXT, source TEXT, made_ns INTEGER, presses INTEGER,
    error_n REAL, level TEXT, looked_ns INTEGER, remedy TEXT)"""
_ADD = """
INSERT OR REPLACE INTO calibrations VALUES (
    :model_id, :gel, :sensor, :file, :source, :made_ns, :presses, :error_n, :level, :looked_ns, :remedy)"""
_ALL = """
SELECT model_id, gel, sensor, file, source, made_ns, presses, error_n, level, looked_ns, remedy FROM calibrations
ORDER BY made_ns DESC, model_id"""
_LOOK = 'UPDATE calibrations SET level = ?, remedy = ?, looked_ns = ? WHERE model_id = ?'


def list_file() -> Path:
    """``$TACTILE_GELS``, else ``$XDG_DATA_HOME/tactile_nodes/gels.sqlite``, else ``~/.local/share/…``."""
    chosen = os.environ.get('TACTILE_GELS')
    return Path(chosen or paths.of_user('XDG_DATA_HOME', '.local/share') / paths.PACKAGE / 'gels.sqlite').expanduser()


class GelList:
    """The list in a file, which is created with the first calibration. `clock` is the host's, also in a replay."""

    def __init__(self, file: Path | None = None, clock: Clock | None = None) -> None:
        self.file, self._clock = file or list_file(), clock

    def add(self, calibration: Calibration) -> None:
        """Add a calibration.

        If the model is listed, it keeps its date, its file if that exists, and all values for which no new one is
        given.

        Raises:
            ConfigurationError: the file cannot be written, or is not such a list.
        """
        with self._open(create=True) as database:
            database.execute('BEGIN IMMEDIATE')  # no other process may change the list until it is written
            others = {each.model_id: each for each in _listed(database)}
            listed = others.pop(calibration.model_id, None)
            if listed is not None:
                is_its_own = all(each.file != listed.file for each in others.values())
                calibration = _merged(listed, calibration, keep_file=is_its_own and Path(listed.file).is_file())
            database.execute(_ADD, asdict(calibration))

    def look(self, model_id: str, level: str, remedy: str, at_ns: int) -> bool:
        """Store the drift monitor's last state of a calibration; false if it is not listed.

        Older states are ignored, unless the stored one is of the future: its clock was wrong, and would hide all later
        ones.

        Raises:
            ConfigurationError: as above.
        """
        if not self._exists():
            return False
        now_ns = (self._clock or SystemClock()).now_ns()
        with self._open() as database:
            cursor = database.execute('SELECT looked_ns FROM calibrations WHERE model_id = ?', (model_id,))
            listed = cursor.fetchone()
            if listed is not None and (listed[0] <= at_ns or listed[0] > now_ns):
                database.execute(_LOOK, (level, remedy, at_ns, model_id))
        return listed is not None

    def forget(self, model_id: str) -> bool:
        """Remove a calibration from the list, not its file; false if it is not listed. Raises ConfigurationError."""
        if not self._exists():
            return False
        with self._open() as database:
            return bool(database.execute('DELETE FROM calibrations WHERE model_id = ?', (model_id,)).rowcount)

    def calibrations(self) -> list[Calibration]:
        """All calibrations, the newest first.

        Raises:
            ConfigurationError: the file cannot be read, is not such a list, or has an impossible value.
        """
        if not self._exists():
            return []
        with self._open() as database:
            return _listed(database)

    def _exists(self) -> bool:
        try:
            self.file.stat()
        except FileNotFoundError:
            return False
        except OSError as error:  # a folder of its path may not be entered
            raise self._unusable(error) from error
        return True

    def _unusable(self, error: Exception) -> ConfigurationError:
        return ConfigurationError(
            f'{self.file} is not a usable list of calibrations ({error}); move it away, '
            'or set TACTILE_GELS to another file'
        )

    @contextmanager
    def _open(self, *, create: bool = False) -> Iterator[sqlite3.Connection]:
        try:
            if create:
                self.file.parent.mkdir(parents=True, exist_ok=True)
            with closing(sqlite3.connect(self.file, timeout=10.0)) as database, database:
                database.execute('PRAGMA trusted_schema = OFF')  # no code defined in the file is run
                if create:
                    database.execute(_CREATE)
                _require_table(database)
                yield database
        except (sqlite3.Error, OSError, TypeError) as error:
            raise self._unusable(error) from error


def _listed(database: sqlite3.Connection) -> list[Calibration]:
    return [_calibration(row) for row in database.execute(_ALL).fetchall()]


def _calibration(row: tuple[Any, ...]) -> Calibration:
    """The calibration of a row, in which another program may have written anything."""
    for entry, value in zip(fields(Calibration), row, strict=True):
        if not isinstance(value, _NUMBERS.get(entry.name, str)):
            raise ConfigurationError(
                f'the list of calibrations has an impossible {entry.name} of model {row[0]}, {value!r}; remove it: '
                f'tactile gels forget {row[0]}'
            )
    return Calibration(*row)


def _merged(listed: Calibration, anew: Calibration, *, keep_file: bool) -> Calibration:
    changes = {name: value for name, value in asdict(anew).items() if value not in {'', 0, None}}
    if anew.level:
        changes['remedy'] = anew.remedy
    if listed.made_ns:
        changes['made_ns'] = listed.made_ns
    if keep_file:
        changes['file'] = listed.file
    return replace(listed, **changes)


def _require_table(database: sqlite3.Connection) -> None:
    found = {(kind, name) for kind, name in database.execute('SELECT type, name FROM sqlite_master')}
    if ('table', 'calibrations') not in found or {kind for kind, _ in found} & {'view', 'trigger'}:
        raise sqlite3.DatabaseError('it has no table of calibrations, or objects other than tables')
