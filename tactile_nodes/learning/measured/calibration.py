"""The uncertainty of a response readout, measured on presses that its fit did not see."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tactile_nodes.learning.coverage import COVERAGE, NORMAL_90, ONE_OF_A_THOUSAND, to_coverage
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.measured.contact_shape import shape_of
from tactile_nodes.sensing.explain.measured.readout import Observation, ResponseReadout
from tactile_nodes.sensing.explain.measured.response import Fit
from tactile_nodes.sensing.explain.uncertainty import Calibration, factor_at
from tactile_nodes.shapes import Float

FLOORS = np.concatenate([[0.0], np.geomspace(0.05, 4.0, 12)])
MOST_PRESSES = 2000
LEAST_JUDGES = 200
LEVELS = 9
LEAST_FLOOR = 1e-3
"""In units of the noise at rest: if directions explain everything, rounding must not count as novelty."""


def calibrated(readout: ResponseReadout, dataset: Dataset, judges: np.ndarray) -> tuple[Calibration, Likeness]:
    """Uncertainties and limits that have the wanted coverage on `judges` (indices of samples)."""
    raw = replace(readout, calibration=Calibration())
    judges, observed = _readable(raw, dataset, _thinned(judges))
    components = [raw.whitening @ each.scores for each in observed]
    fits = [raw.fit(each) for each in components]
    touched = dataset.presses[judges, 2] > 0
    presses = dataset.presses[judges[touched]]
    corrected = [
        raw.with_usual_width(*each)
        for each, press in zip(zip(components, fits, strict=True), touched, strict=True)
        if press
    ]
    errors, sigmas = _errors(raw, presses, corrected)
    heights = np.maximum(presses[:, 3], 0.0) / raw.response.s.high
    place_floor, place_factors = spread_of(errors[:, :2].reshape(-1), np.repeat(sigmas[:, 0], 2), np.repeat(heights, 2))
    force_floor, force_factors = spread_of(errors[:, 2], sigmas[:, 1], heights)
    limit = float(np.sqrt(np.percentile([fit.misfit for fit in fits], ONE_OF_A_THOUSAND)))
    gains = [raw.gain(each, fit) for each, fit, t in zip(components, fits, touched, strict=True) if not t]
    least = float(np.percentile(gains, ONE_OF_A_THOUSAND)) if gains else 0.0
    calibration = Calibration(place_floor, force_floor, place_factors, force_factors, limit, least)
    return calibration, _likeness(raw.likeness, np.array([(each.left_over, each.size) for each in observed]), touched)


def rescaled(readout: ResponseReadout, dataset: Dataset, judges: np.ndarray) -> Calibration:
    """The readout's calibration with its spreads scaled to the final fit, which saw more presses than the judged one.

    `judges` are presses that not even the final fit saw, at positions of their own; with few of them nothing changes.
    """
    judges = _thinned(judges[dataset.presses[judges, 2] > 0])
    if len(judges) < LEAST_JUDGES:
        return readout.calibration
    judges, observed = _readable(readout, dataset, judges)
    components = [readout.whitening @ each.scores for each in observed]
    corrected = [readout.with_usual_width(each, readout.fit(each)) for each in components]
    errors, sigmas = _errors(readout, dataset.presses[judges], corrected)
    place = to_coverage(errors[:, :2].reshape(-1), np.repeat(sigmas[:, 0], 2))
    force = to_coverage(errors[:, 2], sigmas[:, 1])
    c = readout.calibration
    return replace(
        c,
        place_factors=tuple(place * each for each in c.place_factors),
        force_factors=tuple(force * each for each in c.force_factors),
    )


def most_shift_gain(readout: ResponseReadout, dataset: Dataset, held_out: np.ndarray) -> float:
    """The gain by a shift of all regions that one of a thousand presses exceeds, without presses at the ends.

    Measured on held-out presses if these are enough, otherwise on all. If all lie at the ends there is no limit.
    """
    touched = dataset.presses[:, 2] > 0
    judges = np.flatnonzero(touched & held_out)
    _, observed = _readable(
        readout, dataset, _thinned(judges if len(judges) >= LEAST_JUDGES else np.flatnonzero(touched))
    )
    found = [(each, readout.fit(each)) for each in (readout.whitening @ one.scores for one in observed)]
    inside = [each for each in found if not readout.beyond(each[1].contacts)]
    gains = [shape_of(readout.response, readout.shifts, *each).shift_gain for each in inside]
    return float(np.percentile(gains, ONE_OF_A_THOUSAND)) if gains else math.inf


def _thinned(judges: np.ndarray) -> np.ndarray:
    """An evenly spaced subset, `MOST_PRESSES` at most."""
    return judges[:: max(1, math.ceil(len(judges) / MOST_PRESSES))]


def _readable(readout: ResponseReadout, dataset: Dataset, judges: np.ndarray) -> tuple[np.ndarray, list[Observation]]:
    """The presses that show enough regions, and their features as the readout sees them."""
    features, confidence = dataset.features[judges].astype(np.float32), dataset.confidence[dataset.rest[judges]]
    observed = [readout.observed(*each) for each in zip(features, confidence, strict=True)]
    readable = np.array([bool(np.isfinite(each.scores).all()) for each in observed], bool)
    return judges[readable], [each for each, usable in zip(observed, readable, strict=True) if usable]


def _errors(readout: ResponseReadout, presses: np.ndarray, fits: list[Fit]) -> tuple[np.ndarray, np.ndarray]:
    """Errors of x, y (mm) and force (N), and the fits' own standard deviations of place and force."""
    errors, sigmas = [], []
    for (x, y, _, force_n), fit in zip(presses.tolist(), fits, strict=True):
        contact = readout.contacts(fit)[0]
        errors.append((contact.x_mm - x, contact.y_mm - y, contact.force_n - force_n))
        sigmas.append((contact.sigma_mm, contact.sigma_n))
    return np.array(errors), np.array(sigmas)


def spread_of(
    errors: Float[np.ndarray, ' n'], sigmas: Float[np.ndarray, ' n'], heights: Float[np.ndarray, ' n']
) -> tuple[float, tuple[float, ...]]:
    """The most probable floor for the errors, and the factors that give a coverage of 90 % at every height.

    (Most probable under a Laplace distribution, which outliers do not dominate.)
    """
    unit = float(np.median(np.abs(errors)))
    choices = []
    for floor in (FLOORS * unit).tolist():
        base = np.hypot(floor, sigmas)
        factors = _factors(np.abs(errors) / base, heights)
        stated = base * [factor_at(factors, height) for height in heights.tolist()]
        choices.append((float(np.mean(np.log(stated) + np.abs(errors) / stated)), floor, factors))
    return min(choices)[1:]


def _factors(ratios: Float[np.ndarray, ' n'], heights: Float[np.ndarray, ' n']) -> tuple[float, ...]:
    """For each level, the 90 % quantile of the errors nearest to it in height, relative to that of normal errors."""
    nearest = max(LEAST_JUDGES // 4, len(ratios) // LEVELS)
    around = (np.argsort(np.abs(heights - level))[:nearest] for level in np.linspace(0.0, 1.0, LEVELS))
    return tuple(float(np.percentile(ratios[chosen], 100 * COVERAGE)) / NORMAL_90 for chosen in around)


def _likeness(likeness: Likeness, left_over: Float[np.ndarray, 'n 2'], touched: np.ndarray) -> Likeness:
    """Limits on the residuals of the directions, at rest and under a press."""
    left, size = left_over.T
    still = left[~touched] if (~touched).any() else left[size <= np.percentile(size, 10)]
    floor = max(float(np.percentile(still, ONE_OF_A_THOUSAND)), LEAST_FLOOR)
    share = float(np.percentile(np.maximum(left - floor, 0.0) / np.maximum(size, 1e-9), ONE_OF_A_THOUSAND))
    return replace(likeness, floor=floor, share=share)
