"""Rows as lines of aligned columns."""

from __future__ import annotations

from collections.abc import Sequence


def columns(rows: Sequence[Sequence[str]]) -> str:
    """The lines of a header and its rows.

    >>> print(columns([('gel', 'presses'), ('gel-7', '40')]))
    gel    presses
    gel-7  40
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return '\n'.join('  '.join(map(str.ljust, row, widths)).rstrip() for row in rows)
