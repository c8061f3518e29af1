"""Results of a readout for the features of one frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float, Float32

UNKNOWN = float('nan')
BEYOND_UNLIKENESS = 2.0
"""Least novelty of a contact at or beyond the limits of the training, of one that is wider than those of the training,
and of one that drags the skin."""


@dataclass(frozen=True)
class Contact:
    """One place of contact: surface frame, force positive into the gel.

    `sigma_mm` (along each axis) and `sigma_n` are standard deviations, scaled on presses held out in training so that
    1.645 of them to either side cover 90 %; NaN if unknown.
    """

    x_mm: float
    y_mm: float
    force_n: float
    sigma_mm: float = UNKNOWN
    sigma_n: float = UNKNOWN
    region: Region | None = None


@dataclass(frozen=True)
class Region:
    """Further properties of a contact: force along the surface, torsion, extent.

    `torsion_n_mm` is the moment about z at the contact's place. `area_mm2` is the area with at least half of the
    highest pressure. `length_mm` and `width_mm` are its extent along and across its longest axis, which is turned by
    `angle_rad` from x towards y. `slip_share` is how near the contact is to slipping as a whole: net shear and torsion
    over those at the highest friction that it shows.
    """

    shear_n: tuple[float, float]
    shear_sigma_n: float
    torsion_n_mm: float
    torsion_sigma_n_mm: float
    area_mm2: float
    length_mm: float
    width_mm: float
    angle_rad: float
    slip_share: float


@dataclass(frozen=True)
class SurfaceField:
    """Pressure (positive into the gel) and shear along x and y on equal cells of the whole surface, all in MPa."""

    pressure_mpa: Float32[np.ndarray, 'rows cols']
    shear_mpa: Float32[np.ndarray, 'rows cols 2']
    pressure_sigma_mpa: Float32[np.ndarray, 'rows cols']
    shear_sigma_mpa: Float32[np.ndarray, 'rows cols']


@dataclass(frozen=True)
class Acting:
    """Further results besides the normal force on the bins, from readouts that have them.

    `explanation` is the simplest that explains the motion: 'nothing', 'tips' or 'field'. `wrench` is force x, y, z [N]
    and torque x, y, z [N mm] on the gel about the frame's origin; a press is -z. `field` computes the fine maps on
    request.
    """

    explanation: str
    shear_n: Float32[np.ndarray, 'rows cols 2']
    normal_sigma_n: Float32[np.ndarray, 'rows cols']
    wrench: Float[np.ndarray, ' 6']
    wrench_covariance: Float[np.ndarray, '6 6']
    field: Callable[[], SurfaceField] | None = None


@dataclass(frozen=True)
class Reading:
    """The normal force on each bin, the contacts that cause it (strongest first), and the uncertainty.

    `unlikeness` is the novelty: 1 at the limit of presses held out in training; above it the frame is unlike the
    training. NaN if unknown.
    """

    normal_force_n: Float32[np.ndarray, 'rows cols']
    contacts: tuple[Contact, ...]
    total_sigma_n: float = UNKNOWN
    unlikeness: float = UNKNOWN
    acting: Acting | None = None


def nothing_read(bins: BinGrid) -> Reading:
    """The result for features that are not finite, too few, or whose forces cannot be told apart."""
    forces = np.full((bins.rows, bins.cols), UNKNOWN, np.float32)
    return Reading(forces, (Contact(UNKNOWN, UNKNOWN, UNKNOWN),))


@runtime_checkable
class Readout(Protocol):
    """Turns features into forces; the result depends only on the features and the readout's numbers."""

    @property
    def kind(self) -> str: ...

    @property
    def parameter_count(self) -> int:
        """Number of learned parameters."""
        ...

    def nominal_n(self, total_n: float) -> float:
        """The usual error of the total, as a standard deviation; NaN if unknown."""
        ...

    def require_fit(self, features: int, bins: BinGrid) -> None:
        """Refuse features or bins that the readout was not made for.

        Raises:
            ModelError: states both.
        """
        ...

    def read(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Reading: ...


def require_central(bins: BinGrid) -> None:
    """Refuse bins that a readout for tips does not support. Raises ModelError."""
    if bins.centre_mm != (0.0, 0.0):
        raise ModelError(
            f'a model for tips only supports bins centred on the surface, but these are centred at {bins.centre_mm} '
            'mm; set bins.centre_mm to 0, or use a model for any contact (field)'
        )


def spread_over_bins(contacts: tuple[Contact, ...], bins: BinGrid) -> Float32[np.ndarray, 'rows cols']:
    """The expected force on each bin if all of a contact's force belongs to the bin of its centre.

    The centre is known to `sigma_mm` only, so near a border the bins on both sides share the force: on the border
    itself half each. Force outside the surface counts towards the outermost bins; the sum is kept.
    """
    forces = np.zeros((bins.rows, bins.cols))
    for each in contacts:
        along_x = _shares(each.x_mm, each.sigma_mm, bins.cols, bins.width_mm)
        along_y = _shares(each.y_mm, each.sigma_mm, bins.rows, bins.height_mm)
        forces += each.force_n * np.outer(along_y, along_x)
    return forces.astype(np.float32)


def _shares(at_mm: float, sigma_mm: float, count: int, size_mm: float) -> np.ndarray:
    """Probability that a place with a normal error lies in each of `count` equal intervals."""
    scale = max(sigma_mm if math.isfinite(sigma_mm) else 0.0, 1e-6) * math.sqrt(2)
    borders = (size_mm * (i / count - 0.5) for i in range(1, count))
    below = [0.0, *(0.5 * (1 + math.erf((border - at_mm) / scale)) for border in borders), 1.0]
    return np.diff(below)
