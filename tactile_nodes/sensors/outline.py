"""The rim of a gel's surface: a rectangle, an ellipse, or a polygon within the rectangle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_nodes.sensors.covering import corners_of
from tactile_nodes.shapes import Bool, Float

ELLIPSE = 'ellipse'
ROUND_CORNERS = 180
"""Corners of an ellipse: a circle's rim is then off by a seven-thousandth of its radius."""

MOST_CORNERS = 500

_SQUARE = (-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)


@dataclass(frozen=True)
class Outline:
    """The part of a rectangle of `width_mm` by `height_mm` about the origin that is gel.

    `shape` is empty (all of it), 'ellipse' (the inscribed ellipse, a circle if the sides are equal), or corners
    'x,y x,y x,y' [mm] in the surface frame.

    Raises:
        ValueError: `shape` is invalid, goes beyond the rectangle, or does not contain the origin.
    """

    width_mm: float
    height_mm: float
    shape: str = ''

    def __post_init__(self) -> None:
        if self.shape in ('', ELLIPSE):
            return
        try:
            corners = corners_of(self.shape)
        except ValueError as error:
            raise ValueError(
                f'gel.outline_mm is {self.shape[:60]!r}, but must be empty (a rectangle), {ELLIPSE}, or three corners '
                "or more, such as '-9,-6 9,-6 9,6 -9,6'"
            ) from error
        if len(corners) > MOST_CORNERS:
            raise ValueError(f'gel.outline_mm has {len(corners)} corners, at most {MOST_CORNERS} are allowed')
        if (np.abs(corners) > self._half_mm + 1e-6).any():
            raise ValueError(
                f'gel.outline_mm goes beyond gel.width_mm by gel.height_mm, {self.width_mm:g}x{self.height_mm:g} mm '
                'about (0, 0); move its corners, or make the rectangle larger'
            )
        if not self.holds(np.zeros(2)):
            raise ValueError('gel.outline_mm does not contain (0, 0), the middle of the surface; move its corners')

    @property
    def _half_mm(self) -> Float[np.ndarray, ' 2']:
        return np.array([self.width_mm, self.height_mm]) / 2

    @cached_property
    def corners_mm(self) -> Float[np.ndarray, 'corners 2']:
        """Corners of the rim, one after another."""
        if self.shape == ELLIPSE:
            turn = np.arange(ROUND_CORNERS) * math.tau / ROUND_CORNERS
            return np.asarray(np.column_stack([np.cos(turn), np.sin(turn)]) * self._half_mm)
        return corners_of(self.shape) if self.shape else np.asarray(np.array(_SQUARE) * self._half_mm)

    def rim_mm(self) -> Float[np.ndarray, 'places 2']:
        """Places along the rim, sixteen from each corner to the next."""
        first, share = self.corners_mm[:, None], np.linspace(0, 1, 16, endpoint=False)[:, None]
        rim: np.ndarray = first + share * (np.roll(self.corners_mm, -1, axis=0)[:, None] - first)
        return rim.reshape(-1, 2)

    @property
    def farthest_mm(self) -> float:
        """Greatest distance of the rim from the middle."""
        return float(np.hypot(*self.corners_mm.T).max())

    @property
    def inner_mm(self) -> float:
        """Half the side of the largest square about the origin that lies within the gel: 16 for the paper's gel."""
        if not self.shape:
            return float(self._half_mm.min())
        return float(np.abs(self.rim_mm()).max(axis=1).min())

    def holds(self, places_mm: Float[np.ndarray, '*shape 2']) -> Bool[np.ndarray, '*shape']:
        """Which places (x, y) are on the gel."""
        if not self.shape:
            return np.asarray((np.abs(places_mm) <= self._half_mm).all(axis=-1))
        if self.shape == ELLIPSE:
            return np.asarray(np.square(places_mm / self._half_mm).sum(axis=-1) <= 1)
        inside = np.zeros(places_mm.shape[:-1], bool)
        x, y = places_mm[..., 0], places_mm[..., 1]
        for (left, high), (right, low) in zip(self.corners_mm, np.roll(self.corners_mm, -1, axis=0), strict=True):
            if high != low:
                # Ray casting: a ray from the place to the right enters or leaves at each edge that it crosses.
                inside ^= ((high > y) != (low > y)) & (x < left + (y - high) * (right - left) / (low - high))
        return inside

    def lattice_mm(self, pitch_mm: float, through_mm: Sequence[float]) -> Float[np.ndarray, 'places 2']:
        """Places on the gel on a square lattice of `pitch_mm` through one given place, row by row."""
        x, y = (
            at + pitch_mm * np.arange(np.ceil((-half - at) / pitch_mm), np.floor((half - at) / pitch_mm) + 1)
            for at, half in zip(through_mm, self._half_mm, strict=True)
        )
        places = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        return np.asarray(places[self.holds(places)])
