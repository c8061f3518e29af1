"""Calibrate a response model for another gel from a few presses: as many numbers as these support, no more.

Forms from the simplest on: a gain of force and motion, an affine warp, with it every region's own deviation, and a
smooth correction of what is left. Each is judged by presses that its fit did not see.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from tactile_nodes.errors import DatasetError
from tactile_nodes.learning.coverage import COVERAGE, NORMAL_90
from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.progress import Progress
from tactile_nodes.learning.transfer_build import Samples, Told, build, hardest_force
from tactile_nodes.learning.transfer_checks import require_presses, require_tared
from tactile_nodes.learning.transfer_warp import Pairs, SourceField, fit_warp, force_offset, with_regions
from tactile_nodes.sensing.response import Calibration, ResponseReadout

FORMS = ('gain', 'affine', 'regions', 'corrected')
REGION_SIGMA = 0.05
"""How far a region's markers may be expected to deviate: as a share of motion, and in mm."""
FOLDS = 5
WORTH = 1.02
"""A simpler form is taken if its held-out misfit is at most this times the best."""


@dataclass(frozen=True)
class Errors:
    """Of held-out presses: root mean square and median of the force's error, median distance of the place."""

    force_rmse_n: float
    force_median_n: float
    place_median_mm: float

    @classmethod
    def of(cls, errors: Float[np.ndarray, 'n 3']) -> Errors:
        away = np.hypot(errors[:, 0], errors[:, 1])
        off = np.abs(errors[:, 2])
        return cls(float(np.sqrt(np.mean(off**2))), float(np.median(off)), float(np.median(away)))


@dataclass(frozen=True)
class Transfer:
    """A calibrated readout, and how it came about. `misfits` are by form, in units of the noise at rest."""

    readout: ResponseReadout
    form: str
    misfits: Mapping[str, float]
    before: Errors
    after: Errors
    presses: int
    force_offset_n: float

    @property
    def reason(self) -> str:
        """Why this form, in a sentence."""
        best = min(self.misfits, key=lambda name: self.misfits[name])
        if best == self.form:
            return f'{self.form}: no other form leaves less of held-out presses unexplained'
        return f'{self.form}: {best} leaves no more than {100 * (WORTH - 1):.0f} % less of held-out presses unexplained'

    def as_dict(self) -> dict[str, Any]:
        """What a model's card says of it."""
        plain = asdict(replace(self, readout=None))  # type: ignore[arg-type]
        return {**{name: value for name, value in plain.items() if name != 'readout'}, 'reason': self.reason}


def transfer(source: ResponseReadout, dataset: Dataset, progress: Progress | None = None) -> Transfer:
    """The readout for the gel of a data set.

    Raises:
        DatasetError: presses from which no calibration follows, or which it would read worse than without.
    """
    progress = progress or Progress()
    require_presses(dataset, source)
    field = SourceField.of(source)
    samples = Samples.of(source, dataset, field.gain)
    pairs, fold = samples.pairs, folds_of(samples.pairs.presses)
    offset = force_offset(field, pairs)
    require_tared(offset)
    with progress.bar('comparing forms', len(FORMS)) as bar:
        left = {}
        for form in FORMS:
            left[form] = held_out_left(field, pairs, fold, form)
            bar.advance()
    misfits = {form: float(np.sqrt(np.mean(each**2))) for form, each in left.items()}
    form = next(name for name in FORMS if misfits[name] <= WORTH * min(misfits.values()))
    judged = _Judged.of(field, source, samples, dataset, fold, form, left[form])
    before = Errors.of(_errors(source, dataset, samples.rows)[0])
    after = Errors.of(judged.errors)
    _require_better(before, after)
    told = fit_form(field, pairs, form)
    made = build(told, source, samples, left[form], told.heights(pairs.presses))
    made = replace(made, calibration=judged.calibration(source))
    share = max(source.likeness.share, judged.share)
    made = replace(made, likeness=replace(made.likeness, share=share))
    return Transfer(made, form, misfits, before, after, len(pairs), offset)


def fit_form(field: SourceField, pairs: Pairs, form: str) -> Told:
    """A form fitted to presses; 'regions' and 'corrected' stand on the affine warp."""
    warp, _ = fit_warp(field, pairs, 'gain' if form == 'gain' else 'affine')
    if form in ('regions', 'corrected'):
        warp = with_regions(field, warp, pairs, REGION_SIGMA, REGION_SIGMA)
    told = Told(field, warp, hardest_force(field, warp, pairs))
    return told.corrected(pairs) if form == 'corrected' else told


def folds_of(presses: Float[np.ndarray, 'n 3']) -> np.ndarray:
    """A number of 0 to 4 for each press; presses at one place have the same."""
    _, first, place = np.unique(np.round(presses[:, :2], 3), axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    fold: np.ndarray = rank[place.reshape(-1)] % FOLDS
    return fold


def held_out_left(field: SourceField, pairs: Pairs, fold: np.ndarray, form: str) -> Float[np.ndarray, 'n inputs']:
    """What a form leaves over of each press when fitted to the other folds, in units of noise."""
    left = np.zeros((len(pairs), field.gain.size))
    for number in np.unique(fold):
        out = np.flatnonzero(fold == number)
        left[out] = fit_form(field, pairs.take(np.flatnonzero(fold != number)), form).left(pairs.take(out))
    return left


@dataclass(frozen=True)
class _Judged:
    """Errors of held-out presses and what was stated of them, pooled over the folds."""

    errors: Float[np.ndarray, 'n 3']
    sigmas: Float[np.ndarray, 'n 2']
    misfits: Float[np.ndarray, ' n']
    share: float

    @classmethod
    def of(
        cls,
        field: SourceField,
        source: ResponseReadout,
        samples: Samples,
        dataset: Dataset,
        fold: np.ndarray,
        form: str,
        left: np.ndarray,
    ) -> _Judged:
        found = []
        for number in np.unique(fold):
            rest, out = np.flatnonzero(fold != number), np.flatnonzero(fold == number)
            told = fit_form(field, samples.pairs.take(rest), form)
            heights = told.heights(samples.pairs.presses[rest])
            readout = build(told, source, samples, left[rest], heights)
            found.append(_errors(readout, dataset, samples.rows[out]))
        errors, sigmas, rest_of = (np.concatenate(parts) for parts in zip(*found, strict=True))
        if not len(errors):
            raise DatasetError('no press shows enough regions to be read; check the camera and the light')
        left_over = (rest_of[:, 1] - source.likeness.floor) / np.maximum(rest_of[:, 2], 1e-9)
        return cls(errors, sigmas, rest_of[:, 0], float(left_over.max()))

    def calibration(self, source: ResponseReadout) -> Calibration:
        """Stated uncertainties that nine of ten held-out presses fall within; with few presses rather more do."""
        old = source.calibration
        place = np.hypot(old.place_floor_mm, np.repeat(self.sigmas[:, 0], 2))
        force = np.hypot(old.force_floor_n, self.sigmas[:, 1])
        return replace(
            old,
            place_factors=(cautious(np.abs(self.errors[:, :2]).reshape(-1) / place, len(self.errors)) / NORMAL_90,),
            force_factors=(cautious(np.abs(self.errors[:, 2]) / force, len(self.errors)) / NORMAL_90,),
            misfit_limit=max(old.misfit_limit, math.sqrt(float(self.misfits.max()))),
        )


def cautious(ratios: Float[np.ndarray, ' n'], presses: int) -> float:
    """What 90 % of further ratios stay below: with 10 presses the largest, with 100 the level 0.91 of them."""
    level = min(1.0, COVERAGE * (1 + 1 / presses))
    return float(np.quantile(ratios, level if presses > 1 / (1 - COVERAGE) else 1.0, method='higher'))


def _errors(
    readout: ResponseReadout, dataset: Dataset, rows: np.ndarray
) -> tuple[Float[np.ndarray, 'n 3'], Float[np.ndarray, 'n 2'], Float[np.ndarray, 'n 3']]:
    """Errors of x, y (mm) and force (N), stated deviations, and misfit, left over and size, of readable presses."""
    errors, sigmas, rest = [], [], []
    for row in rows.tolist():
        seen = readout.seen(dataset.features[row].astype(np.float32), dataset.confidence[dataset.rest[row]])
        if not np.isfinite(seen.scores).all():
            continue
        fit = readout.fit(readout.whitening @ seen.scores)
        contact, (x, y, _, force_n) = readout.contacts(fit)[0], dataset.presses[row].tolist()
        errors.append((contact.x_mm - x, contact.y_mm - y, contact.force_n - force_n))
        sigmas.append((contact.sigma_mm, contact.sigma_n))
        rest.append((fit.misfit, seen.left_over, seen.size))
    return np.reshape(errors, (-1, 3)), np.reshape(sigmas, (-1, 2)), np.reshape(rest, (-1, 3))


def _require_better(before: Errors, after: Errors) -> None:
    """On balance of places and forces, by medians: of few presses one alone rules a mean."""
    ratio = after.force_median_n * after.place_median_mm / (before.force_median_n * before.place_median_mm)
    if ratio >= 1:
        raise DatasetError(
            f'the calibration would not pay: held-out presses are read {after.force_median_n:.4f} N and '
            f'{after.place_median_mm:.3f} mm off with it, {before.force_median_n:.4f} N and '
            f'{before.place_median_mm:.3f} mm without (medians); keep the model, or press at more places'
        )
