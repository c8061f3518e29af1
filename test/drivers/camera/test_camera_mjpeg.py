"""MJPEG over HTTP, against a server on this machine that stalls, cuts, lies and sends garbage."""

from __future__ import annotations

import base64
import contextlib
import threading
from collections.abc import Callable

import pytest

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


def test_a_silent_server_is_lost_after_the_stall_time(serve: Serve, clock: SystemClock) -> None:
    """By its socket, or by the pictures that are missing, whichever is noticed first."""
    last_ns = []

    def script(peer) -> None:
        peer.head()
        peer.stream(count=2)
        last_ns.append(clock.now_ns())
        peer.stall()

    reason = until_lost(connected(serve(script), clock, stall_s=0.3))
    assert 'has sent nothing for 0.3 s' in reason or 'has sent no complete picture for 0.' in reason
    assert 0.25e9 < clock.now_ns() - last_ns[0] < 1.5e9


def test_a_server_that_trickles_bytes_without_a_picture_is_lost_too(serve: Serve, clock: SystemClock) -> None:
    def script(peer) -> None:
        peer.head()
        peer.stream(count=1)
        while not peer.over.wait(0.02):
            peer.raw(b'x' * 100)

    assert 'no complete picture' in until_lost(connected(serve(script), clock, stall_s=0.3))


def test_a_cut_connection_is_lost_at_once(serve: Serve, clock: SystemClock) -> None:
    def script(peer) -> None:
        peer.head()
        peer.stream(count=2)

    assert 'has ended its stream' in until_lost(connected(serve(script), clock, stall_s=5.0))


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
    assert level(camera.read(2.0)) == 0
    go.set()
    frame = camera.read(2.0)
    assert (level(frame), frame.sequence, frame.dropped) == (7, 7, 6)
    camera.close()


def test_wrong_lengths_cost_no_more_than_the_parts_that_carry_them(
    serve: Serve, clock: SystemClock, jpeg_of: Jpeg
) -> None:
    go = threading.Event()

    def script(peer) -> None:
        peer.head()
        peer.part(jpeg_of(0), length=None)
        peer.part(jpeg_of(1))
        go.wait(30)
        peer.part(jpeg_of(2), length=100)  # too short: the picture is cut
        peer.part(jpeg_of(3), length=1_000_000)  # too long: the next delimiter ends it
        peer.part(jpeg_of(4))
        peer.stall()

    camera = connected(serve(script), clock, stall_s=5.0)
    while level(camera.read(2.0)) != 1:
        pass
    go.set()
    while level(frame := camera.read(2.0)) != 4:
        pass
    assert frame.sequence == 4
    camera.close()


def test_the_newest_picture_wins_and_overtaken_ones_are_counted(
    serve: Serve, clock: SystemClock, jpeg_of: Jpeg
) -> None:
    sent = threading.Event()

    def script(peer) -> None:
        peer.head()
        for number in range(10):
            peer.part(jpeg_of(number))
        sent.set()
        peer.stall()

    camera = connected(serve(script), clock, stall_s=5.0)
    assert sent.wait(30)
    last = camera.read(2.0)
    while level(last) != 9:
        last = camera.read(2.0)
    assert last.sequence == 9
    camera.close()


def test_pictures_are_stamped_when_they_arrive(serve: Serve, clock: SystemClock, jpeg_of: Jpeg) -> None:
    """The first bytes of the second picture come before, its last bytes after the pause."""
    go, sent_ns = threading.Event(), []

    def script(peer) -> None:
        peer.head()
        peer.part(jpeg_of(0))
        go.wait(30)
        body = jpeg_of(1)
        sent_ns.append(clock.now_ns())
        peer.raw(b'--frame\r\nContent-Length: %d\r\n\r\n' % len(body) + body[:50])
        peer.over.wait(0.3)
        peer.raw(body[50:])
        peer.stall()

    camera = connected(serve(script), clock, stall_s=5.0)
    camera.read(2.0)
    go.set()
    frame = camera.read(2.0)
    assert 0 <= frame.stamp_ns - sent_ns[0] < 0.2e9
    camera.close()


def test_closing_does_not_wait_for_a_silent_server(serve: Serve, clock: SystemClock) -> None:
    def script(peer) -> None:
        peer.head()
        peer.stream(count=1)
        peer.stall()

    camera = connected(serve(script), clock, stall_s=10.0)
    camera.read(2.0)
    started_ns = clock.now_ns()
    camera.close()
    assert clock.now_ns() - started_ns < 0.5e9


def test_a_server_without_pictures_fails_to_open_in_time(serve: Serve, clock: SystemClock) -> None:
    def script(peer) -> None:
        peer.head()
        peer.stall()

    with pytest.raises(DeviceError, match=r'has sent nothing for 0\.3 s'):
        connected(serve(script), clock, stall_s=0.3)


@pytest.mark.parametrize(
    ('kind', 'status', 'text'),
    [
        ('multipart/x-mixed-replace; boundary=frame', 404, r'responded 404 Not Found; check the path'),
        ('text/html', 401, r'responded 401 Unauthorized; give user and password'),
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
    while camera.health.level == Level.OK:
        read_or_none(camera, 0.05)
    deadline_ns = clock.now_ns() + 10_000_000_000
    while camera.health.level != Level.OK and clock.now_ns() < deadline_ns:
        read_or_none(camera, 0.05)
    assert camera.health.level == Level.OK
    camera.close()


def test_the_camera_reconnects_when_the_server_comes_back(serve: Serve, clock: SystemClock) -> None:
    """The first connection is cut after three pictures; the second goes on."""
    connections = []

    def script(peer) -> None:
        connections.append(peer)
        peer.head()
        peer.stream(count=3 if len(connections) == 1 else 10_000)

    camera = open_camera(CameraSettings(serve(script), stall_s=0.5), clock)
    frames, failures = [], 0
    while len(connections) < 2 or not frames or len(frames) < 8:
        frame = read_or_none(camera, 0.1)
        if frame is not None:
            frames.append(frame)
            continue
        failures += 1
        assert camera.health.level == Level.ERROR
        assert failures < 50
    assert failures >= 1
    assert camera.health.level == Level.OK
    assert 'reconnected so far: 1' in camera.health.message
    assert camera.description['times lost'] == '1'
    numbers = [frame.sequence for frame in frames]
    assert numbers == sorted(set(numbers))
    camera.close()
