"""Where the markers of a gel are: at random or printed, within its rim, below its surface."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float32

from tactile_nodes.simulation.gel import Gel

ACROSS_A_DOT = 9
"""Small discs that fill a printed dot, along its diameter."""


def place_markers(gel: Gel) -> tuple[Float32[np.ndarray, 'markers 3'], Float32[np.ndarray, ' markers']]:
    """Places of the markers in the surface frame, at random through the soft gel or printed, and their diameters."""
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
    """Markers of a flat gel where a dome has them, and axes along which they move there; the base stays flat."""
    if not gel.dome_radius_mm:
        return flat_mm, None
    places, height = flat_mm[:, :2].astype(float), gel.dome.height_mm(flat_mm[:, :2].astype(float))
    share = 1 + flat_mm[:, 2] / (gel.layer_mm + height)
    lower = np.column_stack([np.zeros_like(places), height]).astype(np.float32)
    return flat_mm + lower, gel.dome.axes(places, share).astype(np.float32)


def _printed(gel: Gel, z_mm: float) -> tuple[Float32[np.ndarray, 'markers 3'], Float32[np.ndarray, ' markers']]:
    """Dots in rows and columns, each filled with small discs that have its area together."""
    diameter_mm = sum(gel.marker_diameter_mm) / 2
    steps = (np.arange(ACROSS_A_DOT) + 0.5) / ACROSS_A_DOT - 0.5
    within = diameter_mm * np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    within = within[np.hypot(*within.T) < diameter_mm / 2]
    flat = (gel.rim.lattice_mm(gel.pitch_mm, gel.dot_mm)[:, None] + within).reshape(-1, 2)
    places = np.column_stack([flat, np.full(len(flat), z_mm)]).astype(np.float32)
    return places, np.full(len(flat), diameter_mm / math.sqrt(len(within)), np.float32)
