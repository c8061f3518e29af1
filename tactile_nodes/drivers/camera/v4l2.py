"""A UVC or other V4L2 camera, through OpenCV.

Problems of such devices, and what is done about them: ``set`` returns True without effect, so all values are read back.
Setting the size resets the format, so the format is set first. After a camera is unplugged, ``read`` returns False at
once while ``isOpened()`` stays True, so the time of the last good frame decides whether it is alive. A stalled camera
blocks ``grab``, so a separate thread grabs. Some accept manual exposure only while streaming, so controls are set after
the first frame and again a second later. MJPG pictures are taken raw, checked for their end, and decoded here.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes import clock as clocks
from tactile_nodes import opencv
from tactile_nodes.clock import Clock
from tactile_nodes.drivers.camera import jpeg, v4l2_controls
from tactile_nodes.drivers.camera.contract import CameraSettings, Picture, check_size
from tactile_nodes.drivers.camera.reader import CameraConnection, LiveCamera, NewestFrame
from tactile_nodes.drivers.camera.stamps import Cadence, KernelStamps
from tactile_nodes.drivers.camera.v4l2_controls import KernelControls, Readback
from tactile_nodes.drivers.camera.v4l2_devices import check_device, device_path, located
from tactile_nodes.errors import DeviceLostError, DeviceNotFoundError

SETTLED_S = 1.0
PAUSE_S = 0.005


def open_capture(path: str) -> Any:
    """OpenCV's capture of a device, with the V4L2 back-end only: other back-ends may open another device."""
    cv2 = opencv.load()
    return cv2.VideoCapture(path, cv2.CAP_V4L2)


class V4l2Connection(CameraConnection):
    """An open device.

    Args:
        settings: the requested settings.
        clock: the host's.
        capture: opens the device's stream.
        controls: opens the device's controls.
        check: raises if the device is not a camera that this user may open.

    Raises:
        DeviceNotFoundError: there is no such camera, or it gives no video.
    """

    def __init__(
        self,
        settings: CameraSettings,
        clock: Clock,
        capture: Callable[[str], Any] = open_capture,
        controls: Callable[[str], KernelControls] = KernelControls,
        check: Callable[[str], None] = check_device,
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._source = device_path(settings.source)
        self._name = located(self._source)
        check(self._name)
        self._capture = capture(self._name)
        if not self._capture.isOpened():
            raise DeviceNotFoundError(
                f'{self._name} exists but gives no video; another program may use it '
                f'(see: fuser -v {self._name}), or it is not a camera (see: v4l2-ctl --list-devices)'
            )
        self._stamps = KernelStamps()
        self._format: dict[str, str] = {}
        self._format_complaints: list[str] = []
        self._readbacks: list[Readback] = []
        self._pause = threading.Event()
        self._raw = False
        self._cadence = Cadence(0.0)
        self._first_good_ns = 0
        self._settled = False
        self._controls: KernelControls | None = None
        with contextlib.suppress(OSError):  # no controls: requested ones are reported as missing
            self._controls = controls(self._name)
        self._configure()

    @property
    def description(self) -> Mapping[str, str]:
        """Format and controls, as read back, with the requested values."""
        readbacks = {readback.name: str(readback) for readback in self._readbacks}
        base = {'source': self._source, 'kind': 'V4L2 camera'}
        return {**base, **self._format, **readbacks, 'stamps': self._stamps.source}

    @property
    def complaints(self) -> list[str]:
        found = [*self._format_complaints, *(readback.complaint for readback in self._readbacks)]
        found.append(self._cadence.complaint)
        if self._stamps.complaint:
            found.append(f'stamped on arrival, because {self._stamps.complaint}')
        return [complaint for complaint in found if complaint]

    def fetch(self, slot: NewestFrame) -> None:
        if not self._capture.grab():
            self._check_plugged()
            return
        handed_ns = round(clocks.monotonic_s() * clocks.NS_PER_S)
        stamp_ns = self._stamps.stamp(self._capture.get(opencv.load().CAP_PROP_POS_MSEC), handed_ns)
        if missing := self._cadence.missing(stamp_ns):
            slot.miss(missing)
        image = self._picture()
        if image is None:
            slot.miss()
            self._check_plugged()
            return
        check_size(image, self._settings, self._name)
        self._note_size(image)
        self._set_controls()
        slot.put(image, stamp_ns)

    def interrupt(self) -> None:
        """End a pause; a grab cannot be woken."""
        self._pause.set()

    def close(self) -> None:
        self._capture.release()
        if self._controls is not None:
            self._controls.close()

    def _configure(self) -> None:
        cv2, settings = opencv.load(), self._settings
        if settings.fourcc:
            self._capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*settings.fourcc.ljust(4)[:4]))
        if settings.width and settings.height:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.width)
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.height)
        if settings.fps:
            self._capture.set(cv2.CAP_PROP_FPS, settings.fps)
        fourcc = fourcc_text(round(self._capture.get(cv2.CAP_PROP_FOURCC)))
        fps = self._capture.get(cv2.CAP_PROP_FPS)
        self._cadence = Cadence(fps)
        self._take_raw(fourcc)
        self._format = {
            'format': f'{fourcc} (requested {settings.fourcc or "none"})',
            'frames/s': f'{fps:g} (requested {settings.fps:g})',
        }
        if settings.fourcc and fourcc != settings.fourcc:
            self._format_complaints.append(f'the pixel format is {fourcc}, but {settings.fourcc} was requested')
        if settings.fps and abs(fps - settings.fps) > 0.01 * settings.fps:
            self._format_complaints.append(f'it gives {fps:g} frames/s, but {settings.fps:g} was requested')

    def _take_raw(self, fourcc: str) -> None:
        convert = opencv.load().CAP_PROP_CONVERT_RGB
        if fourcc == 'MJPG':
            self._capture.set(convert, 0)
            self._raw = self._capture.get(convert) == 0

    def _picture(self) -> Picture | None:
        """The picture; None: it did not arrive complete, or OpenCV cannot decode it."""
        try:
            good, image = self._capture.retrieve()
        except opencv.load().error:
            return None
        if not good or image is None:
            return None
        if self._raw:
            return jpeg.decode(np.asarray(image, np.uint8).tobytes())
        return np.asarray(image, np.uint8)

    def _note_size(self, image: Picture) -> None:
        requested = f'{self._settings.width or "any"}x{self._settings.height or "any"}'
        self._format['size'] = f'{image.shape[1]}x{image.shape[0]} (requested {requested})'

    def _set_controls(self) -> None:
        """Set the controls with the first frame, and again after a second, because some cameras reset them."""
        now_ns = self._clock.now_ns()
        self._first_good_ns = self._first_good_ns or now_ns
        settled = now_ns - self._first_good_ns >= SETTLED_S * clocks.NS_PER_S
        if self._readbacks and (self._settled or not settled):
            return
        self._settled = settled
        if self._controls is None:
            wanted = v4l2_controls.wishes(self._settings)
            self._readbacks = [Readback(name, value, None, needed) for name, (value, needed) in wanted.items()]
            return
        try:
            self._readbacks = v4l2_controls.apply(self._controls, self._settings)
        except OSError as error:
            raise DeviceLostError(f'{self._name} is gone ({error.strerror}); plug it in again') from error

    def _check_plugged(self) -> None:
        if not Path(self._name).exists():
            raise DeviceLostError(f'{self._name} was unplugged; plug it in again')
        self._pause.wait(PAUSE_S)  # read() fails at once after unplugging: avoid a busy loop


def v4l2_camera(settings: CameraSettings, clock: Clock) -> LiveCamera:
    """A device or serial number, not open yet."""
    return LiveCamera(device_path(settings.source), lambda: V4l2Connection(settings, clock), clock, settings)


def fourcc_text(code: int) -> str:
    """The four characters of a pixel format: 0x47504A4D is MJPG."""
    return (code & 0xFFFFFFFF).to_bytes(4, 'little').decode('latin-1').strip('\0 ')
