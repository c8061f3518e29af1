"""Indenters: round bodies on a shaft, as signed distance functions for the contact."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tactile_nodes.shapes import Float


@dataclass(frozen=True)
class Indenter:
    """A cylinder of `radius_mm` whose lower edge is rounded by `edge_mm`. If both are equal it ends in half a sphere.

    The paper's tip is Indenter(0.6, 0.6); a flat punch has a small edge, which keeps its pressure finite.
    """

    radius_mm: float = 0.6
    edge_mm: float = 0.6

    def touch(
        self, across_mm: Float[np.ndarray, '*points'], above_mm: Float[np.ndarray, '*points']
    ) -> tuple[Float[np.ndarray, '*points'], Float[np.ndarray, '*points 2'], Float[np.ndarray, '*points']]:
        """Signed distance of points from the body (negative inside), outward normal, curvature of the distance.

        Points are relative to the lowest point on the axis, across and upwards. Both signs of `across_mm` are valid,
        so that the same body can be used in plane strain. The tip of 0.6 mm is 0.4 mm from (1.0, 0.6).
        """
        flat = self.radius_mm - self.edge_mm
        side = np.where(across_mm < 0, -1.0, 1.0) * np.maximum(np.abs(across_mm) - flat, 0)
        below = np.minimum(above_mm - self.edge_mm, 0)
        length = np.maximum(np.hypot(side, below), 1e-12)
        normal = np.stack([side, below], axis=-1) / length[..., None]
        return length - self.edge_mm, normal, np.where((side != 0) & (below < 0), 1 / length, 0.0)


PAPER_TIP = Indenter()

BALL, PUNCH = 'ball', 'punch'
INDENTERS = {BALL: Indenter(3.0, 3.0), PUNCH: Indenter(1.5, 0.15)}
"""Indenters besides the gel's own 'tip': a sphere of 6 mm and a flat punch of 3 mm diameter."""

RECORDED = {BALL: 'sphere', PUNCH: 'flat punch'}
"""Names of a ball and a punch in records, followed by their diameter: 'sphere 1.2 mm'."""

EDGE_SHARE = 0.1
"""Edge radius of a punch, as a share of its radius."""


def indenter_of(name: str) -> Indenter | None:
    """The indenter of a name such as 'ball:5' or 'punch:1.5' (radius in mm); None for any other name."""
    shape, _, size = name.partition(':')
    radius_mm = number(size)
    if shape not in INDENTERS or not (0 < radius_mm < math.inf):
        return None
    return Indenter(radius_mm, radius_mm if shape == BALL else EDGE_SHARE * radius_mm)


def indenter_name(tip_radius_mm: float, indenter: str) -> str:
    """The name of an indenter in records: 'sphere 1.2 mm' is the paper's tip, 'flat punch 3 mm' the punch."""
    body = INDENTERS.get(indenter, Indenter(tip_radius_mm, tip_radius_mm))
    shape = BALL if body.edge_mm == body.radius_mm else PUNCH
    return f'{RECORDED[shape]} {2 * body.radius_mm:g} mm'


def name_of_record(record: str) -> str:
    """'ball:0.6' for 'sphere 1.2 mm', 'punch:1.5' for 'flat punch 3 mm'; any other text unchanged."""
    for shape, words in RECORDED.items():
        size = record.removeprefix(words).removesuffix('mm')
        if record == f'{words}{size}mm' and not math.isnan(number(size)):
            return f'{shape}:{number(size) / 2:g}'
    return record


def number(text: str) -> float:
    """The text as a number; NaN if it is not a number."""
    try:
        return float(text)
    except ValueError:
        return math.nan
