"""A live camera that reconnects by itself after an unplugged cable, an interrupted stream, or a stuck driver."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable, Mapping

from tactile_nodes.clock import NS_PER_S, Clock
from tactile_nodes.drivers.camera.contract import Camera, CameraSettings, Frame
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceTimeoutError, TactileError

FIRST_DELAY_S = 0.25
LONGEST_DELAY_S = 5.0


def in_a_thread(job: Callable[[], None]) -> None:
    """Run a job in a daemon thread: it may finish late, but does not keep the process alive."""
    threading.Thread(target=job, name='camera reconnecting', daemon=True).start()


class _Attempt:
    """Reopening a camera, which can take seconds, while a reader with a shorter timeout waits."""

    def __init__(self, connect: Callable[[], Camera], spawn: Callable[[Callable[[], None]], None]) -> None:
        self._connect = connect
        self._lock = threading.Lock()
        self._finished = threading.Event()
        self._abandoned = False
        self._camera: Camera | None = None
        self._error: Exception | None = None
        spawn(self._run)

    def finished(self, within_s: float) -> bool:
        return self._finished.wait(within_s)

    def result(self) -> Camera:
        """The open camera, or the error of opening it."""
        if self._camera is not None:
            return self._camera
        raise self._error or DeviceLostError('reopening the camera was cancelled')

    def abandon(self) -> None:
        """Give up this attempt: the camera is closed as soon as it is open."""
        with self._lock:
            self._abandoned = True
            if self._camera is not None:
                self._camera.close()

    def _run(self) -> None:
        camera = self._connect()
        try:
            camera.open()
            with self._lock:
                self._camera = None if self._abandoned else camera
        except (TactileError, OSError) as error:
            self._error = error
        finally:
            if self._camera is None:
                camera.close()
            self._finished.set()


class Reconnecting:
    """A camera that wraps the cameras made by `connect`, one after another.

    The first `open` fails if the camera fails: a camera that was never there should be reported at once. After that, a
    lost camera is reopened repeatedly, with delays that double from 0.25 s to 5 s until a good frame arrives. Meanwhile
    `read` raises `DeviceTimeoutError`, never `DeviceLostError`, and keeps its timeout. The time of the
    last good frame decides whether it is alive, because OpenCV's ``isOpened()`` stays true after the cable is pulled.

    Args:
        connect: makes a camera that is not open yet.
        clock: times the delays.
        settings: `stall_s` is the silence after which the camera counts as lost.
        spawn: runs an attempt to reopen it.
    """

    def __init__(
        self,
        connect: Callable[[], Camera],
        clock: Clock,
        settings: CameraSettings,
        spawn: Callable[[Callable[[], None]], None] = in_a_thread,
    ) -> None:
        self._connect = connect
        self._spawn = spawn
        self._clock = clock
        self._source = settings.source
        self._stall_ns = round(settings.stall_s * NS_PER_S)
        self._camera: Camera | None = None
        self._attempt: _Attempt | None = None
        self._opened = False
        self._description: dict[str, str] = {}
        self._alive_ns = 0
        self._connected_ns = 0
        self._reason = ''
        self._delay_s = FIRST_DELAY_S
        self._next_try_ns = 0
        self._losses = 0
        self._frames_of_connection = 0
        self._last = (-1, 0)
        self._offset = (0, 0)

    @property
    def description(self) -> Mapping[str, str]:
        """As of the current or last camera, with the number of losses."""
        if self._camera is not None:
            self._description = dict(self._camera.description)
        return {**self._description, 'times lost': str(self._losses)}

    @property
    def health(self) -> Health:
        """ERROR while it is lost, or reopened without a frame yet; else the health of the camera."""
        if self._reason:
            lost_s = (self._clock.now_ns() - self._alive_ns) / NS_PER_S
            return Health(Level.ERROR, f'lost for {lost_s:.1f} s, reconnecting: {self._reason}')
        if self._camera is None:
            return Health(Level.STALE, f'{self._source} is not open')
        health = self._camera.health
        if self._losses and health.level == Level.OK:
            return Health(Level.OK, f'{health.message}; reconnected so far: {self._losses}')
        return health

    def open(self) -> None:
        """As `Camera.open`; the first failure is raised."""
        camera = self._connect()
        try:
            camera.open()
        except BaseException:
            camera.close()
            raise
        self._opened = True
        self._adopt(camera)
        self._alive_ns = self._clock.now_ns()

    def read(self, timeout_s: float) -> Frame | None:
        """The newest frame; `DeviceTimeoutError` while the camera is lost."""
        if not self._opened:
            raise DeviceError(f'{self._source} is closed; open it before reading')
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        camera = self._camera or self._try_again(deadline_ns)
        try:
            frame = camera.read(max(0.0, (deadline_ns - self._clock.now_ns()) / NS_PER_S))
        except DeviceTimeoutError as error:
            if self._clock.now_ns() - max(self._alive_ns, self._connected_ns) >= self._stall_ns:
                self._lose(error)
            raise
        except DeviceLostError as error:
            self._lose(error)
            raise DeviceTimeoutError(f'{error}; reconnecting') from error
        return self._counted(frame) if frame is not None else None

    def close(self) -> None:
        """As `Camera.close`."""
        self._opened = False
        self._reason = ''
        if self._attempt is not None:
            self._attempt.abandon()
            self._attempt = None
        self._drop_camera()

    def _adopt(self, camera: Camera) -> None:
        self._camera = camera
        self._frames_of_connection = 0
        self._connected_ns = self._clock.now_ns()

    def _try_again(self, deadline_ns: int) -> Camera:
        """The camera, if it is available before the deadline."""
        if self._attempt is None:
            self._clock.sleep_until(min(self._next_try_ns, deadline_ns))
            if self._next_try_ns > deadline_ns:
                raise DeviceTimeoutError(f'{self._source} is lost ({self._reason}); reconnecting')
            self._attempt = _Attempt(self._connect, self._spawn)
        if not self._attempt.finished(max(0.0, (deadline_ns - self._clock.now_ns()) / NS_PER_S)):
            raise DeviceTimeoutError(f'{self._source} is lost ({self._reason}); reopening it')
        attempt, self._attempt = self._attempt, None
        try:
            self._adopt(camera := attempt.result())
        except (DeviceError, OSError) as error:
            self._wait_longer(error)
            raise DeviceTimeoutError(f'{self._source} is still lost ({error}); reconnecting') from error
        return camera

    def _lose(self, error: DeviceError) -> None:
        if not self._reason:
            self._losses += 1
        self._wait_longer(error)
        self._drop_camera()

    def _wait_longer(self, error: Exception) -> None:
        self._reason = str(error)
        self._next_try_ns = self._clock.now_ns() + round(self._delay_s * NS_PER_S)
        self._delay_s = min(2 * self._delay_s, LONGEST_DELAY_S)

    def _drop_camera(self) -> None:
        if self._camera is not None:
            self._description = dict(self._camera.description)
            self._camera.close()
            self._camera = None

    def _counted(self, frame: Frame) -> Frame:
        """The frame with numbers that continue across connections; marks the camera as alive."""
        if self._frames_of_connection == 0:
            self._offset = (self._last[0] + 1, self._last[1])
        self._frames_of_connection += 1
        self._alive_ns = self._clock.now_ns()
        self._reason, self._delay_s = '', FIRST_DELAY_S
        self._last = (frame.sequence + self._offset[0], frame.dropped + self._offset[1])
        return dataclasses.replace(frame, sequence=self._last[0], dropped=self._last[1])
