"""Streams a bag into tables, a batch of rows at a time, so that memory does not grow with the bag."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from tactile_nodes.errors import TactileError
from tactile_nodes.exporting.columns import IMAGE_TYPE, TEXT, Column, Layout
from tactile_nodes.exporting.source import Source, StampedMessage
from tactile_nodes.learning.progress import Progress

BATCH_ROWS = 4096
IMAGE_ROWS = 16
STAMPS = (Column('stamp_ns', 'int64', (), 'ns'), Column('received_ns', 'int64', (), 'ns'))
"""The first columns of every table: capture (or publication), and when the recorder received it; both since 1970."""

Batch = dict[str, Any]
"""Arrays by column name, lists for texts; all have the same length."""


class Sink(Protocol):
    """Writes the rows of one topic."""

    def write(self, batch: Batch) -> None: ...

    def close(self, facts: dict[str, Any]) -> None:
        """End the output; `facts` are stored with the data."""
        ...


@dataclass
class Table:
    """The rows of one topic that wait to be written."""

    layout: Layout
    sink: Sink
    waiting: list[list[Any]] = field(default_factory=list)

    @property
    def columns(self) -> list[Column]:
        return [*STAMPS, *self.layout.columns]

    def take(self, stamped: StampedMessage) -> None:
        """Add a row; a full batch is written."""
        self.waiting.append([stamped.stamp_ns, stamped.received_ns, *self.layout.row(stamped.message)])
        if len(self.waiting) >= (IMAGE_ROWS if self.layout.type_name == IMAGE_TYPE else BATCH_ROWS):
            self.flush()

    def flush(self) -> None:
        """Write the waiting rows."""
        if self.waiting:
            values = zip(*self.waiting, strict=True)
            self.sink.write(
                {column.name: _together(column, part) for column, part in zip(self.columns, values, strict=True)}
            )
            self.waiting = []


def write_tables(source: Source, open_sink: Callable[[Layout], Sink], facts: dict[str, Any], progress: Progress) -> int:
    """Write a table for each topic of a bag; returns the total number of rows.

    Args:
        source: the bag.
        open_sink: opens the output for the rows of a topic.
        facts: stored with each table, beside those of the source.
        progress: shows how many messages were read.

    Raises:
        TactileError: a message fits no table.
    """
    tables = {name: Table(layout, open_sink(layout)) for name, layout in source.layouts.items()}
    try:
        with progress.bar(f'exporting {source.bag.path.name}', source.count) as bar:
            for stamped in source.messages(bar):
                try:
                    tables[stamped.topic].take(stamped)
                except TactileError as error:
                    raise type(error)(f'{source.bag.path}: {error}') from error
        for table in tables.values():
            table.flush()
    finally:  # also if the output is discarded: files must not stay open
        for table in tables.values():
            table.sink.close({**facts, **source.facts()})
    return source.provenance.rows.total()


def _together(column: Column, values: tuple[Any, ...]) -> Any:
    return list(values) if column.dtype == TEXT else np.asarray(values, column.dtype)
