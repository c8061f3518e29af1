"""Features in, force distribution out: the network in numpy, and what it was made for.

Weights live in a file (`tactile_nodes.model_file`), training in `tactile_nodes.learning`; this is arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float32

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid


@dataclass(frozen=True)
class FeatureLayout:
    """The features that a network was trained on."""

    encoding: str = 'polar_mean'
    rows: int = 40
    cols: int = 40
    channels: int = 2

    @property
    def count(self) -> int:
        """3200 for the paper's 40x40 regions of magnitude and angle."""
        return self.rows * self.cols * self.channels

    def __str__(self) -> str:
        return f'{self.rows}x{self.cols} regions of {self.encoding} with {self.channels} channels'


@dataclass(frozen=True)
class Mlp:
    """Fully connected layers; hidden units logistic, outputs plain (the paper's network).

    `weights[i]` is (outputs, inputs), as torch stores it. The result for one input vector depends on nothing
    but that vector and the weights: each output is one dot product, whatever the number of threads.
    """

    weights: tuple[Float32[np.ndarray, '_ _'], ...]
    biases: tuple[Float32[np.ndarray, ' _'], ...]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Units per layer, inputs first: (3200, 800, 400, 400, 81) for the paper's."""
        return (self.weights[0].shape[1], *(len(bias) for bias in self.biases))

    def __call__(self, inputs: Float32[np.ndarray, ' inputs']) -> Float32[np.ndarray, ' outputs']:
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            inputs = logistic(weight @ inputs + bias)
        outputs: np.ndarray = self.weights[-1] @ inputs + self.biases[-1]
        return outputs


def logistic(values: Float32[np.ndarray, '*shape']) -> Float32[np.ndarray, '*shape']:
    """1 / (1 + exp(-x)), written with tanh because that cannot overflow: 0.5 at 0, 0.7311 at 1."""
    half = np.float32(0.5)
    activation: np.ndarray = half * np.tanh(half * values) + half
    return activation


@dataclass(frozen=True)
class InputScaling:
    """How features become network inputs: subtract, multiply, and silence the regions without markers.

    A region counts where it held markers in training (`trusted`) and holds them in the present rest image
    (its confidence reaches `confidence_floor`); elsewhere flow is noise of whole pixels, and the input is 0.
    """

    mean: Float32[np.ndarray, 'rows cols channels']
    gain: Float32[np.ndarray, 'rows cols channels']
    trusted: Float32[np.ndarray, 'rows cols']
    confidence_floor: float = 0.5

    def __call__(
        self, values: Float32[np.ndarray, '*batch rows cols channels'], confidence: Float32[np.ndarray, 'rows cols']
    ) -> Float32[np.ndarray, '*batch rows cols channels']:
        used = self.trusted * (confidence >= self.confidence_floor)
        scaled: np.ndarray = (values - self.mean) * self.gain * used[..., None]
        return scaled


@dataclass(frozen=True)
class ForceModel:
    """A trained network with everything that its numbers mean."""

    layout: FeatureLayout
    bins: BinGrid
    scaling: InputScaling
    network: Mlp
    output_scale_n: float = 1.0
    contact_threshold_n: float = 0.05
    model_id: str = field(default='unsaved')

    def __post_init__(self) -> None:
        sizes = self.network.sizes
        if sizes[0] != self.layout.count or sizes[-1] != self.bins.count:
            raise ModelError(
                f'model {self.model_id} has a network of {sizes[0]} inputs and {sizes[-1]} outputs, but describes '
                f'{self.layout.count} features and {self.bins.count} bins; train it again or use another model file'
            )


@dataclass(frozen=True)
class ForceMap:
    """The normal force on the surface, positive into the gel.

    `contact_mm` is the force-weighted mean of the centres of the strongest bin and its neighbours, in the
    surface frame. With the paper's labels (all force in the bin of the indentation's centre) it says in which
    bin the contact lies and hints at the side of it: expect an error of about a millimetre.
    `confidence` is the share, between 0 and 1, of the regions the network learned from that hold markers now.
    """

    normal_force_n: Float32[np.ndarray, 'rows cols']
    total_n: float
    peak_n: float
    contact_mm: tuple[float, float]
    confidence: float


class ForceEstimator:
    """Applies a model to features; bit for bit the same result for the same features."""

    def __init__(self, model: ForceModel) -> None:
        self.model = model
        self._centres_mm = model.bins.centres_mm

    def predict(self, features: Features) -> ForceMap:
        """The force distribution for one frame's features.

        Raises:
            ModelError: the features have another layout than those the model was trained on.
        """
        model = self.model
        require_layout(model.layout, features, model.model_id)
        inputs = model.scaling(features.values, features.confidence).reshape(-1)
        forces = model.network(inputs) * np.float32(model.output_scale_n)
        return self._summary(forces.reshape(model.bins.rows, model.bins.cols), features)

    def _summary(self, forces_n: np.ndarray, features: Features) -> ForceMap:
        return ForceMap(
            normal_force_n=forces_n,
            total_n=float(forces_n.sum(dtype=np.float64)),
            peak_n=float(forces_n.max()),
            contact_mm=contact_position_mm(forces_n, self._centres_mm),
            confidence=_share_trusted(self.model.scaling, features),
        )


def contact_position_mm(forces_n: Float32[np.ndarray, 'rows cols'], centres_mm: np.ndarray) -> tuple[float, float]:
    """Force-weighted mean of the centres of the strongest bin and its (up to eight) neighbours.

    Negative forces count as none. Equal forces in two neighbouring bins give the middle of their border;
    a map without any positive force gives the centre of its strongest bin.
    """
    row, col = np.unravel_index(int(forces_n.argmax()), forces_n.shape)
    window = np.s_[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]
    weights = np.maximum(forces_n[window], 0).astype(np.float64)
    if not weights.sum() > 0:
        return float(centres_mm[row, col, 0]), float(centres_mm[row, col, 1])
    x, y = (weights[..., None] * centres_mm[window]).sum(axis=(0, 1)) / weights.sum()
    return float(x), float(y)


def require_layout(layout: FeatureLayout, features: Features, model_id: str) -> None:
    """Refuse features that a model was not trained on.

    Raises:
        ModelError: says both layouts.
    """
    rows, cols, channels = features.values.shape
    found = FeatureLayout(features.encoding, rows, cols, channels)
    if found != layout:
        raise ModelError(
            f'model {model_id} was trained on {layout}, but the features are {found}; '
            'configure the features as the model needs them or choose another model'
        )


def _share_trusted(scaling: InputScaling, features: Features) -> float:
    textured = features.confidence >= scaling.confidence_floor
    return float((scaling.trusted * textured).sum() / max(float(scaling.trusted.sum()), 1.0))
