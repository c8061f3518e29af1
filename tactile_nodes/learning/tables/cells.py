"""Reads the cells of a table from CSV or Parquet: a header, and rows of text by line number."""

from __future__ import annotations

import csv
import importlib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactile_nodes.errors import DatasetError, from_extra
from tactile_nodes.files import TEXT_BYTES, open_plain, read_text, separator_of

EXAMPLE = 'picture,x_mm,y_mm,force_n'
PARQUET = '.parquet'
_MOST_ROWS = 1_000_000


@dataclass(frozen=True)
class Cells:
    """Names of the columns, and each row's cells as text with its line number."""

    header: list[str]
    rows: list[tuple[int, list[str]]]
    decimal_comma: bool = False


def read_cells(table: Path) -> Cells:
    """All cells of a table. For a Parquet file (by extension), rows count as lines below a header.

    Raises:
        DatasetError: it cannot be read, or has lines of several lengths.
        ConfigurationError: it is a Parquet file, and pyarrow is not installed.
    """
    try:
        return _parquet(table) if table.suffix.lower() == PARQUET else _csv(table)
    except OSError as error:
        raise DatasetError(f'cannot read {table} ({error.strerror or error}); give a table of images') from error


def _csv(table: Path) -> Cells:
    try:
        # The byte order mark that spreadsheets write first is not part of the first name.
        text = read_text(table, encoding='utf-8-sig')
    except UnicodeDecodeError as error:
        raise DatasetError(
            f'{table} is not a table of images; its first line must name columns, as in {EXAMPLE}, in UTF-8 (Excel '
            'saves that as CSV UTF-8)'
        ) from error
    text = re.sub(r'\A"?sep=.?"?', '', text, flags=re.IGNORECASE)  # some programs begin with a line for spreadsheets
    delimiter = separator_of(next(filter(str.strip, text.splitlines()), ''))
    try:
        rows = list(_rows(text, table, delimiter))
    except csv.Error as error:
        raise DatasetError(f'{table} is not a table of images ({error}); begin it with {EXAMPLE}') from error
    return Cells(rows[0][1] if rows else [], rows[1:], delimiter != ',')


def _rows(text: str, table: Path, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Lines by number, with as many cells as the first one. Empty lines are skipped."""
    reader, width = csv.reader(text.splitlines(), delimiter=delimiter, strict=True), 0
    for row in reader:
        if not any(cell.strip() for cell in row):
            continue
        width = width or len(row)
        if len(row) != width:
            hint = ': correct or delete it'
            if delimiter == ',' and len(row) > width:
                hint = '; numbers with decimal commas need semicolons between cells'
            raise DatasetError(
                f'{table}, line {reader.line_num} has {len(row)} cells, but the first line has {width}{hint}'
            )
        yield reader.line_num, row


def _parquet(table: Path) -> Cells:
    """Columns of numbers and texts. Other content of the file is not unpacked."""
    with from_extra('export', 'a Parquet table, unlike CSV,'):
        arrow: Any = importlib.import_module('pyarrow')
        parquet: Any = importlib.import_module('pyarrow.parquet')
    with open_plain(table, TEXT_BYTES) as opened:
        try:
            file = parquet.ParquetFile(opened)
            metadata = file.metadata
            unpacked = sum(metadata.row_group(number).total_byte_size for number in range(metadata.num_row_groups))
            if metadata.num_rows > _MOST_ROWS or unpacked > 16 * TEXT_BYTES:
                raise DatasetError(
                    f'{table} is too large for a table of images: {metadata.num_rows} rows of {unpacked} bytes'
                )
            plain = [each.name for each in file.schema_arrow if _is_plain(arrow, each.type)]
            columns = file.read(columns=plain).to_pydict()
        except arrow.ArrowException as error:
            raise DatasetError(f'{table} is not a readable Parquet file; write it again, or as CSV') from error
    rows = zip(*(map(_text, columns[name]) for name in plain), strict=True)
    return Cells(plain, [(line, list(row)) for line, row in enumerate(rows, start=2)])


def _is_plain(arrow: Any, kind: Any) -> bool:
    is_a = arrow.types
    if is_a.is_dictionary(kind):
        kind = kind.value_type
    numbers = is_a.is_integer(kind) or is_a.is_floating(kind) or is_a.is_decimal(kind)
    return bool(numbers or is_a.is_string(kind) or is_a.is_large_string(kind) or is_a.is_string_view(kind))


def _text(value: Any) -> str:
    """The value as in CSV. Missing values and NaN are left empty."""
    return '' if value is None or (isinstance(value, float) and math.isnan(value)) else str(value)
