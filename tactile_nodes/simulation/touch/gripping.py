"""An object between two facing gels: how deep its round ends press into them, and when it slips.

The fingers are stiff and move slowly, so forces balance at every moment: both gels press with the same force, and share
a pull by their stiffnesses. An end sticks to its gel up to the friction limit of its force (Coulomb). Beyond it the
object slides until it is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tactile_nodes.simulation.gel import Gel
from tactile_nodes.simulation.mechanics import ContactTable
from tactile_nodes.simulation.shear import shear_of

SLIDES_MM_S = 10.0
"""Speed at which an object slides when it is pulled harder than it is held."""
LOST_MM = 6.0
"""Distance it slides until it leaves the grip."""
_FORCES = 400


class Finger:
    """One gel under a round end."""

    def __init__(self, gel: Gel, table: ContactTable) -> None:
        self.table = table
        self._shear = shear_of(gel, table)

    def stiffness_n_mm(self, depth_mm: float) -> float:
        """Drag per mm of sideways motion at a depth."""
        return self._shear.force_n(self.table.contact_at(depth_mm), (1.0, 0.0))[0]

    def drag_n(self, depth_mm: float, drag_mm: float) -> float:
        """The drag on the gel of an end that was dragged by `drag_mm` at a depth."""
        return self.stiffness_n_mm(depth_mm) * drag_mm if depth_mm > 0 else 0.0


@dataclass(frozen=True)
class Gripped:
    """The gripped object: its width at rest, and the friction between its ends and the gels."""

    width_mm: float = 30.0
    friction: float = 0.9


class Hold(NamedTuple):
    """How an object is held: force on each gel, depths in them, sticking drag, and distance it has slid."""

    normal_n: float
    depth_mm: tuple[float, float]
    drag_mm: float
    slid_mm: float
    slips: bool


class Grip:
    """Two fingers around an object; `hold` follows it from moment to moment."""

    def __init__(self, fingers: Sequence[Finger], gripped: Gripped) -> None:
        first, second = fingers
        self._fingers, self._gripped = (first, second), gripped
        self._forces_n = np.linspace(0.0, min(float(each.table.force_n[-1]) for each in fingers), _FORCES)
        depths = [[each.table.depth_at(force_n) for force_n in self._forces_n.tolist()] for each in fingers]
        self._squeezed_mm = np.sum(depths, axis=0)
        self._slid_mm = 0.0

    @property
    def lost(self) -> bool:
        """Whether it has slid out."""
        return self._slid_mm >= LOST_MM

    def hold(self, opening_mm: float, pull_n: float, since_s: float) -> Hold:
        """How it is held at an opening and a pull, `since_s` after the last call."""
        squeezed_mm = self._gripped.width_mm - opening_mm
        if self.lost or squeezed_mm <= 0:
            gap_mm = -1.0 if self.lost else squeezed_mm / 2
            return Hold(0.0, (gap_mm, gap_mm), 0.0, self._slid_mm, False)
        normal_n = float(np.interp(squeezed_mm, self._squeezed_mm, self._forces_n))
        first_mm, second_mm = (each.table.depth_at(normal_n) for each in self._fingers)
        first, second = self._fingers
        stiffness = first.stiffness_n_mm(first_mm), second.stiffness_n_mm(second_mm)
        stuck_mm = self._gripped.friction * normal_n / max(stiffness)
        wanted_mm = pull_n / sum(stiffness)
        slips = wanted_mm > stuck_mm
        self._slid_mm += SLIDES_MM_S * since_s * slips
        return Hold(normal_n, (first_mm, second_mm), min(wanted_mm, stuck_mm), self._slid_mm, slips)
