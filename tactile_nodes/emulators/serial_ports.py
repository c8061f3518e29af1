"""Connects the host to an emulated serial device through a pseudo terminal."""

from __future__ import annotations

import contextlib
import errno
import os
import pty
import select
import threading
import tty
from pathlib import Path
from typing import Protocol

from tactile_nodes.clock import NS_PER_S, Clock

LONGEST_WAIT_S = 0.01  # largest delay until the device notices a step of the clock, or a host that opens it


class Pluggable(Protocol):
    """The interface that `PtyPort` needs of a device."""

    def receive(self, data: bytes) -> None:
        """Bytes from the host."""
        ...

    def run(self) -> None:
        """Process all events that are due."""
        ...

    def take_output(self) -> bytes:
        """What it has sent since the last call."""
        ...

    def next_event_ns(self) -> int | None:
        """The time of the next event without new input."""
        ...

    def power_cycle(self) -> None:
        """Restart after a loss of power or a pulse on the reset line."""
        ...


class PtyPort:
    """A device behind a pseudo terminal, served by its own thread.

    Args:
        device: the emulated device.
        link: path of a symbolic link to the terminal, which stays the same after unplugging.
        reset_on_open: opening the port restarts the device, as on Arduino boards.

    Attributes:
        in_use: a host has it open.
    """

    def __init__(self, device: Pluggable, clock: Clock, link: Path, reset_on_open: bool = False) -> None:
        self._device = device
        self._clock = clock
        self.reset_on_open = reset_on_open
        self._master = -1
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self.path = link
        self.in_use = False

    def __enter__(self) -> PtyPort:
        self.plug()
        return self

    def __exit__(self, *args: object) -> None:
        self.unplug()

    def plug(self) -> None:
        """Make the port appear."""
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)  # what nobody reads is lost, as on a wire
        name = os.ttyname(slave)
        os.close(slave)  # from now on the master reports a hang-up while no host has it open
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(name)
        self._stopping.clear()
        self._thread = threading.Thread(target=self._serve, name=f'emulated {self.path.name}', daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Make the port disappear, even while a host has it open; the device itself keeps running."""
        if self._thread is None:
            return
        self._stopping.set()
        self._thread.join()
        self._thread = None
        self.in_use = False
        os.close(self._master)
        self.path.unlink(missing_ok=True)

    def _serve(self) -> None:
        poller, opened = select.poll(), False
        poller.register(self._master, select.POLLIN)
        while not self._stopping.is_set():
            events = poller.poll(1000 * self._patience_s())
            flags = events[0][1] if events else 0
            if flags & select.POLLIN:
                self._device.receive(_read(self._master))
            if (present := not flags & select.POLLHUP) != opened:
                opened = self.in_use = present
                if opened and self.reset_on_open:
                    self._device.power_cycle()
            self._exchange(opened)
            if not opened:
                self._stopping.wait(LONGEST_WAIT_S)  # a hang-up makes poll return at once

    def _exchange(self, opened: bool) -> None:
        self._device.run()
        if (data := self._device.take_output()) and opened:
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, data)

    def _patience_s(self) -> float:
        due_ns = self._device.next_event_ns()
        wait_s = LONGEST_WAIT_S if due_ns is None else (due_ns - self._clock.now_ns()) / NS_PER_S
        return min(max(wait_s, 0.0005), LONGEST_WAIT_S)


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, 4096)
    except OSError as error:
        if error.errno != errno.EIO:
            raise
        return b''
