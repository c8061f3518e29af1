"""One run of a plan on a rig: journal, devices and campaign, from checking the bags to closing everything."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tactile_nodes.bus.node.log import Log
from tactile_nodes.bus.protocol import Publisher
from tactile_nodes.bus.topics import Topic
from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.collection.hands import InterruptedRunError
from tactile_nodes.collection.machine_record import MachineRecord, record_file
from tactile_nodes.collection.plan.audit import audit, await_recorded, settle
from tactile_nodes.collection.plan.journal import INDENTER, Journal
from tactile_nodes.collection.plan.order import ordered
from tactile_nodes.collection.plan.plan import PlanSettings, load_plan_settings, make_plan, plan_path
from tactile_nodes.collection.press.cycle import Record
from tactile_nodes.collection.press.speed import longest_period_s
from tactile_nodes.collection.readings import Picture
from tactile_nodes.collection.run.campaign import Campaign
from tactile_nodes.collection.run.outlet import Outlet
from tactile_nodes.collection.run.person import AFTER_KILL, ASK, GO_ON, Person
from tactile_nodes.collection.run.recall import recalled
from tactile_nodes.collection.run.voice import Names, Voice
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.station import LEAVE_S, NOT_UP_YET, Station
from tactile_nodes.contact_tables.gel_tables import load_gel
from tactile_nodes.drivers.cnc.contract import SIMULATED, CncSettings, CncStatus
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings
from tactile_nodes.drivers.waiting import opened_within
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.errors import (
    BusError,
    ConfigurationError,
    DeviceBusyError,
    DeviceError,
    DeviceNotFoundError,
    DeviceTimeoutError,
)
from tactile_nodes.params import parameter
from tactile_nodes.simulation.indenter import indenter_name

NOT_THERE_YET = (DeviceNotFoundError, DeviceBusyError, DeviceTimeoutError)
"""Errors of a rig that was just switched on: opening it is retried."""


@dataclass(frozen=True)
class RigSettings(CollectionSettings):
    """A collection with its plan, its devices, and its files."""

    folder: str = parameter('collection', 'folder with the journal and the bags that it is compared with')
    plan_file: str = parameter('', 'name of a plan in config/plans, or a YAML file; empty: the plan below `plan`')
    plan: PlanSettings = field(default_factory=PlanSettings)
    anew: bool = parameter(False, 'do the whole plan again at each start, instead of the rest of it')
    after_kill: str = parameter(ASK, AFTER_KILL, choices=(ASK, GO_ON))
    cnc: CncSettings = field(default_factory=CncSettings)
    force_torque: ForceTorqueSettings = field(default_factory=ForceTorqueSettings)
    world: WorldSettings = field(default_factory=WorldSettings)
    wait_s: float = parameter(
        20.0, 'how long to wait for camera and recorder, at the start or after a loss', minimum=0.0
    )
    require_recorder: bool = parameter(True, 'press only while a recorder is running')
    sensor_frame_id: str = parameter('force_torque_sensor', 'frame of the force samples')
    machine_frame_id: str = parameter('rig', "frame of the machine's coordinates")
    surface_frame_id: str = parameter('gel_surface', 'frame of the presses')
    camera_frame_id: str = parameter('gel_camera_optical_frame', 'frame of the images')


def with_indenter(settings: RigSettings) -> RigSettings:
    """The settings with the name of the indenter.

    It is `press.indenter`, or the indenter of `world` if the machine is simulated or the name is empty.

    Raises:
        ConfigurationError: a gel that cannot be read.
    """
    if settings.cnc.source != SIMULATED and settings.press.indenter:
        return settings
    world = settings.world
    name = indenter_name(load_gel(world.gel).tip_radius_mm, world.indenter)
    return dataclasses.replace(settings, press=dataclasses.replace(settings.press, indenter=name))


class Session:
    """Opens everything; `run` does the rest of the plan.

    Args:
        settings: plan, devices and limits.
        publishers: one for each of `voice.TOPICS`.
        clock: the host's.
        log: for a person.
        answer: the command with which a person answers a question of the run.
        still_wanted: called while a bag is read or a device is waited for; raises if the process is to end.

    Raises:
        ConfigurationError: an invalid plan, journal or limit.
        DeviceError: a device that is not available within `wait_s`.
    """

    def __init__(
        self,
        settings: RigSettings,
        publishers: dict[Topic, Publisher],
        clock: Clock,
        log: Log,
        answer: str,
        still_wanted: Callable[[], None],
    ) -> None:
        self._settings = s = with_indenter(settings)
        self._clock = clock
        self._log = log
        self._still_wanted = still_wanted
        self.person = Person(answer, log.warn, clock)
        plan = load_plan_settings(plan_path(s.plan_file)) if s.plan_file else s.plan
        self.plan = make_plan(plan)
        frames = (s.sensor_frame_id, s.machine_frame_id, s.surface_frame_id, s.camera_frame_id)
        names = Names(*frames, self.plan.plan_id, s.press.indenter, s.force_torque.source, s.cnc.source)
        self._voice = voice = Voice(publishers, names, clock, (s.surface.gel_x_mm, s.surface.gel_y_mm), log.warn)
        self._runner: threading.Thread | None = None
        self._alone_ns = 0
        self._station: Station | None = None
        self._journal = Journal(Path(s.folder) / f'{self.plan.plan_id}.jsonl', self.plan)
        try:
            self._audit()
            self._station = self.station = station = opened_within(
                s.wait_s, self._devices, self._clock, self._waiting, NOT_THERE_YET
            )
            outlet = Outlet(
                self._record, voice.rest_image, log.info, self._require_recorder, voice.suspect,
                lambda entry: recalled(Path(s.folder), self.plan.plan_id, entry, self._run_wanted), self._missing,
                self.person,
            )  # fmt: skip
            machine = MachineRecord(record_file(s.cnc.source, Path(s.folder)))  # no other process has its port now
            self.campaign = Campaign(
                self.plan, ordered(self.plan, plan), self._journal, machine, station.hands, s, s.cnc.safe_z_mm, outlet,
                longest_period_s(station.sensor), s.after_kill == GO_ON,
            )  # fmt: skip
        except BaseException:
            self.close()
            raise

    def run(self) -> str:
        """Do the rest of the plan, in this thread; returns a sentence about the result. Raises as `Campaign.run`."""
        self._runner = threading.current_thread()
        self._await_partners()
        return self.campaign.run()

    def stop(self) -> None:
        """Ask the run to end, with the tip up; returns at once."""
        self.station.stop()

    def close(self) -> None:
        """End the run and close everything, except what a run still needs while its tip is not up."""
        if self._station is not None:
            self.stop()
            if not self._station.close_after(self._runner, LEAVE_S):
                self._log.warn(NOT_UP_YET)
                return
            self._voice.the_rest()
        self._journal.close()

    def image(self, stamp_ns: int, image: Picture) -> None:
        """Add an image. Raises ImageError."""
        self.station.image(stamp_ns, image)

    def _devices(self) -> Station:
        s = self._settings
        voice = self._voice
        return Station(
            s, s.cnc, s.force_torque, s.world, self._clock, voice.sample, self._on_status, voice.switched, voice.passed
        )

    def _waiting(self, error: DeviceError) -> None:
        self._still_wanted()
        self._log.warn(f'waiting for a device: {error}', once=type(error).__name__)

    def _on_status(self, status: CncStatus) -> None:
        self._voice.status(status, self.campaign.now, self.campaign.surface)

    def _await_partners(self) -> None:
        """Wait for camera and recorder; the campaign checks whether they came."""
        start_ns = self._clock.now_ns()
        deadline_ns = start_ns + round(self._settings.wait_s * NS_PER_S)
        while self._clock.now_ns() < deadline_ns and not self.station.hands.asked_to_stop:
            if self.station.readings.frames(0) and self._is_recorded:
                return
            self._clock.sleep_until(self._clock.now_ns() + NS_PER_S // 20)
        self._alone_ns = 0 if self._is_recorded else start_ns

    @property
    def _is_recorded(self) -> bool:
        return self._voice.is_recorded or not self._settings.require_recorder

    def _require_recorder(self) -> bool:
        """See `Outlet.require_recorder`: a killed recorder is restarted by its launch."""
        now_ns, wait_s = self._clock.now_ns(), self._settings.wait_s
        if self._is_recorded:
            self._alone_ns = 0
        elif not self._alone_ns:
            self._alone_ns = now_ns
            self._log.warn(f'no recorder is running; the tip stays up, waiting up to {wait_s:g} s for one')
        elif now_ns - self._alone_ns > wait_s * NS_PER_S:
            raise BusError(
                'no recorder takes press, press_image and force_torque: none is running, or it has stopped, as on a '
                'full disk (see its log); start one, then start this again'
            )
        return self._is_recorded

    def _record(self, record: Record) -> None:
        """Publish an attempt. One without a running recorder is rejected, so that it is made again."""
        if self._settings.require_recorder and not record.reason and self._voice.unheard_ns >= record.start_ns:
            record.reason = 'no recorder was running during the press'
        self._voice.record(record)

    def _missing(self) -> int:
        """See `Outlet.missing`. 0 if no bag of the folder holds any press: then all are recorded elsewhere."""
        if not self._settings.require_recorder:
            return 0
        folder = Path(self._settings.folder)
        held = await_recorded(self._journal, self.plan.plan_id, folder, self._clock, self._run_wanted)
        return settle(self._journal, held, self._clock.now_ns())[1] if held else 0

    def _run_wanted(self) -> None:
        if self.station.hands.asked_to_stop:
            raise InterruptedRunError

    def _audit(self) -> None:
        if self._journal.repaired:
            self._log.warn(self._journal.repaired)
        if self._settings.anew and (done := self._journal.begin_anew(self._clock.now_ns())):
            self._log.info(
                f'starting plan {self.plan.plan_id} anew; presses of earlier runs that remain in their bags: {done}'
            )
        self._check_indenter()
        if self._settings.anew:
            return
        folder, now_ns = Path(self._settings.folder), self._clock.now_ns()
        found = missing = 0
        if self._settings.require_recorder:  # else they are recorded elsewhere
            found, missing = audit(self._journal, self.plan.plan_id, folder, now_ns, self._still_wanted)
        if self._journal.done or missing:
            self._log.info(
                f'resuming plan {self.plan.plan_id}: {self._journal.done} of {len(self.plan.points)} presses are '
                f'done, {found} of them newly found in the bags; {missing} not found will be done again'
            )
        if aside := self._journal.aside:
            self._log.info(f'presses set aside because the force was too large: {len(aside)}; see the journal')

    def _check_indenter(self) -> None:
        """Refuse to mix presses of two indenters in one plan. Raises ConfigurationError."""
        ours, theirs = self._settings.press.indenter, self._journal.indenter
        if theirs not in {'', ours} and self._journal.done:
            raise ConfigurationError(
                f'the presses of this plan in {self._settings.folder} were made with {theirs}, but the indenter is '
                f'{ours}; choose another folder, or set anew: true'
            )
        if theirs != ours:
            self._journal.note_run(INDENTER, self._clock.now_ns(), ours)
