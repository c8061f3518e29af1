"""Exports bags as parquet: one file per topic, one row per message."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.exporting.columns import TEXT, Column, Layout
from tactile_nodes.exporting.libraries import require
from tactile_nodes.exporting.output import FACTS, write_json
from tactile_nodes.exporting.source import Source
from tactile_nodes.exporting.tables import STAMPS, Batch, write_tables
from tactile_nodes.learning.progress import Progress

METADATA_KEY = 'tactile'
"""The key of the facts, as JSON, in the metadata of a file."""


class ParquetSink:
    """One file; every batch is a row group."""

    def __init__(self, file: Path, columns: list[Column]) -> None:
        self._arrow = require('pyarrow')
        self._columns = columns
        self._schema = self._arrow.schema([arrow_field(self._arrow, column) for column in columns])
        self._writer = require('pyarrow.parquet').ParquetWriter(file, self._schema, compression='zstd')

    def write(self, batch: Batch) -> None:
        """Add a row group."""
        arrays = [
            arrow_array(self._arrow, batch[column.name], field.type)
            for column, field in zip(self._columns, self._schema, strict=True)
        ]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))

    def close(self, facts: dict[str, Any]) -> None:
        """Write the footer, with the facts in it."""
        self._writer.add_key_value_metadata({METADATA_KEY: json.dumps(facts, ensure_ascii=False)})
        self._writer.close()


def export_parquet(source: Source, folder: Path, facts: dict[str, Any], progress: Progress) -> int:
    """Write one file for each topic of a bag into `folder`; returns the total number of rows.

    Raises:
        ConfigurationError: pyarrow is not installed.
        TactileError: a message fits no table.
    """

    def open_sink(layout: Layout) -> ParquetSink:
        return ParquetSink(folder / f'{table_name(layout.topic)}.parquet', [*STAMPS, *layout.columns])

    rows = write_tables(source, open_sink, facts, progress)
    write_json(folder / FACTS, {**facts, **source.facts()})
    return rows


def table_name(topic: str) -> str:
    """'/left/wrench' as 'left.wrench': no name in ROS 2 has a dot."""
    return topic.strip('/').replace('/', '.')


def arrow_field(arrow: Any, column: Column) -> Any:
    """Texts as dictionaries, arrays as lists of fixed length, row by row; unit and shape are in its metadata."""
    kind = arrow.dictionary(arrow.int32(), arrow.string()) if column.dtype == TEXT else _scalar(arrow, column.dtype)
    if column.shape:
        kind = arrow.list_(kind, int(np.prod(column.shape)))
    about = {'unit': column.unit, 'shape': json.dumps(column.shape) if column.shape else ''}
    return arrow.field(column.name, kind, metadata={key: value for key, value in about.items() if value})


def arrow_array(arrow: Any, values: Any, kind: Any) -> Any:
    """Values as an Arrow array of the type that `arrow_field` or a schema gives."""
    if arrow.types.is_fixed_size_list(kind):
        flat = arrow.array(np.ascontiguousarray(values).reshape(-1), kind.value_type)
        return arrow.FixedSizeListArray.from_arrays(flat, type=kind)
    return arrow.array(values, kind)


def _scalar(arrow: Any, dtype: str) -> Any:
    return arrow.bool_() if dtype == 'bool' else getattr(arrow, dtype)()
