"""The force map: one cell per bin, with a fixed colour scale."""

from __future__ import annotations

import math
from functools import cache
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np
from rich.style import Style
from rich.text import Text

MAP_WIDTH = 45  # columns of the terminal
_STEPS = 24
_SHOWN_N = 0.005  # smaller forces would print as 0.00
_FAINT = 0.02  # of the full scale: below, noise would make the map flicker
# From black over purple and orange to pale yellow; perceptually uniform, and readable with colour blindness.
_ANCHORS = np.array(
    [(8, 6, 24), (40, 11, 84), (101, 21, 110), (159, 42, 99), (212, 72, 66), (245, 125, 21), (250, 193, 39),
     (252, 255, 164)], float
)  # fmt: skip
_DIM = Style(dim=True)
_NOT_FINITE = Style(color='magenta')


def map_lines(force: Any, true_bin: int | None, full_scale_n: float) -> list[Text]:
    """The rows of a ForceDistribution's grid, and the scale; `true_bin` is marked."""
    newtons = force.normal_force.reshape(force.rows, force.cols)
    if newtons.shape[1] * 5 > MAP_WIDTH:
        lines = [_coloured_row(row, full_scale_n) for row in _pooled(newtons)]
    else:
        marks = [true_bin - row * force.cols if true_bin is not None else -1 for row in range(force.rows)]
        lines = [_numbered_row(row, full_scale_n, mark) for row, mark in zip(newtons, marks, strict=True)]
    return [*lines, _scale_line(full_scale_n)]


def _numbered_row(newtons: np.ndarray, full_scale_n: float, true_col: int) -> Text:
    cells = [
        (('›' if col == true_col else ' ') + _cell(force_n), _colour(force_n, full_scale_n))
        for col, force_n in enumerate(newtons.tolist())
    ]
    return _joined(cells)


def _coloured_row(newtons: np.ndarray, full_scale_n: float) -> Text:
    return _joined([('  ', _colour(force_n, full_scale_n)) for force_n in newtons.tolist()])


def _joined(cells: list[tuple[str, Style]]) -> Text:
    """One text. Neighbours of the same style are merged: drawing time grows with the number of pieces."""
    row = Text()
    for style, run in groupby(cells, key=itemgetter(1)):
        row.append(''.join(text for text, _ in run), style)
    return row


def _cell(force_n: float) -> str:
    """Four characters: 0.12, 12.3, -.12."""
    if abs(force_n) < _SHOWN_N:
        return ' .  '
    return f'{force_n:4.2f}'.replace('-0.', '-.')[:4]


def _pooled(newtons: np.ndarray) -> np.ndarray:
    """A grid of at most 22 columns; each cell holds the largest force of its bins."""
    factor = math.ceil(newtons.shape[1] * 2 / MAP_WIDTH)
    rows, cols = (math.ceil(size / factor) * factor for size in newtons.shape)
    padded = np.full((rows, cols), -np.inf)
    padded[: newtons.shape[0], : newtons.shape[1]] = newtons
    pooled: np.ndarray = padded.reshape(rows // factor, factor, cols // factor, factor).max(axis=(1, 3))
    return pooled


def _scale_line(full_scale_n: float) -> Text:
    scale = Text('0 ', _DIM)
    for step in range(0, _STEPS, 2):
        scale.append(' ', _style(step))
    return scale.append(f' {full_scale_n:g} N per bin (fixed)   › true bin', _DIM)


def _colour(force_n: float, full_scale_n: float) -> Style:
    if not math.isfinite(force_n):
        return _NOT_FINITE
    if abs(force_n) < max(_SHOWN_N, _FAINT * full_scale_n):
        return _DIM
    return _style(max(0, min(_STEPS - 1, int(force_n / full_scale_n * _STEPS)))) if force_n > 0 else _negative()


@cache
def _style(step: int) -> Style:
    place = step / (_STEPS - 1) * (len(_ANCHORS) - 1)
    rgb = [round(np.interp(place, np.arange(len(_ANCHORS)), _ANCHORS[:, channel])) for channel in range(3)]
    light = 0.3 * rgb[0] + 0.6 * rgb[1] + 0.1 * rgb[2] > 110
    return Style(color='#000000' if light else '#ffffff', bgcolor=f'#{rgb[0]:02x}{rgb[1]:02x}{rgb[2]:02x}')


@cache
def _negative() -> Style:
    """For negative (pulling) forces. A gel under a probe cannot measure them: the model is wrong there."""
    return Style(color='#ffffff', bgcolor='#1f4f8f')
