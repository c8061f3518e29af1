"""The model in use: features in, a force message out. Another model can replace it between two frames."""

from __future__ import annotations

import shlex
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tactile_nodes import conversions
from tactile_nodes.clock import perf_ns
from tactile_nodes.errors import ModelError
from tactile_nodes.messages import types
from tactile_nodes.model_file import SENSOR
from tactile_nodes.params import to_values
from tactile_nodes.paths import is_file
from tactile_nodes.pipeline.judge_force import ForceMemory, judge_force
from tactile_nodes.pipeline.ready_model import Inputs, Ready
from tactile_nodes.pipeline.tell import tell_force
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.reading import Acting
from tactile_nodes.sensing.judge.stamped import ByStamp
from tactile_nodes.sensors import Sensor, load_sensor
from tactile_nodes.sensors.writing import ONLY_IF_CHANGED, values_of

MOST_EARLIER = 16
"""Earlier models that stay in memory. Older ones are found by the cards of the files."""


class Estimating:
    """Turns features into forces with the model in use: explain, judge, write the message.

    `prepared` and `previous` may be called from any thread. All its models compute with compiled loops if `compiled`
    is set, else with NumPy.

    Raises:
        ModelError: there is no such model, or it does not belong to `sensor`, if a sensor is named.
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
        """Load a model that can replace the one in use.

        Raises:
            ModelError: there is no such model, it needs other features than those received, or it is of another sensor.
        """
        ready, last = Ready.read(name, self._compiled), self._last
        inputs = self.now.inputs if last is None else Inputs.of_message(last)
        if ready.inputs != inputs:
            raise ModelError(
                f'model {name} needs other features than flow_features publishes: {ready.inputs.unlike(inputs)}; '
                'choose a model for these features, or start both flow_features and force_estimator with this model'
            )
        require_of_sensor(ready, self._sensor)
        return ready

    def outdated(self) -> str:
        """How the description of the sensor has changed since the model in use was made; empty if it has not."""
        return changed_since(self.now, self._sensor)

    def misfit(self) -> str:
        """Why the images received give no force, and what to do; empty if they do, or if none was received yet."""
        needs, last = self.now.inputs, self._last
        if last is None or (last.image_width, last.image_height) == needs.image_size:
            return ''
        return (
            f'they have {Inputs.of_message(last).pixels}, but model {self.now.file.stem} was trained on '
            f'{needs.pixels}; set the crop of camera or flow_features, or choose a model of that size'
        )

    def previous(self) -> Ready:
        """The model in use before this one. After a restart it is the model that the card names as the one before.

        Raises:
            ModelError: there was none, or it no longer exists.
        """
        self._back = self._earlier[-1] if self._earlier else self._replaced()
        return self._back

    def take(self, ready: Ready) -> None:
        """Use this model from the next frame on."""
        if ready is not self._back:
            if (ready.name, ready.loaded.model_id) != (self.now.name, self.now.loaded.model_id):
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
        """The force of one frame whose features were published `age_s` ago.

        Raises:
            ModelError, MessageError: the model cannot read these features.
        """
        self._last, start_ns = features, perf_ns()
        found = self.now.explain(features)
        predict_s = (perf_ns() - start_ns) * 1e-9
        self._acting = found.acting
        verdict, touching = judge_force(self._memory, self.now, features, found, least_confidence)
        stages = replace(  # type: ignore[type-var]
            features.stages, predict=predict_s, transport=features.stages.transport + age_s
        )
        head = types.Header(stamp=features.header.stamp, frame_id=frame_id)
        bins, provenance = self.now.loaded.model.bins, self._provenance_of(features.reference_id)
        return tell_force(found, verdict, touching, bins, head=head, provenance=provenance, stages=stages)

    @property
    def calibration(self) -> ByStamp[int]:
        """Reasons added by the state of the calibration, by stamp."""
        return self._memory.calibration

    def field(self, force: types.ForceDistribution) -> types.ForceField | None:
        """The fine maps of the last force: empty if there was no force, None for a model without fine maps."""
        model = self.now.loaded.model
        if not isinstance(model.readout, FieldReadout):
            return None
        field = self._acting.field() if self._acting and self._acting.field else None
        return conversions.field_message(field, model.bins, force)

    def _provenance_of(self, reference_id: str) -> types.Provenance:
        """Made anew if the model or the rest image differs from that of the frame before."""
        if (self._from.model_id, self._from.reference_id) != (self.now.provenance.model_id, reference_id):
            self._from = replace(self.now.provenance, reference_id=reference_id)  # type: ignore[type-var]
        return self._from

    def _replaced(self) -> Ready:
        card, file = self.now.loaded.card, self.now.file
        old = card.get('replaces') or card.get('source') or {}
        if not (name := str(old.get('model', ''))):
            raise ModelError(f'{file.name} did not replace another model, so there is no model to return to')
        beside = file.parent / name
        ready = self.prepared(str(beside) if is_file(beside) else name)
        if ready.loaded.model_id != old['model_id']:
            raise ModelError(
                f'{file.name} replaced model {old["model_id"]}, but {name} now holds {ready.loaded.model_id}; '
                'set the parameter model to the file that you want'
            )
        return ready


def require_of_sensor(ready: Ready, sensor: str) -> None:
    """Refuse a model of another sensor; `sensor` is the name or file of the description, or empty.

    Raises:
        ConfigurationError: there is no such description.
        ModelError: the images are cropped to another size than the model reads, or the model was made from a
            description of another name. (For one of the same name see `changed_since`.)
    """
    if not sensor:
        return
    described, card = load_sensor(sensor), ready.loaded.card.get(SENSOR, {})
    size, reads = described.image.crop_px, ready.inputs.image_size
    other = card.get('name', described.name) != described.name and _unlike(described, card)
    if size == reads and not other:
        return
    why = (
        f'it was made from the description {card["name"]}'
        if size == reads
        else f'it reads images of {_size(reads)}, and this sensor gives {_size(size)}'
    )
    raise ModelError(f'model {ready.name} does not belong to sensor {sensor}: {why}; {_remedy(sensor)}')


def changed_since(ready: Ready, sensor: str) -> str:
    """How the description of a sensor differs from the one that a model was made from; empty if it does not.

    Raises:
        ConfigurationError: there is no such description.
    """
    unlike = _unlike(load_sensor(sensor), ready.loaded.card.get(SENSOR, {})) if sensor else []
    if not unlike:
        return ''
    return (
        f'the description {sensor} has changed since model {ready.name} was made ({", ".join(unlike)}), and the model '
        f'still uses the old one; {_remedy(sensor)}'
    )


def _unlike(described: Sensor, card: Mapping[str, Any]) -> list[str]:
    """The entries that differ, in words; none if the card describes no sensor."""
    if not card:
        return []
    usual = to_values(Sensor())
    unwritten = {name: usual[name] for name in ONLY_IF_CHANGED}
    now = unwritten | values_of(described)
    return [
        f'{key} was {value}, is {now[key]}'
        for key, value in {**unwritten, **card}.items()
        if key in now and key != 'name' and now[key] != value
    ]


def _remedy(sensor: str) -> str:
    model_file = f'{Path(sensor).stem}.safetensors'
    command = shlex.join(['tactile', 'calibrate', '--sensor', sensor, '--model', 'field', '-o', model_file])
    return f'make one with `{command}` and start with model:={shlex.quote(model_file)}'


def _size(size: tuple[int, int]) -> str:
    return f'{size[0]}x{size[1]}'
