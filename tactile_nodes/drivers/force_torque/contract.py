"""What every force/torque sensor does."""

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
    """What is to be known of a sample beside its numbers."""

    FAULT = 1
    """The sensor says that something is wrong with it: the numbers mean nothing."""
    SATURATED = 2
    """Beyond the range: the force is at least this, and perhaps much more."""
    STALLED = 4
    """Records come, but what measures stands still: this is an old measurement once more."""
    THRESHOLD = 8
    """A limit that is set in the sensor itself was passed, now or since it was last reset."""
    WARNING = 16
    """The sensor complains of something that leaves the numbers good."""
    RESTARTED = 32
    """The first sample after the sensor was lost and found again: how long it was away is only estimated."""
    NOT_A_NUMBER = 64
    """An axis that it measures shows no finite number."""
    UNTIMED = 128
    """Its clock does not keep the rate that it announces, so the stamp is the arrival: nobody knows how old it is."""


UNUSABLE = Flag.FAULT | Flag.SATURATED | Flag.STALLED | Flag.NOT_A_NUMBER


class Sample(NamedTuple):
    """One measurement.

    Attributes:
        wrench: (Fx, Fy, Fz, Tx, Ty, Tz) in N and N·m in the sensor's own axes; NaN on an axis that it does not
            measure, which is not zero.
        stamp_ns: when it was measured, on the host's time base, by the sensor's own clock; strictly increasing.
        arrival_ns: when it arrived.
        device_ticks: the sensor's own clock, unwrapped; 0 from a sensor without one.
        sequence: number of the sample among all that the sensor is known to have made since it was opened.
        dropped: how many of those were lost so far. Between two samples that were read, the growth of `sequence` is
            one more than that of `dropped`.
        flags: of `Flag`, as a number.
        status: the sensor's own status word.
        raw: what the sensor sent, in its own units, before any tare.
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
        """Whether the numbers may be used: as a label, as the end of a search, as a sign that nothing is touched."""
        return not self.flags & UNUSABLE

    @property
    def force_n(self) -> float:
        """Size of the force over the measured axes; infinite if none is measured or the sample is not usable.

        (3, NaN, 4) N is 5 N. Infinite, because whoever limits a force must not take "unknown" for "none".
        """
        measured = [value for value in self.wrench[:3] if not math.isnan(value)]
        return math.hypot(*measured) if measured and self.usable else math.inf


@dataclass(frozen=True)
class NetFtSettings:
    """What is particular to an ATI Net F/T box."""

    rdt_port: int = parameter(49152, 'UDP port of RDT', minimum=1, maximum=65535)
    http_port: int = parameter(80, 'TCP port of the web pages', minimum=1, maximum=65535)
    buffered: bool = parameter(False, 'several records a datagram: less load on the network, more delay')
    start_tries: int = parameter(10, 'requests to start, 0.1 s apart, before the box counts as silent', minimum=1)
    count_s: float = parameter(10.0, 'the box stops by itself this long after the last renewal', minimum=1.0)
    renew_s: float = parameter(5.0, 'seconds between renewals', minimum=0.2)
    set_rate: bool = parameter(False, 'change the output rate of the box to rate_hz; the box keeps it')

    def __post_init__(self) -> None:
        if self.renew_s >= self.count_s:
            raise ValueError(f'renew_s ({self.renew_s:g}) must be less than count_s ({self.count_s:g})')


@dataclass(frozen=True)
class TextLineSettings:
    """What is particular to a sensor that sends lines of text."""

    axes: tuple[str, ...] = parameter(('fz',), 'which of fx, fy, fz, tx, ty, tz each channel measures')
    units_per_count: tuple[float, ...] = parameter((1.0,), 'N or N·m per count, of each channel')
    lowest: float = parameter(-8388608.0, 'counts at the lower end of the range (a 24-bit converter has these)')
    highest: float = parameter(8388607.0, 'counts at the upper end of the range')

    def __post_init__(self) -> None:
        unknown = set(self.axes) - set(AXES)
        if unknown or not self.axes or len(set(self.axes)) != len(self.axes):
            raise ValueError(f'axes must be different ones of {", ".join(AXES)}, got {", ".join(self.axes)}')
        if len(self.axes) != len(self.units_per_count):
            raise ValueError(
                f'{len(self.axes)} axes and {len(self.units_per_count)} units_per_count; give one for each'
            )


@dataclass(frozen=True)
class ForceTorqueSettings:
    """What is asked of a force/torque sensor."""

    source: str = parameter(SIMULATED, 'simulated, netft://ADDRESS, bota:DEVICE or text:DEVICE')
    rate_hz: float = parameter(0.0, 'samples a second, where the sensor can choose; 0.0: as it is', minimum=0.0)
    silence_ms: float = parameter(50.0, 'this long (or three periods) without a sample is silence', minimum=1.0)
    lost_s: float = parameter(1.0, 'silent for this long counts as lost: it is opened again', minimum=0.2)
    same_values: int = parameter(
        20, 'so many equal samples in a row (of one axis in six 120): it stands still; 0: do not look', minimum=0
    )
    delay_ms: float = parameter(0.0, 'constant time from measurement to arrival, taken off the stamps', minimum=0.0)
    queue: int = parameter(20000, 'samples that wait for a slow reader before the oldest are dropped', minimum=10)
    baud: int = parameter(0, "of a serial sensor; 0: the sensor's usual (bota 460800, text 115200)", minimum=0)
    dtr: str = parameter('default', 'the DTR line of a serial sensor', choices=DTR_POLICIES)
    net_ft: NetFtSettings = field(default_factory=NetFtSettings)
    text: TextLineSettings = field(default_factory=TextLineSettings)


Listener = Callable[[Sample], None]


class ForceTorqueSensor(Protocol):
    """A source of samples."""

    @property
    def description(self) -> Mapping[str, str]:
        """What it is and how it is set: keys and values for ``/diagnostics`` and for the record."""
        ...

    @property
    def health(self) -> Health:
        """How it is now, in a sentence."""
        ...

    @property
    def axes(self) -> tuple[str, ...]:
        """Which components of the wrench it measures."""
        ...

    @property
    def rate_hz(self) -> float:
        """Samples a second, as announced or seen; 0 while it is not open."""
        ...

    @property
    def expected_hz(self) -> float:
        """Samples a second that shall come: as announced, else as seen when it was opened, however slow it becomes."""
        ...

    def open(self) -> None:
        """Start measuring; returns when samples come.

        Raises:
            DeviceNotFoundError: nothing there, or nothing that this user may open.
            DeviceTimeoutError: it is there, and sends no sample.
            DeviceError: it is there, and cannot be used as it is set.
        """
        ...

    def read(self, timeout_s: float) -> Sequence[Sample]:
        """Every sample that has come since the last call, oldest first; at least one.

        Raises:
            DeviceTimeoutError: none within `timeout_s`.
            DeviceLostError: it was there, and is not any more; it is being looked for.
            DeviceError: it is not open.
        """
        ...

    def newest(self) -> Sample | None:
        """The last sample that has come, whether it was read or not; None before the first."""
        ...

    def listen(self, listener: Listener) -> None:
        """Have each sample handed over as it comes, in the thread that reads the sensor; be quick about it."""
        ...

    def close(self) -> None:
        """Stop, and let go of the sensor; a second call does nothing."""
        ...
