"""A force model: features in, force distribution out.

This is the computation only. Files are in `tactile_nodes.model_file`, training in `tactile_nodes.learning`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np

from tactile_nodes.errors import ModelError
from tactile_nodes.sensing.explain.arrays import AnyReadout
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.explain.reading import UNKNOWN, Acting, Contact, Reading, nothing_read
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.geometry import BinGrid
from tactile_nodes.shapes import Float32


@dataclass(frozen=True)
class FeatureLayout:
    """The features that a model was trained on."""

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
class ForceModel:
    """A trained readout with all that is needed to interpret its numbers."""

    layout: FeatureLayout
    bins: BinGrid
    readout: AnyReadout
    contact_threshold_n: float = 0.05
    model_id: str = field(default='unsaved')

    def __post_init__(self) -> None:
        try:
            self.readout.require_fit(self.layout.count, self.bins)
        except ModelError as error:
            raise ModelError(f'model {self.model_id}: {error}') from error


OK_TIMES = 2.0
"""A force is ok up to this multiple of the nominal error."""


@dataclass(frozen=True)
class ForceMap:
    """The normal force on the surface, positive into the gel.

    `contacts` are in the surface frame, strongest first; `contact_mm` is the first one's place. `position_sigma_mm` is
    that place's standard deviation along each axis, `total_sigma_n` that of the total. `unlikeness` is the novelty:
    above 1 the frame is unlike the training. All three are NaN for models that do not know them. `nominal_n` is the
    model's usual standard deviation of the total of such contacts. `confidence` is the share, between 0 and 1, of the
    trained regions that show markers now. `acting` is that of the reading.
    """

    normal_force_n: Float32[np.ndarray, 'rows cols']
    total_n: float
    contact_mm: tuple[float, float]
    confidence: float
    contacts: tuple[Contact, ...] = ()
    total_sigma_n: float = UNKNOWN
    position_sigma_mm: float = UNKNOWN
    unlikeness: float = UNKNOWN
    nominal_n: float = UNKNOWN
    acting: Acting | None = None


class ForceEstimator:
    """Applies a model to features. The same frames in the same order give bit-identical results.

    Results of compiled loops and NumPy differ in the last digits.
    """

    def __init__(self, model: ForceModel, *, compiled: bool = False) -> None:
        self.model: ForceModel = _by_loops(model) if compiled else model
        self._layout = model.layout.encoding, model.layout.rows, model.layout.cols, model.layout.channels
        self._trusted = max(float(model.readout.scaling.trusted.sum()), 1.0)
        self._at_rest: tuple[Features, ForceMap] | None = None

    def predict(self, features: Features) -> ForceMap:
        """The force distribution for one frame's features.

        Raises:
            ModelError: the layout of the features differs from that of the training.
        """
        model = self.model
        if (features.encoding, *features.values.shape) != self._layout:
            raise ModelError(_other_layout(model, features))
        readout, scaling = model.readout, model.readout.scaling
        if isinstance(readout, FieldReadout):
            reading = readout.read(features.values, features.confidence, features.noise_px)
        else:
            reading = readout.read(features.values, features.confidence)
        textured = np.vdot(scaling.trusted, features.confidence >= scaling.confidence_floor)
        return _force_map(reading, float(textured) / self._trusted, readout)

    def at_rest(self, features: Features) -> ForceMap:
        """No force, with the uncertainty that the model states for these features, which show no motion.

        They are the same in every frame, so the model is evaluated once. For a network it is the uncertainty of zero
        force: its training has no features without noise, so its answer to them is not used.

        Raises:
            ModelError: as above.
        """
        known = self._at_rest
        if known is None or not np.array_equal(known[0].confidence, features.confidence):
            found, nominal_n = self.predict(features), self.model.readout.nominal_n(0.0)
            none = np.zeros_like(found.normal_force_n)
            resting = replace(found, normal_force_n=none, total_n=0.0, nominal_n=nominal_n)
            if isinstance(readout := self.model.readout, NetworkReadout):
                resting = replace(resting, total_sigma_n=readout.spread.sigma_n(0.0), unlikeness=0.0)
            self._at_rest = known = features, replace(resting, acting=self._still(resting))
        return known[1]

    def _still(self, found: ForceMap) -> Acting | None:
        """The further results without contact, if the readout has them."""
        readout = self.model.readout
        return readout.nothing() if isinstance(readout, FieldReadout) else found.acting


def _by_loops(part: Any) -> Any:
    """The same model with compiled loops in all parts that have them."""
    parts = {each.name: getattr(part, each.name) for each in fields(part)}
    changed = {name: _by_loops(inner) for name, inner in parts.items() if is_dataclass(inner)}
    return replace(part, **changed, **({'compiled': True} if 'compiled' in parts else {}))


def _force_map(reading: Reading, confidence: float, readout: AnyReadout | None = None) -> ForceMap:
    strongest = reading.contacts[0]
    total_n: float = sum(reading.normal_force_n.reshape(-1).tolist())  # for so few numbers lists are faster
    return ForceMap(
        normal_force_n=reading.normal_force_n,
        total_n=total_n,
        contact_mm=(strongest.x_mm, strongest.y_mm),
        confidence=confidence,
        contacts=reading.contacts,
        total_sigma_n=reading.total_sigma_n,
        position_sigma_mm=strongest.sigma_mm,
        unlikeness=reading.unlikeness,
        nominal_n=UNKNOWN if readout is None else readout.nominal_n(total_n),
        acting=reading.acting,
    )


def unknown_forces(bins: BinGrid) -> ForceMap:
    """The result for a frame that could not be measured: all NaN."""
    return _force_map(nothing_read(bins), UNKNOWN)


def _other_layout(model: ForceModel, features: Features) -> str:
    found = FeatureLayout(features.encoding, *features.values.shape)
    return (
        f'model {model.model_id} was trained on {model.layout}, but the features are {found}; '
        'configure the features as the model needs them or choose another model'
    )
