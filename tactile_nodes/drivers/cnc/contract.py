"""The protocol of all machines of an indentation rig.

Positions are machine coordinates in mm (never work offsets), feeds are mm/min. Before `home`, only motion straight up
is allowed. Every target is checked against the envelope before it is sent (`cnc.envelope`).
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
"""Receives all data on the wire: '>' for sent or '<' for received, the stamp in ns, the bytes."""

SIMULATED = 'simulated'
NO_SOFT_LIMITS = 'no soft limits'
NO_HOMING = 'no homing'
NO_HARD_LIMITS = 'no hard limits'
OTHER_FIRMWARE = 'other firmware'
RISKS = (NO_SOFT_LIMITS, NO_HOMING, NO_HARD_LIMITS, OTHER_FIRMWARE)
BLIND_STEP_MM = 0.05


@dataclass(frozen=True)
class CncSettings:
    """Settings of a machine, and its allowed motion."""

    source: str = parameter(SIMULATED, 'simulated, or a serial port, preferably below /dev/serial/by-id')
    kind: str = parameter('grbl', 'protocol: grbl (also grblHAL and FluidNC) or marlin', choices=('grbl', 'marlin'))
    baud: int = parameter(115200, 'bits per second of the port', minimum=1200)
    dtr: str = parameter(
        'default', 'policy for the DTR line, see serial_port', choices=('default', 'pulse', 'low', 'untouched')
    )
    boot_s: float = parameter(3.0, 'time for a controller to start after its port was opened', minimum=0.0)
    answer_s: float = parameter(2.0, 'time to respond to a line without motion', minimum=0.1)
    home_s: float = parameter(120.0, 'time for homing', minimum=1.0)
    report_hz: float = parameter(5.0, 'status requests per second at rest; ten while moving', minimum=1.0, maximum=10.0)
    lowest_mm: tuple[float, ...] = parameter(
        (), "x, y, z of the lower corner of the workspace; empty: the machine's own limits"
    )
    highest_mm: tuple[float, ...] = parameter(
        (), "x, y, z of the upper corner of the workspace; empty: the machine's own limits"
    )
    safe_z_mm: float = parameter(-5.0, 'at and above this height the tip may move sideways; target of a retract')
    lateral_when_low: bool = parameter(False, 'allow sideways moves below safe_z_mm, to shear the gel')
    fastest_mm_min: float = parameter(2000.0, 'largest feed of any move', minimum=1.0)
    retract_mm_min: float = parameter(600.0, 'feed of a retract', minimum=1.0)
    home_command: str = parameter('', 'empty: $H on Grbl, none on Marlin, because G28 may drive the tip into the gel')
    line_on: str = parameter('', 'command that sets the digital line high; empty: M8 on Grbl, M106 S255 on Marlin')
    line_off: str = parameter('', 'command that sets it low; empty: M9 on Grbl, M107 on Marlin')
    accept: tuple[str, ...] = parameter((), f'accepted risks: {", ".join(map(repr, RISKS))}')

    def __post_init__(self) -> None:
        for corner in (self.lowest_mm, self.highest_mm):
            if len(corner) not in {0, 3}:
                raise ValueError(f'lowest_mm and highest_mm must be x, y, z or empty, got {len(corner)} numbers')
        if unknown := set(self.accept) - set(RISKS):
            raise ValueError(f'accept may contain {", ".join(map(repr, RISKS))}, not {", ".join(sorted(unknown))}')
        if self.retract_mm_min > self.fastest_mm_min:  # every retract would be refused, with the tip in the gel
            raise ValueError(
                f'retract_mm_min, {self.retract_mm_min:g}, must be at most fastest_mm_min, {self.fastest_mm_min:g}'
            )


class CncState(Enum):
    """The state of a machine."""

    IDLE = 'idle'
    RUN = 'moving'
    JOG = 'jogging'
    HOLD = 'held'
    HOME = 'homing'
    ALARM = 'locked by an alarm'
    OTHER = 'busy with something else'


@dataclass(frozen=True)
class CncStatus:
    """The reported position of a machine, and its time.

    Attributes:
        state: of the machine.
        position_mm: machine coordinates; on Marlin the target while it moves.
        homed: whether these coordinates are valid.
        stamp_ns: between request and response, on the host's time base.
        uncertainty_ns: half the time between them: the largest error of the stamp.
    """

    state: CncState
    position_mm: Place
    homed: bool
    stamp_ns: int
    uncertainty_ns: int


@dataclass(frozen=True)
class Identity:
    """Firmware and version, as the controller reports them."""

    firmware: str
    version: str
    options: tuple[str, ...] = ()


@dataclass(frozen=True)
class Envelope:
    """The workspace of the tip, in machine coordinates."""

    lowest_mm: Place
    highest_mm: Place


@dataclass(frozen=True)
class Switched:
    """When the digital line changed its level: after the command was sent, before it was acknowledged."""

    level: bool
    earliest_ns: int
    latest_ns: int


class Cnc(Protocol):
    """A machine that moves the tip. `stop` may be called from any thread, the rest from one at a time.

    Attributes:
        deceleration_mm_s2: with which it stops, as its controller reports; a cautious guess if it does not.
    """

    deceleration_mm_s2: float

    @property
    def description(self) -> Mapping[str, str]:
        """What it is and how it is configured, for ``/diagnostics`` and the record of a run."""
        ...

    @property
    def health(self) -> Health:
        """Its current state, in a sentence."""
        ...

    @property
    def limits(self) -> Envelope:
        """The workspace that targets must be in."""
        ...

    @property
    def blind_step_mm(self) -> float | None:
        """The longest allowed jog, if a longer one could not be stopped in time; None: any length."""
        ...

    def feed_along(self, way: Place, feed: float) -> float:
        """The feed along a way if this one is commanded, because no axis goes faster than its own limit."""
        ...

    def connect(self) -> None:
        """Open, identify and check it, without motion and without changing settings.

        Raises:
            DeviceNotFoundError, DeviceTimeoutError: no device, or no response.
            DeviceFaultError: its configuration is dangerous or misleading.
            ConfigurationError: the settings do not fit it.
        """
        ...

    def home(self) -> None:
        """Find the end switches; returns at rest, position known. Clears an alarm, so a person must request it."""
        ...

    def move(self, x: float | None = None, y: float | None = None, z: float | None = None, *, feed: float) -> None:
        """Move on a straight line to machine coordinates; None keeps a coordinate. Returns when it is queued.

        Raises:
            ConfigurationError: a target outside the envelope, or sideways below the safe height.
            DeviceFaultError: not homed, in alarm, or refused by the machine.
            DeviceTimeoutError, DeviceLostError: no response.
        """
        ...

    def jog(self, dx: float = 0.0, dy: float = 0.0, dz: float = 0.0, *, feed: float) -> None:
        """Move by a distance, such that `stop` can end it quickly; else as `move`. Straight up needs no homing."""
        ...

    def stop(self) -> None:
        """Come to rest as soon as possible and clear the queue; commands of other threads fail.

        Returns at rest with the position kept; if it could not be kept, `status().homed` is false.
        """
        ...

    def retract(self) -> None:
        """Stop, then go straight up to the safe height; returns there.

        From an unknown position it goes up as far as the safe height is above the lowest place that was commanded,
        but only once, and then raises.

        Raises:
            DeviceFaultError: the position is unknown, so that a person has to check first.
        """
        ...

    def wait_idle(self) -> None:
        """Return when all queued motion is done.

        Raises:
            DeviceTimeoutError: it takes longer than the motion can take.
            DeviceFaultError: it ended otherwise: alarm, stop or restart.
        """
        ...

    def status(self) -> CncStatus:
        """The position, requested now."""
        ...

    def set_line(self, level: bool) -> Switched:
        """Switch the digital line after all queued motion; returns when it is switched."""
        ...

    def close(self) -> None:
        """Close the connection; motors stay on."""
        ...
