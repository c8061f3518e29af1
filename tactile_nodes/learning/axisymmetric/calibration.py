"""Systematic errors and uncertainty of an axisymmetric readout, measured on presses that its fit did not see."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_nodes.learning.coverage import ONE_OF_A_THOUSAND
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.measured.calibration import LEAST_JUDGES, spread_of
from tactile_nodes.sensing.explain.axisymmetric.correction import Correction
from tactile_nodes.sensing.explain.axisymmetric.readout import AxisymmetricReadout
from tactile_nodes.sensing.explain.measured.response import Fit
from tactile_nodes.sensing.explain.uncertainty import Calibration
from tactile_nodes.shapes import Float

TYPICAL = np.array([0.1, 0.1, 0.02])
"""Errors of x and y (mm) and of the force (share) that a correction is expected to remove."""
LEAST_FORCE_N = 0.02


@dataclass(frozen=True)
class Judged:
    """Fits to presses before any correction, and the truth (x, y in mm, force in N)."""

    readout: AxisymmetricReadout
    truth: Float[np.ndarray, 'n 3']
    fits: list[Fit]

    @classmethod
    def of(cls, readout: AxisymmetricReadout, dataset: Dataset, rows: np.ndarray) -> Judged:
        """From the samples that show enough regions."""
        raw, fits, kept = replace(readout, calibration=Calibration(), most_contacts=1), [], []
        for row in rows.tolist():
            observed = raw.observed(dataset.features[row].astype(np.float32), dataset.confidence[dataset.rest[row]])
            if observed.enough:
                fits.append(raw.fit(observed))
                kept.append(row)
        return cls(readout, dataset.presses[np.array(kept, int)][:, [0, 1, 3]].astype(float), fits)

    @property
    def found(self) -> Float[np.ndarray, 'n 3']:
        return np.reshape([fit.contacts[0] for fit in self.fits], (-1, 3))

    @property
    def errors(self) -> Float[np.ndarray, 'n 3']:
        """Errors of x, y (mm) and force (N), after the correction."""
        errors: np.ndarray = self.readout.corrected(self.found) - self.truth
        return errors

    @property
    def sigmas(self) -> Float[np.ndarray, 'n 2']:
        """Standard deviations of place (mm) and force (N) as the fits state them."""
        plain = replace(self.readout, calibration=Calibration())
        stated = [plain.contacts(fit)[0] for fit in self.fits]
        return np.reshape([(each.sigma_mm, each.sigma_n) for each in stated], (-1, 2))


def with_correction(judged: Judged) -> AxisymmetricReadout:
    """The readout with the polynomials that bring its estimates closest to the truth; outliers weigh less.

    With few presses it stays as it is, because so many numbers would overfit them.
    """
    readout, found = judged.readout, judged.found
    if len(judged.fits) < LEAST_JUDGES:
        return readout
    terms = correcting(found, judged.truth, readout.correction)
    return replace(readout, correction=replace(readout.correction, terms=terms))


def correcting(
    found: Float[np.ndarray, 'n 3'], truth: Float[np.ndarray, 'n 3'], correction: Correction
) -> Float[np.ndarray, 'terms 3']:
    """The terms of a polynomial correction that bring the estimates closest to the truth."""
    powers = Correction.powers(found, correction.reach_mm, correction.hardest_n)
    wanted = truth - found
    wanted[:, 2] /= np.maximum(found[:, 2], LEAST_FORCE_N)
    terms = [
        typical * _robust(powers, column / typical) for column, typical in zip(wanted.T, TYPICAL.tolist(), strict=True)
    ]
    return np.stack(terms, axis=1)


def _robust(powers: Float[np.ndarray, 'n terms'], wanted: Float[np.ndarray, ' n']) -> Float[np.ndarray, ' terms']:
    """Ridge regression in which outliers from the median weigh less (Huber)."""
    off = np.abs(wanted - np.median(wanted))
    usual = 3 * max(float(np.median(off)), 1e-6)
    weighted = powers * np.minimum(1.0, usual / np.maximum(off, 1e-12))[:, None]
    solved: np.ndarray = np.linalg.solve(weighted.T @ powers + np.eye(powers.shape[1]), weighted.T @ wanted)
    return solved


def calibrated(judged: Judged, dataset: Dataset, untouched: np.ndarray) -> Calibration:
    """Uncertainties and limits that have the wanted coverage on held-out presses and untouched images."""
    readout = judged.readout
    errors, sigmas = judged.errors, judged.sigmas
    heights = judged.truth[:, 2] / readout.highest_n
    place_floor, place_factors = spread_of(errors[:, :2].reshape(-1), np.repeat(sigmas[:, 0], 2), np.repeat(heights, 2))
    force_floor, force_factors = spread_of(errors[:, 2], sigmas[:, 1], heights)
    return Calibration(
        place_floor, force_floor, place_factors, force_factors,
        misfit_limit(judged.fits), least_gain(readout, dataset, untouched),
    )  # fmt: skip


def misfit_limit(fits: list[Fit]) -> float:
    """The square root of the misfit that one press of a thousand exceeds."""
    return float(np.sqrt(np.percentile([fit.misfit for fit in fits], ONE_OF_A_THOUSAND)))


def least_gain(readout: AxisymmetricReadout, dataset: Dataset, untouched: np.ndarray) -> float:
    """The gain by a contact that noise alone exceeds in one of a thousand images of the untouched gel."""
    raw = replace(readout, calibration=Calibration(), most_contacts=1)
    gains = []
    for row in untouched.tolist():
        observed = raw.observed(dataset.features[row].astype(np.float32), dataset.confidence[dataset.rest[row]])
        if observed.enough:
            gains.append(raw.gain(observed, raw.fit(observed)))
    return float(np.percentile(gains, ONE_OF_A_THOUSAND)) if gains else 0.0
