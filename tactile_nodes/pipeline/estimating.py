"""The model in use: features in, a force message out; and how another model takes its place between two frames."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from tactile_nodes import conversions
from tactile_nodes.clock import perf_ns
from tactile_nodes.errors import ModelError
from tactile_nodes.messages import types
from tactile_nodes.paths import is_file
from tactile_nodes.pipeline.described_model import require_of_sensor
from tactile_nodes.pipeline.judge_force import ForceMemory, judge_force
from tactile_nodes.pipeline.ready_model import Inputs, Ready
from tactile_nodes.pipeline.tell import tell_force
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.reading import Acting
from tactile_nodes.sensing.judge.stamped import ByStamp

MOST_EARLIER = 16
"""Models to go back to that stay in memory; further back by what the cards of the files say."""


class Estimating:
    """Answers features with forces by the model in use: explain, judge, tell.

    `prepared` and `previous` may be called from any thread. Every model that it uses computes by `compiled` loops, or
    by numpy.

    Raises:
        ModelError: there is no such model, or it is not one of the described `sensor`, if one is named.
    """

    def __init__(self, name: str, *, sensor: str = '', compiled: bool = False) -> None:
        self._compiled, self._sensor = compiled, sensor
        self.now = Ready.read(name, compiled)
        require_of_sensor(self.now, sensor)
        self._earlier: deque[Ready] = deque(maxlen=MOST_EARLIER)
        self._back: Ready | None = None
        self._last: types.FlowFeatures | None = None
        self._memory = ForceMemory(self.now.loaded.model.contact_threshold_n)
        self._acting: Acting | None = None
        self._from = self.now.provenance

    def prepared(self, name: str) -> Ready:
        """A model that can take over.

        Raises:
            ModelError: there is no such model, it needs other features than come in, or it is of another sensor.
        """
        ready, last = Ready.read(name, self._compiled), self._last
        known = self.now.inputs if last is None else Inputs.of_message(last)
        if ready.inputs != known:
            raise ModelError(
                f'model {name} needs other features than come in: {ready.inputs.unlike(known)}; choose a model of '
                'features that do, or start flow features and force estimator with that one'
            )
        require_of_sensor(ready, self._sensor)
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
        self.now, self._from = ready, ready.provenance
        self._memory.contact = replace(self._memory.contact, threshold_n=ready.loaded.model.contact_threshold_n)

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
        found = self.now.explain(features)
        predict_s = (perf_ns() - start_ns) * 1e-9
        self._acting = found.acting
        told = judge_force(self._memory, self.now, features, found, least_confidence)
        stages = replace(  # type: ignore[type-var]
            features.stages, predict=predict_s, transport=features.stages.transport + age_s
        )
        head = types.Header(stamp=features.header.stamp, frame_id=frame_id)
        bins, provenance = self.now.loaded.model.bins, self._provenance_of(features.reference_id)
        return tell_force(found, told, bins, head=head, provenance=provenance, stages=stages)

    @property
    def calibration(self) -> ByStamp[int]:
        """The reasons that the state of the calibration adds, by stamp."""
        return self._memory.calibration

    def field(self, force: types.ForceDistribution) -> types.ForceField | None:
        """The fine maps beside the force that was answered last, empty where it is none; None of a model without."""
        model = self.now.loaded.model
        if not isinstance(model.readout, FieldReadout):
            return None
        field = self._acting.field() if self._acting and self._acting.field else None
        return conversions.field_message(field, model.bins, force)

    def _provenance_of(self, reference_id: str) -> types.Provenance:
        """Made anew where model or rest image are others than those of the frame before."""
        if (self._from.model_id, self._from.reference_id) != (self.now.provenance.model_id, reference_id):
            self._from = replace(self.now.provenance, reference_id=reference_id)  # type: ignore[type-var]
        return self._from

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
