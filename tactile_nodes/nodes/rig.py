"""Presses the gel by a plan and tells what it measures: machine, force/torque sensor, and the images of a camera node.

Publishes ``force_torque``, ``rig_state``, ``sync_edge``, ``press``, ``press_image`` and ``reference_image``; takes
``image_raw``; offers ``~/pause``, ``~/resume`` and ``~/stop`` (std_srvs/Trigger). It ends by itself with the plan.
"""

from __future__ import annotations

import math
import sys
import threading
import traceback
from dataclasses import dataclass, field
from pathlib import Path

from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.arguments import NodeArguments
from tactile_nodes.bus.diagnostics import Level
from tactile_nodes.bus.node import Node, NodeParams
from tactile_nodes.bus.protocol import Bus, Received
from tactile_nodes.bus.runtime import run_node
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.collection import telling
from tactile_nodes.collection.audit import audit
from tactile_nodes.collection.campaign import Campaign
from tactile_nodes.collection.cycle import Record
from tactile_nodes.collection.journal import Entry, Journal
from tactile_nodes.collection.order import ordered
from tactile_nodes.collection.outlet import Outlet
from tactile_nodes.collection.plan import PlanSettings, load_plan_settings, make_plan
from tactile_nodes.collection.readings import Picture
from tactile_nodes.collection.recall import recalled
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.station import Station
from tactile_nodes.drivers.cnc import CncSettings, CncStatus, Switched
from tactile_nodes.drivers.force_torque import ForceTorqueSettings, Sample
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.errors import BusError, DeviceNotFoundError, DeviceTimeoutError, TactileError
from tactile_nodes.messages import stamp_ns
from tactile_nodes.params import parameter

STATUS_S = 1.0
LEAVE_S = 1.5
BETWEEN = 0


@dataclass(frozen=True)
class RigParams(CollectionSettings, NodeParams):
    """Parameters of the rig node."""

    folder: str = parameter('collection', 'where the journal lies, and the bags that it is compared with')
    plan_file: str = parameter('', 'YAML of a plan (config/plans); empty: the plan below `plan`')
    plan: PlanSettings = field(default_factory=PlanSettings)
    cnc: CncSettings = field(default_factory=CncSettings)
    force_torque: ForceTorqueSettings = field(default_factory=ForceTorqueSettings)
    world: WorldSettings = field(default_factory=WorldSettings)
    wait_s: float = parameter(20.0, 'how long camera and recorder may take to come', minimum=0.0)
    require_recorder: bool = parameter(True, 'press only while somebody records')
    sensor_frame_id: str = parameter('force_torque_sensor', 'frame of the force samples')
    machine_frame_id: str = parameter('rig', "frame of the machine's coordinates")
    surface_frame_id: str = parameter('gel_surface', 'frame of the presses')
    camera_frame_id: str = parameter('gel_camera_optical_frame', 'frame of the images')


class RigNode(Node):
    """The run has a thread of its own; this node's thread takes images in and answers."""

    NAME = 'rig'
    PARAMS = RigParams

    def __init__(self, bus: Bus, arguments: NodeArguments | None = None, clock: Clock | None = None) -> None:
        super().__init__(bus, arguments, clock)
        p = self.params
        settings = load_plan_settings(Path(p.plan_file)) if p.plan_file else p.plan
        self._plan = make_plan(settings)
        self._force, self._state, self._edge, self._press, self._picture, self._rest = (
            self.create_publisher(topic)
            for topic in (
                topics.FORCE_TORQUE, topics.RIG_STATE, topics.SYNC_EDGE, topics.PRESS, topics.PRESS_IMAGE,
                topics.REFERENCE_IMAGE,
            )
        )  # fmt: skip
        self._edges = 0
        self._campaign: Campaign | None = None
        self._journal = Journal(Path(p.folder) / f'{self._plan.plan_id}.jsonl', self._plan)
        self._station: Station | None = None
        try:
            self._audit()
            self._station = station = self._opened()
            outlet = Outlet(
                self._on_record, self._on_rest_image, self.log.info, self._require_recorder,
                self._on_suspect, self._recall,
            )  # fmt: skip
            order = ordered(self._plan, settings)
            self._campaign = Campaign(
                self._plan, order, self._journal, station.hands, p, p.cnc.safe_z_mm, outlet, 1 / station.sensor.rate_hz
            )
        except BaseException:
            self.on_close()
            raise
        self.create_subscription(topics.IMAGE, self._on_image)
        self.create_trigger('~/pause', lambda: self._pause(True))
        self.create_trigger('~/resume', lambda: self._pause(False))
        self.create_trigger('~/stop', self._stop_run)
        self.create_timer(STATUS_S, self._report)
        self._runner = threading.Thread(target=self._collect, name='collection', daemon=True)
        self._runner.start()

    def _opened(self) -> Station:
        """The devices, once they are there: a rig that was just switched on takes its time."""
        p = self.params
        told = (self._on_sample, self._on_status, self._on_switch)
        deadline_ns = self.clock.now_ns() + round(p.wait_s * NS_PER_S)
        while True:
            try:
                return Station(p, p.cnc, p.force_torque, p.world, self.clock, *told)
            except (DeviceNotFoundError, DeviceTimeoutError) as error:
                if self.clock.now_ns() > deadline_ns:
                    raise
                self.log.warn(f'waiting for a device: {error}', once=type(error).__name__)
            self.clock.sleep_until(self.clock.now_ns() + NS_PER_S // 4)

    def on_close(self) -> None:
        if self._station is not None:
            self._station.hands.asked_to_stop = True
            if (runner := getattr(self, '_runner', None)) is not None:
                runner.join(LEAVE_S)
            self._station.close()
        self._journal.close()

    # The run.

    def _collect(self) -> None:
        assert self._campaign is not None
        try:
            self._await_partners()
            self.log.info(self._campaign.run())
        except TactileError as error:
            self.fail('collection', error)
        except Exception:  # noqa: BLE001 - a bug: the tip is up by now; say all we know, and end
            self.log.fatal(f'a bug ends this run:\n{traceback.format_exc()}')
            self.fail('collection', TactileError('a bug ended this run; please report what was said before'))
        else:
            self.stop()

    def _await_partners(self) -> None:
        assert self._station is not None
        deadline_ns = self.clock.now_ns() + round(self.params.wait_s * NS_PER_S)
        while self.clock.now_ns() < deadline_ns and not self._station.hands.asked_to_stop:
            if self._station.readings.frames(0) and (self._recorded() or not self.params.require_recorder):
                return
            self.clock.sleep_until(self.clock.now_ns() + NS_PER_S // 20)

    def _recorded(self) -> bool:
        return all(end.listeners for end in (self._press, self._picture, self._force))

    def _require_recorder(self) -> None:
        if self.params.require_recorder and not self._recorded():
            raise BusError('nobody records press, press_image and force_torque; start a recorder, then this again')

    def _audit(self) -> None:
        if self._journal.repaired:
            self.log.warn(self._journal.repaired)
        found, missing = audit(self._journal, self._plan.plan_id, Path(self.params.folder), self.clock.now_ns())
        if self._journal.done or missing:
            self.log.info(
                f'going on with plan {self._plan.plan_id}: {self._journal.done} of {len(self._plan.points)} presses '
                f'are there, {found} of them just found in the bags; {missing} not found will be done again'
            )

    # What it tells.

    def _on_sample(self, sample: Sample) -> None:
        self._force.publish(telling.sample_message(sample, self.params.sensor_frame_id))

    def _on_status(self, status: CncStatus) -> None:
        campaign, surface = self._campaign, self.params.surface
        press = campaign.now.press if campaign is not None and campaign.now is not None else BETWEEN
        plane = campaign.surface if campaign is not None else None
        gel_mm = (surface.gel_x_mm, surface.gel_y_mm)
        frame_id = self.params.machine_frame_id
        self._state.publish(telling.state_message(status, press, plane, gel_mm, status.state.value, frame_id))

    def _on_switch(self, switched: Switched) -> None:
        self._edges += 1
        self._edge.publish(telling.edge_message(switched, self._edges, self.params.machine_frame_id, 'press'))

    def _on_record(self, record: Record) -> None:
        for frame in (*record.rest, *record.frames):
            head = conversions.header(frame.stamp_ns, self.params.camera_frame_id)
            self._picture.publish(conversions.image_message(frame.image, head))
        indenter = self.params.press.indenter
        self._press.publish(telling.press_message(record, self._plan.plan_id, indenter, self.params.surface_frame_id))

    def _on_suspect(self, entry: Entry, reason: str) -> None:
        frame_id, now_ns = self.params.surface_frame_id, self.clock.now_ns()
        self._press.publish(telling.suspect_message(entry, self._plan.plan_id, reason, now_ns, frame_id))

    def _recall(self, entry: Entry) -> Record | None:
        return recalled(Path(self.params.folder), self._plan.plan_id, entry)

    def _on_rest_image(self, image: Picture, at_ns: int) -> None:
        self._rest.publish(conversions.image_message(image, conversions.header(at_ns, self.params.camera_frame_id)))

    def _report(self) -> None:
        assert self._campaign is not None and self._station is not None
        campaign, station = self._campaign, self._station
        progress = campaign.progress
        text = progress.line(campaign.now)
        level = Level.WARN if campaign.paused or station.safety.trip is not None else Level.OK
        self.report(
            'collection', level, text, plan=self._plan.plan_id, done=progress.done, presses=progress.presses,
            rejected=progress.rejected, seconds_left=progress.seconds_left, greatest_force_n=station.safety.greatest_n,
        )  # fmt: skip
        for part, health in (('cnc', station.cnc.health), ('force_torque', station.sensor.health)):
            self.report(part, Level(health.level), health.message)
        if sys.stderr.isatty() or math.fmod(self.clock.now_ns() / NS_PER_S, 10) < STATUS_S:
            self.log.info(text)

    # What it is told.

    def _on_image(self, received: Received) -> None:
        assert self._station is not None
        message = received.message
        self._station.image(stamp_ns(message.header.stamp), conversions.image_array(message))

    def _pause(self, paused: bool) -> str:
        assert self._campaign is not None
        self._campaign.paused = paused
        return 'pausing after this press' if paused else 'going on'

    def _stop_run(self) -> str:
        assert self._station is not None
        self._station.hands.asked_to_stop = True
        return 'stopping: the tip goes up, and the run ends; started again it goes on with the next press'


def main() -> int:
    """The program ``rig_node``."""
    return run_node(RigNode)


if __name__ == '__main__':
    sys.exit(main())
