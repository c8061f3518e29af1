"""A rigid body as a height map of its lower side, which is all that matters to a gel under it.

Lengths in mm. A body's frame has x and y as the gel's surface and z away from the gel; its lowest point is at height 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_nodes.errors import ConfigurationError
from tactile_nodes.shapes import Float

SPACING_MM = 0.1
NO_BODY_MM = 4.0
"""Height outside a body; no gel reaches it."""

STEEPEST = 1.5
"""Steepest slope of a wall: the gel's surface is computed on a grid of 0.4 mm, which cannot follow steeper walls."""


@dataclass(frozen=True)
class Body:
    """Height of the lower side on a square grid whose middle is the body's origin; `NO_BODY_MM` outside the body."""

    name: str
    height_mm: Float[np.ndarray, 'n n']
    spacing_mm: float = SPACING_MM

    @classmethod
    def of_heights(
        cls, name: str, height_mm: Float[np.ndarray, 'rows columns'], spacing_mm: float = SPACING_MM
    ) -> Body:
        """A body from any heights: the lowest becomes 0, NaN and infinity mean no body, walls become slopes.

        Raises:
            ConfigurationError: no point belongs to the body, or the heights are not a square.
        """
        if height_mm.ndim != 2 or height_mm.shape[0] != height_mm.shape[1] or len(height_mm) < 2:
            raise ConfigurationError(f'the body {name!r} needs a square of heights, got the shape {height_mm.shape}')
        there = np.isfinite(height_mm)
        if not there.any():
            raise ConfigurationError(f'the body {name!r} is empty: it has no finite height')
        above = np.where(there, height_mm - height_mm[there].min(), NO_BODY_MM)
        return cls(name, _sloped(np.minimum(above, NO_BODY_MM), STEEPEST * spacing_mm), spacing_mm)

    @property
    def half_mm(self) -> float:
        """Distance from the middle of the grid to its rim."""
        return (len(self.height_mm) - 1) / 2 * self.spacing_mm

    @property
    def reach_mm(self) -> float:
        """How far the body extends from its origin, along x or y."""
        there = np.argwhere(self.height_mm < NO_BODY_MM)
        return float(np.abs(there * self.spacing_mm - self.half_mm).max())

    def tilted(self, along_x_deg: float, along_y_deg: float) -> Body:
        """The body tilted a little: lower towards +x (and +y) for positive angles; slopes add."""
        across = np.arange(len(self.height_mm)) * self.spacing_mm - self.half_mm
        right, down = np.tan(np.radians([along_x_deg, along_y_deg]))
        plane = right * across + down * across[:, None]
        heights = np.where(self.height_mm < NO_BODY_MM, self.height_mm - plane, np.inf)
        return Body.of_heights(self.name, heights, self.spacing_mm)

    @classmethod
    def joined(cls, name: str, parts: Iterable[tuple[Body, tuple[float, float, float]]]) -> Body:
        """Several bodies as one, each shifted along x and y and raised [mm], so that they move together."""
        placed = list(parts)
        half_mm = max(body.half_mm + max(abs(x), abs(y)) for body, (x, y, _) in placed)
        x, y = grid(half_mm)
        heights = np.full(x.shape, NO_BODY_MM)
        for body, (right, down, raised) in placed:
            heights = np.minimum(heights, body.under(x - right, y - down)[0] + raised)
        return cls.of_heights(name, np.where(heights < NO_BODY_MM, heights, np.inf))

    def under(
        self, x_mm: Float[np.ndarray, '*points'], y_mm: Float[np.ndarray, '*points']
    ) -> tuple[Float[np.ndarray, '*points'], Float[np.ndarray, '*points'], Float[np.ndarray, '*points']]:
        """Height of the lower side at points of the body's frame, and its slopes along x and y.

        A ball of radius 5 mm has the height 5 - sqrt(21) = 0.4174 at (2, 0), and the slope 2 / sqrt(21) = 0.4364.
        Beyond the grid its rim rises as a wall does.
        """
        last = len(self.height_mm) - 1
        column = np.clip((x_mm + self.half_mm) / self.spacing_mm, 0, last - 1e-9)
        row = np.clip((y_mm + self.half_mm) / self.spacing_mm, 0, last - 1e-9)
        i, j = row.astype(np.intp), column.astype(np.intp)
        down, right = row - i, column - j

        def between(values: np.ndarray) -> np.ndarray:
            upper = (1 - right) * values[i, j] + right * values[i, j + 1]
            blended: np.ndarray = (1 - down) * upper + down * (
                (1 - right) * values[i + 1, j] + right * values[i + 1, j + 1]
            )
            return blended

        right_of, below = (each - np.clip(each, -self.half_mm, self.half_mm) for each in (x_mm, y_mm))
        beyond = np.hypot(right_of, below)
        height = np.minimum(between(self.height_mm) + STEEPEST * beyond, NO_BODY_MM)
        steep = STEEPEST * (height < NO_BODY_MM) / np.maximum(beyond, 1e-12)
        return height, between(self._slopes[1]) + steep * right_of, between(self._slopes[0]) + steep * below

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray]:
        along_y, along_x = np.gradient(self.height_mm, self.spacing_mm)
        return along_y, along_x


def grid(half_mm: float, spacing_mm: float = SPACING_MM) -> tuple[np.ndarray, np.ndarray]:
    """The coordinates x and y of a square of heights that extends at least `half_mm` from its middle."""
    cells = int(np.ceil(half_mm / spacing_mm))
    line = np.arange(-cells, cells + 1) * spacing_mm
    x, y = np.meshgrid(line, line)
    return x, y


def _sloped(height_mm: np.ndarray, step_mm: float) -> np.ndarray:
    """Lower the heights so that they change by at most a step from cell to cell (root 2 steps on diagonals)."""
    sloped = np.pad(height_mm, 1, constant_values=NO_BODY_MM)
    while True:
        before = sloped.copy()
        for rise, moves in ((step_mm, ((0, 1), (1, 0))), (step_mm * 2**0.5, ((1, 1), (1, -1)))):
            for move in moves:
                for sign in (1, -1):
                    beside = np.roll(sloped, (sign * move[0], sign * move[1]), (0, 1))
                    np.minimum(sloped, beside + rise, out=sloped)
        sloped[[0, -1]] = sloped[:, [0, -1]] = NO_BODY_MM
        if np.array_equal(before, sloped):
            inner: np.ndarray = sloped[1:-1, 1:-1].copy()
            return inner
