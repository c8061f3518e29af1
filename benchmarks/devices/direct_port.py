"""An emulated serial device as a driver's port, within one thread."""

from __future__ import annotations

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.emulators.serial_device import SerialDevice
from tactile_nodes.errors import DeviceLostError


class DirectPort:
    """The device as a driver's port, without a thread: `read` lets time pass until the device has sent something.

    With a clock that skips waiting times, a dialogue takes no real time and is the same in every run.
    """

    name = 'the emulated port'

    def __init__(self, device: SerialDevice, clock: Clock) -> None:
        self._device = device
        self._clock = clock
        self.unplugged = False

    def write(self, data: bytes) -> None:
        """Send bytes to the device."""
        self._check()
        self._device.receive(data)

    def read(self, timeout_s: float) -> bytes:
        """The bytes from the device, without waiting if there are any; empty after the timeout."""
        self._check()
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        while True:
            self._device.run()
            if data := self._device.take_output():
                return data
            if self._clock.now_ns() >= deadline_ns:
                return b''
            due_ns = self._device.next_event_ns()
            self._clock.sleep_until(deadline_ns if due_ns is None else min(due_ns, deadline_ns))

    def close(self) -> None:
        """Nothing to close."""

    def _check(self) -> None:
        if self.unplugged:
            raise DeviceLostError(f'{self.name} was unplugged; plug it in again')
