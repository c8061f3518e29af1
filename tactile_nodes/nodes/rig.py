"""Presses the gel as in a plan; publishes machine state, force/torque samples, and images of a camera node.

Publishes ``force_torque``, ``force_torque_counts``, ``serial_traffic``, ``rig_state``, ``sync_edge``, ``press``,
``press_image`` and ``reference_image``; subscribes to ``image_raw`` and ``camera_info``; offers ``~/pause``,
``~/resume``, ``~/stop`` and ``~/acknowledge`` (std_srvs/Trigger). It ends with the plan. If it was killed, it can be
started again at once. It then asks a person before anything moves, unless ``after_kill`` is ``go_on``; after a failed
run, a person has to check.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import NodeArguments
from tactile_nodes.bus.node.diagnostics import Level
from tactile_nodes.bus.node.node import Node, NodeParams
from tactile_nodes.bus.node.priority import crowded, lacking
from tactile_nodes.bus.node.runtime import run_node
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.collection.run.session import RigSettings, Session
from tactile_nodes.collection.run.voice import TOPICS
from tactile_nodes.collection.station import LEAVE_S
from tactile_nodes.errors import NOT_AGAIN, DeviceError, DeviceFaultError
from tactile_nodes.messages import stamp_ns
from tactile_nodes.params import parameter
from tactile_nodes.sensing.geometry import described_part, middle_part
from tactile_nodes.sensors import load_sensor

STATUS_S = 1.0
_PAUSED = 'paused'
SELDOM_S = 10.0  # interval of progress messages without a terminal


@dataclass(frozen=True)
class RigParams(RigSettings, NodeParams):
    READ_ONLY: ClassVar[bool] = True

    sensor: str = parameter(
        '',
        'sensor description (name or file) for pictures of another camera node: those of its size are cropped as it '
        'says, others are not; empty: the central 440x440 px',
    )


class RigNode(Node):
    """The run has its own thread; the node's thread receives images and answers services."""

    NAME = 'rig'
    PARAMS = RigParams
    FAILURE_STATUS = NOT_AGAIN
    END_WITHIN_S = LEAVE_S + 1.0

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock or bus.clock)  # devices do not follow a simulated time
        publishers = {topic: self.create_publisher(topic) for topic in TOPICS}
        if notice := lacking():
            self.log.info(notice)
        answer = f"tactile service call {self.full_name}/acknowledge std_srvs/srv/Trigger '{{}}'"
        self._session = Session(self.params, publishers, self.clock, self.log, answer, self.still_wanted)
        self.diagnostics.hardware |= {'cnc': self.params.cnc.source, 'force_torque': self.params.force_torque.source}
        self._session.campaign.paused = self.kept.get(_PAUSED) is not None
        self._cropped_px = 0, 0
        self._described = load_sensor(self.params.sensor).image if self.params.sensor else None
        self.create_subscription(topics.CAMERA_INFO, self._on_camera_info)
        self.create_subscription(topics.IMAGE, self._on_image)
        self.create_trigger('~/pause', lambda: self._pause(True))
        self.create_trigger('~/resume', lambda: self._pause(False))
        self.create_trigger('~/stop', self._stop_run)
        self.create_trigger('~/acknowledge', self._session.person.acknowledge)
        self.create_timer(STATUS_S, self._report)
        self.run_beside('collection', self._collect)

    def on_close(self) -> None:
        self._session.close()

    def _collect(self) -> None:
        try:
            self.log.info(self._session.run())
        except DeviceError as error:
            if not self._session.station.safety.fell_silent or not (explanation := crowded()):
                raise
            raise DeviceFaultError(f'{error}; {explanation}') from error
        self.stop()

    def _report(self) -> None:
        campaign, station = self._session.campaign, self._session.station
        progress = campaign.progress
        text = self._session.person.question or self._paused() + progress.line(campaign.now)
        waits = campaign.paused or bool(self._session.person.question)
        level = Level.WARN if waits or station.safety.trip is not None else Level.OK
        self.report(
            'collection', level, text, plan=self._session.plan.plan_id, done=progress.done, presses=progress.presses,
            rejected=progress.rejected, seconds_left=progress.seconds_left, greatest_force_n=station.safety.greatest_n,
        )  # fmt: skip
        for part, health in (('cnc', station.cnc.health), ('force_torque', station.sensor.health)):
            self.report(part, Level(health.level), health.message)
        if sys.stderr.isatty() or math.fmod(self.clock.now_ns() / NS_PER_S, SELDOM_S) < STATUS_S:
            self.log.info(text)

    def _paused(self) -> str:
        campaign = self._session.campaign
        return ('paused, ' if campaign.stands else 'pausing, ') if campaign.paused else ''

    def _on_camera_info(self, received: Received) -> None:
        cut = received.message.roi
        self._cropped_px = cut.width, cut.height

    def _on_image(self, received: Received) -> None:
        message = received.message
        picture = conversions.image_array(message)
        if self._cropped_px != (message.width, message.height):  # else our camera node has cropped it, to any shape
            picture = described_part(picture, self._described) if self._described else middle_part(picture)
        self._session.image(stamp_ns(message.header.stamp), picture)

    def _pause(self, paused: bool) -> str:
        self._session.campaign.paused = paused
        if paused:
            self.kept.put(_PAUSED, b'')  # else a rig that is killed while paused would press again without being asked
        else:
            self.kept.drop(_PAUSED)
        return 'pausing after this press' if paused else 'continuing'

    def _stop_run(self) -> str:
        self._session.stop()
        return 'stopping: the tip is lifted, and the run ends; when started again it continues with the next press'


main = partial(run_node, RigNode)
