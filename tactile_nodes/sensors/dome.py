"""The surface of a gel that is a shallow dome: its height and slope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Float

STEEPEST = 0.35
"""Greatest distance from the middle over the radius of a shallow dome; the slope there is 20 degrees."""


@dataclass(frozen=True)
class Dome:
    """A spherical cap whose highest point is the origin of the surface frame; a radius of 0 is a flat surface."""

    radius_mm: float

    def require_shallow(self, far_mm: float) -> None:
        """Refuse a dome that is steep at its rim, `far_mm` from the middle. Raises ValueError."""
        if self.radius_mm and not far_mm <= STEEPEST * self.radius_mm:
            raise ValueError(
                f'gel.dome_radius_mm is {self.radius_mm:g}, but the rim is {far_mm:g} mm from the middle: a shallow '
                f'dome has a radius of {far_mm / STEEPEST:.3g} mm or more; 0 is flat'
            )

    def height_mm(self, places_mm: Float[np.ndarray, '*shape 2']) -> Float[np.ndarray, '*shape']:
        """z of the surface at places (x, y): for a radius of 30 mm, 0 in the middle and -0.404 mm at 4.9 mm from it."""
        squared = np.square(places_mm).sum(axis=-1)
        if not self.radius_mm:
            return np.zeros_like(squared)
        return np.asarray(-squared / (self.radius_mm + self._above(squared)))

    def axes(
        self, places_mm: Float[np.ndarray, '*shape 2'], share: float | Float[np.ndarray, '*shape'] = 1.0
    ) -> Float[np.ndarray, '*shape 3 3']:
        """Axes of the surface at places, as columns: two tangential ones and the outward normal.

        They are the frame's axes after the smallest rotation. With a `share` the surface has this share of its slope.
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
        """Height of the surface above the sphere's centre, for squared distances from the middle."""
        return np.asarray(np.sqrt(np.maximum(self.radius_mm**2 - squared, 1e-9)))
