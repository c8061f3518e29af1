"""A model that is ready for use, and the features that it reads."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.errors import ModelError
from tactile_nodes.messages import types
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.pipeline.methods import describe_flow
from tactile_nodes.pipeline.reasons import UNMEASURED
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceMap, unknown_forces
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.flow.choice import make_flow

FORCE = types.ForceDistribution


@dataclass(frozen=True)
class Inputs:
    """The kind of features: how motion is measured, how it is summed up, and the size of the images [px]."""

    method: str
    layout: FeatureLayout
    image_size: tuple[int, int]

    @classmethod
    def of_model(cls, loaded: LoadedModel) -> Inputs:
        """The features that a model was trained on."""
        return cls(describe_flow(make_flow(*loaded.flow)), loaded.model.layout, loaded.image_size)

    @classmethod
    def of_message(cls, message: types.FlowFeatures) -> Inputs:
        """The features of a received message."""
        layout = FeatureLayout(message.encoding, message.rows, message.cols, message.channels)
        return cls(message.method, layout, (message.image_width, message.image_height))

    @property
    def pixels(self) -> str:
        """The size of the images, as text."""
        width, height = self.image_size
        return f'{width}x{height} pixels'

    def unlike(self, found: Inputs) -> str:
        """What is needed but differs in `found`: '440x440 pixels and not 400x400 pixels', or empty."""
        pairs = (
            (f'{self.layout}', f'{found.layout}'), _differing(self.method, found.method),
            (self.pixels, found.pixels),
        )  # fmt: skip
        return ', '.join(f'{mine} and not {other}' for mine, other in pairs if mine != other)


def _differing(method: str, other: str) -> tuple[str, str]:
    """Two flow methods, 'name(option=1, other=2)'; if they differ in options only, with just those options."""
    (name, *options), (other_name, *other_options) = (re.split('[(,)] ?', each) for each in (method, other))
    if name != other_name or len(options) != len(other_options):
        return f'the flow {method}', other
    unlike = [pair for pair in zip(options, other_options, strict=True) if pair[0] != pair[1]]
    needed, found = (', '.join(pair[side] for pair in unlike) for side in (0, 1))
    return f'the flow {name} with {needed}' if needed else found, found


def _estimator(loaded: LoadedModel, compiled: bool) -> ForceEstimator:
    """The estimator of a model, with compiled loops or NumPy. It is run once, so that the first frame takes no longer.

    Raises:
        ModelError: its numbers are such that it cannot estimate anything.
    """
    estimator, layout = ForceEstimator(loaded.model, compiled=compiled), loaded.model.layout
    still = np.zeros((layout.rows, layout.cols, layout.channels), np.float32)
    try:
        if isinstance(readout := estimator.model.readout, FieldReadout):
            readout.prepare()
        estimator.predict(Features(layout.encoding, still, np.ones(still.shape[:2], np.float32)))
    except (ValueError, ArithmeticError, LookupError) as error:
        raise ModelError(
            f'model {loaded.model_id} holds invalid numbers, so no force can be computed ({error}); '
            'train it again or download it again'
        ) from error
    return estimator


@dataclass(frozen=True)
class Ready:
    """A model that was loaded, checked and run once.

    `name` is the name it was requested by. For a calibrated model the provenance also gives it as the calibration.
    `inputs` are the features that it reads.
    """

    name: str
    file: Path
    loaded: LoadedModel
    inputs: Inputs
    estimator: ForceEstimator
    provenance: types.Provenance

    @property
    def unsure_of(self) -> int:
        """Reasons after which its error is unknown: a network may take noise or a blur for force."""
        return int(FORCE.REASON_BLURRED) if isinstance(self.loaded.model.readout, NetworkReadout) else 0

    @property
    def reasons(self) -> int:
        """Reasons that hold for all its forces, unless the error is within the usual range."""
        return int(FORCE.REASON_UNCALIBRATED) if self.loaded.of_description else 0

    def explain(self, features: types.FlowFeatures) -> ForceMap:
        """The force map that explains the motion of one frame; NaN for a frame that was not measured.

        Raises:
            ModelError, MessageError: the model cannot read these features, or was trained with another flow method.
        """
        if features.method not in ('', self.inputs.method):
            needed, other = _differing(self.inputs.method, features.method)
            raise ModelError(
                f'model {self.name} needs {needed}, but the features come from {other}; start flow_features and '
                'force_estimator with the same model'
            )
        if features.reasons & UNMEASURED:
            return unknown_forces(self.loaded.model.bins)
        seen = conversions.features_array(features)
        if not np.isfinite(seen.values).all():
            return unknown_forces(self.loaded.model.bins)
        return self.estimator.at_rest(seen) if features.untouched else self.estimator.predict(seen)

    @classmethod
    def read(cls, name: str, compiled: bool = False) -> Ready:
        """Load from a file, or a shipped model by name. Raises ModelError."""
        file = find_model(name)
        loaded = load_model(file)
        calibrated = loaded.card.get('data', {}).get('origin') == 'calibration'
        provenance = types.Provenance(
            model=file.stem, model_id=loaded.model_id, gel=loaded.gel,
            calibration_id=loaded.model_id if calibrated else '',
        )  # fmt: skip
        return cls(name, file, loaded, Inputs.of_model(loaded), _estimator(loaded, compiled), provenance)
