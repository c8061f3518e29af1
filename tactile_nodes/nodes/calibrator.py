"""Makes a model for another gel from the presses of a running rig, or of a bag, and switches the estimator to it.

Subscribes to ``press``, ``press_image``, ``reference_image``, ``rig_state`` and ``flow_features``. At the end it sets
the parameter ``model`` of the force estimator. ``~/finish`` (std_srvs/Trigger) ends the presses at once.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.clock import Clock
from tactile_nodes.conversions import image_array
from tactile_nodes.errors import BusError, TactileError
from tactile_nodes.learning.calibrating.live_model import LiveModel
from tactile_nodes.learning.calibrating.presses import BagPresses
from tactile_nodes.learning.calibrating.session import CalibrationSession, CalibrationSettings
from tactile_nodes.learning.recorded.rig_presses import RigPresses
from tactile_nodes.messages import services, types

LOOK_S = 0.25


@dataclass(frozen=True)
class CalibratorParams(CalibrationSettings, NodeParams):
    """Parameters of the calibrator node."""


class CalibratorNode(Node):
    """The calibration runs in its own thread; the node's thread receives messages and answers services."""

    NAME = 'calibrator'
    PARAMS = CalibratorParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        self._session = CalibrationSession(self.params, self._tell)
        self._rig = RigPresses(self._stop_rig)
        estimator = self.params.estimator
        self._live = LiveModel(bus, self.names.resolve(estimator)) if estimator else None
        if not self.params.bag:
            self.create_subscription(topics.PRESS_IMAGE, lambda received: self._rig.image(received.message))
            self.create_subscription(topics.RIG_STATE, lambda received: self._rig.state(received.message))
            self.create_subscription(topics.PRESS, self._on_press)
            self.create_timer(LOOK_S, self._look)
        self.create_subscription(topics.REFERENCE_IMAGE, self._on_reference)
        self._features = self.create_subscription(topics.FLOW_FEATURES, self._on_features)
        self.create_trigger('~/finish', self._finish)
        self._thread: threading.Thread | None = None
        self.post(self._begin)  # after latched messages that have already arrived

    def on_close(self) -> None:
        self._session.end()
        self._rig.end()
        if self._thread is not None:
            self._thread.join(timeout=1.0)

    def _begin(self) -> None:
        self._thread = self.run_beside('calibration', self._calibrate)

    def _calibrate(self) -> None:
        bag = self.params.bag
        try:
            presses = BagPresses([Path(bag)], tell=self._tell) if bag else self._rig
            self._session.run(presses, self._live)
        except TactileError as error:
            if not self._session.ended:  # else the presses ended because this node was asked to end
                raise
            self.log.info(f'ended before the calibration was finished: {error}')
            return
        if not self.params.stay:
            self.stop()

    def _tell(self, text: str) -> None:
        self.log.info(text)
        self.report('calibration', Level.OK, text, **self._session.values)

    def _on_press(self, received: Received) -> None:
        self._rig.press(received.message, received.data, self.clock.now_ns())

    def _on_reference(self, received: Received) -> None:
        if self.params.bag:
            self._session.calibrator.live_rest = image_array(received.message)
        else:
            self._rig.reference(received.message)

    def _on_features(self, received: Received) -> None:
        """The first message shows whether the running sensor fits this model."""
        self._features.close()
        try:
            self._session.require_features(received.message)
        except TactileError as error:
            self.fail('calibration', error)
            if not self.params.bag:
                self._rig.stop()

    def _look(self) -> None:
        there = self.bus.graph().publishers(self.names.resolve(topics.PRESS.name))
        if became := self._rig.look(self.clock.now_ns(), bool(there)):
            self.log.info(f'{self.params.rig} {became}')

    def _stop_rig(self) -> None:
        service = f'{self.names.resolve(self.params.rig)}/{self.params.rig_end}'
        try:
            answer = self.bus.call(service, services.TRIGGER, types.Trigger_Request())
            self.log.info(f'{self.params.rig}: {answer.message}')
        except BusError as error:
            self.log.warn(f'{self.params.rig} could not be asked to end: {error}')
            self._rig.end()

    def _finish(self) -> str:
        self._session.calibrator.asked_to_finish = True
        if not self.params.bag:
            self.post(self._rig.stop)  # a paused or halted rig would send no further press
        return 'the calibration starts with the presses so far'


main = partial(run_node, CalibratorNode)
