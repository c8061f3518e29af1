"""Serial force/torque sensors on pseudo-terminals: a pty that can be unplugged, and the device behind it.

    with PtySensor(BotaSensor(world), clock, tmp_path / 'ttyFT') as device:
        ... # bota:<tmp_path>/ttyFT

The path is a link to the pty, so that the name stays the same after unplugging, as below ``/dev/serial/by-id``.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
import tty
from pathlib import Path
from typing import Protocol

from tactile_nodes.clock import NS_PER_S, Clock

LONGEST_WAIT_S = 0.01
SHORTEST_WAIT_S = 0.0005


class Talker(Protocol):
    """The inside of a serial device, as a function of time."""

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


class PtySensor:
    """A device on a pty; it gets power when it is plugged in."""

    def __init__(self, talker: Talker, clock: Clock, path: Path) -> None:
        self.talker = talker
        self.path = path
        self._clock = clock
        self._lock = threading.Lock()
        self._ends: tuple[int, int] | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f'serial emulator {path.name}', daemon=True)

    def __enter__(self) -> PtySensor:
        self.plug()
        self._thread.start()
        return self

    def __exit__(self, *args: object) -> None:
        self._stop.set()
        self._thread.join()
        self.unplug()

    def plug(self) -> None:
        """Plug it in, which gives it power."""
        with self._lock:
            ours, theirs = os.openpty()
            tty.setraw(theirs)
            os.set_blocking(ours, False)
            self.path.unlink(missing_ok=True)
            self.path.symlink_to(os.ttyname(theirs))
            self._ends = (ours, theirs)
            self.talker.power_on(self._clock.now_ns())

    def unplug(self) -> None:
        """Unplug it: the host's open port fails, and the path disappears."""
        with self._lock:
            ends, self._ends = self._ends, None
            self.path.unlink(missing_ok=True)
            for end in ends or ():
                os.close(end)

    def _run(self) -> None:
        while not self._stop.is_set():
            ends = self._ends
            if ends is None:
                self._stop.wait(LONGEST_WAIT_S)
                continue
            with contextlib.suppress(OSError, ValueError):  # unplugged meanwhile
                select.select([ends[0]], [], [], self._wait_s())
            with self._lock:
                if self._ends is not None:
                    self._exchange(self._ends[0])

    def _exchange(self, ours: int) -> None:
        now_ns = self._clock.now_ns()
        with contextlib.suppress(BlockingIOError, OSError):
            self.talker.receive(os.read(ours, 4096), now_ns)
        with contextlib.suppress(BlockingIOError):  # nobody reads, so the rest is lost, as on a wire
            os.write(ours, self.talker.due(now_ns))

    def _wait_s(self) -> float:
        next_ns = self.talker.next_ns()
        if next_ns is None:
            return LONGEST_WAIT_S
        return min(LONGEST_WAIT_S, max(SHORTEST_WAIT_S, (next_ns - self._clock.now_ns()) / NS_PER_S))
