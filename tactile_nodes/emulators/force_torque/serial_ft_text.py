"""The inside of an emulated text-line sensor: an HX711 on an Arduino, or anything that prints ``t_us,ch0[,ch1..5]``."""

from __future__ import annotations

from tactile_nodes.emulators.clocks import DeviceClock
from tactile_nodes.emulators.force_torque.serial_ft_sensor import SampledSensor, microsecond_clock
from tactile_nodes.emulators.world import WrenchSource

AXES = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')
HX711_MAX, HX711_MIN = 0x7F_FFFF, -0x80_0000
SETTLING = 4  # conversions of an HX711 until it shows a step fully


class TextLineSensor(SampledSensor):
    """Sends the counts of a 24-bit converter for each channel, one line per sample; a comment line at power-on.

    Args:
        world: the load on it.
        axes: which component of the wrench each channel measures.
        counts_per_unit: of each channel, counts per N or N·m.
        rate_hz: of the converter; an HX711 has 10 (RATE pin low) or 80.
        settling: conversions over which the converter averages; only after these its output shows a step fully.
    """

    def __init__(
        self,
        world: WrenchSource,
        axes: tuple[str, ...] = ('fz',),
        counts_per_unit: tuple[float, ...] = (100_000.0,),
        clock: DeviceClock | None = None,
        rate_hz: float = 80.0,
        noise: float = 0.001,
        settling: int = SETTLING,
    ) -> None:
        super().__init__(world, clock or microsecond_clock(), noise)
        self.period_us = 1e6 / rate_hz
        self._axes = tuple(AXES.index(axis) for axis in axes)
        self._scale = counts_per_unit
        self._window: list[tuple[float, ...]] = []
        self._settling = settling
        self._to_say = b''

    def power_on(self, now_ns: int) -> None:
        self._to_say = b'# text-line force sensor\r\n'
        self._window = []
        self.restart(now_ns)

    def receive(self, data: bytes, now_ns: int) -> None:
        """Ignore the bytes."""

    def due(self, now_ns: int) -> bytes:
        response, self._to_say = self._to_say, b''
        return response + b''.join(self.spoilt(self._line(stamp, values)) for stamp, values in self.samples(now_ns))

    def next_ns(self) -> int | None:
        return self.next_sample_ns()

    def _line(self, stamp: int, values: tuple[float, ...]) -> bytes:
        self._window = [*self._window, values][-self._settling :]
        counts = [self._count(channel, axis) for channel, axis in enumerate(self._axes)]
        return ','.join(map(str, [stamp, *counts])).encode('ascii') + b'\r\n'

    def _count(self, channel: int, axis: int) -> int:
        if self.faults.saturated:
            return HX711_MAX
        mean = sum(values[axis] for values in self._window) / len(self._window)
        return max(HX711_MIN, min(HX711_MAX, round(mean * self._scale[channel])))
