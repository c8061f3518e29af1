"""The net force of a ForceDistribution: net shear, torsion, and how the motion was explained."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_nodes.conversions import EXPLANATIONS, MILLI
from tactile_nodes.shapes import Float

_WORDS = {number: word for word, number in EXPLANATIONS.items()}
UNKNOWN = math.nan


@dataclass(frozen=True)
class Net:
    """Net force components, each with its standard deviation; NaN: unknown. `direction_rad` of shear is from x to y.

    `torsion_n_mm` is the moment along the axis of the force, which is that about z at the centre of pressure.
    `explanation` is 'nothing', 'tips' or 'field', or empty if the model does not state it.
    """

    explanation: str
    shear_n: float = UNKNOWN
    shear_sigma_n: float = UNKNOWN
    direction_rad: float = UNKNOWN
    torsion_n_mm: float = UNKNOWN
    torsion_sigma_n_mm: float = UNKNOWN

    @property
    def is_known(self) -> bool:
        """Whether the model estimates shear at all."""
        return not math.isnan(self.shear_n)


def net_of(force: Any) -> Net:
    """The net of a ForceDistribution; a covariance that begins with -1 means that shear was not estimated."""
    explanation = _WORDS.get(int(force.explanation), '')
    covariance = np.asarray(force.wrench_covariance, float).reshape(6, 6)
    if force.status == force.STATUS_INVALID or not covariance[0, 0] >= 0:
        return Net(explanation)
    pull = np.array([force.wrench.force.x, force.wrench.force.y])
    size = float(np.hypot(*pull))
    along = pull / size if size else np.sqrt([0.5, 0.5])
    sigma = _sigma(covariance[:2, :2], along)
    return Net(explanation, size, sigma, math.atan2(pull[1], pull[0]), *_torsion(force, covariance))


def _torsion(force: Any, covariance: Float[np.ndarray, '6 6']) -> tuple[float, float]:
    """T F / F_z and its deviation (N mm).

    The centre of pressure is (-T_y, T_x) / F_z, and T_z - x F_y + y F_x = (T_x F_x + T_y F_y + T_z F_z) / F_z.
    """
    pull, turn = force.wrench.force, force.wrench.torque
    if not force.in_contact or not pull.z < 0:
        return UNKNOWN, UNKNOWN
    torsion = (turn.x * pull.x + turn.y * pull.y) / pull.z + turn.z
    slope = np.array([turn.x, turn.y, turn.z - torsion, pull.x, pull.y, pull.z]) / pull.z
    return torsion / MILLI, _sigma(covariance, slope) / MILLI


def _sigma(covariance: np.ndarray, slope: np.ndarray) -> float:
    return math.sqrt(max(0.0, float(slope @ covariance @ slope)))
