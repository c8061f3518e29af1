"""Compare tables with their images: the stated presses, and the motion of the gel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.agreement.known import Known
from tactile_nodes.learning.agreement.objections import (
    aside,
    description_objection,
    middles,
    places_objection,
    strength_of,
)
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.tables.faults import SHOWN_ROWS
from tactile_nodes.shapes import Float, Float32, Int

LEAST = 8
"""Fewer presses cannot judge a table."""
PRESSED = 0.25
"""Share of the median press's motion: an image of the untouched gel that moves more shows a press."""


@dataclass(frozen=True)
class StatedPresses:
    """Presses of one table, by their line numbers (or those of what `counted` names).

    `motion` (px) and `confidence` are what the regions of their images show. `rest_lines` are the lines of the
    untouched gel, `rest_motion` the motion in their images.
    """

    table: Path
    lines: Int[np.ndarray, ' n']
    place_mm: Float[np.ndarray, 'n 2']
    force_n: Float[np.ndarray, ' n']
    motion: Float32[np.ndarray, 'n rows cols 2']
    confidence: Float32[np.ndarray, 'n rows cols']
    rest_lines: Int[np.ndarray, ' rests']
    rest_motion: Float32[np.ndarray, 'rests rows cols 2']
    counted: str = 'line'

    def rows(self, lines: Sequence[int]) -> str:
        """Some rows as text."""
        shown = ', '.join(map(str, lines[:SHOWN_ROWS])) + ' …' * (len(lines) > SHOWN_ROWS)
        return f'{self.counted}{"s" * (len(lines) > 1)} {shown}'

    @property
    def strength(self) -> Float[np.ndarray, 'n rows cols']:
        return strength_of(self.motion, self.confidence)


def require_agreement(
    tables: Sequence[StatedPresses], progress: Progress, known: Known, *, forced: bool = False
) -> None:
    """Refuse tables, or rows of them, that contradict their images, unless forced.

    `known` describes the pressed sensor, if a description exists.

    Raises:
        DatasetError: says what contradicts, and the likely cause.
        ConfigurationError: by the description hardly any region sees the gel.
    """
    for table in tables:
        faults = _objection(table, known) or _presses_aside(table), _rests_pressed(table)
        if objection := '; '.join(filter(None, faults)):
            if not forced:
                raise DatasetError(f'{table.table}: {objection} (--force uses the table as it is)')
            progress.say(f'{table.table}: used because of --force: {objection}')


def _objection(table: StatedPresses, known: Known) -> str:
    """What is wrong with a table; empty if nothing is, or if it has too few presses."""
    if len(table.lines) < LEAST:
        return ''
    seen = middles(table.strength)
    objection = places_objection(table.place_mm, seen)
    objection = objection or (description_objection(table.place_mm, seen, known.sensor) if known.sensor else '')
    return objection or known.force_objection(table.force_n, table.motion, table.confidence)


def _rests_pressed(table: StatedPresses) -> str:
    """Which rows of the untouched gel have images that show a press; empty if none has."""
    if not (len(table.lines) and len(table.rest_lines)):
        return ''
    sure = table.confidence.mean(axis=0)
    moved = (np.square(table.rest_motion).sum(axis=-1) * sure).sum(axis=(1, 2))
    usual = float(np.median(table.strength.sum(axis=(1, 2))))
    if not (lines := table.rest_lines[moved > PRESSED * usual].tolist()):
        return ''
    return f'the gel is said to be untouched, but the image moves as under a press, in {table.rows(lines)}'


def _presses_aside(table: StatedPresses) -> str:
    """Which presses have images that move elsewhere; empty if none has, or if there are too few to know."""
    if len(table.lines) < LEAST:
        return ''
    if not (lines := table.lines[aside(table.place_mm, middles(table.strength))].tolist()):
        return ''
    return (
        f'the image does not move at the given place in {table.rows(lines)}: correct images or places, or leave these '
        'presses out'
    )
