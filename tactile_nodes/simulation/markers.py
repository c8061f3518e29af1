"""Positions of a gel's markers: random or printed, within its rim, below its surface."""

from __future__ import annotations

import math

import numpy as np

from tactile_nodes.shapes import Float, Float32
from tactile_nodes.simulation.gel import Gel

RINGS = 6
"""Least rings of small discs that fill a printed dot, around one in its middle; each has six more than the last."""

LARGEST_DISC_PX = 1.5
"""Radius in the image up to which such discs leave no gaps between them. Larger dots have more rings."""


def place_markers(gel: Gel) -> tuple[Float32[np.ndarray, 'markers 3'], Float32[np.ndarray, ' markers']]:
    """Positions of the markers in the surface frame, random in the soft gel or printed, and their diameters."""
    random = np.random.default_rng(gel.seed)
    right, down = (side / 2 for side in gel.sides_mm)
    lowest = -gel.skin_mm - (gel.markers_thickness_mm or gel.soft_mm)
    if gel.pattern == 'dots':
        return _printed(gel, (lowest - gel.skin_mm) / 2)
    low, high = (-right, -down, lowest), (right, down, -gel.skin_mm)
    places = random.uniform(low, high, (gel.marker_count, 3))
    diameter_mm = random.uniform(*gel.marker_diameter_mm, gel.marker_count)
    on_gel = gel.rim.holds(places[:, :2])
    return places[on_gel].astype(np.float32), diameter_mm[on_gel].astype(np.float32)


def domed(
    gel: Gel, flat_mm: Float32[np.ndarray, 'markers 3']
) -> tuple[Float32[np.ndarray, 'markers 3'], Float32[np.ndarray, 'markers 3 3'] | None]:
    """Move the markers of a flat gel to their places in a dome; also returns the axes along which they move there.

    The base stays flat.
    """
    if not gel.dome_radius_mm:
        return flat_mm, None
    places, height = flat_mm[:, :2].astype(float), gel.dome.height_mm(flat_mm[:, :2].astype(float))
    share = 1 + flat_mm[:, 2] / (gel.layer_mm + height)
    lower = np.column_stack([np.zeros_like(places), height]).astype(np.float32)
    return flat_mm + lower, gel.dome.axes(places, share).astype(np.float32)


def _printed(gel: Gel, z_mm: float) -> tuple[Float32[np.ndarray, 'markers 3'], Float32[np.ndarray, ' markers']]:
    """Dots in rows and columns, each filled with small discs of the same total area."""
    diameter_mm = sum(gel.marker_diameter_mm) / 2
    within = diameter_mm / 2 * _filling(_rings(gel, diameter_mm / 2, z_mm))
    flat = (gel.rim.lattice_mm(gel.pitch_mm, gel.dot_mm)[:, None] + within).reshape(-1, 2)
    places = np.column_stack([flat, np.full(len(flat), z_mm)]).astype(np.float32)
    return places, np.full(len(flat), diameter_mm / math.sqrt(len(within)), np.float32)


def _rings(gel: Gel, radius_mm: float, z_mm: float) -> int:
    """So many that no disc is larger in the image: n rings have 1 + 3 n (n + 1) discs, more than 3 n^2."""
    radius_px = gel.focal_px_per_rad * radius_mm / (z_mm - gel.pupil_z_mm)
    return max(RINGS, math.ceil(radius_px / LARGEST_DISC_PX / math.sqrt(3)))


def _filling(rings: int) -> Float[np.ndarray, 'discs 2']:
    """Positions of discs of equal size that fill a circle of radius 1."""
    count = 6 * np.arange(rings + 1)
    count[0] = 1
    rim = np.sqrt(np.cumsum(count) / count.sum())  # of each ring: all discs have the same area
    middle = (rim + np.concatenate([[0.0], rim[:-1]])) / 2
    places = [np.zeros((1, 2))]
    for ring in range(1, rings + 1):
        turn = 2 * np.pi * (np.arange(count[ring]) + ring % 2 / 2) / count[ring]
        places.append(middle[ring] * np.column_stack([np.cos(turn), np.sin(turn)]))
    return np.concatenate(places)
