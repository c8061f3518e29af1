"""A thread that reads a device continuously, and a slot with its newest frame.

A device that is not read continuously returns old frames: after a second without reading, a UVC camera's next two
frames were 977 and 924 ms old. So a separate thread always reads it, the newest frame replaces an unread one, and every
lost frame is counted.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from tactile_nodes.drivers.camera.contract import Frame, Picture
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceTimeoutError, TactileError

JOIN_S = 1.0  # less than the two seconds that a node has to end


class NewestFrame:
    """One slot: the writer never waits; the reader gets the newest frame, or the reason why there is none."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._changed = threading.Condition()
        self._unread: Frame | None = None
        self._failure: TactileError | None = None
        self._closed = False
        self._sequence = 0
        self._dropped = 0

    def put(self, image: Picture, stamp_ns: int) -> None:
        """Store a frame; it replaces one that was not read."""
        with self._changed:
            if self._unread is not None:
                self._dropped += 1
            self._unread = Frame(image, stamp_ns, self._sequence, self._dropped)
            self._sequence += 1
            self._changed.notify_all()

    def miss(self, count: int = 1) -> None:
        """Count frames that the device captured but that did not arrive complete."""
        with self._changed:
            self._sequence += count
            self._dropped += count

    def fail(self, error: TactileError) -> None:
        """Report that no more frames will come, and why; the first reason counts."""
        with self._changed:
            self._failure = self._failure or error
            self._changed.notify_all()

    def close(self) -> None:
        """End on request; no more frames."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def dropped(self) -> int:
        """Frames lost so far."""
        return self._dropped

    def take(self, timeout_s: float) -> Frame:
        """The newest unread frame, waiting for it up to `timeout_s`.

        Raises:
            DeviceTimeoutError: none came.
            TactileError: the error given to `fail`.
        """
        with self._changed:
            frame = self._wait(timeout_s)
            self._unread = None
            return frame

    def peek(self, timeout_s: float) -> Frame:
        """As `take`, but the frame stays unread."""
        with self._changed:
            return self._wait(timeout_s)

    def _wait(self, timeout_s: float) -> Frame:
        self._changed.wait_for(lambda: self._unread or self._failure or self._closed, timeout_s)
        if self._closed:
            raise DeviceError(f'{self._name} is closed; open it before reading')
        if self._unread is not None:
            return self._unread
        if self._failure is not None:
            raise self._failure
        raise DeviceTimeoutError(f'{self._name} sent no complete picture within {timeout_s:g} s; check its cable')


class FrameReader:
    """The thread that reads a device into a slot.

    Args:
        name: name of the device, for errors.
        fetch: waits for the next data of the device and puts it into the slot; raises a `TactileError` at the end.
        release: closes the device. The thread calls it itself at its end, because closing a handle that another
            thread reads from crashes in the libraries below.
    """

    def __init__(self, name: str, fetch: Callable[[NewestFrame], None], release: Callable[[], None]) -> None:
        self._slot = NewestFrame(name)
        self._fetch = fetch
        self._release = release
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f'camera {name}', daemon=True)
        self._name = name
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Frames lost so far."""
        return self._slot.dropped

    def read(self, timeout_s: float) -> Frame:
        """As `NewestFrame.take`."""
        return self._slot.take(timeout_s)

    def first(self, timeout_s: float) -> Frame:
        """As `NewestFrame.peek`: it shows that the device delivers."""
        return self._slot.peek(timeout_s)

    def stop(self) -> None:
        """Ask the thread to end after its current wait."""
        self._stopping.set()
        self._slot.close()

    def join(self) -> None:
        """Wait briefly until the device is closed; a blocked thread closes it when it wakes."""
        self._thread.join(JOIN_S)

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._fetch(self._slot)
        except TactileError as error:
            self._slot.fail(error)
        finally:
            self._slot.fail(DeviceLostError(f'reading from {self._name} has ended'))
            self._release()


class LiveCamera:
    """Common part of all cameras that use a `FrameReader`; subclasses open the device and describe it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._reader: FrameReader | None = None

    def read(self, timeout_s: float) -> Frame:
        """The newest frame; raises as `Camera.read` does."""
        if self._reader is None:
            raise DeviceError(f'{self.name} is closed; open it before reading')
        return self._reader.read(timeout_s)

    def close(self) -> None:
        """Close the device; a thread that is blocked in it does so when it wakes."""
        if self._reader is None:
            return
        self._reader.stop()
        self._interrupt()
        self._reader.join()
        self._reader = None

    def _drain(self, fetch: Callable[[NewestFrame], None], release: Callable[[], None], first_s: float) -> Frame:
        """Start the thread and wait for its first frame; without a frame, the device is closed again."""
        self._reader = FrameReader(self.name, fetch, release)
        try:
            return self._reader.first(first_s)
        except BaseException:
            self.close()
            raise

    def _interrupt(self) -> None:
        """Wake the thread, if the device can be made to return."""
