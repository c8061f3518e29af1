"""The surface of a gel that is a shallow dome: how high it is, and how it leans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

STEEPEST = 0.35
"""Distance from the middle over the radius, up to which a dome is shallow: there it leans by 20 degrees."""


@dataclass(frozen=True)
class Dome:
    """A part of a sphere whose highest point is the origin of the surface frame; a radius of 0 is a flat surface."""

    radius_mm: float

    def require_shallow(self, far_mm: float) -> None:
        """Refuse a dome that is steep at its rim, which is so far from the middle. Raises ValueError."""
        if self.radius_mm and not far_mm <= STEEPEST * self.radius_mm:
            raise ValueError(
                f'gel.dome_radius_mm is {self.radius_mm:g}, and the rim is {far_mm:g} mm from the middle: a shallow '
                f'dome has a radius of {far_mm / STEEPEST:.3g} mm or more; 0 is flat'
            )

    def height_mm(self, places_mm: Float[np.ndarray, '*shape 2']) -> Float[np.ndarray, '*shape']:
        """z of the surface at places (x, y): 0 in the middle, -0.404 mm 4.9 mm beside that on a radius of 30 mm."""
        squared = np.square(places_mm).sum(axis=-1)
        if not self.radius_mm:
            return np.zeros_like(squared)
        return np.asarray(-squared / (self.radius_mm + self._above(squared)))

    def axes(
        self, places_mm: Float[np.ndarray, '*shape 2'], share: float | Float[np.ndarray, '*shape'] = 1.0
    ) -> Float[np.ndarray, '*shape 3 3']:
        """Axes of the surface at places, as columns: two along it, and the one out of the gel.

        They are the frame's own by the least turn; with a `share`, of a surface that leans by so much of its slope.
        """
        if not self.radius_mm:
            return np.broadcast_to(np.eye(3), (*places_mm.shape[:-1], 3, 3))
        slope = -(share / self._above(np.square(places_mm).sum(axis=-1)))[..., None] * places_mm
        a, b, c = np.moveaxis(np.concatenate([-slope, np.ones((*slope.shape[:-1], 1))], axis=-1), -1, 0) / np.sqrt(
            1 + np.square(slope).sum(axis=-1)
        )
        rows = (1 - a * a / (1 + c), -a * b / (1 + c), a), (-a * b / (1 + c), 1 - b * b / (1 + c), b), (-a, -b, c)
        return np.moveaxis(np.array(rows), (0, 1), (-2, -1))

    def _above(self, squared: Float[np.ndarray, '*shape']) -> Float[np.ndarray, '*shape']:
        """Of places by their squared distance from the middle: how far the surface is above the sphere's centre."""
        return np.asarray(np.sqrt(np.maximum(self.radius_mm**2 - squared, 1e-9)))
