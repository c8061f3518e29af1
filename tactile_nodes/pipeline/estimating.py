"""The model in use: features in, a force message out; and how another model takes its place between two frames."""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.clock import perf_ns
from tactile_nodes.errors import ModelError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.model_file import LoadedModel, find_model, load_model
from tactile_nodes.paths import is_file
from tactile_nodes.pipeline.force_status import ALTERED, INVALID, UNMEASURED, found_reasons, judged
from tactile_nodes.pipeline.methods import told
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.model import FeatureLayout, ForceEstimator, ForceMap, unknown_forces
from tactile_nodes.sensing.explain.network import NetworkReadout
from tactile_nodes.sensing.explain.reading import Acting, Contact
from tactile_nodes.sensing.features import Features
from tactile_nodes.sensing.flow.choice import make_flow
from tactile_nodes.sensing.judge.stamped import ByStamp
from tactile_nodes.sensing.picture.quality import ContactDetector

FORCE = types.ForceDistribution
MOST_EARLIER = 16
"""Models to go back to that stay in memory; further back by what the cards of the files say."""


@dataclass(frozen=True)
class Inputs:
    """What features are like: how motion is measured, how it is summed up, and in images of which size (px)."""

    method: str
    layout: FeatureLayout
    image_size: tuple[int, int]

    @classmethod
    def of_model(cls, loaded: LoadedModel) -> Inputs:
        """Those that a model learned from."""
        return cls(told(make_flow(*loaded.flow)), loaded.model.layout, loaded.image_size)

    @classmethod
    def of_message(cls, message: types.FlowFeatures) -> Inputs:
        """Those that come in."""
        layout = FeatureLayout(message.encoding, message.rows, message.cols, message.channels)
        return cls(message.method, layout, (message.image_width, message.image_height))

    @property
    def pixels(self) -> str:
        """The size of the images in words."""
        width, height = self.image_size
        return f'{width}x{height} pixels'

    def unlike(self, found: Inputs) -> str:
        """What of these is needed and comes in otherwise: '440x440 pixels and not 400x400 pixels', or nothing."""
        pairs = (
            (f'{self.layout}', f'{found.layout}'), _told_apart(self.method, found.method),
            (self.pixels, found.pixels),
        )  # fmt: skip
        return ', '.join(f'{mine} and not {other}' for mine, other in pairs if mine != other)


def _told_apart(method: str, other: str) -> tuple[str, str]:
    """Two flows, 'name(option=1, other=2)', with only the options in which they differ, if that is all."""
    (name, *options), (other_name, *other_options) = (re.split('[(,)] ?', each) for each in (method, other))
    if name != other_name or len(options) != len(other_options):
        return f'the flow {method}', other
    unlike = [pair for pair in zip(options, other_options, strict=True) if pair[0] != pair[1]]
    needed, found = (', '.join(pair[side] for pair in unlike) for side in (0, 1))
    return f'the flow {name} with {needed}' if needed else found, found


def _estimator(loaded: LoadedModel, compiled: bool) -> ForceEstimator:
    """What reads by a model, by compiled loops or numpy; run once, so that its first frame takes no longer.

    Raises:
        ModelError: its numbers are such that nothing can be read by them.
    """
    estimator, layout = ForceEstimator(loaded.model, compiled=compiled), loaded.model.layout
    still = np.zeros((layout.rows, layout.cols, layout.channels), np.float32)
    try:
        if isinstance(readout := estimator.model.readout, FieldReadout):
            readout.prepare()
        estimator.predict(Features(layout.encoding, still, np.ones(still.shape[:2], np.float32)))
    except (ValueError, ArithmeticError, LookupError) as error:
        raise ModelError(
            f'model {loaded.model_id} holds numbers by which nothing can be read ({error}); '
            'train it again or fetch it again'
        ) from error
    return estimator


@dataclass(frozen=True)
class Ready:
    """A model that was read, checked and run once.

    `name` is what it was asked for by; a calibrated model's provenance names it as the calibration, too. `inputs` are
    the features that it reads.
    """

    name: str
    file: Path
    loaded: LoadedModel
    inputs: Inputs
    estimator: ForceEstimator
    provenance: types.Provenance

    @property
    def unsure_of(self) -> int:
        """Reasons for which nobody can say how far off it is: a network's errors in altered pictures follow no rule."""
        return ALTERED if isinstance(self.loaded.model.readout, NetworkReadout) else 0

    @property
    def reasons(self) -> int:
        """What speaks against every force of it, unless that is within what is usual."""
        return int(FORCE.REASON_UNCALIBRATED) if self.loaded.of_description else 0

    def found(self, features: types.FlowFeatures) -> ForceMap:
        """The force of one frame.

        Raises:
            ModelError, MessageError: the features are none that the model can read.
        """
        seen = conversions.features_array(features)
        if not np.isfinite(seen.values).all():
            return unknown_forces(self.loaded.model.bins)
        return self.estimator.at_rest(seen) if features.untouched else self.estimator.predict(seen)

    @classmethod
    def read(cls, name: str, compiled: bool = False) -> Ready:
        """From a file, or one that ships. Raises ModelError."""
        file = find_model(name)
        loaded = load_model(file)
        calibrated = loaded.card.get('data', {}).get('origin') == 'calibration'
        provenance = types.Provenance(
            model=file.stem, model_id=loaded.model_id, gel=loaded.gel,
            calibration_id=loaded.model_id if calibrated else '',
        )  # fmt: skip
        return cls(name, file, loaded, Inputs.of_model(loaded), _estimator(loaded, compiled), provenance)


class Estimating:
    """Answers features with forces by the model in use. `prepared` and `previous` may be called from any thread.

    Every model that it uses computes by `compiled` loops, or by numpy.

    Raises:
        ModelError: there is no such model.
    """

    def __init__(self, name: str, *, compiled: bool = False) -> None:
        self._compiled = compiled
        self.now = Ready.read(name, compiled)
        self._earlier: deque[Ready] = deque(maxlen=MOST_EARLIER)
        self._back: Ready | None = None
        self._last: types.FlowFeatures | None = None
        self._contact = ContactDetector(self.now.loaded.model.contact_threshold_n)
        self._free_n: float | None = None
        self._acting: Acting | None = None
        self.calibration = ByStamp(0)
        self._from = self.now.provenance

    def prepared(self, name: str) -> Ready:
        """A model that can take over.

        Raises:
            ModelError: there is no such model, or it needs other features than come in.
        """
        ready, last = Ready.read(name, self._compiled), self._last
        known = self.now.inputs if last is None else Inputs.of_message(last)
        if ready.inputs != known:
            raise ModelError(
                f'model {name} needs other features than come in: {ready.inputs.unlike(known)}; choose a model of '
                'features that do, or start flow features and force estimator with that one'
            )
        return ready

    def misfit(self) -> str:
        """Why pictures as they come in give no force, and what to do; empty: they do, or none have come."""
        needs, last = self.now.inputs, self._last
        if last is None or (last.image_width, last.image_height) == needs.image_size:
            return ''
        return (
            f'they have {Inputs.of_message(last).pixels}, and model {self.now.file.stem} was trained on '
            f'{needs.pixels}; set the crop of camera or flow_features, or choose a model of that size'
        )

    def previous(self) -> Ready:
        """The model in use before this one; after a restart the one whose place this one took, as its card says.

        Raises:
            ModelError: there was none, or it is there no more.
        """
        self._back = self._earlier[-1] if self._earlier else self._replaced()
        return self._back

    def take(self, ready: Ready) -> None:
        """From the next frame on with this model."""
        if ready is not self._back:
            self._earlier.append(self.now)
        elif self._earlier:
            self._earlier.pop()
        self._back = None
        self.now = ready
        self._contact = replace(self._contact, threshold_n=ready.loaded.model.contact_threshold_n)

    def answer(
        self,
        features: types.FlowFeatures,
        frame_id: str,
        least_confidence: float,
        age_s: float,
    ) -> types.ForceDistribution:
        """The force of one frame, whose features were published `age_s` ago.

        Raises:
            ModelError, MessageError: the features are none that the model can read.
        """
        self._last, start_ns = features, perf_ns()
        found = self._found(features)
        stages, predict_s = features.stages, (perf_ns() - start_ns) * 1e-9
        reasons = int(features.reasons | self.now.reasons | self._reasons(features, found, least_confidence))
        touching, begun_n = self._contact_now(found, reasons)
        reasons |= self.calibration.at(stamp_ns(features.header.stamp))
        self._acting = found.acting
        verdict = judged(found, reasons, begun_n, unsure_of=self.now.unsure_of)
        fields = conversions.force_fields(
            found.normal_force_n, self.now.loaded.model.bins, self._touching(found) if touching else (),
            total_sigma_n=verdict.sigma_n, unlikeness=found.unlikeness, acting=found.acting,
        )  # fmt: skip
        return types.ForceDistribution(
            header=types.Header(stamp=features.header.stamp, frame_id=frame_id),
            status=verdict.status,
            reasons=verdict.reasons,
            provenance=self._provenance_of(features.reference_id),
            stages=types.StageTimes(
                acquire=stages.acquire,
                flow=stages.flow,
                features=stages.features,
                predict=predict_s,
                transport=stages.transport + age_s,
            ),
            **fields,
        )

    def field(self, force: types.ForceDistribution) -> types.ForceField | None:
        """The fine maps beside the force that was answered last; None of a model that knows none."""
        if self._acting is None or self._acting.field is None:
            return None
        return conversions.field_message(self._acting.field(), self.now.loaded.model.bins, force)

    def _provenance_of(self, reference_id: str) -> types.Provenance:
        """Made anew where model or rest image are others than those of the frame before."""
        if (self._from.model_id, self._from.reference_id) != (self.now.provenance.model_id, reference_id):
            self._from = replace(self.now.provenance, reference_id=reference_id)  # type: ignore[type-var]
        return self._from

    def _found(self, features: types.FlowFeatures) -> ForceMap:
        if features.reasons & UNMEASURED:
            return unknown_forces(self.now.loaded.model.bins)
        return self.now.found(features)

    def _contact_now(self, found: ForceMap, reasons: int) -> tuple[bool, float]:
        """Whether anything touches, and by how much force grew since a frame in which nothing did."""
        before_n, self._free_n = self._free_n, None
        if reasons & INVALID:
            return False, 0.0
        touching = self._contact.update(found.total_n)
        if not touching:
            self._free_n = found.total_n
        return touching, found.total_n - before_n if touching and before_n is not None else 0.0

    def _replaced(self) -> Ready:
        card, file = self.now.loaded.card, self.now.file
        old = card.get('replaces') or card.get('source') or {}
        if not (name := str(old.get('model', ''))):
            raise ModelError(f'{file.name} took the place of no other model, so there is nothing to return to')
        beside = file.parent / name
        ready = self.prepared(str(beside) if is_file(beside) else name)
        if ready.loaded.model_id != old['model_id']:
            raise ModelError(
                f'{file.name} took the place of model {old["model_id"]}, and {name} is {ready.loaded.model_id} now; '
                'set the parameter model to the file that is meant'
            )
        return ready

    def _touching(self, found: ForceMap) -> tuple[Contact, ...]:
        """The strongest contact, and the others that are above the threshold."""
        least_n = self._contact.threshold_n
        return (found.contacts[0], *(each for each in found.contacts[1:] if each.force_n >= least_n))

    def _reasons(self, features: types.FlowFeatures, found: ForceMap, least_confidence: float) -> int:
        reasons = found_reasons(found, least_confidence)
        if features.reasons & UNMEASURED:
            reasons &= ~FORCE.REASON_NOT_FINITE
        if features.untouched:
            reasons &= ~FORCE.REASON_UNLIKE_TRAINING
        if (features.image_width, features.image_height) != self.now.inputs.image_size:
            reasons |= FORCE.REASON_OTHER_IMAGE
        return int(reasons)
