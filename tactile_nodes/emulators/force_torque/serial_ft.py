"""Serial force/torque sensors on pseudo terminals: a port that can be unplugged, and the sensor behind it.

with PtySensor(BotaSensor(world), clock, tmp_path / 'ttyFT') as device:
    ... # bota:<tmp_path>/ttyFT
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from tactile_nodes.clock import Clock
from tactile_nodes.emulators.serial_ports import PtyPort


class Talker(Protocol):
    """The inside of a serial sensor, as a function of time."""

    def power_on(self, now_ns: int) -> None:
        """Start, because power has come."""
        ...

    def receive(self, data: bytes, now_ns: int) -> None:
        """Process bytes from the host."""
        ...

    def due(self, now_ns: int) -> bytes:
        """The bytes that it has sent since the last call."""
        ...

    def next_ns(self) -> int | None:
        """When it will send next without a request; None: unknown."""
        ...


class PtySensor(PtyPort):
    """A sensor behind a pseudo terminal; it gets power when it is plugged in."""

    def __init__(self, talker: Talker, clock: Clock, link: Path) -> None:
        self.talker = talker
        self._powered = _Powered(talker, clock)
        super().__init__(self._powered, clock, link)

    def plug(self) -> None:
        """Make the port appear, and give the sensor power."""
        self._powered.power_cycle()
        super().plug()


class _Powered:
    """A talker as a device of a `PtyPort`."""

    def __init__(self, talker: Talker, clock: Clock) -> None:
        self._talker = talker
        self._clock = clock
        self.next_event_ns = talker.next_ns

    def receive(self, data: bytes) -> None:
        self._talker.receive(data, self._clock.now_ns())

    def run(self) -> None:
        """Nothing: `take_output` processes all events that are due."""

    def take_output(self) -> bytes:
        return self._talker.due(self._clock.now_ns())

    def power_cycle(self) -> None:
        self._talker.power_on(self._clock.now_ns())
