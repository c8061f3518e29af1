"""Measure a gel's response: from presses to the splines that `tactile_nodes.sensing.explain.measured.response` inverts.

The fit is linear algebra: principal components of the features, one regression on cubic splines (P-splines: Eilers
and Marx, Statistical Science 11, 1996), and the covariance of the residuals. So it takes seconds, and the same
presses give the same readout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.sparse

from tactile_nodes.errors import ConfigurationError, DatasetError, TooFewPressesError
from tactile_nodes.learning.config import ResponseConfig, TipsConfig
from tactile_nodes.learning.datasets.simulated import Dataset
from tactile_nodes.learning.measured.calibration import calibrated, most_shift_gain, rescaled
from tactile_nodes.learning.progress import Progress
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout, project
from tactile_nodes.sensing.explain.measured.response import Response
from tactile_nodes.sensing.explain.network import InputScaling
from tactile_nodes.sensing.explain.splines import SplineAxis
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Bool, Float, Float32

LEAST_UNTOUCHED = 12
MORE_UNTOUCHED = (
    'take more of the untouched gel: into the table, or from the same bags (tactile dataset build … '
    '--without-contact 0.2)'
)


def require_enough(aim: str, untouched: int, presses: int, least_presses: int, or_else: str = '') -> None:
    """Raise an error if there are too few samples for `aim`. `or_else` names another remedy if presses are missing.

    Raises:
        TooFewPressesError: names what is missing and how many.
    """
    lacking = [
        (LEAST_UNTOUCHED - untouched, 'images of the untouched gel'),
        (least_presses - presses, 'presses'),
    ]  # fmt: skip
    missing = ' and '.join(f'{count} {name}' for count, name in lacking if count > 0)
    if missing:
        mends = [
            'record more (if simulated: --presses)',
            or_else if presses < least_presses else '',
            MORE_UNTOUCHED if untouched < LEAST_UNTOUCHED else '',
        ]
        raise TooFewPressesError(
            f'{aim} needs at least {LEAST_UNTOUCHED} images of the untouched gel and {least_presses} presses to train '
            f'on, but without the test set there are {untouched} and {presses}: {missing} are missing; '
            + ', or '.join(filter(None, mends))
        )


UNTOUCHED_WEIGHT = 10.0
CALIBRATION_SHARE = 0.15
LEAST_VARIANCE = 1e-6
"""Least variance of noise, in units of that of a feature."""
LEAST_REACH_MM = 0.1
SAMPLES_AT_ONCE = 1000


def fit_response(
    dataset: Dataset, held_out: np.ndarray, config: ResponseConfig, bins: BinGrid, progress: Progress
) -> ResponseReadout:
    """The readout of a data set.

    Smoothing and stated uncertainty are chosen on presses at positions that the fit did not see. The final fit then
    uses all samples except `held_out` (a boolean for each sample).

    Raises:
        ConfigurationError: the weights of the penalty cannot be used.
        DatasetError: too few presses or images of the untouched gel, or presses from which no response follows.
    """
    if not config.smoothing or min(config.smoothing) < 0:
        raise ConfigurationError('response.smoothing must list weights to try, none below zero, such as [0.001, 0.1]')
    used = np.flatnonzero(~held_out)
    subspace = Subspace.of(dataset, used, config)
    inner = inner_held_out(dataset, used, config.seed)
    first, rest = used[~inner], used[inner]
    if not (subspace.touched[first].any() and subspace.touched[rest].any()):
        raise DatasetError('a response needs presses at many places, so that some can be held out for validation')
    steps = len(config.smoothing) + 2
    with progress.bar('measuring the response', steps) as bar:
        normal = subspace.normal(first)
        tried = []
        for smoothing in config.smoothing:
            coefficients = normal.solve(smoothing)
            tried.append((subspace.misfit(rest, coefficients), smoothing, coefficients))
            bar.advance(1, f'smoothing {smoothing:g}: misfit {tried[-1][0]:.4g}')
        _, smoothing, coefficients = min(tried, key=lambda each: each[:2])
        calibration, likeness = calibrated(subspace.readout(first, coefficients, bins), dataset, rest)
        bar.advance(1, f'smoothing {smoothing:g}; uncertainty from {len(rest)} samples')
        final = subspace.readout(used, subspace.normal(used).solve(smoothing), bins)
        final = replace(final, calibration=calibration, likeness=likeness, most_contacts=config.most_contacts)
        final = replace(final, calibration=rescaled(final, dataset, at_new_places(dataset, held_out)))
        final = replace(final, most_shift_gain=most_shift_gain(final, dataset, held_out))
        bar.advance(1)
    return final


def at_new_places(dataset: Dataset, held_out: np.ndarray) -> np.ndarray:
    """Held-out samples at positions where no other sample is."""
    known = {(x, y) for x, y in dataset.presses[~held_out, :2].tolist()}
    return np.array([i for i in np.flatnonzero(held_out) if tuple(dataset.presses[i, :2].tolist()) not in known], int)


def inner_held_out(dataset: Dataset, used: np.ndarray, seed: int) -> np.ndarray:
    """The used samples to hold out: whole positions, so that interpolation between positions is judged too.

    Images of the untouched gel have no position, so they are drawn one by one.
    """
    keys = np.column_stack([dataset.presses[used, :2], np.zeros(len(used))])
    still = dataset.presses[used, 2] <= 0
    keys[still] = np.column_stack([np.zeros((still.sum(), 2)), np.arange(1, still.sum() + 1)])
    _, position = np.unique(keys, axis=0, return_inverse=True)
    position = position.reshape(-1)
    numbers = np.random.default_rng(seed).permutation(position.max() + 1)
    chosen: np.ndarray = numbers[position] < max(1, round(CALIBRATION_SHARE * len(numbers)))
    return chosen


@dataclass(frozen=True)
class Subspace:
    """Scaled features as principal components, and the contacts that they belong to."""

    scaling: InputScaling
    directions: Float32[np.ndarray, 'components inputs']
    components: Float[np.ndarray, 'samples components']
    places: Float[np.ndarray, 'samples 3']
    touched: np.ndarray
    axes: tuple[SplineAxis, SplineAxis, SplineAxis]

    @classmethod
    def of(cls, dataset: Dataset, used: np.ndarray, config: ResponseConfig) -> Subspace:
        touched = dataset.presses[:, 2] > 0
        untouched = used[~touched[used]]
        require_enough(
            f'a response of {config.components} components', len(untouched), int(touched[used].sum()),
            config.components, 'lower response.components',
        )  # fmt: skip
        scaling = noise_scaling(dataset, untouched, config)
        inputs, _ = scaled(dataset, scaling)
        square = gram(inputs, used)
        first = square.shape[0] - config.components
        _, vectors = scipy.linalg.eigh(square, subset_by_index=[max(first, 0), square.shape[0] - 1])
        directions = np.ascontiguousarray(vectors[:, ::-1].T, np.float32)
        places = _places(dataset)
        axes = _axes(places[used][touched[used]], config)
        return cls(scaling, directions, scores_of(dataset, scaling, directions), places, touched, axes)

    def normal(self, chosen: np.ndarray) -> _Normal:
        """The regression of some samples, before smoothing."""
        chosen = chosen[self.touched[chosen]]
        design = sparse_cubes(self.axes, self.places[chosen])
        still = sparse_cubes(self.axes, _floor_of(self.axes))
        square = (design.T @ design + UNTOUCHED_WEIGHT * (still.T @ still)).toarray()
        return _Normal(square, design.T @ self.components[chosen], curvature([axis.count for axis in self.axes]))

    def misfit(self, chosen: np.ndarray, coefficients: np.ndarray) -> float:
        """RMS of the residuals with these coefficients."""
        return float(np.sqrt(np.mean(self._left(chosen, coefficients) ** 2)))

    def readout(self, chosen: np.ndarray, coefficients: np.ndarray, bins: BinGrid) -> ResponseReadout:
        """The readout of some samples, with uncertainties as the fit states them."""
        whitening, growth = self._whitening(chosen, coefficients)
        shape = (*(axis.count for axis in self.axes), len(whitening))
        table = np.asarray((coefficients @ whitening.T).reshape(shape), np.float32)
        response = Response(*self.axes, table, growth)
        inputs = self.directions.shape[1]
        likeness = Likeness(np.zeros(inputs, np.float32), self.directions, 1.0, 1.0)
        return ResponseReadout(self.scaling, likeness, whitening, response, bins)

    def _left(self, chosen: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        chosen = chosen[self.touched[chosen]]
        left: np.ndarray = self.components[chosen] - sparse_cubes(self.axes, self.places[chosen]) @ coefficients
        return left

    def _whitening(self, chosen: np.ndarray, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Components in which the noise at rest is 1 and the splines' errors are independent, growing with s²."""
        values, vectors = np.linalg.eigh(steady_covariance(self.components[chosen[~self.touched[chosen]]]))
        rough = (vectors / np.sqrt(np.maximum(values, max(1e-3 * float(np.median(values)), LEAST_VARIANCE)))).T
        left = self._left(chosen, coefficients) @ rough.T
        height = (self.places[chosen[self.touched[chosen]], 2] / self.axes[2].high) ** 2
        missed = (left.T @ left - len(left) * np.eye(len(rough))) / height.sum()
        growth, turned = np.linalg.eigh(missed)
        return np.asarray(turned.T @ rough, np.float32), np.asarray(np.maximum(growth, 0.0), np.float32)


@dataclass(frozen=True)
class _Normal:
    """Normal equations of the splines' coefficients, and the penalties added to them."""

    square: Float[np.ndarray, 'n n']
    right: Float[np.ndarray, 'n components']
    curvature: Float[np.ndarray, 'n n']

    def solve(self, smoothing: float) -> Float[np.ndarray, 'n components']:
        """Coefficients: least squares, smooth, and zero where there is no force."""
        system = self.square + smoothing * self.curvature
        system[np.diag_indices_from(system)] += 1e-9 * np.trace(system) / len(system)
        solved: np.ndarray = scipy.linalg.solve(system, self.right, assume_a='pos', overwrite_a=True)
        return solved


def steady_covariance(samples: Float[np.ndarray, 'n components']) -> Float[np.ndarray, 'components components']:
    """Covariance with off-diagonals shrunk by components / (components + n), since few samples estimate it badly.

    Of 40 samples of 40 components half of it is left; without shrinkage their covariance has no inverse.
    """
    count, components = samples.shape
    found = np.cov(samples.T)
    shrunk: np.ndarray = found + components / (components + count) * (np.diag(np.diag(found)) - found)
    return shrunk


def noise_scaling(dataset: Dataset, untouched: np.ndarray, config: TipsConfig) -> InputScaling:
    """Features minus their mean over the untouched gel, in units of their noise there, which is at least the median.

    Regions without markers are silenced.
    """
    trusted = dataset.trusted(config.trusted_floor)
    if not trusted.any():
        raise DatasetError('a response needs regions with markers in them, and the data set has none; check the camera')
    return InputScaling(*rest_and_gain(dataset, untouched, trusted), trusted, config.confidence_floor)


def rest_and_gain(
    dataset: Dataset, untouched: np.ndarray, trusted: Float32[np.ndarray, 'rows cols']
) -> tuple[Float32[np.ndarray, 'rows cols channels'], Float32[np.ndarray, 'rows cols channels']]:
    """The mean of the untouched gel's features, and the inverse of their noise, which is at least the median."""
    values = dataset.features[untouched].astype(np.float32)
    noise = values.std(axis=0)
    least = float(np.median(noise[trusted > 0])) if trusted.any() else 1.0
    return values.mean(axis=0), np.asarray(1 / np.maximum(noise, max(least, 1e-6)), np.float32)


def scaled(
    dataset: Dataset, scaling: InputScaling
) -> tuple[Float32[np.ndarray, 'samples inputs'], Bool[np.ndarray, 'samples inputs']]:
    """All samples as the readout scales them, and which of their inputs are missing (and zero)."""
    confidence = dataset.confidence[dataset.rest]
    used = scaling.trusted * (confidence >= scaling.confidence_floor)
    inputs = (dataset.features.astype(np.float32) - scaling.mean) * scaling.gain * used[..., None]
    missing = np.repeat(scaling.missing(confidence)[..., None], inputs.shape[-1], axis=-1)
    return inputs.reshape(len(inputs), -1), missing.reshape(len(inputs), -1)


def scores_of(
    dataset: Dataset, scaling: InputScaling, directions: Float32[np.ndarray, 'components inputs']
) -> Float[np.ndarray, 'samples components']:
    """The scores of all samples along some directions."""
    found = [project(directions, *each).scores for each in zip(*scaled(dataset, scaling), strict=True)]
    return np.stack(found).astype(float)


def gram(inputs: Float32[np.ndarray, 'samples inputs'], used: np.ndarray) -> Float[np.ndarray, 'inputs inputs']:
    """Sums of products over some samples, in double precision.

    In single precision, rounding decides directions of nearly equal variance, so results would depend on the processor.
    """
    parts = np.array_split(used, max(1, math.ceil(len(used) / SAMPLES_AT_ONCE)))
    return sum((part.T @ part for part in (inputs[each].astype(float) for each in parts)), np.zeros(()))


def _places(dataset: Dataset) -> Float[np.ndarray, 'samples 3']:
    """x, y and force of each sample; the force is 0 without contact."""
    force = np.maximum(dataset.presses[:, 3].astype(float), 0.0)
    places = np.column_stack([dataset.presses[:, :2].astype(float), force])
    places[dataset.presses[:, 2] <= 0, 2] = 0.0
    return places


def sparse_cubes(axes: tuple[SplineAxis, ...], places: Float[np.ndarray, 'n 3']) -> scipy.sparse.csr_array:
    """As `tactile_nodes.sensing.explain.splines.cubes`, with 64 nonzeros a row."""
    many = len(places)
    columns, values = np.zeros((many, 1), int), np.ones((many, 1))
    for axis, along in zip(axes, places.T, strict=True):
        near = axis.weights_of(along)[0][:, None] + np.arange(4)
        weights = np.take_along_axis(axis.design(along), near, axis=1)
        columns = (columns[:, :, None] * axis.count + near[:, None, :]).reshape(many, -1)
        values = (values[:, :, None] * weights[:, None, :]).reshape(many, -1)
    starts = np.arange(many + 1) * values.shape[1]
    shape = (many, math.prod(axis.count for axis in axes))
    return scipy.sparse.csr_array((values.ravel(), columns.ravel(), starts), shape=shape)


def _axes(touched: Float[np.ndarray, 'n 3'], config: ResponseConfig) -> tuple[SplineAxis, SplineAxis, SplineAxis]:
    reach = np.abs(touched[:, :2]).max(axis=0)
    if not (reach.min() >= LEAST_REACH_MM and touched[:, 2].max() > 0):
        raise DatasetError('a response needs presses with a force and at different places along x and along y')
    x, y = (SplineAxis(-far, far, max(1, round(2 * far / config.spacing_mm))) for far in reach.tolist())
    return x, y, SplineAxis(0.0, float(touched[:, 2].max()), config.levels)


def _floor_of(axes: tuple[SplineAxis, ...]) -> Float[np.ndarray, 'n 3']:
    """A dense grid of places without force, all over the surface."""
    x, y = (np.linspace(axis.low, axis.high, 2 * axis.intervals + 1) for axis in axes[:2])
    return np.stack(np.meshgrid(x, y, [0.0], indexing='ij'), axis=-1).reshape(-1, 3)


def curvature(counts: Sequence[int]) -> Float[np.ndarray, 'n n']:
    """Sum of the squared second differences of coefficients along each axis, as a quadratic form; see P-splines above.

    `counts` is the number of coefficients along each axis.
    """
    total = np.zeros(1)
    for axis in range(len(counts)):
        parts = [np.eye(count) for count in counts]
        difference = np.diff(parts[axis], n=2, axis=0)
        parts[axis] = difference.T @ difference
        quadratic: np.ndarray = np.ones((1, 1))
        for part in parts:
            quadratic = np.kron(quadratic, part)
        total = total + quadratic
    return total
