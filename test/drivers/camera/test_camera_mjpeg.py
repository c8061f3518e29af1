"""MJPEG over HTTP, against a server on this machine that stalls, cuts, lies and sends garbage."""

from __future__ import annotations

import base64
import contextlib
import threading
from collections.abc import Callable

import pytest
from jumping_clock import AheadClock

from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.camera.contract import Camera, CameraSettings, Frame
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import (
    ConfigurationError,
    DeviceError,
    DeviceNotFoundError,
    DeviceTimeoutError,
)

Serve = Callable[..., str]
Jpeg = Callable[..., bytes]


def connected(url: str, clock: SystemClock, **settings: object) -> Camera:
    return open_camera(CameraSettings(url, **settings), clock)


def level(frame: Frame) -> int:
    return round((float(frame.image.mean()) - 22) / 10)


def read_or_none(camera: Camera, timeout_s: float) -> Frame | None:
    with contextlib.suppress(DeviceTimeoutError):
        return camera.read(timeout_s)
    return None


def until_lost(camera: Camera) -> str:
    """Why it was lost."""
    while (health := camera.health).level != Level.ERROR:
        read_or_none(camera, 0.05)
    camera.close()
    return health.message


def sends(count: int, stalls: bool = True) -> Callable[..., None]:
    """What a server does: so many pictures, and then nothing more, or the end of the connection."""

    def script(peer) -> None:
        peer.head()
        peer.stream(count=count)
        if stalls:
            peer.stall()

    return script


def test_a_silent_server_is_lost_after_the_stall_time(serve: Serve, clock: SystemClock) -> None:
    """By its socket, or by the pictures that are missing, whichever is noticed first; and not before."""
    camera = connected(serve(sends(2)), clock, stall_s=0.3)
    last = camera.read(20.0)
    reason = until_lost(camera)
    assert 'has sent nothing for 0.3 s' in reason or 'has sent no complete picture for ' in reason
    assert clock.now_ns() - last.stamp_ns >= 0.3e9


def test_a_server_that_trickles_bytes_without_a_picture_is_lost_too(serve: Serve, ahead: AheadClock) -> None:
    def script(peer) -> None:
        peer.head()
        peer.stream(count=1)
        while not peer.over.wait(0.02):
            peer.raw(b'x' * 100)

    camera = connected(serve(script), ahead, stall_s=60.0)
    ahead.advance(61.0)
    assert 'no complete picture' in until_lost(camera)


def test_a_cut_connection_is_lost_at_once(serve: Serve, clock: SystemClock) -> None:
    assert 'has ended its stream' in until_lost(connected(serve(sends(2, stalls=False)), clock, stall_s=5.0))


def test_pictures_that_are_not_whole_are_dropped_and_counted(serve: Serve, clock: SystemClock, jpeg_of: Jpeg) -> None:
    """Of frame 0, six spoiled ones and frame 7, two arrive, and six are lost."""
    go = threading.Event()

    def script(peer) -> None:
        peer.head()
        peer.part(jpeg_of(0))
        go.wait(30)
        picture = jpeg_of(3)
        for spoiled in (picture[:-300], picture[2:], b'', b'garbage', b'\xff\xd8\xff\xd9', picture[:100]):
            peer.part(spoiled)
        peer.raw(b'\x00\xff more garbage between the parts\r\n' * 20)
        peer.part(jpeg_of(7))
        peer.stall()

    camera = connected(serve(script), clock, stall_s=5.0)
    assert level(camera.read(20.0)) == 0
    go.set()
    frame = camera.read(20.0)
    assert (level(frame), frame.sequence, frame.dropped) == (7, 7, 6)
    camera.close()


def test_pictures_are_stamped_when_they_arrive(serve: Serve, clock: SystemClock, jpeg_of: Jpeg) -> None:
    """The first bytes of the second picture are read before its last ones are sent."""
    go, sent_ns, read_ns = threading.Event(), [], []

    class Noting(SystemClock):
        def now_ns(self) -> int:
            read_ns.append(super().now_ns())
            return read_ns[-1]

    def script(peer) -> None:
        peer.head()
        peer.part(jpeg_of(0))
        go.wait(30)
        body = jpeg_of(1)
        sent_ns.append(clock.now_ns())
        peer.raw(b'--frame\r\nContent-Length: %d\r\n\r\n' % len(body) + body[:50])
        while sum(each > sent_ns[0] for each in read_ns) < 2 and not peer.over.wait(0.01):
            pass  # one reading may be the last of the first picture, but not both
        sent_ns.append(clock.now_ns())
        peer.raw(body[50:])
        peer.stall()

    camera = connected(serve(script), Noting(), stall_s=60.0)
    camera.read(20.0)
    go.set()
    frame = camera.read(20.0)
    assert sent_ns[0] < frame.stamp_ns < sent_ns[1]
    camera.close()


def test_closing_does_not_wait_for_a_silent_server(serve: Serve, clock: SystemClock) -> None:
    camera = connected(serve(sends(1)), clock, stall_s=120.0)
    (thread,) = (each for each in threading.enumerate() if each.name.startswith('camera '))
    camera.close()
    thread.join(30)
    assert not thread.is_alive()


def test_a_server_without_pictures_fails_to_open_in_time(serve: Serve, clock: SystemClock) -> None:
    with pytest.raises(DeviceError, match=r'has sent nothing for 0\.3 s'):
        connected(serve(sends(0)), clock, stall_s=0.3)


@pytest.mark.parametrize(
    ('kind', 'status', 'text'),
    [
        ('multipart/x-mixed-replace; boundary=frame', 404, r'responded 404 Not Found; check the path'),
        ('text/html', 401, r'responded 401 Unauthorized; give user and password .* allow basic authentication'),
        ('text/html', 200, r'sends text/html, but an MJPEG stream is multipart'),
        ('image/jpeg', 200, r'sends image/jpeg, but an MJPEG stream is multipart'),
        ('multipart/x-mixed-replace', 200, r'with a boundary'),
    ],
)
def test_an_answer_that_is_no_stream_is_refused(
    serve: Serve, clock: SystemClock, kind: str, status: int, text: str
) -> None:
    url = serve(lambda peer: peer.head(kind, status))
    with pytest.raises(DeviceNotFoundError, match=text):
        connected(url, clock)


@pytest.mark.parametrize('scheme', ['http', 'rtsp'])
@pytest.mark.parametrize('host', ['192.168.1..5', '[::1', ':80', '127.0.0.1:99999'])
def test_an_address_with_a_typing_error_is_refused_in_a_sentence(scheme: str, host: str, clock: SystemClock) -> None:
    with pytest.raises(ConfigurationError, match='is not a camera address') as raised:
        open_camera(CameraSettings(source=f'{scheme}://me:secret@{host}/gel'), clock)
    assert 'secret' not in str(raised.value)


def test_user_and_password_are_sent_and_never_shown(serve: Serve, clock: SystemClock) -> None:
    requests = []

    def script(peer) -> None:
        requests.append((peer.path, peer.headers['Authorization']))
        peer.head()
        peer.stream()

    url = serve(script).replace('http://', 'http://me:se%40cret@') + '?res=vga'
    camera = connected(url, clock)
    camera.close()
    assert requests == [('/stream.mjpg?res=vga', 'Basic ' + base64.b64encode(b'me:se@cret').decode())]
    assert 'cret' not in str(camera.description)


def test_a_lost_connection_is_closed_before_the_next_for_servers_that_have_one_client(
    serve: Serve, clock: SystemClock
) -> None:
    """Such as an ESP32-CAM, which refuses a second one as long as the first is connected."""
    left, clients = threading.Event(), []

    def script(peer) -> None:
        clients.append(peer)
        if len(clients) == 1:
            peer.head()
            peer.stream(count=2)
            peer.wait_until_left()
            left.set()
        else:
            peer.head(status=200 if left.is_set() else 503)
            peer.stream()

    camera = open_camera(CameraSettings(serve(script), stall_s=0.3), clock)
    deadline_ns = clock.now_ns() + 60_000_000_000
    for level in (Level.ERROR, Level.OK):
        while camera.health.level != level:
            assert clock.now_ns() < deadline_ns
            read_or_none(camera, 0.05)
    camera.close()


def test_the_camera_reconnects_when_the_server_comes_back(serve: Serve, clock: SystemClock) -> None:
    """The first connection is cut after three pictures; the others go on, once the loss was seen."""
    connections, seen = [], threading.Event()

    def script(peer) -> None:
        connections.append(peer)
        if len(connections) > 1:
            seen.wait(30)
        peer.head()
        peer.stream(count=3 if len(connections) == 1 else 10_000)

    camera = connected(serve(script), clock, stall_s=30.0)
    frames = []
    while camera.health.level != Level.ERROR:
        frames.append(read_or_none(camera, 0.05))
    seen.set()
    frames += [camera.read(20.0) for _ in range(8)]
    assert camera.health.level == Level.OK
    assert 'reconnected so far: 1' in camera.health.message
    assert camera.description['times lost'] == '1'
    numbers = [frame.sequence for frame in frames if frame is not None]
    assert numbers == sorted(set(numbers))
    camera.close()
