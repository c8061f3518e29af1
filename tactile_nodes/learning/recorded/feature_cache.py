"""Cache of measured features on disk. The key depends on the inputs of the measurement."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.shapes import Float16, Float32


@dataclass(frozen=True)
class Measured:
    """Features of one image, in the precision of data sets, and the confidence of each region."""

    values: Float16[np.ndarray, 'rows cols channels']
    confidence: Float32[np.ndarray, 'rows cols']


class FeatureCache:
    """Features on disk by key, one file per recipe. Several processes may use it at once.

    Raises:
        DatasetError: the file cannot be written, or is no cache.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        with self._translated():
            # Other threads than the one that opened it may use it, one at a time.
            self._open = sqlite3.connect(file, timeout=30.0, check_same_thread=False)
            try:
                self._prepare()
            except sqlite3.Error:
                self._open.close()
                raise

    def _prepare(self) -> None:
        with contextlib.suppress(sqlite3.OperationalError):  # where another does the same: it does not wait
            self._open.execute('PRAGMA journal_mode=WAL')
        self._open.execute('PRAGMA synchronous=NORMAL')
        self._open.execute('CREATE TABLE IF NOT EXISTS features (key BLOB PRIMARY KEY, vals BLOB, confidence BLOB)')

    def get(self, key: bytes, shape: tuple[int, int, int]) -> Measured | None:
        """The entry of a key; None if there is none, or if it has another shape."""
        with self._translated():
            found = self._open.execute('SELECT vals, confidence FROM features WHERE key = ?', (key,)).fetchone()
        regions = shape[0] * shape[1]
        if found is None or (len(found[0]), len(found[1])) != (2 * regions * shape[2], 4 * regions):
            return None
        values = np.frombuffer(found[0], '<f2').reshape(shape)
        return Measured(values, np.frombuffer(found[1], '<f4').reshape(shape[:2]))

    def put(self, key: bytes, measured: Measured) -> None:
        """Store features under a key."""
        row = (key, measured.values.astype('<f2').tobytes(), measured.confidence.astype('<f4').tobytes())
        with self._translated():
            self._open.execute('INSERT OR REPLACE INTO features VALUES (?, ?, ?)', row)
            self._open.commit()  # at once: other processes wait until then

    def close(self) -> None:
        """Close the file."""
        with self._translated():
            self._open.close()

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise DatasetError(
                f'cannot use the cache of features {self._file} ({error}); delete it, it will be made again'
            ) from error
