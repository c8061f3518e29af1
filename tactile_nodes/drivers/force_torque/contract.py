"""The protocol of all force/torque sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntFlag
from typing import NamedTuple, Protocol

from tactile_nodes.drivers.health import Health
from tactile_nodes.drivers.serial_port import DTR_POLICIES
from tactile_nodes.params import parameter

Wrench = tuple[float, float, float, float, float, float]
AXES = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')

SIMULATED = 'simulated'


class Flag(IntFlag):
    """Properties of a sample besides its numbers."""

    FAULT = 1
    """The sensor reports a fault: the numbers are invalid."""
    SATURATED = 2
    """Out of range: the force is at least this large, perhaps much larger."""
    STALLED = 4
    """Records come, but the measurement is frozen: this is an old value again."""
    THRESHOLD = 8
    """A limit that is set in the sensor was exceeded, now or since its last reset."""
    WARNING = 16
    """The sensor reports a problem that does not affect the numbers."""
    RESTARTED = 32
    """The first sample after the sensor was lost: the duration of the gap is only an estimate."""
    NOT_A_NUMBER = 64
    """A measured axis is not a finite number."""
    UNTIMED = 128
    """Its clock does not keep the announced rate, so the stamp is the arrival time and the age is unknown."""


UNUSABLE = Flag.FAULT | Flag.SATURATED | Flag.STALLED | Flag.NOT_A_NUMBER


class Sample(NamedTuple):
    """One measurement.

    Attributes:
        wrench: (Fx, Fy, Fz, Tx, Ty, Tz) in N and N·m in the sensor's own axes; NaN (not zero) for an axis that is not
            measured.
        stamp_ns: time of measurement by the sensor's own clock, on the host's time base; strictly increasing.
        arrival_ns: time of arrival.
        device_ticks: the sensor's own clock, unwrapped; 0 for a sensor without one.
        sequence: number of the sample among all that the sensor is known to have made since it was opened.
        dropped: how many of those were lost so far. Between two samples that were read, `sequence` grows by one more
            than `dropped`.
        flags: of `Flag`, as a number.
        status: the sensor's own status word.
        raw: the numbers that the sensor sent, in its own units, before any tare.
    """

    wrench: Wrench
    stamp_ns: int
    arrival_ns: int
    device_ticks: int
    sequence: int
    dropped: int
    flags: int
    status: int
    raw: tuple[float, ...]

    @property
    def usable(self) -> bool:
        """Whether the numbers can be used: as a label, as the end of a search, or to show that there is no contact."""
        return not self.flags & UNUSABLE

    @property
    def force_n(self) -> float:
        """Magnitude of the force over the measured axes; infinite if none is measured or the sample is not usable.

        (3, NaN, 4) N is 5 N. Infinite, because a limit must not mistake "unknown" for "no force".
        """
        measured = [value for value in self.wrench[:3] if not math.isnan(value)]
        return math.hypot(*measured) if measured and self.usable else math.inf


@dataclass(frozen=True)
class NetFtSettings:
    """Settings for an ATI Net F/T box."""

    rdt_port: int = parameter(49152, 'UDP port of RDT', minimum=1, maximum=65535)
    http_port: int = parameter(80, 'TCP port of the web pages', minimum=1, maximum=65535)
    start_tries: int = parameter(10, 'start requests, 0.1 s apart, before the box counts as silent', minimum=1)
    count_s: float = parameter(10.0, 'time after the last renewal when the box stops by itself', minimum=1.0)
    renew_s: float = parameter(5.0, 'time between renewals', minimum=0.2)
    set_rate: bool = parameter(False, 'set the output rate of the box to rate_hz, permanently')

    def __post_init__(self) -> None:
        if self.renew_s >= self.count_s:
            raise ValueError(f'renew_s ({self.renew_s:g}) must be less than count_s ({self.count_s:g})')


@dataclass(frozen=True)
class TextLineSettings:
    """Settings for a sensor that sends lines of text."""

    axes: tuple[str, ...] = parameter(('fz',), 'axis of each channel: fx, fy, fz, tx, ty, tz')
    units_per_count: tuple[float, ...] = parameter((1.0,), 'N or N·m per count, for each channel')
    lowest: float = parameter(-8388608.0, 'counts at the lower end of the range (a 24-bit converter has these)')
    highest: float = parameter(8388607.0, 'counts at the upper end of the range')

    def __post_init__(self) -> None:
        unknown = set(self.axes) - set(AXES)
        if unknown or not self.axes or len(set(self.axes)) != len(self.axes):
            raise ValueError(f'axes must be distinct values of {", ".join(AXES)}, got {", ".join(self.axes)}')
        if len(self.axes) != len(self.units_per_count):
            raise ValueError(
                f'{len(self.axes)} axes and {len(self.units_per_count)} units_per_count; give one for each'
            )


@dataclass(frozen=True)
class ForceTorqueSettings:
    """Settings of a force/torque sensor."""

    source: str = parameter(SIMULATED, 'simulated, netft://ADDRESS, bota:DEVICE or text:DEVICE')
    rate_hz: float = parameter(0.0, 'samples per second, if the sensor can be set; 0.0: unchanged', minimum=0.0)
    silence_ms: float = parameter(
        50.0, 'time without a sample (at least three periods) that counts as silence', minimum=1.0
    )
    lost_s: float = parameter(1.0, 'silence after which the sensor counts as lost and is reopened', minimum=0.2)
    same_values: int = parameter(
        20, 'equal samples in a row that mean a frozen sensor (120 if one of six axes repeats); 0: no check', minimum=0
    )
    delay_ms: float = parameter(
        0.0, 'constant time from measurement to arrival, subtracted from the stamps', minimum=0.0
    )
    queue: int = parameter(20000, 'samples that wait for a slow reader before the oldest are dropped', minimum=10)
    baud: int = parameter(
        0, 'baud rate of a serial sensor; 0: default of the sensor (bota 460800, text 115200)', minimum=0
    )
    dtr: str = parameter('default', 'policy for the DTR line of a serial sensor', choices=DTR_POLICIES)
    net_ft: NetFtSettings = field(default_factory=NetFtSettings)
    text: TextLineSettings = field(default_factory=TextLineSettings)


Listener = Callable[[Sample], None]


class ForceTorqueSensor(Protocol):
    """A source of samples."""

    @property
    def description(self) -> Mapping[str, str]:
        """What it is and its settings: keys and values for ``/diagnostics`` and for the record."""
        ...

    @property
    def health(self) -> Health:
        """Its current state, in a sentence."""
        ...

    @property
    def axes(self) -> tuple[str, ...]:
        """The measured components of the wrench."""
        ...

    @property
    def rate_hz(self) -> float:
        """Samples per second, as announced or observed; 0 while it is not open."""
        ...

    @property
    def expected_hz(self) -> float:
        """Expected samples per second: as announced, else as observed when it was opened, even if it slows down."""
        ...

    def open(self) -> None:
        """Start measuring; returns when samples arrive.

        Raises:
            DeviceNotFoundError: no device, or no permission to open it.
            DeviceTimeoutError: the device sends no sample.
            DeviceError: the device cannot be used with its settings.
        """
        ...

    def read(self, timeout_s: float) -> Sequence[Sample]:
        """Every sample since the last call, oldest first; at least one.

        Raises:
            DeviceTimeoutError: none within `timeout_s`.
            DeviceLostError: the device has disappeared; it is being reopened.
            DeviceError: it is not open.
        """
        ...

    def newest(self) -> Sample | None:
        """The last sample, whether it was read or not; None before the first."""
        ...

    def listen(self, listener: Listener) -> None:
        """Call `listener` with each sample as it arrives, in the reading thread; it must be quick."""
        ...

    def close(self) -> None:
        """Stop, and close the sensor; a second call does nothing."""
        ...
