"""A device that is read in a thread, and opened again after it was lost: unplugged, silent or switched off."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from tactile_nodes.errors import DeviceError, DeviceLostError, TactileError

FIRST_DELAY_S = 0.25
LONGEST_DELAY_S = 5.0


class Connection(Protocol):
    """An open device; make a new one after it is lost."""

    def close(self) -> None:
        """Close it; called in the thread that reads it, because libraries crash if another thread does."""
        ...


Opened = TypeVar('Opened', bound=Connection)


class Reopening(Generic[Opened]):
    """Reads one connection after another. Between attempts it waits 0.25, 0.5, 1, 2, 4, 5, 5, … s, until data come.

    Args:
        name: of the thread.
        connect: opens the device.
        fetch: waits a moment for data of the device, and passes them on; returns whether there were any. A DeviceError
            or OSError means that it is lost; another TactileError, that opening it again cannot help.
        lose: receives the reason each time when there are no more data.

    Attributes:
        connection: the open device, or the last one; None before the first.
        is_lost: whether it is not open now.
        losses: how often it was lost.
    """

    def __init__(
        self,
        name: str,
        connect: Callable[[], Opened],
        fetch: Callable[[Opened], bool],
        lose: Callable[[TactileError], None],
    ) -> None:
        self._name = name
        self._connect = connect
        self._fetch = fetch
        self._lose = lose
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self.connection: Opened | None = None
        self.is_lost = False
        self.losses = 0

    @property
    def is_open(self) -> bool:
        """Whether it was opened, and not closed since."""
        return self._thread is not None

    def open(self) -> None:
        """Open the device, and start the thread. Raises as `connect`: a device that was never there is an error."""
        self.connection = connection = self._connect()
        self.is_lost = False
        self._stopping = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(connection, self._stopping), name=self._name, daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """Ask the thread to end; returns at once."""
        self._stopping.set()

    def close(self, within_s: float) -> None:
        """End the thread, which closes the device; one that is blocked in the device does so when it wakes."""
        self.stop()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(within_s)

    def _run(self, connection: Opened | None, stopping: threading.Event) -> None:
        end: TactileError = DeviceLostError(f'reading from {self._name} has ended')
        is_well, delay_s = True, FIRST_DELAY_S
        try:
            while not stopping.is_set():
                try:
                    if connection is None:
                        connection = self.connection = self._connect()
                        self.is_lost = False
                    is_well |= self._fetch(connection)
                except (DeviceError, OSError) as error:
                    self.losses += is_well
                    self._lose(error if isinstance(error, DeviceError) else DeviceLostError(str(error)))
                    if connection is not None:
                        connection.close()
                    connection, self.is_lost = None, True
                    delay_s = FIRST_DELAY_S if is_well else min(2 * delay_s, LONGEST_DELAY_S)
                    is_well = False
                    stopping.wait(delay_s)
        except TactileError as error:
            end = error
        finally:
            if not stopping.is_set():
                self._lose(end)
            if connection is not None:
                connection.close()
