"""Collects the faults of a table row by row, so that users can correct all of them at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tactile_nodes.errors import ConfigurationError, DatasetError, ImageError, TactileError

SHOWN_ROWS = 12
ERRORS = DatasetError, ConfigurationError, ImageError


class RowFaults:
    """Collects the faults of a table's rows, which are counted as lines of a file or as rows of an array."""

    def __init__(self, table: Path, counted: str = 'line') -> None:
        self._table, self._counted = table, counted
        self._found: list[tuple[int, str]] = []

    def __len__(self) -> int:
        return len(self._found)

    @contextmanager
    def row(self, line: int, of: tuple[type[TactileError], ...] = ERRORS) -> Iterator[None]:
        """Context for one row. An error in it, of these types, is stored, and the next row continues."""
        try:
            yield
        except of as error:
            self._found.append((line, str(error)))

    def require_none(self) -> None:
        """Refuse a table with faults.

        Raises:
            DatasetError: describes the first fault, and lists the other rows with faults.
        """
        if not self._found:
            return
        (line, first), *rest = sorted(self._found, key=lambda found: found[0])
        others = [str(number) for number, _ in rest]
        more = ', '.join(others[:SHOWN_ROWS]) + (' …' if len(others) > SHOWN_ROWS else '')
        others_text = f'; {len(others)} more cannot be used either: {self._counted} {more}' if others else ''
        raise DatasetError(f'{self._table}, {self._counted} {line}: {first}{others_text}')
