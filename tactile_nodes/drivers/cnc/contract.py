"""What every CNC does for an indentation rig.

Positions are the machine's own coordinates in mm (never work offsets), feeds are mm/min. Nothing moves before `home`
but the tip straight up. Every target is checked against the envelope before it is sent (`cnc.envelope`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from tactile_nodes.drivers.health import Health
from tactile_nodes.params import parameter

Place = tuple[float, float, float]
Traffic = Callable[[str, int, bytes], None]
"""Told everything on the wire: '>' for to the machine or '<' for from it, the stamp in ns, the bytes."""

SIMULATED = 'simulated'
NO_SOFT_LIMITS = 'no soft limits'
NO_HOMING = 'no homing'
NO_HARD_LIMITS = 'no hard limits'
RISKS = (NO_SOFT_LIMITS, NO_HOMING, NO_HARD_LIMITS)
BLIND_STEP_MM = 0.05


@dataclass(frozen=True)
class CncSettings:
    """What is asked of a CNC, and what it may do."""

    source: str = parameter(SIMULATED, 'simulated, or a serial port, best one below /dev/serial/by-id')
    kind: str = parameter('grbl', 'protocol: grbl (also grblHAL and FluidNC) or marlin', choices=('grbl', 'marlin'))
    baud: int = parameter(115200, 'bits per second of the port', minimum=1200)
    dtr: str = parameter(
        'default', 'what happens to DTR, see serial_port', choices=('default', 'pulse', 'low', 'untouched')
    )
    boot_s: float = parameter(3.0, 'how long a controller may take to start after its port was opened', minimum=0.0)
    answer_s: float = parameter(2.0, 'how long it may take to answer a line that moves nothing', minimum=0.1)
    home_s: float = parameter(120.0, 'how long homing may take', minimum=1.0)
    report_hz: float = parameter(
        5.0, 'status reports asked for per second at rest; ten while it moves', minimum=1.0, maximum=10.0
    )
    lowest_mm: tuple[float, ...] = parameter((), "x, y, z of the box's lower corner; empty: the machine's own limits")
    highest_mm: tuple[float, ...] = parameter((), "x, y, z of the box's upper corner; empty: the machine's own limits")
    safe_z_mm: float = parameter(-5.0, 'at and above this height the tip may move sideways; retract goes here')
    lateral_when_low: bool = parameter(False, 'allow sideways moves below safe_z_mm, to shear the gel')
    fastest_mm_min: float = parameter(2000.0, 'greatest feed of any move', minimum=1.0)
    retract_mm_min: float = parameter(600.0, 'feed of a retract', minimum=1.0)
    home_command: str = parameter('', 'empty: $H on Grbl, none on Marlin, where G28 may drive the tip into the gel')
    line_on: str = parameter('', 'command that raises the digital line; empty: M8 on Grbl, M106 S255 on Marlin')
    line_off: str = parameter('', 'command that lowers it; empty: M9 on Grbl, M107 on Marlin')
    accept: tuple[str, ...] = parameter((), f'risks that are accepted in words: {", ".join(map(repr, RISKS))}')

    def __post_init__(self) -> None:
        for corner in (self.lowest_mm, self.highest_mm):
            if len(corner) not in {0, 3}:
                raise ValueError(f'lowest_mm and highest_mm are x, y, z or empty, got {len(corner)} numbers')
        if unknown := set(self.accept) - set(RISKS):
            raise ValueError(f'accept knows {", ".join(map(repr, RISKS))}, not {", ".join(sorted(unknown))}')


class CncState(Enum):
    """What a machine does."""

    IDLE = 'idle'
    RUN = 'moving'
    JOG = 'jogging'
    HOLD = 'held'
    HOME = 'homing'
    ALARM = 'locked by an alarm'
    OTHER = 'busy with something else'


@dataclass(frozen=True)
class CncStatus:
    """Where a machine said that it was, and when.

    Attributes:
        state: what it does.
        position_mm: machine coordinates; on Marlin the target while it moves.
        homed: whether these coordinates can be trusted.
        stamp_ns: between the question and the answer, on the host's time base.
        uncertainty_ns: half the time between them: the position is of a time no further from the stamp.
    """

    state: CncState
    position_mm: Place
    homed: bool
    stamp_ns: int
    uncertainty_ns: int


@dataclass(frozen=True)
class Identity:
    """Which firmware, in its own words."""

    firmware: str
    version: str
    options: tuple[str, ...] = ()


@dataclass(frozen=True)
class Envelope:
    """The box that the tip stays in, in machine coordinates."""

    lowest_mm: Place
    highest_mm: Place


@dataclass(frozen=True)
class Switched:
    """When the digital line got its level: after the command was sent, before it was acknowledged."""

    level: bool
    earliest_ns: int
    latest_ns: int


class Cnc(Protocol):
    """A machine that moves the tip. `stop` may be called from any thread, the rest from one at a time."""

    @property
    def description(self) -> Mapping[str, str]:
        """What it is and how it is set up, for ``/diagnostics`` and the record of a run."""
        ...

    @property
    def health(self) -> Health:
        """How it is now, in a sentence."""
        ...

    @property
    def limits(self) -> Envelope:
        """The box that targets must be in."""
        ...

    @property
    def blind_step_mm(self) -> float | None:
        """The longest jog that it takes, because a longer one could not be stopped in time; None: any length."""
        ...

    def connect(self) -> None:
        """Open, identify and check it; nothing moves and nothing is changed.

        Raises:
            DeviceNotFoundError, DeviceTimeoutError: nothing there, or nothing that answers.
            DeviceFaultError: it is set up in a way that is dangerous or misleading.
            ConfigurationError: the settings do not fit it.
        """
        ...

    def identify(self) -> Identity:
        """Which firmware it is."""
        ...

    def home(self) -> None:
        """Find the end switches; returns at rest, with the position known. Ends an alarm: a person asks for it."""
        ...

    def move(self, x: float | None = None, y: float | None = None, z: float | None = None, *, feed: float) -> None:
        """Go on a straight line to machine coordinates; what is None stays. Returns when it is queued.

        Raises:
            ConfigurationError: a target outside the envelope, or sideways below the safe height.
            DeviceFaultError: not homed, in alarm, or refused by the machine.
            DeviceTimeoutError, DeviceLostError: no answer.
        """
        ...

    def jog(self, dx: float = 0.0, dy: float = 0.0, dz: float = 0.0, *, feed: float) -> None:
        """Go on by a distance, in a way that `stop` ends soonest; else as `move`. Straight up needs no homing."""
        ...

    def stop(self) -> None:
        """Come to rest as soon as it can and forget what is queued; other threads' commands fail.

        Returns at rest with the position kept; where it could not be kept `status().homed` is false.
        """
        ...

    def hold(self) -> None:
        """Pause; returns at rest."""
        ...

    def resume(self) -> None:
        """Go on after `hold`."""
        ...

    def retract(self) -> None:
        """Stop, then go straight up to the safe height; returns there.

        Raises:
            DeviceFaultError: the position is not known, so that a person has to look first.
        """
        ...

    def wait_idle(self, timeout_s: float | None = None) -> None:
        """Return when all that was queued is done. None: as long as the motion can take.

        Raises:
            DeviceTimeoutError: it takes longer.
            DeviceFaultError: it ended otherwise: an alarm, a stop, a restart.
        """
        ...

    def status(self) -> CncStatus:
        """Where it is, asked now."""
        ...

    def set_line(self, level: bool) -> Switched:
        """Switch the digital line when all that was queued is done; returns when it is switched."""
        ...

    def close(self) -> None:
        """Let go of it; motors stay on."""
        ...
