"""How uncertain a response readout is: judged by presses that its fit did not see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.sensing.likeness import Likeness
from tactile_nodes.sensing.response import Calibration, Fit, ResponseReadout

COVERAGE = 0.90
NORMAL_90 = 1.6449
"""Standard deviations to either side that hold 90 % of a normal distribution."""
ONE_OF_A_THOUSAND = 99.9
FLOORS = np.concatenate([[0.0], np.geomspace(0.05, 4.0, 12)])
MOST_PRESSES = 2000


def calibrated(readout: ResponseReadout, dataset: Dataset, judges: np.ndarray) -> tuple[Calibration, Likeness]:
    """Uncertainties and limits such that `judges` (indices of samples) fall within them as often as they should."""
    judges = judges[:: max(1, len(judges) // MOST_PRESSES)]
    raw = replace(readout, calibration=Calibration())
    inputs = [_inputs(raw, dataset, index) for index in judges]
    fits = [raw.fit(raw.components(each)) for each in inputs]
    touched = dataset.presses[judges, 2] > 0
    errors, sigmas = _errors(raw, dataset.presses[judges[touched]], [f for f, t in zip(fits, touched, strict=True) if t])
    place_floor, place_factor = _spread(errors[:, :2].reshape(-1), np.repeat(sigmas[:, 0], 2))
    force_floor, force_factor, force_share = _force_spread(errors[:, 2], sigmas[:, 1], dataset.presses[judges[touched], 3])
    limit = float(np.sqrt(np.percentile([fit.misfit for fit in fits], ONE_OF_A_THOUSAND)))
    calibration = Calibration(place_floor, place_factor, force_floor, force_share, force_factor, limit)
    return calibration, _likeness(raw.likeness, np.array([raw.likeness.left_over(each) for each in inputs]), touched)


def _inputs(readout: ResponseReadout, dataset: Dataset, index: int) -> np.ndarray:
    values, confidence = dataset.features[index].astype(np.float32), dataset.confidence[dataset.rest[index]]
    flat: np.ndarray = readout.scaling(values, confidence).reshape(-1)
    return flat


def _errors(readout: ResponseReadout, presses: np.ndarray, fits: list[Fit]) -> tuple[np.ndarray, np.ndarray]:
    """Errors of x, y (mm) and force (N), and the fits' own standard deviations of place and force."""
    errors, sigmas = [], []
    for (x, y, _, force_n), fit in zip(presses.tolist(), fits, strict=True):
        contact = readout.contacts(fit)[0]
        errors.append((contact.x_mm - x, contact.y_mm - y, contact.force_n - force_n))
        sigmas.append((contact.sigma_mm, contact.sigma_n))
    return np.array(errors), np.array(sigmas)


def _spread(errors: Float[np.ndarray, ' n'], sigmas: Float[np.ndarray, ' n']) -> tuple[float, float]:
    """Floor and factor: the most probable (of a Laplace distribution, which outliers do not rule), then to 90 %."""
    unit = float(np.median(np.abs(errors)))
    best = min((_surprise(errors, np.hypot(floor * unit, sigmas)), floor * unit) for floor in FLOORS)[1]
    scale = _to_coverage(errors, np.hypot(best, sigmas))
    return best * scale, scale


def _force_spread(
    errors: Float[np.ndarray, ' n'], sigmas: Float[np.ndarray, ' n'], forces: Float[np.ndarray, ' n']
) -> tuple[float, float, float]:
    """Floor, factor and share of the force, likewise."""
    unit, relative = float(np.median(np.abs(errors))), float(np.median(np.abs(errors) / np.maximum(forces, 1e-3)))
    choices = [(floor * unit, share * relative) for floor in FLOORS for share in FLOORS]
    spread = {each: np.hypot(np.hypot(each[0], sigmas), each[1] * forces) for each in choices}
    floor, share = min(choices, key=lambda each: _surprise(errors, spread[each]))
    scale = _to_coverage(errors, spread[floor, share])
    return floor * scale, scale, share * scale


def _surprise(errors: np.ndarray, sigmas: np.ndarray) -> float:
    """Negative log likelihood of a Laplace distribution with its best common scale."""
    ratio = np.abs(errors) / sigmas
    return float(np.mean(np.log(sigmas)) + np.log(np.mean(ratio)))


def _to_coverage(errors: np.ndarray, sigmas: np.ndarray) -> float:
    return float(np.percentile(np.abs(errors) / sigmas, 100 * COVERAGE) / NORMAL_90)


def _likeness(likeness: Likeness, left_over: Float[np.ndarray, 'n 2'], touched: np.ndarray) -> Likeness:
    """Limits of what the directions leave over, at rest and under a press."""
    left, size = left_over.T
    still = left[~touched] if (~touched).any() else left[size <= np.percentile(size, 10)]
    floor = float(np.percentile(still, ONE_OF_A_THOUSAND))
    share = float(np.percentile(np.maximum(left - floor, 0.0) / np.maximum(size, 1e-9), ONE_OF_A_THOUSAND))
    return replace(likeness, floor=floor, share=share)
