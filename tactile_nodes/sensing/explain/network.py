"""The paper's readout: fully connected layers from features to one force per bin, in NumPy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.explain.likeness import Likeness
from tactile_nodes.sensing.explain.reading import UNKNOWN, Contact, Reading, Readout
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Bool, Float16, Float32


def logistic(values: Float32[np.ndarray, '*shape']) -> Float32[np.ndarray, '*shape']:
    """1 / (1 + exp(-x)), written with tanh because that cannot overflow: 0.5 at 0, 0.7311 at 1."""
    half = np.float32(0.5)
    activation: np.ndarray = half * np.tanh(half * values) + half
    return activation


def rectified(values: Float32[np.ndarray, '*shape']) -> Float32[np.ndarray, '*shape']:
    """The larger of x and 0."""
    activation: np.ndarray = np.maximum(values, np.float32(0))
    return activation


ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {'logistic': logistic, 'relu': rectified}


@dataclass(frozen=True)
class Mlp:
    """Fully connected layers; hidden units logistic (the paper's) or rectified, outputs linear.

    `weights[i]` is (outputs, inputs), as in torch. The result for one input vector depends only on that vector and the
    weights: each output is one dot product, independent of the number of threads, except with numpy before 2.
    """

    weights: tuple[Float32[np.ndarray, '_ _'], ...]
    biases: tuple[Float32[np.ndarray, ' _'], ...]
    hidden: str = 'logistic'

    @property
    def sizes(self) -> tuple[int, ...]:
        """Units per layer, inputs first: (3200, 800, 400, 400, 81) for the paper's."""
        return (self.weights[0].shape[1], *(len(bias) for bias in self.biases))

    def __call__(self, inputs: Float32[np.ndarray, ' inputs']) -> Float32[np.ndarray, ' outputs']:
        activation = ACTIVATIONS[self.hidden]
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            inputs = activation(weight @ inputs + bias)
        outputs: np.ndarray = self.weights[-1] @ inputs + self.biases[-1]
        return outputs


@dataclass(frozen=True)
class CalibrationLayer:
    """The paper's layer for another gel, in front of a network that was trained on the first (section V).

    One rectified unit per feature, applied to the measured features before any scaling: max(0, W v + b). With W the
    identity and b zero it leaves non-negative features bit-identical, such as a magnitude and an angle in [0, 2 pi).
    Motion along x and y can be negative.
    """

    weight: Float32[np.ndarray, 'features features']
    bias: Float32[np.ndarray, ' features']

    @classmethod
    def of_change(
        cls, change: Float16[np.ndarray, 'features features'], bias: Float32[np.ndarray, ' features']
    ) -> CalibrationLayer:
        """A layer whose weights are the identity plus a change; without a change it has no effect."""
        return cls(np.eye(len(bias), dtype=np.float32) + change.astype(np.float32), bias)

    @property
    def change(self) -> Float16[np.ndarray, 'features features']:
        """The difference of the weights from the identity. It is small, so that 16-bit floats are precise enough."""
        added: np.ndarray = (self.weight - np.eye(len(self.bias), dtype=np.float32)).astype(np.float16)
        return added

    def __call__(self, values: Float32[np.ndarray, 'rows cols channels']) -> Float32[np.ndarray, 'rows cols channels']:
        adjusted: np.ndarray = rectified(self.weight @ values.reshape(-1) + self.bias).reshape(values.shape)
        return adjusted


@dataclass(frozen=True)
class InputScaling:
    """Scaling of features to network inputs: subtract, multiply, and set regions without markers to zero.

    A region is used if it showed markers in training (`trusted`) and shows them in the present rest image (its
    confidence reaches `confidence_floor`). Elsewhere flow is noise of whole pixels, and the input is 0.
    """

    mean: Float32[np.ndarray, 'rows cols channels']
    gain: Float32[np.ndarray, 'rows cols channels']
    trusted: Float32[np.ndarray, 'rows cols']
    confidence_floor: float = 0.5

    def missing(self, confidence: Float32[np.ndarray, '*batch rows cols']) -> Bool[np.ndarray, '*batch rows cols']:
        """The regions that showed markers in training but cannot be tracked now."""
        lost: np.ndarray = (self.trusted > 0) & (confidence < self.confidence_floor)
        return lost

    def known(self, confidence: Float32[np.ndarray, '*batch rows cols']) -> Bool[np.ndarray, '*batch rows cols']:
        """The regions that showed markers in training and can be tracked now."""
        found: np.ndarray = (self.trusted > 0) & (confidence >= self.confidence_floor)
        return found

    def __call__(
        self, values: Float32[np.ndarray, '*batch rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Float32[np.ndarray, '*batch rows cols channels']:
        used = self.trusted * (confidence >= self.confidence_floor)
        scaled: np.ndarray = (values - self.mean) * self.gain * used[..., None]
        return scaled


CONTRADICTED_SIGMAS = math.sqrt(3.0)
"""A force of the novelty check this many standard deviations from the network's contradicts it: with the difference
added, the uncertainty is twice what the network states."""

TINY_N = 1e-9


@dataclass(frozen=True)
class TotalSpread:
    """Uncertainty of the total force: the standard deviation for a total of F is hypot(floor, share F)."""

    floor_n: float = UNKNOWN
    share: float = UNKNOWN

    def sigma_n(self, total_n: float) -> float:
        return float(np.hypot(self.floor_n, self.share * total_n))


@dataclass(frozen=True)
class NetworkReadout:
    """Scaled features through a network to forces in units of `output_scale_n`, one per bin, row-major.

    A network for another gel than its own has a calibration layer before the scaling. Its one contact is the
    force-weighted mean of the strongest bin and its neighbours. With the paper's labels (all force in the bin of the
    indentation's centre) it shows the bin of the contact and little more: expect an error of about a millimetre, which
    it does not state (`sigma_mm` is NaN).

    A `novelty_check` reads the same features. A frame counts as unlike the training if the check says so or contradicts
    the force.
    """

    scaling: InputScaling
    network: Mlp
    bins: BinGrid
    output_scale_n: float = 1.0
    spread: TotalSpread = TotalSpread()
    likeness: Likeness | None = None
    layer: CalibrationLayer | None = None
    novelty_check: Readout | None = None

    kind = 'network'

    @property
    def parameter_count(self) -> int:
        """Weights and biases: 3 074 081 for the paper's network, 10 243 200 for its calibration layer."""
        added = (self.layer.weight, self.layer.bias) if self.layer else ()
        return sum(each.size for each in (*self.network.weights, *self.network.biases, *added))

    def require_fit(self, features: int, bins: BinGrid) -> None:
        sizes = self.network.sizes
        if sizes[0] != features or sizes[-1] != bins.count:
            raise ModelError(
                f'a network of {sizes[0]} inputs and {sizes[-1]} outputs does not fit {features} features and '
                f'{bins.count} bins; train it again or use another model file'
            )
        if self.novelty_check is not None:
            self.novelty_check.require_fit(features, bins)

    def nominal_n(self, total_n: float) -> float:
        """The model's stated uncertainty of such a force."""
        return self.spread.sigma_n(total_n)

    def inputs(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Float32[np.ndarray, ' inputs']:
        """The network's inputs for one frame; all NaN if a feature is not finite."""
        if not np.isfinite(values).all():  # saturated units would give a finite force
            return np.full(values.size, np.nan, np.float32)
        adjusted = self.layer(values) if self.layer else values
        inputs: np.ndarray = self.scaling(adjusted, confidence).reshape(-1)
        return inputs

    def read(
        self, values: Float32[np.ndarray, 'rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Reading:
        inputs = self.inputs(values, confidence)
        forces = (self.network(inputs) * np.float32(self.output_scale_n)).reshape(self.bins.rows, self.bins.cols)
        total_n = float(forces.sum(dtype=np.float64))
        sigma_n = self.spread.sigma_n(total_n)
        contact = Contact(*contact_position_mm(forces, self.bins.centres_mm), total_n, UNKNOWN, sigma_n)
        unlike = self._left_over(inputs)
        if self.novelty_check is not None and math.isfinite(total_n):
            checked = self.novelty_check.read(values, confidence)
            apart = abs(total_n - checked.contacts[0].force_n) / max(CONTRADICTED_SIGMAS * sigma_n, TINY_N)
            unlike = _largest(unlike, checked.unlikeness, apart)
        return Reading(forces, (contact,), sigma_n, unlike)

    def _left_over(self, inputs: Float32[np.ndarray, ' inputs']) -> float:
        return self.likeness.unlikeness(inputs) if self.likeness is not None else UNKNOWN


def _largest(*unlike: float) -> float:
    """The largest known value; NaN if none is known."""
    return max((each for each in unlike if not math.isnan(each)), default=UNKNOWN)


def contact_position_mm(forces_n: Float32[np.ndarray, 'rows cols'], centres_mm: np.ndarray) -> tuple[float, float]:
    """Force-weighted mean of the centres of the strongest bin and its (up to eight) neighbours.

    Negative forces count as zero. Equal forces in two neighbouring bins give the middle of their border. A map without
    any positive force gives the centre of its strongest bin.
    """
    row, col = np.unravel_index(int(forces_n.argmax()), forces_n.shape)
    window = np.s_[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]
    weights = np.maximum(forces_n[window], 0).astype(np.float64)
    if not weights.sum() > 0:
        return float(centres_mm[row, col, 0]), float(centres_mm[row, col, 1])
    x, y = (weights[..., None] * centres_mm[window]).sum(axis=(0, 1)) / weights.sum()
    return float(x), float(y)
