"""RTSP cameras, through OpenCV and FFmpeg, over TCP.

The stamps are arrival times: for a network source, OpenCV's position is the frame number over the nominal rate. FFmpeg
reorders frames in a buffer. Arrival stamps do not include the delay of that buffer and of the network. If latency
matters, use the MJPEG address of the camera instead.
"""

from __future__ import annotations

import socket
from collections.abc import Mapping
from typing import Any

import numpy as np

from tactile_nodes import opencv
from tactile_nodes.clock import Clock
from tactile_nodes.decoding import open_video
from tactile_nodes.drivers.camera.contract import CameraSettings, check_size
from tactile_nodes.drivers.camera.mjpeg import parse_address, without_password
from tactile_nodes.drivers.camera.reader import LiveCamera, NewestFrame
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceNotFoundError

PORTS = {'rtsp': 554, 'rtsps': 322}
CONNECT_S = 3.0


class RtspCamera(LiveCamera):
    """One session with an RTSP server; make a new one after it is lost."""

    def __init__(self, settings: CameraSettings, clock: Clock) -> None:
        self._settings = settings
        self._clock = clock
        self._url = parse_address(settings.source)
        super().__init__(without_password(self._url))
        self._size = ''
        self._last_ns = 0

    @property
    def description(self) -> Mapping[str, str]:
        """The address, the size of the pictures, and the kind of stamps."""
        return {'source': self.name, 'kind': 'RTSP over TCP', 'size': self._size, 'stamps': 'arrival'}

    @property
    def health(self) -> Health:
        """OK while it is open, with the number of lost frames."""
        if self._reader is None:
            return Health(Level.STALE, f'{self.name} is not open')
        return Health(Level.OK, f'receiving {self.name}, frames lost: {self._reader.dropped}')

    def open(self) -> None:
        """Start the session, and wait for the first picture."""
        self._knock()
        video = self._start()
        frame = self._drain(lambda slot: self._fetch(video, slot), video.release, CONNECT_S)
        self._size = f'{frame.image.shape[1]}x{frame.image.shape[0]}'

    def _knock(self) -> None:
        """Open a plain connection first, because FFmpeg gives no reason for a failure."""
        try:
            address = (self._url.hostname or '', self._url.port or PORTS[self._url.scheme.lower()])
            socket.create_connection(address, timeout=CONNECT_S).close()
        except OSError as error:
            raise DeviceNotFoundError(
                f'cannot connect to {self.name} ({error.strerror or error}); check the address, and that it is on'
            ) from error

    def _start(self) -> Any:
        cv2 = opencv.load()
        limits = [
            (cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, round(CONNECT_S * 1000)),
            (cv2.CAP_PROP_READ_TIMEOUT_MSEC, round(self._settings.stall_s * 1000)),
        ]
        try:
            video = open_video(self._settings.source.strip(), [value for pair in limits for value in pair])
        except OSError as error:
            raise DeviceError(f'{self.name} sends too large pictures: {error.strerror}; reduce the size') from error
        if video is None:
            raise DeviceNotFoundError(
                f'{self.name} responds, but sends no video; check the path, user and password: '
                'rtsp://user:password@host/path'
            )
        return video

    def _fetch(self, video: Any, slot: NewestFrame) -> None:
        good, image = video.read()
        if not good:
            raise DeviceLostError(f'{self.name} has ended its stream or sent nothing for {self._settings.stall_s:g} s')
        check_size(image, self._settings, self.name)
        self._last_ns = max(self._clock.now_ns(), self._last_ns + 1)
        slot.put(np.asarray(image, np.uint8), self._last_ns)
