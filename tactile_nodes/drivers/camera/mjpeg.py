"""MJPEG over HTTP: ``multipart/x-mixed-replace``, as sent by IP cameras, mjpg-streamer, ESP32-CAM and others.

OpenCV can read such streams too, but it detects a stall late, keeps old frames in a queue, and its time stamps are the
frame number divided by 25. So this driver reads the stream itself. A picture is stamped when its first bytes arrive,
a silence of `stall_s` means that the camera is lost, and truncated pictures are counted and dropped. Arrival stamps do
not include the latency of the network.
"""

from __future__ import annotations

import base64
import contextlib
import http.client
import re
import socket
import urllib.parse
from collections.abc import Mapping

from tactile_nodes.clock import Clock
from tactile_nodes.drivers.camera import jpeg
from tactile_nodes.drivers.camera.contract import CameraSettings, check_size
from tactile_nodes.drivers.camera.multipart import MultipartParser, Part
from tactile_nodes.drivers.camera.reader import CameraConnection, LiveCamera, NewestFrame
from tactile_nodes.errors import ConfigurationError, DeviceLostError, DeviceNotFoundError

CONNECT_S = 3.0
CHUNK = 64 * 1024
RECEIVE_BUFFER = 256 * 1024  # the kernel would keep megabytes of old pictures for a delayed reader


class MjpegConnection(CameraConnection):
    """One connection to an MJPEG server.

    Raises:
        DeviceNotFoundError: it cannot be connected to, or sends no such stream.
    """

    def __init__(self, settings: CameraSettings, clock: Clock) -> None:
        self._settings = settings
        self._clock = clock
        self._url = parse_address(settings.source)
        self._name = without_password(self._url)
        self._size = ''
        self._last_ns = 0
        self._response = self._request()
        self._parser = MultipartParser(_boundary(self._response, self._name))

    @property
    def description(self) -> Mapping[str, str]:
        return {'source': self._name, 'kind': 'MJPEG over HTTP', 'size': self._size, 'stamps': 'arrival'}

    def fetch(self, slot: NewestFrame) -> None:
        for part in self._parser.feed(self._receive(), self._clock.now_ns()):
            self._put(part, slot)

    def interrupt(self) -> None:
        with contextlib.suppress(OSError):  # it may be closed already
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._response.close()
        self._socket.close()

    def _request(self) -> http.client.HTTPResponse:
        secure = self._url.scheme == 'https'
        kind = http.client.HTTPSConnection if secure else http.client.HTTPConnection
        connection = kind(self._url.hostname or '', self._url.port, timeout=CONNECT_S)
        try:
            connection.connect()
            self._socket = connection.sock
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            connection.request('GET', _path(self._url), headers=_headers(self._url))
            response = connection.getresponse()
            self._socket.settimeout(self._settings.stall_s)
        except TimeoutError as error:
            connection.close()
            raise DeviceNotFoundError(
                f'{self._name} did not respond within {CONNECT_S:g} s; check the address and the network'
            ) from error
        except (OSError, http.client.HTTPException) as error:
            connection.close()
            raise DeviceNotFoundError(
                f'cannot connect to {self._name} ({_reason(error)}); check the address, and that the camera is on'
            ) from error
        return _accepted(response, self._name)

    def _receive(self) -> bytes:
        try:
            data = self._response.read1(CHUNK)
        except TimeoutError as error:
            raise DeviceLostError(f'{self._name} has sent nothing for {self._settings.stall_s:g} s') from error
        except (OSError, ValueError, http.client.HTTPException) as error:
            raise DeviceLostError(f'the connection to {self._name} broke ({_reason(error)})') from error
        if not data:
            raise DeviceLostError(f'{self._name} has ended its stream')
        return data

    def _put(self, part: Part, slot: NewestFrame) -> None:
        image = jpeg.decode(part.body)
        if image is None:
            slot.miss()
            return
        check_size(image, self._settings, self._name)
        self._size = f'{image.shape[1]}x{image.shape[0]}'
        self._last_ns = max(part.arrival_ns, self._last_ns + 1)  # two parts may arrive together
        slot.put(image, self._last_ns)


def mjpeg_camera(settings: CameraSettings, clock: Clock) -> LiveCamera:
    """The camera at an address, not open yet. Raises ConfigurationError: it is no address of a camera."""
    name = without_password(parse_address(settings.source))
    return LiveCamera(name, lambda: MjpegConnection(settings, clock), clock, settings)


def without_password(url: urllib.parse.SplitResult) -> str:
    """The address as shown in logs: ``http://user:secret@host/`` becomes ``http://host/``."""
    return url._replace(netloc=url.netloc.rpartition('@')[2]).geturl()


def parse_address(source: str) -> urllib.parse.SplitResult:
    """The parts of an address.

    Raises:
        ConfigurationError: it is no address of a camera.
    """
    shown = re.sub('//[^/]*@', '//', source)  # without a password
    try:
        url = urllib.parse.urlsplit(source.strip())
        usable = bool((url.hostname or '').encode('idna')) and url.port != 0
    except ValueError as error:  # UnicodeError, too: 'http://192.168.1..5/' has an empty part
        raise ConfigurationError(f'{shown!r} is not a camera address ({error})') from error
    if not usable:
        raise ConfigurationError(f'{shown!r} is not a camera address; use {url.scheme}://host:port/path')
    return url


def _path(url: urllib.parse.SplitResult) -> str:
    return (url.path or '/') + (f'?{url.query}' if url.query else '')


def _headers(url: urllib.parse.SplitResult) -> dict[str, str]:
    headers = {'Accept': 'multipart/x-mixed-replace, image/jpeg', 'User-Agent': 'tactile_nodes'}
    if url.username is not None:
        pair = f'{urllib.parse.unquote(url.username)}:{urllib.parse.unquote(url.password or "")}'
        headers['Authorization'] = 'Basic ' + base64.b64encode(pair.encode()).decode()
    return headers


def _accepted(response: http.client.HTTPResponse, name: str) -> http.client.HTTPResponse:
    if response.status == http.client.OK:
        return response
    target = response.getheader('Location')
    response.close()
    advice = f'it redirects to {target}' if target else 'check the path'
    if response.status == http.client.UNAUTHORIZED:
        advice = 'give user and password as http://user:password@host/…, and allow basic authentication in the camera'
    raise DeviceNotFoundError(f'{name} responded {response.status} {response.reason}; {advice}')


def _boundary(response: http.client.HTTPResponse, name: str) -> str:
    kind = response.getheader('Content-Type', '')
    found = re.search(r'boundary\s*=\s*("[^"]+"|[^\s;"]+)', kind, re.IGNORECASE)
    if kind.lower().startswith('multipart/') and found is not None and found.group(1).strip('"-'):
        return found.group(1)
    response.close()
    raise DeviceNotFoundError(
        f'{name} sends {kind or "no Content-Type"}, but an MJPEG stream is multipart/x-mixed-replace with a '
        "boundary; look up the address of the stream in the camera's manual"
    )


def _reason(error: Exception) -> str:
    text = error.strerror if isinstance(error, OSError) else None
    return text or str(error) or type(error).__name__
