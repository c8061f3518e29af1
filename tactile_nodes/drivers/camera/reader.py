"""Live cameras: a thread that reads a device continuously, and a slot with its newest frame.

A device that is not read continuously returns old frames: after a second without reading, a UVC camera's next two
frames were 977 and 924 ms old. So a separate thread always reads it, the newest frame replaces an unread one, and every
lost frame is counted.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Protocol

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.camera.contract import Camera, CameraSettings, Frame, Picture
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.drivers.reopening import Reopening
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceTimeoutError, TactileError

FIRST_FRAME_S = 5.0  # some cameras take seconds to start
JOIN_S = 1.0  # less than the two seconds that a node has to end


class NewestFrame:
    """One slot: the writer never waits; the reader gets the newest frame. Numbers continue when a camera is reopened.

    Attributes:
        good_ns: when the last frame was put.
        dropped: frames lost so far.
        failure: why no frames come now; None: they come.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self._name = name
        self._clock = clock
        self._changed = threading.Condition()
        self._unread: Frame | None = None
        self._closed = False
        self._sequence = 0
        self.good_ns = 0
        self.dropped = 0
        self.failure: TactileError | None = None

    def put(self, image: Picture, stamp_ns: int) -> None:
        """Store a frame; it replaces one that was not read."""
        with self._changed:
            self.good_ns = self._clock.now_ns()
            self.failure = None
            if self._unread is not None:
                self.dropped += 1
            self._unread = Frame(image, stamp_ns, self._sequence, self.dropped)
            self._sequence += 1
            self._changed.notify_all()

    def miss(self, count: int = 1) -> None:
        """Count frames that the device captured but that did not arrive complete."""
        with self._changed:
            self._sequence += count
            self.dropped += count

    def fail(self, error: TactileError) -> None:
        """Report that no more frames come until further notice, and why."""
        with self._changed:
            self.failure = error
            self._changed.notify_all()

    def close(self) -> None:
        """End on request; no more frames."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def first(self, timeout_s: float) -> None:
        """Wait for a frame, which stays unread.

        Raises:
            DeviceTimeoutError: none came.
            TactileError: the error given to `fail`.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._unread or self.failure, timeout_s)
            if self._unread is None:
                raise self.failure or self._nothing(timeout_s)

    def take(self, timeout_s: float) -> Frame:
        """The newest unread frame, waiting for it up to `timeout_s`.

        Raises:
            DeviceTimeoutError: none came; perhaps because the camera is lost.
            DeviceError: it is closed.
            TactileError: the error given to `fail`, if it is not of the device.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._unread or self._closed or self._final, timeout_s)
            if self._closed:
                raise DeviceError(f'{self._name} is closed; open it before reading')
            frame, self._unread = self._unread, None
            if frame is not None:
                return frame
            raise self._final or self._nothing(timeout_s)

    @property
    def _final(self) -> TactileError | None:
        """The failure, if opening the device again cannot help."""
        return None if isinstance(self.failure, DeviceError) else self.failure

    def _nothing(self, timeout_s: float) -> DeviceTimeoutError:
        if self.failure is not None:
            return DeviceTimeoutError(f'{self._name} is lost ({self.failure}); reconnecting')
        return DeviceTimeoutError(f'{self._name} sent no complete picture within {timeout_s:g} s; check its cable')


class CameraConnection(Protocol):
    """An open camera; make a new one after it is lost."""

    @property
    def description(self) -> Mapping[str, str]:
        """As `Camera.description`."""
        ...

    @property
    def complaints(self) -> list[str]:
        """Settings that the camera did not accept, and other problems for a person."""
        return []

    def fetch(self, slot: NewestFrame) -> None:
        """Wait for data, and put a frame into the slot if one is complete.

        Raises:
            DeviceLostError: no more data will come.
            ImageError: a picture of another size than required.
        """
        ...

    def interrupt(self) -> None:
        """Make `fetch` in another thread return, if that is possible."""
        return

    def close(self) -> None:
        """Close the device."""
        ...


class LiveCamera(Camera):
    """The camera behind the connections made by `connect`, one after another.

    The first `open` fails if the camera fails. After that, a lost camera is reopened (`Reopening`). Meanwhile `read`
    raises `DeviceTimeoutError`, never `DeviceLostError`. The time of the last good frame decides whether it is alive,
    because OpenCV's ``isOpened()`` stays true after the cable is pulled.

    Args:
        name: for errors, without a password.
        connect: opens the camera.
        clock: the host's.
        settings: `stall_s` is the silence after which the camera counts as lost.
    """

    def __init__(
        self, name: str, connect: Callable[[], CameraConnection], clock: Clock, settings: CameraSettings
    ) -> None:
        self.name = name
        self._connect = connect
        self._clock = clock
        self._stall_s = settings.stall_s
        self._connected_ns = 0
        self._slot = NewestFrame(name, clock)
        self._source = Reopening(f'camera {name}', self._connected, self._fetch, self._slot.fail)

    @property
    def description(self) -> Mapping[str, str]:
        """As of the current or last connection, with the number of losses."""
        connection = self._source.connection
        return {**(connection.description if connection else {}), 'times lost': str(self._source.losses)}

    @property
    def health(self) -> Health:
        """ERROR while it is lost or silent, WARN if it did not accept a setting."""
        connection, slot = self._source.connection, self._slot
        if not self._source.is_open or connection is None:
            return Health(Level.STALE, f'{self.name} is not open')
        if reason := slot.failure or self._silence:
            lost_s = (self._clock.now_ns() - slot.good_ns) / NS_PER_S
            return Health(Level.ERROR, f'lost for {lost_s:.1f} s, reconnecting: {reason}')
        if complaints := connection.complaints:
            return Health(Level.WARN, f'{self.name}: {"; ".join(complaints)}')
        again = f'; reconnected so far: {self._source.losses}' if self._source.losses else ''
        return Health(Level.OK, f'receiving {self.name}, frames lost: {slot.dropped}{again}')

    def open(self) -> None:
        """Connect, and wait for the first complete picture."""
        self._source.open()
        try:
            self._slot.first(FIRST_FRAME_S)
        except BaseException:
            self.close()
            raise

    def read(self, timeout_s: float) -> Frame:
        """The newest frame; `DeviceTimeoutError` while the camera is lost. Raises as `Camera.read`."""
        return self._slot.take(timeout_s)

    def close(self) -> None:
        """Close the device; a thread that is blocked in it does so when it wakes."""
        if not self._source.is_open:
            return
        self._slot.close()
        connection = self._source.connection
        self._source.stop()
        if connection is not None:
            connection.interrupt()
        self._source.close(JOIN_S)

    def _connected(self) -> CameraConnection:
        connection = self._connect()
        self._connected_ns = self._clock.now_ns()
        return connection

    def _fetch(self, connection: CameraConnection) -> bool:
        before_ns = self._slot.good_ns
        connection.fetch(self._slot)
        if self._slot.good_ns > before_ns:  # what has just come is not silent, even if this computer paused since
            return True
        if silence := self._silence:
            raise DeviceLostError(silence)
        return False

    @property
    def _silence(self) -> str:
        """A message if it has been silent for too long; the time is longer before its first frame."""
        silent_s = (self._clock.now_ns() - max(self._slot.good_ns, self._connected_ns)) / NS_PER_S
        has_begun = self._slot.good_ns > self._connected_ns
        if silent_s < (self._stall_s if has_begun else max(self._stall_s, FIRST_FRAME_S)):
            return ''
        return f'{self.name} has sent no complete picture for {silent_s:.1f} s; check its cable or network'
