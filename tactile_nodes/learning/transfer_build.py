"""From a warp of a source's response to a readout of the new gel, which is a model like any other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from jaxtyping import Float

from tactile_nodes.learning.dataset import Dataset
from tactile_nodes.learning.response_fit import LEAST_UNTOUCHED, scaled, steady_covariance
from tactile_nodes.learning.transfer_warp import Pairs, SourceField, Warp
from tactile_nodes.sensing.likeness import Likeness
from tactile_nodes.sensing.network import InputScaling
from tactile_nodes.sensing.response import Calibration, Response, ResponseReadout
from tactile_nodes.sensing.splines import SplineAxis

REACHES_MM = (1.5, 2.5, 4.0, 8.0)
DOUBTS = (0.3, 1.0, 3.0)
"""Of a correction: how far around a press it reaches, and the variance that it does not believe."""
SITES_AT_ONCE = 60
MARGIN = 1.1
LEAST_HEIGHT = 0.05
"""Of the hardest press: what corrections of lighter ones are divided by."""


@dataclass(frozen=True)
class Samples:
    """Presses on the new gel as pairs, the scaling of its features, and its scaled features while nothing touches."""

    scaling: InputScaling
    pairs: Pairs
    rows: np.ndarray
    untouched: Float[np.ndarray, 'frames inputs']

    @classmethod
    def of(cls, source: ResponseReadout, dataset: Dataset, gain: np.ndarray) -> Samples:
        """In the source's units of noise, about the new gel's own mean at rest."""
        touched = dataset.presses[:, 2] > 0
        trusted = np.asarray(source.scaling.trusted * dataset.trusted(0.5), np.float32)
        mean = source.scaling.mean
        if (~touched).sum() >= LEAST_UNTOUCHED:
            mean = np.asarray(dataset.features[~touched].astype(np.float32).mean(axis=0), np.float32)
        scaling = replace(source.scaling, mean=mean, trusted=trusted)
        inputs, missing = scaled(dataset, scaling)
        rows = np.flatnonzero(touched)
        motion = (dataset.features[rows].astype(float) - mean).reshape(len(rows), -1, 2)
        seen = trusted.reshape(-1) * ~missing.reshape(len(inputs), -1, 2)[rows, :, 0]
        presses = dataset.presses[rows][:, [0, 1, 3]].astype(float)
        return cls(scaling, Pairs.of(presses, motion, seen, gain), rows, inputs[~touched].astype(float))


@dataclass(frozen=True)
class Correction:
    """What a warp leaves over, spread around the presses that showed it (kernel ridge regression).

    In units of noise and of the press's height, s over the largest s.
    """

    presses: Float[np.ndarray, 'n 2']
    weights: Float[np.ndarray, 'n inputs']
    reach_mm: float

    def at(self, places: Float[np.ndarray, 'm 2']) -> Float[np.ndarray, 'm inputs']:
        """The correction of a press of full height."""
        found: np.ndarray = _kernel(places, self.presses, self.reach_mm) @ self.weights
        return found

    @classmethod
    def fit(cls, presses: np.ndarray, left: Float[np.ndarray, 'n inputs'], heights: np.ndarray) -> Correction:
        """With the reach and the doubt under which each press is foretold best by the others."""
        relative = left / heights[:, None]
        tried = []
        for reach in REACHES_MM:
            for doubt in DOUBTS:
                inverse = np.linalg.inv(_kernel(presses, presses, reach) + doubt * np.eye(len(presses)))
                weights = inverse @ relative
                foretold = weights / np.diag(inverse)[:, None] * heights[:, None]
                tried.append((float((foretold**2).sum()), reach, doubt, weights))
        error, reach, _, weights = min(tried, key=lambda each: each[:3])
        worth = error < float((left**2).sum())
        return cls(presses, weights if worth else np.zeros_like(weights), reach)


def _kernel(a: np.ndarray, b: np.ndarray, reach_mm: float) -> np.ndarray:
    squared = ((a[:, None] - b[None]) ** 2).sum(axis=-1)
    kernel: np.ndarray = np.exp(-squared / (2 * reach_mm**2))
    return kernel


@dataclass(frozen=True)
class Told:
    """The new gel's response as a function of place and force: a warp, and perhaps a correction of it."""

    field: SourceField
    warp: Warp
    hardest_n: float
    correction: Correction | None = None

    def heights(self, presses: Float[np.ndarray, 'n 3']) -> np.ndarray:
        """s over the largest s."""
        height = (np.maximum(presses[:, 2], 0.0) / self.hardest_n) ** self.field.power
        return np.asarray(np.maximum(height, LEAST_HEIGHT))

    def motion(self, presses: Float[np.ndarray, 'n 3']) -> Float[np.ndarray, 'n regions 2']:
        """Motion of the regions (px) under presses."""
        told = self.warp.predict(self.field, presses)
        if self.correction is None:
            return told
        gain = np.where(self.field.gain > 0, self.field.gain, 1.0)
        height = (np.maximum(presses[:, 2], 0.0) / self.hardest_n) ** self.field.power
        more = self.correction.at(presses[:, :2]).reshape(told.shape)
        result: np.ndarray = told + more / gain * height[:, None, None]
        return result

    def left(self, pairs: Pairs) -> Float[np.ndarray, 'n inputs']:
        """What presses show beyond it, in units of noise; 0 where nothing is known."""
        known = self.field.gain * (pairs.weight > 0)
        left: np.ndarray = (pairs.motion - self.motion(pairs.presses)) * known
        return left.reshape(len(pairs), -1)

    def corrected(self, pairs: Pairs) -> Told:
        """With the correction that presses support."""
        heights = self.heights(pairs.presses)
        return replace(self, correction=Correction.fit(pairs.presses[:, :2], self.left(pairs), heights))


def hardest_force(field: SourceField, warp: Warp, pairs: Pairs) -> float:
    """The force (N) that the readout ends at: a little more than both the source and the presses know."""
    known = field.axes[2].high ** (1 / field.power) / warp.gain
    return MARGIN * max(float(known), float(pairs.presses[:, 2].max()))


def build(
    told: Told, source: ResponseReadout, samples: Samples, left: Float[np.ndarray, 'n inputs'], heights: np.ndarray
) -> ResponseReadout:
    """The readout that inverts a told response; `left` is what presses that it was not fitted to left over."""
    old = source.response
    axes = old.x, old.y, SplineAxis(0.0, told.hardest_n**old.power, old.s.intervals)
    sites, fields = _at_sites(told, axes)
    fields *= np.repeat(samples.scaling.trusted.reshape(-1), 2)
    components = len(source.whitening)
    square = fields.T @ fields
    _, vectors = scipy.linalg.eigh(square, subset_by_index=[len(square) - components, len(square) - 1])
    directions = np.ascontiguousarray(vectors[:, ::-1].T, np.float32)
    whitening, growth = _whitening(directions.astype(float), samples.untouched, left, heights)
    shape = (*(axis.count for axis in axes), components)
    table = _interpolating(axes, sites, (fields @ directions.T @ whitening.T).reshape(shape))
    response = Response(*axes, np.asarray(table, np.float32), growth, old.power)
    likeness = Likeness(
        np.zeros(directions.shape[1], np.float32), directions, source.likeness.floor, source.likeness.share
    )
    return ResponseReadout(
        samples.scaling, likeness, whitening, response, source.bins, Calibration(), source.most_contacts
    )


def _at_sites(told: Told, axes: tuple[SplineAxis, ...]) -> tuple[list[np.ndarray], Float[np.ndarray, 'sites inputs']]:
    """As many even steps along each axis as it has splines, and the fields (units of noise) there."""
    sites = [np.linspace(axis.low, axis.high, axis.count) for axis in axes]
    places = np.stack(np.meshgrid(*sites, indexing='ij'), axis=-1).reshape(-1, 3)
    places[:, 2] **= 1 / told.field.power
    parts = np.array_split(places, max(1, len(places) // SITES_AT_ONCE))
    fields = np.concatenate([told.motion(part) for part in parts]) * told.field.gain
    return sites, fields.reshape(len(places), -1)


def _interpolating(axes: tuple[SplineAxis, ...], sites: list[np.ndarray], values: np.ndarray) -> np.ndarray:
    """Coefficients of the splines that go through values at sites."""
    for number, (axis, along) in enumerate(zip(axes, sites, strict=True)):
        turned = np.moveaxis(values, number, 0)
        solved = np.linalg.solve(axis.design(along), turned.reshape(axis.count, -1))
        values = np.moveaxis(solved.reshape(turned.shape), 0, number)
    return values


def _whitening(
    directions: np.ndarray, untouched: np.ndarray, left: np.ndarray, heights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """As in the fit of a response: noise of 1 at rest, and independent misses whose variance grows with s²."""
    count = len(directions)
    noise = np.eye(count)
    if len(untouched) >= LEAST_UNTOUCHED:
        known = len(untouched) / (len(untouched) + count)
        noise = known * steady_covariance(untouched @ directions.T) + (1 - known) * noise
    values, vectors = np.linalg.eigh(noise)
    rough = (vectors / np.sqrt(np.maximum(values, 1e-3))).T
    missed = left @ directions.T @ rough.T / heights[:, None]
    square = missed.T @ missed / len(missed)
    shrunk = square + count / (count + len(missed)) * (np.diag(np.diag(square)) - square)
    growth, turned = np.linalg.eigh(shrunk)
    return np.asarray(turned.T @ rough, np.float32), np.asarray(np.maximum(growth, 0.0), np.float32)
