"""Whether the calibration is still valid: on ``calibration_state`` (latched), /diagnostics, and in every force.

Subscribes to ``image_raw``, ``reference_image``, ``flow_features``, ``force_distribution``, ``model_in_use``,
``calibration_image`` and the topic of an independent force sensor (``force_topic``). Service: ``~/check_weight``
compares the measured force with the weight ``weight_g`` on the gel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level as Health
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.bus.subscription import Subscription
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.errors import ConfigurationError, ImageError
from tactile_nodes.gel_list import GelList
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.params import parameter
from tactile_nodes.pipeline.drifting import Calibrated, VerdictStamps, kept_in, state_message, usable
from tactile_nodes.sensing.geometry import Crop
from tactile_nodes.sensing.judge.drift import DriftMonitor
from tactile_nodes.sensing.picture.motion import PictureMotion
from tactile_nodes.sensing.rest.reference import content_id

KEEP_EVERY_NS = 3600 * NS_PER_S
_EVIDENCE = 'evidence'


@dataclass(frozen=True)
class DriftMonitorParams(NodeParams):
    model: str = parameter('fast', 'model whose simulated gel is used if a model holds no rest image', read_only=True)
    source: str = parameter(
        '', 'source of the camera; the simulated gel is used only if it is `simulated`', read_only=True
    )
    check_s: float = parameter(
        2.0, 'time between two checked pictures; a quarter of it while something seems wrong', minimum=0.05
    )
    force_topic: str = parameter(
        '', 'topic of an independent force sensor (WrenchStamped); empty: none', read_only=True
    )
    weight_g: float = parameter(200.0, 'weight that ~/check_weight expects on the gel', minimum=1.0)


class DriftMonitorNode(Node):
    """Checks a picture now and then; the conclusions are computed in `sensing.judge.drift`."""

    NAME = 'drift_monitor'
    PARAMS = DriftMonitorParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        self._calibrated = Calibrated(self.params.model, simulated=self.params.source == 'simulated')
        self._monitor = DriftMonitor(self._calibrated.limits)
        self._states, self._stamps = self.create_publisher(topics.CALIBRATION_STATE), VerdictStamps()
        self._reference_id, self._compared_ids = '', ('', '', True)
        self._gels, self._kept, self._kept_ns = GelList(), ('', 0, 0), 0
        self._rest_shape: tuple[int, ...] = ()
        self._taken_out: PictureMotion | None = None
        self._last_force: Received | None = None
        self._before = self.kept.get(_EVIDENCE)
        self.create_subscription(topics.MODEL_IN_USE, self._on_model)
        self.create_subscription(topics.CALIBRATION_IMAGE, self._on_calibration)
        self.create_subscription(topics.REFERENCE_IMAGE, self._on_reference)
        self.create_subscription(topics.IMAGE, self._on_image)
        self.create_subscription(topics.FLOW_FEATURES, self._on_features)
        self.create_subscription(topics.FORCE_DISTRIBUTION, self._on_force)
        self._independent, self._heard = (self._subscribe(name) if (name := self.params.force_topic) else None), 0
        self.create_trigger('~/check_weight', self._check_weight)

    def _subscribe(self, force_topic: str) -> Subscription:
        return self.create_subscription(replace(topics.FORCE_TORQUE, name=force_topic), self._on_independent)

    def _on_model(self, received: Received) -> None:
        self._calibrated.use_model(received.message)
        self._compare()

    def _on_calibration(self, received: Received) -> None:
        self._calibrated.use_picture(received.message)
        self._compare()

    def _compare(self) -> None:
        if self._calibrated.complete and self._calibrated.ids != self._compared_ids:  # else an estimator started again
            self._monitor.use_calibration(self._calibrated.picture(), calibrated=self._calibrated.is_calibrated)
            self._compared_ids = self._calibrated.ids

    def _on_reference(self, received: Received) -> None:
        picture = conversions.image_array(received.message)
        if (reference_id := content_id(picture)) == self._reference_id:
            return  # sensing was started again and goes on with it: the evidence stays
        self._rest_shape, self._reference_id = picture.shape, reference_id
        try:
            self._monitor.rest(picture)
        except ImageError:
            self._before = None
            raise
        finally:  # also if it cannot be compared: the verdict on the rest image before no longer holds
            if self._before is None:
                self._tell(stamp_ns(received.message.header.stamp), of_rest=True)

    def _on_image(self, received: Received) -> None:
        at_ns = stamp_ns(received.message.header.stamp)
        if self._monitor.is_due(at_ns, self.params.check_s):
            self._go_on()
            self._monitor.frame(at_ns, self._cut(received.message), self._taken_out)
            if self._before is None:
                self._tell(at_ns)

    @property
    def _of(self) -> bytes:
        """What the evidence is about: model, its rest image, and the one in use."""
        return ' '.join((*map(str, self._compared_ids), self._reference_id)).encode()

    def _go_on(self) -> None:
        """Continue with the evidence from before a restart, if it is about the same model and rest image.

        Nothing is told before: pictures of three seconds are needed to see again what speaks against a calibration.
        """
        if self._before is None:
            return
        of, _, evidence = self._before.partition(b'\n')
        if of != self._of and not any(self._compared_ids[:2]):  # the model may be told later
            return
        self._before = None
        if of == self._of:
            try:
                self._monitor.recall(evidence)
            except (ValueError, KeyError, TypeError) as error:
                self.log.warn(f'the evidence from before the restart cannot be used: {error!r}')

    def _cut(self, message: types.Image) -> np.ndarray:
        """The crop of the rest image; other camera nodes publish whole pictures."""
        picture = conversions.image_array(message)
        (height, width), (rest_height, rest_width) = picture.shape, self._rest_shape
        return Crop.centred(width, height, rest_width, rest_height).apply(picture)

    def _on_features(self, received: Received) -> None:
        self._taken_out = conversions.picture_motion(received.message)

    def _on_force(self, received: Received) -> None:
        force: types.ForceDistribution = received.message
        self._last_force = received
        if self._calibrated.use_force(force):
            self._compare()
        self._monitor.force(
            stamp_ns(force.header.stamp), force.total, force.unlikeness,
            in_contact=force.in_contact, usable=usable(force),
        )  # fmt: skip

    def _on_independent(self, received: Received) -> None:
        force = received.message.wrench.force
        self._monitor.independent_force(stamp_ns(received.message.header.stamp), (force.x, force.y, force.z))

    def _check_weight(self) -> str:
        silent_s = self.age_s(self._last_force) if self._last_force is not None else 0.0
        return self._monitor.weigh(self.params.weight_g, silent_s)

    def _tell(self, at_ns: int, *, of_rest: bool = False) -> None:
        verdict = self._monitor.verdict
        from_ns = self._stamps.holds_from_ns(verdict, at_ns, of_rest=of_rest)
        state = state_message(verdict, at_ns, from_ns, self._calibrated, self._reference_id)
        self._states.publish(state)
        evidence = self._of + b'\n' + self._monitor.saved()
        self.post(lambda: self.kept.put(_EVIDENCE, evidence))  # not now: a full disk is no reason to say nothing
        self._keep(state, at_ns)
        self.report(
            'calibration', Health(verdict.level), verdict.text, compared_with=self._calibrated.origin,
            moved_px=verdict.moved_px, lost=verdict.lost, unlike_share=verdict.unlike_share,
        )  # fmt: skip
        if self._independent is not None:
            self._tell_independent(self._independent)

    def _tell_independent(self, forces: Subscription) -> None:
        new, self._heard = forces.received > self._heard, forces.received
        level, none = (Health.OK, '') if new else (Health.WARN, 'no message on ')
        self.report('independent force', level, f'{none}{forces.topic}')

    def _keep(self, state: types.CalibrationState, at_ns: int) -> None:
        """Update the list of the lab's gels: every change, and each hour without one."""
        summary = state.model_id, state.level, state.reasons
        if summary == self._kept and 0 <= at_ns - self._kept_ns < KEEP_EVERY_NS:
            return
        self._kept, self._kept_ns = summary, at_ns
        try:
            kept_in(self._gels, state)
        except ConfigurationError as error:
            self.log.warn(str(error))


main = partial(run_node, DriftMonitorNode)
