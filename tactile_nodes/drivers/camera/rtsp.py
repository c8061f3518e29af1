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
from tactile_nodes.drivers.camera.reader import CameraConnection, LiveCamera, NewestFrame
from tactile_nodes.errors import DeviceError, DeviceLostError, DeviceNotFoundError

PORTS = {'rtsp': 554, 'rtsps': 322}
CONNECT_S = 3.0


class RtspConnection(CameraConnection):
    """One session with an RTSP server.

    Raises:
        DeviceNotFoundError: it cannot be connected to, or sends no video.
    """

    def __init__(self, settings: CameraSettings, clock: Clock) -> None:
        self._settings = settings
        self._clock = clock
        self._url = parse_address(settings.source)
        self._name = without_password(self._url)
        self._size = ''
        self._last_ns = 0
        self._knock()
        self._video = self._start()

    @property
    def description(self) -> Mapping[str, str]:
        return {'source': self._name, 'kind': 'RTSP over TCP', 'size': self._size, 'stamps': 'arrival'}

    def fetch(self, slot: NewestFrame) -> None:
        good, image = self._video.read()
        if not good:
            raise DeviceLostError(f'{self._name} has ended its stream or sent nothing for {self._settings.stall_s:g} s')
        check_size(image, self._settings, self._name)
        self._size = f'{image.shape[1]}x{image.shape[0]}'
        self._last_ns = max(self._clock.now_ns(), self._last_ns + 1)
        slot.put(np.asarray(image, np.uint8), self._last_ns)

    def close(self) -> None:
        self._video.release()

    def _knock(self) -> None:
        """Open a plain connection first, because FFmpeg gives no reason for a failure."""
        try:
            address = (self._url.hostname or '', self._url.port or PORTS[self._url.scheme.lower()])
            socket.create_connection(address, timeout=CONNECT_S).close()
        except OSError as error:
            raise DeviceNotFoundError(
                f'cannot connect to {self._name} ({error.strerror or error}); check the address, and that it is on'
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
            raise DeviceError(f'{self._name} sends too large pictures: {error.strerror}; reduce the size') from error
        if video is None:
            raise DeviceNotFoundError(
                f'{self._name} responds, but sends no video; check the path, user and password: '
                'rtsp://user:password@host/path'
            )
        return video


def rtsp_camera(settings: CameraSettings, clock: Clock) -> LiveCamera:
    """The camera at an address, not open yet. Raises ConfigurationError: it is no address of a camera."""
    name = without_password(parse_address(settings.source))
    return LiveCamera(name, lambda: RtspConnection(settings, clock), clock, settings)
