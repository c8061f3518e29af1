"""Fault handling of a run: tip up, ask a person, wait for devices, and decide whether the run continues."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from tactile_nodes.collection.actions import Procedure
from tactile_nodes.collection.hands import Hands, TrippedError
from tactile_nodes.collection.machine_record import BEGUN, ENDED, MachineRecord
from tactile_nodes.collection.press.rest import await_recovery, zero
from tactile_nodes.collection.press.up import bring_up, check_free, not_up
from tactile_nodes.collection.run.outlet import Outlet
from tactile_nodes.collection.run.person import require_looked
from tactile_nodes.collection.safety import CAMERA, FORCE, MACHINE, OVERLOAD, PASSING, SENSOR, SILENT_MACHINE, Trip
from tactile_nodes.collection.settings import CollectionSettings
from tactile_nodes.collection.wrench import Tare
from tactile_nodes.errors import DeviceError, DeviceFaultError

Result = TypeVar('Result')
TOO_GREAT = {FORCE, OVERLOAD}


class Recovery:
    """Handles a trip; `tare` is the last reading of the unloaded sensor.

    Args:
        hands: the machine.
        settings: limits.
        record: where it is noted that the machine moves, was halted, or has its tip up.
        outlet: receives messages and questions.
        shaken: called after a collision, or when the machine became silent, because steps may be lost.
    """

    def __init__(
        self,
        hands: Hands,
        settings: CollectionSettings,
        record: MachineRecord,
        outlet: Outlet,
        shaken: Callable[[], None],
    ) -> None:
        self._hands = hands
        self._settings = settings
        self._record = record
        self._outlet = outlet
        self._shaken = shaken
        self.tare: Tare | None = None
        self.waited_ns = 0
        """How long the run has waited for a person."""
        self._nothing_moved = False  # since the tip was found free: a force is none of the gel

    @property
    def unwaited_ns(self) -> int:
        """The time, without that for which the run has waited for a person."""
        return self._hands.clock.now_ns() - self.waited_ns

    def begin(self, run_name: str) -> None:
        """Note that the machine moves from now on, for a run of this name."""
        self._note(BEGUN, run_name)

    def end(self) -> str:
        """Go up at the end of the run; empty, or why the tip is not up, which is also reported.

        It does not raise that, because the run may have ended for another reason.
        """
        try:
            self.up()
        except DeviceError as error:
            why = not_up(error)
            self._outlet.say(why)
            return why
        finally:
            self._write_down(self._hands.safety.trip)  # of a force on the way up
        self._note(ENDED)
        return ''

    def ask_first(self, unasked: bool) -> None:
        """Ask a person after a halted run, and, if not `unasked`, after a run that was cut off.

        Raises:
            InterruptedRunError: the run was asked to end.
        """
        if why := self._record.question(unasked):
            self._ask(why)

    def up(self, tare: Tare | None = None, doubted: bool = False) -> None:
        """Bring the tip up. Raises as `bring_up`."""
        doubted = doubted or self._hands.machine_failed or self._hands.safety.machine_tripped
        bring_up(self._hands, tare or self.tare, self._settings, doubted)

    def write_down(self, tripped: TrippedError) -> None:
        """Note that a person must check, before anything moves, so that no other process continues either."""
        self._write_down(self._worst(tripped))

    def go_on_after(self, tripped: TrippedError) -> None:
        """The tip is up; check whether the run can continue.

        Raises:
            DeviceError: it cannot.
            InterruptedRunError: the run was asked to end.
            TrippedError: there is a new fault.
        """
        trip = self._worst(tripped)
        if trip.kind == MACHINE:
            raise DeviceFaultError(trip.reason) from tripped
        if trip.kind in {*TOO_GREAT, SILENT_MACHINE}:
            self._shaken()
        if trip.kind == OVERLOAD:
            self._halt(trip)
        if trip.kind != FORCE:
            self._await_well(trip.reason)
        for _ in range(self._settings.limits.rejects_in_a_row - 1):
            try:
                return self._require_free(trip)
            except TrippedError as again:
                if again.trip.kind not in {*PASSING, OVERLOAD}:
                    raise
                self._await_well(again.trip.reason)
        return self._require_free(trip)

    def patiently(self, procedure: Callable[[], Procedure[Result]], tip_is_up: bool = False) -> Result:
        """Run a procedure; restart it if a device became silent, or after a person has checked.

        If it leaves the tip up, a force is none of the gel; one above its limit is waited for until it is over.
        """
        for _ in range(self._settings.limits.rejects_in_a_row - 1):
            try:
                return self._hands.run(procedure())
            except TrippedError as tripped:
                self.write_down(tripped)
                kind = self._worst(tripped).kind
                if tip_is_up and kind in {FORCE, SENSOR, CAMERA}:
                    self._hands.retreat()
                    if kind == FORCE:
                        self._await_well(tripped.trip.reason)
                    self._nothing_moved = True  # a hand may stay on the tool, with less than the limit
                else:
                    self.up()
                    if self._worst(tripped).kind not in {*PASSING, OVERLOAD}:
                        raise
                self.go_on_after(tripped)
        return self._hands.run(procedure())

    def _write_down(self, trip: Trip | None) -> None:
        if trip is not None and trip.kind == OVERLOAD:
            self._record.halt(self._hands.clock.now_ns(), trip.reason)

    def _halt(self, trip: Trip) -> None:
        """Note that a person must check, and wait for that."""
        self._write_down(trip)
        self._ask(trip.reason)
        self._nothing_moved = True  # but a sensor drifts while a person is awaited
        self._hands.safety.reset(self._hands.clock.now_ns(), trip)

    def _await_well(self, reason: str) -> None:
        """Wait for silent devices; a sensor that is back may show a force for which a person must check."""
        self._outlet.say(f'{reason}; the tip is up, waiting until it has recovered')
        while True:
            try:
                return await_recovery(self._hands, self._settings.limits, reason)
            except TrippedError as tripped:
                if tripped.trip.kind != OVERLOAD:
                    raise
                self._shaken()
                self._halt(tripped.trip)

    def _require_free(self, handled: Trip) -> None:
        """Check for faults again, and for contact; if nothing has moved, the force is the new zero instead."""
        self._hands.safety.reset(self._hands.clock.now_ns(), handled)
        if self.tare is not None and self._nothing_moved:
            self.tare = self._hands.run(zero(self._settings))
        elif self.tare is not None:
            self._hands.safety.tare(self.tare.wrench)
            self._hands.run(check_free(self.tare, self._settings))
        self._nothing_moved = False

    def _worst(self, tripped: TrippedError) -> Trip:
        """The current trip, which may be worse than `tripped`: the force still grows while the machine stops."""
        return self._hands.safety.trip or tripped.trip

    def _ask(self, why: str) -> None:
        since_ns = self._hands.clock.now_ns()
        require_looked(why, self._outlet.person, self._record, self._hands)
        self.waited_ns += self._hands.clock.now_ns() - since_ns

    def _note(self, step: str, reason: str = '') -> None:
        self._record.note(step, self._hands.clock.now_ns(), reason)
