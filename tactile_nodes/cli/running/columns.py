"""Rows as lines in which each column begins at one place."""

from __future__ import annotations

from collections.abc import Sequence


def columns(rows: Sequence[Sequence[str]]) -> str:
    """The lines of a head and its rows.

    >>> print(columns([('gel', 'presses'), ('gel-7', '40')]))
    gel    presses
    gel-7  40
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return '\n'.join('  '.join(map(str.ljust, row, widths)).rstrip() for row in rows)
