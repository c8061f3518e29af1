"""Common part of controllers on a serial line: an open port, and a dialogue over it."""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

from tactile_nodes.clock import Clock
from tactile_nodes.drivers.cnc.contract import CncSettings, Identity, Traffic
from tactile_nodes.drivers.cnc.dead_man import DeadMan, Step
from tactile_nodes.drivers.cnc.guarded import GuardedCnc
from tactile_nodes.drivers.cnc.link import SILENT, SILENT_IN_MOTION, Link
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.drivers.serial_port import Port
from tactile_nodes.errors import DeviceError, DeviceFaultError


class Dialogue(Protocol):
    """The dialogue with a controller."""

    link: Link
    fault: str
    refusal: str
    generation: int
    place_lost: bool

    @property
    def silent(self) -> bool:
        """Whether a response is overdue."""
        ...

    def require_sound(self, up: bool = False) -> None:
        """Raise the current fault, if any; for motion `up`, only one other than an unknown position."""
        ...

    def close(self) -> None:
        """Close the port."""
        ...


Spoken = TypeVar('Spoken', bound=Dialogue)


class SerialCnc(GuardedCnc, Generic[Spoken]):
    """One controller.

    Args:
        settings: its settings and allowed motion.
        clock: the host's.
        port: opens the port.
        traffic: gets every byte.
        threaded: if false, the waiting thread also reads, for emulators in the same thread.
    """

    def __init__(
        self,
        settings: CncSettings,
        clock: Clock,
        port: Callable[[], Port],
        traffic: Traffic | None = None,
        threaded: bool = True,
    ) -> None:
        super().__init__(settings, clock, settings.source)
        self._open_port = port
        self._traffic = traffic
        self._threaded = threaded
        self._dialogue: Spoken | None = None
        self._identity = Identity('unknown', '')
        self._stops = 0
        self._generation = 0  # of the dialogue, when the current motion was decided
        self._dead_man: DeadMan | None = None

    @property
    def health(self) -> Health:
        """ERROR if lost, locked, halted, restarted, hung or silent."""
        dialogue = self._dialogue
        if dialogue is None:
            return Health(Level.STALE, f'{self._name} is not connected')
        if dialogue.link.lost is not None:
            return Health(Level.ERROR, str(dialogue.link.lost))
        if wrong := dialogue.fault or dialogue.refusal or (SILENT if dialogue.silent else ''):
            silent = dialogue.silent or wrong in {SILENT, SILENT_IN_MOTION}
            return Health(Level.ERROR, f'{self._name} {wrong}', silent=silent)
        return self._health_of(dialogue)

    def close(self) -> None:
        self._dismiss()
        if self._dialogue is not None:
            self._dialogue.close()
            self._dialogue = None
            self._homed = False
        self._at_rest()
        self._motion.forget()

    def _keep_watch(self, steps: Sequence[Step]) -> None:
        """Start the dead man's switch: it lifts the tip if this process ends. Needs a port of the system."""
        descriptor = self._talk().link.descriptor
        if self._dead_man is not None and not self._dead_man.on_watch:
            self._dismiss()
        if self._dead_man is None and descriptor is not None:
            self._dead_man = DeadMan(descriptor, steps)

    def _dismiss(self) -> None:
        if self._dead_man is not None:
            self._dead_man.dismiss()
            self._dead_man = None

    @abstractmethod
    def _health_of(self, dialogue: Spoken) -> Health:
        """Health while it responds."""

    def _require_ready(self, up: bool = False) -> None:
        dialogue = self._talk()
        if dialogue.place_lost:
            self._homed = False
        self._generation = dialogue.generation
        dialogue.require_sound(up)

    @abstractmethod
    def _await_lifted(self, timeout_s: float) -> None:
        """Wait until a way up from an unknown position is done, or was stopped."""

    @property
    def _locks_itself(self) -> bool:
        """Whether the controller obeys no motion after it has restarted."""
        return False

    def _lift(self) -> None:
        """If the position is unknown, go straight up, as far as the tip can be below the safe height; once.

        Straight up is the way that the tip came. Nothing counts as up after that: the position stays unknown.
        """
        dialogue, low_mm, stops = self._talk(), self._motion.lowest_mm, self._stops
        if not dialogue.place_lost or low_mm is None:
            return
        self._require_ready(up=True)
        self._motion.lowest_mm = None  # else a machine that falls silent again would go up twice as far
        if (way_mm := self._rules().safe_z_mm - low_mm) <= 0:
            return
        feed = self._settings.retract_mm_min
        self._expect_jog((0.0, 0.0, way_mm), feed)
        with contextlib.suppress(DeviceFaultError):  # locked: the reason is the fault that is known
            self._send_up(way_mm, feed)
            self._await_lifted(self._patience_s())
            dialogue.fault += f'; it was sent {way_mm:.2f} mm up'
        self._at_rest()
        if stops != self._stops:
            self._motion.lowest_mm = low_mm

    def _place_lost(self, restarted: bool) -> None:
        """Expect no position any more.

        The dead man's switch is dismissed, because no absolute height is safe to go to, except if the controller has
        only been silent, and obeys nothing if it has restarted meanwhile.
        """
        self._motion.lose()
        if (dead_man := self._dead_man) is not None and (restarted or not self._locks_itself):
            dead_man.say_farewell()

    def _talk(self) -> Spoken:
        if self._dialogue is None:
            raise DeviceError(f'{self._name} is not connected; connect it first')
        return self._dialogue
