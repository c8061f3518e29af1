"""Exports bags as zarr: a group for each topic, an array for each column; the first axis is the message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.exporting.columns import IMAGE_TYPE, TEXT, Column, Layout
from tactile_nodes.exporting.libraries import require
from tactile_nodes.exporting.output import FACTS, write_json
from tactile_nodes.exporting.source import Source
from tactile_nodes.exporting.tables import BATCH_ROWS, IMAGE_ROWS, STAMPS, Batch, write_tables
from tactile_nodes.learning.progress import Progress

FORMAT = 2  # zarr-python 2 and 3 and readers in other languages support it; few support 3 so far


class ZarrSink:
    """One group. Texts are numbers into the list `labels` of their array's attributes."""

    def __init__(self, group: Any, columns: list[Column], rows: int) -> None:
        self._group = group
        self._labels: dict[str, dict[str, int]] = {column.name: {} for column in columns if column.dtype == TEXT}
        self._arrays = {column.name: self._create(column, rows) for column in columns}

    def write(self, batch: Batch) -> None:
        """Add a chunk to every array."""
        for name, array in self._arrays.items():
            values = batch[name]
            if name in self._labels:
                labels = self._labels[name]
                values = np.array([labels.setdefault(text, len(labels)) for text in values], np.int32)
            array.append(values)

    def close(self, facts: dict[str, Any]) -> None:
        """Write the labels, and the facts into the group."""
        for name, labels in self._labels.items():
            self._arrays[name].attrs['labels'] = list(labels)
        self._group.attrs.update(facts)

    def _create(self, column: Column, rows: int) -> Any:
        dtype = 'int32' if column.dtype == TEXT else column.dtype
        # The names of the axes, where xarray expects them.
        axes = ['message', *(f'{column.name}_{axis}' for axis in range(len(column.shape)))]
        return self._group.create_array(
            column.name,
            shape=(0, *column.shape),
            chunks=(rows, *column.shape),
            dtype=dtype,
            compressors=require('numcodecs').Blosc(cname='zstd', clevel=5),
            # xarray takes any fill value for "missing" and would turn zeros into NaN. Without one, chunks of only zeros
            # must be written, too: for a chunk that is missing, zarr-python 2 reads arbitrary values.
            fill_value=None,
            config={'write_empty_chunks': True},
            attributes={'_ARRAY_DIMENSIONS': axes, **({'unit': column.unit} if column.unit else {})},
        )


def export_zarr(source: Source, folder: Path, facts: dict[str, Any], progress: Progress) -> int:
    """Write one group for each topic of a bag into the store `folder`; returns the total number of rows.

    Raises:
        ConfigurationError: zarr is not installed.
        TactileError: a message fits no table.
    """
    zarr = require('zarr')
    root = zarr.open_group(str(folder), mode='a', zarr_format=FORMAT)

    def open_sink(layout: Layout) -> ZarrSink:
        rows = IMAGE_ROWS if layout.type_name == IMAGE_TYPE else BATCH_ROWS
        return ZarrSink(root.require_group(layout.topic.strip('/')), [*STAMPS, *layout.columns], rows)

    rows = write_tables(source, open_sink, facts, progress)
    all_facts = {**facts, **source.facts()}
    root.attrs.update(all_facts)
    write_json(folder / FACTS, all_facts)
    return rows
