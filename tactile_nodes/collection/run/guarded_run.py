"""A guarded approach on a rig: home, move above the gel, search for the force on its topic, hold it, move up again.

The force/torque sensor is not part of the loop. It enforces the rig's own limits (`Safety`), and at the end it measures
the held force and whether the tip is free. The force is not compared with a surface search (`rising`): there was none,
and the tip may meet something other than the gel.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.collection.actions import Go, Look, Procedure
from tactile_nodes.collection.hands import InterruptedRunError, TrippedError
from tactile_nodes.collection.machine_record import BEGUN, ENDED, MachineRecord, record_file
from tactile_nodes.collection.press.guarded import OK, Feel, Felt, Guarded, GuardSettings
from tactile_nodes.collection.press.rest import go_to_gel, zero
from tactile_nodes.collection.press.speed import check_speeds, longest_period_s
from tactile_nodes.collection.press.surface import check_safe_height
from tactile_nodes.collection.press.up import bring_up, not_up
from tactile_nodes.collection.press.workspace import check_approach
from tactile_nodes.collection.readings import Readings
from tactile_nodes.collection.run.person import AFTER_KILL, ASK, GO_ON, Person, require_looked
from tactile_nodes.collection.safety import OVERLOAD
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.station import Station
from tactile_nodes.collection.wrench import Array, Tare, pressing_n, wrenches
from tactile_nodes.drivers.cnc.contract import Cnc, CncSettings
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.errors import DeviceError, DeviceFaultError, DeviceTimeoutError, TactileError
from tactile_nodes.params import parameter

LOOK_S = 0.005
LATE_S = 0.2  # samples of the force/torque sensor usually arrive at most this late
LATE_LOOKS = 10  # on a busy computer later


@dataclass(frozen=True)
class GuardedRunSettings(CollectionSettings):
    """A rig, where on the gel to go down, and the approach itself."""

    guard: GuardSettings = field(default_factory=GuardSettings)
    cnc: CncSettings = field(default_factory=CncSettings)
    force_torque: ForceTorqueSettings = field(default_factory=ForceTorqueSettings)
    world: WorldSettings = field(default_factory=WorldSettings)
    x_mm: float = parameter(0.0, "where to go down, from the centre of the gel along the machine's x")
    y_mm: float = parameter(0.0, "where to go down, from the centre of the gel along the machine's y")
    wait_s: float = parameter(20.0, 'how long to wait for the first force', minimum=0.0)
    after_kill: str = parameter(ASK, AFTER_KILL, choices=(ASK, GO_ON))


@dataclass(frozen=True)
class Outcome:
    """The held force: by the gel at each frame, and by the force/torque sensor at the same time, in N."""

    gel_n: Array
    sensor_n: Array
    seconds: float
    steps: int
    approach_s: float
    greatest_n: float

    def __str__(self) -> str:
        gel, sensor = self.gel_n, self.sensor_n
        return (
            f'reached in {self.approach_s:.1f} s and {self.steps} steps; held for {self.seconds:.1f} s: by the gel '
            f'{gel.mean():.4f} N, spread {gel.std():.4f} N over {len(gel)} frames; by the force/torque sensor '
            f'{sensor.mean():.4f} N, spread {sensor.std():.4f} N over {len(sensor)} samples; greatest force by the gel '
            f'{self.greatest_n:.4f} N'
        )


class GuardedRun:
    """Opens the rig; `run` makes one approach.

    Args:
        settings: rig and approach.
        clock: the host's.
        feel: returns the newest force.
        person: is asked after the previous run of the machine was cut off or halted.

    Raises:
        ConfigurationError, DeviceError: a device that cannot be opened.
        ConfigurationError: a safe height that is perhaps in the gel, a feed too fast to be stopped in time, or a way
            that leaves the workspace.
    """

    def __init__(self, settings: GuardedRunSettings, clock: Clock, feel: Feel, person: Person) -> None:
        self._settings = s = settings
        self._feel = feel
        self._clock = clock
        self._person = person
        self._begun = self._homed = False
        check_safe_height(s, s.cnc.safe_z_mm)
        self._tare: Tare | None = None
        nothing: Callable[[object], None] = lambda _: None  # noqa: E731
        self.station = Station(s, s.cnc, s.force_torque, s.world, clock, nothing, nothing, nothing)
        try:
            check_speeds(s, self.station.cnc, longest_period_s(self.station.sensor))
            check_approach(s.x_mm, s.y_mm, s.guard.travel_mm, s, self.station.cnc.limits)
            self._record = MachineRecord(record_file(s.cnc.source, None))
        except BaseException:
            self.station.close()
            raise

    def run(self) -> Outcome | None:
        """One approach, which always ends with the tip up; returns the held force, None if `stop` ended it.

        Raises:
            DeviceError: it gave up, and why; or the tip is not up, or that is unknown.
        """
        why = ''
        try:
            return self._approach()
        except InterruptedRunError:
            return None
        except TrippedError as tripped:
            why = f'the approach gave up: {tripped}'
            self._write_down()
            raise DeviceFaultError(why) from tripped
        except DeviceError as error:
            why = str(error)
            raise
        finally:
            if self._begun and (self._homed or _is_homed(self.station.cnc)):
                self._up(why)

    def stop(self) -> None:
        """Ask the run to end, with the tip up; returns at once."""
        self.station.stop()

    def close(self, run: threading.Thread | None = None, within_s: float = 0.0) -> bool:
        """Close the devices when the run has ended, as `Station.close_after`."""
        return self.station.close_after(run, within_s)

    def _approach(self) -> Outcome:
        hands = self.station.hands
        if why := self._record.question(self._settings.after_kill == GO_ON):
            require_looked(why, self._person, self._record, hands)
        hands.safety.watch(self._clock.now_ns(), camera=False)
        self._note(BEGUN, 'a guarded approach')
        self._begun = True
        hands.home()
        self._homed = True
        self._tare = hands.run(above_gel(self._settings, self._feel))
        return hands.run(guarded_approach(self._settings, hands.readings, self._feel, self._tare))

    def _write_down(self) -> None:
        """Note that a person must check, before the tip goes up."""
        trip = self.station.safety.trip
        if trip is not None and trip.kind == OVERLOAD:
            self._record.halt(self._clock.now_ns(), trip.reason)

    def _note(self, step: str, reason: str = '') -> None:
        self._record.note(step, self._clock.now_ns(), reason)

    def _up(self, why: str) -> None:
        """Bring the tip up. If that fails, the error names this first, and then `why` the approach ended."""
        hands = self.station.hands
        doubted = hands.machine_failed or hands.safety.machine_tripped
        try:
            bring_up(hands, self._tare, self._settings, doubted)
        except DeviceError as error:
            raise DeviceFaultError(f'{not_up(error)} (before that: {why})' if why else not_up(error)) from error
        finally:
            self._write_down()  # of a force on the way up
        self._note(ENDED)


def _is_homed(cnc: Cnc) -> bool:
    """Whether the machine knows its position, although homing has not returned."""
    try:
        return cnc.status().homed
    except DeviceError:
        return False


def above_gel(settings: GuardedRunSettings, feel: Feel) -> Procedure[Tare]:
    """Move above the gel, and read the unloaded sensor.

    Raises:
        DeviceError: no force within `wait_s`, the force/torque sensor has a fault, or the tip touches already.
    """
    yield from go_to_gel(settings, settings.cnc.safe_z_mm, (settings.x_mm, settings.y_mm))
    yield from first_force(settings.wait_s, feel)
    yield Go(z=settings.surface.top_mm, feed_mm_min=settings.motion.approach_mm_min)
    return (yield from zero(settings))


def guarded_approach(settings: GuardedRunSettings, readings: Readings, feel: Feel, tare: Tare) -> Procedure[Outcome]:
    """From above the gel to the end of the hold.

    Raises:
        DeviceError: the loop gives up (`Guarded.step_mm`).
    """
    observation = yield Look(LOOK_S)
    guarded = Guarded(settings.guard, observation.now_ns)
    measured: list[tuple[int, float]] = []

    def measure() -> None:
        """Keep the samples since the hold began: `readings` drops them after some seconds."""
        if guarded.hold.stamps_ns:
            since_ns = measured[-1][0] + 1 if measured else guarded.hold.stamps_ns[0]
            samples = readings.samples(since_ns)
            forces_n = pressing_n(wrenches(samples), tare, settings.mounting).tolist()
            measured.extend(zip((sample.stamp_ns for sample in samples), forces_n, strict=True))

    yield from felt_for(guarded, settings.surface.top_mm, settings.motion.press_mm_min, feel, measure)
    for _ in range(LATE_LOOKS):
        yield Look(LATE_S)
        measure()
        if measured and measured[-1][0] >= guarded.hold.stamps_ns[-1]:
            break
    return outcome(guarded, observation.now_ns, measured)


def first_force(wait_s: float, feel: Feel) -> Procedure[Felt]:
    """Wait for a valid force."""
    observation = yield Look(LOOK_S)
    end_ns = observation.now_ns + round(wait_s * NS_PER_S)
    while (felt := feel()) is None or felt.status != OK:
        observation = yield Look(10 * LOOK_S)
        if observation.now_ns > end_ns:
            raise DeviceTimeoutError(f'no valid force within {wait_s:g} s; is the sensor running?')
    return felt


def felt_for(
    guarded: Guarded, top_mm: float, feed_mm_min: float, feel: Feel, measure: Callable[[], None]
) -> Procedure[None]:
    """Step by step down from a height until the hold is over; `measure` is called at each look."""
    z_mm = top_mm
    while not guarded.done:
        yield Look(LOOK_S)
        measure()
        felt = feel()
        observation = yield Look(0.0)  # the time after the force, which a pause in between would date in the future
        step_mm = guarded.step_mm(observation.now_ns, felt)
        if step_mm:
            z_mm -= step_mm
            observation = yield Go(z=z_mm, feed_mm_min=feed_mm_min)
            guarded.rested(observation.now_ns)


def outcome(guarded: Guarded, start_ns: int, measured: Sequence[tuple[int, float]]) -> Outcome:
    """Forces of gel and force/torque sensor at the same time; after a hold of no duration, the sensor's next one.

    Args:
        guarded: with a hold.
        start_ns: start of the approach.
        measured: stamp and force of each sample of the force/torque sensor since the hold began.
    """
    stamps = guarded.hold.stamps_ns
    sensor_n = [force_n for stamp_ns, force_n in measured if stamp_ns < stamps[-1]] or [
        force_n for _, force_n in measured[:1]
    ]
    if not sensor_n:
        raise TactileError('the force/torque sensor measured nothing while the force was held; check it')
    return Outcome(
        gel_n=np.array(guarded.hold.forces_n),
        sensor_n=np.array(sensor_n),
        seconds=guarded.hold.seconds,
        steps=guarded.steps,
        approach_s=(stamps[0] - start_ns) / NS_PER_S,
        greatest_n=guarded.greatest_n,
    )
