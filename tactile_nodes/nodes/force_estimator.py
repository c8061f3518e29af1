"""From features to force in newtons.

Subscribes to ``flow_features`` and ``calibration_state``; publishes ``force_distribution``, ``wrench``, ``force_field``
(only while it has subscribers), and the latched ``model_in_use`` and ``calibration_image``. Setting the parameter
``model`` switches the model between two frames; ``~/undo_calibration`` returns to the previous model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.clock import Clock
from tactile_nodes.errors import ConfigurationError, ModelError
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.params import parameter
from tactile_nodes.pipeline.estimating import Estimating
from tactile_nodes.pipeline.loop_choice import choose
from tactile_nodes.pipeline.ready_model import Ready
from tactile_nodes.pipeline.reasons import calibration_reasons
from tactile_nodes.sensors import mounting_of

_PREVIOUS = ''


@dataclass(frozen=True)
class ForceEstimatorParams(NodeParams):
    model: str = parameter('fast', 'name of a shipped model, or path of a model file')
    sensor: str = parameter(
        '', 'sensor description: `model` must be made for it, and forces are in its `frame`', read_only=True
    )
    frame_id: str = parameter('', 'frame of the forces; empty: that of `sensor`, or gel_surface')
    least_confidence: float = parameter(
        0.85, 'fraction of the known regions that must show markers', minimum=0.0, maximum=1.0
    )
    compiled: bool = parameter(
        True,
        'compute with loops compiled by numba; if set: wait for compilation; if not: use numpy until the next start',
        read_only=True,
    )


class ForceEstimatorNode(Node):
    """Applies the model. Messages carry the stamp of the image and the provenance of the force."""

    NAME = 'force_estimator'
    PARAMS = ForceEstimatorParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        self._prepared: dict[str, Ready | ModelError] = {}
        super().__init__(bus, arguments, clock)
        compiled = choose(self.given('compiled'), self.log.info, self.log.warn)
        self._estimating = Estimating(self.params.model, sensor=self.params.sensor, compiled=compiled)
        self._misfit = ''
        self._described = mounting_of(self.params.sensor)
        self._in_use = self.create_publisher(topics.MODEL_IN_USE)
        self._calibrated_on = self.create_publisher(topics.CALIBRATION_IMAGE)
        self._force = self.create_publisher(topics.FORCE_DISTRIBUTION)
        self._wrench = self.create_publisher(topics.WRENCH)
        self._field = self.create_publisher(topics.FORCE_FIELD)
        self._tell_model()
        self.create_trigger('~/undo_calibration', self._undo, first=self._find_previous)
        self.create_subscription(topics.CALIBRATION_STATE, self._on_calibration)
        self.create_subscription(topics.FLOW_FEATURES, self._on_features)

    def prepare_parameters(self, values: Mapping[str, object]) -> None:
        if isinstance(name := values.get('model'), str):
            self._ask(name, lambda: self._estimating.prepared(name))

    def on_parameters(self, changed: ForceEstimatorParams) -> None:
        prepared = self._prepared.pop(changed.model, None)
        if prepared is None and changed.model == self.params.model:
            return
        try:
            self._estimating.take(_found(prepared) if prepared else self._estimating.prepared(changed.model))
        except ModelError as error:
            raise ConfigurationError(str(error)) from error
        self._tell_model()
        self.log.info(f'switched to model {changed.model}')

    def _on_features(self, received: Received) -> None:
        age_s = max(0.0, self.age_s(received))
        settings = self.params
        frame_id = settings.frame_id or self._described.id
        force = self._estimating.answer(received.message, frame_id, settings.least_confidence, age_s)
        self._force.publish(force)
        if (misfit := self._estimating.misfit()) != self._misfit:
            self._misfit = misfit
            self.report('pictures', Level.WARN if misfit else Level.OK, misfit or 'they fit the model')
        if self._wrench.listeners:
            self._wrench.publish(conversions.wrench_message(force))
        if self._field.listeners and (field := self._estimating.field(force)) is not None:
            self._field.publish(field)

    def _on_calibration(self, received: Received) -> None:
        state: types.CalibrationState = received.message
        self._estimating.calibration.add(stamp_ns(state.valid_from), calibration_reasons(state))

    def _ask(self, name: str, find: Callable[[], Ready]) -> None:
        """Load a model in its own thread; it is taken over or refused between two frames."""
        try:
            self._prepared[name] = find()
        except ModelError as error:
            self._prepared[name] = error

    def _find_previous(self) -> None:
        self._ask(_PREVIOUS, self._estimating.previous)

    def _undo(self) -> str:
        prepared = self._prepared.pop(_PREVIOUS, None)
        ready = _found(prepared) if prepared else self._estimating.previous()  # found for another call, which used it
        self._prepared[ready.name] = ready
        self._parameters.change({'model': ready.name})
        return f'back to {ready.file.stem} ({ready.loaded.model_id})'

    def _tell_model(self) -> None:
        now = self._estimating.now
        self._in_use.publish(now.provenance)
        self._calibrated_on.publish(
            conversions.image_message(now.loaded.rest_image, conversions.header(0, now.loaded.model_id))
        )
        text, outdated = f'{now.file.stem} ({now.loaded.model_id})', self._estimating.outdated()
        level = Level.WARN if outdated else Level.OK
        self.report(
            'model', level, f'{text}: {outdated}' if outdated else text, gel=now.loaded.gel, layout=now.inputs.layout
        )


def _found(prepared: Ready | ModelError) -> Ready:
    if isinstance(prepared, ModelError):
        raise prepared
    return prepared


main = partial(run_node, ForceEstimatorNode)
