"""What every camera does, whatever it is: the twin, recordings, network streams, V4L2."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import statistics
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_nodes.clock import SystemClock
from tactile_nodes.drivers.camera.contract import Camera, CameraSettings, Frame
from tactile_nodes.drivers.camera.opening import open_camera
from tactile_nodes.drivers.camera.reader import LiveCamera
from tactile_nodes.drivers.camera.v4l2 import V4l2Connection
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import DeviceError, DeviceTimeoutError, ImageError

Make = Callable[..., Camera]
CAMERAS = ['simulated', 'video', 'folder', 'mjpeg', 'v4l2 emulated']
REAL = os.environ.get('TACTILE_CAMERA', '/dev/video0')


def make_simulated(request: pytest.FixtureRequest, slow: bool) -> Make:
    settings = CameraSettings(fps=0.2 if slow else 100.0)
    return lambda **more: open_camera(replace(settings, **more), SystemClock())


def make_recorded(request: pytest.FixtureRequest, slow: bool) -> Make:
    path = request.getfixturevalue('video' if 'video' in request.node.name else 'folder')
    settings = CameraSettings(str(path), fps=50.0, rate=0.002 if slow else 1.0)
    return lambda **more: open_camera(replace(settings, **more), SystemClock())


def make_mjpeg(request: pytest.FixtureRequest, slow: bool) -> Make:
    def script(peer) -> None:
        peer.head()
        peer.stream(count=1 if slow else 10_000)
        peer.stall()

    settings = CameraSettings(request.getfixturevalue('serve')(script), stall_s=5.0)
    return lambda **more: open_camera(replace(settings, **more), SystemClock())


def make_emulated(request: pytest.FixtureRequest, slow: bool) -> Make:
    device = request.getfixturevalue('device')
    settings = CameraSettings(str(device.node), fps=100.0)

    def make(**more: object) -> Camera:
        used, clock = replace(settings, **more), SystemClock()
        camera = LiveCamera(
            str(device.node),
            lambda: V4l2Connection(used, clock, device.capture, device.access, lambda path: None),
            clock,
            used,
        )
        camera.open()
        if slow:
            device.stalled.set()
            with contextlib.suppress(DeviceTimeoutError):
                while True:
                    camera.read(0.05)
            request.addfinalizer(device.stalled.clear)
        return camera

    return make


def make_real(request: pytest.FixtureRequest, slow: bool) -> Make:
    if not Path(REAL).exists():
        pytest.skip(f'no camera {REAL}; name one in TACTILE_CAMERA')
    if slow:
        pytest.skip('a real camera cannot be made to stall')
    return lambda **more: open_camera(CameraSettings(REAL, **{'fps': 0.0, **more}), SystemClock())


MAKERS = {
    'simulated': make_simulated,
    'video': make_recorded,
    'folder': make_recorded,
    'mjpeg': make_mjpeg,
    'v4l2 emulated': make_emulated,
    'v4l2': make_real,
}


@pytest.fixture(params=[*CAMERAS, pytest.param('v4l2', marks=pytest.mark.hardware)])
def make(request: pytest.FixtureRequest) -> Iterator[Make]:
    """Makes one kind of camera, with settings of the test's own."""
    with contextlib.ExitStack() as stack:
        yield _closing(stack, MAKERS[request.param](request, slow=False))


@pytest.fixture(params=CAMERAS)
def slow(request: pytest.FixtureRequest) -> Iterator[Camera]:
    """A camera that gives one frame and then, for seconds, none."""
    with contextlib.ExitStack() as stack:
        yield _closing(stack, MAKERS[request.param](request, slow=True))()


def _closing(stack: contextlib.ExitStack, make: Make) -> Make:
    return lambda **more: stack.enter_context(contextlib.closing(make(**more)))


def read(camera: Camera, count: int = 5) -> list[Frame]:
    frames = [camera.read(20.0) for _ in range(count)]
    assert None not in frames
    return frames  # type: ignore[return-value]


def test_a_frame_is_an_8_bit_image_of_one_or_three_channels(make: Make) -> None:
    (frame,) = read(make(), 1)
    assert frame.image.dtype == np.uint8
    assert frame.image.shape[2:] in {(), (3,)}


def test_stamps_increase_on_the_time_base_of_the_host_and_lost_frames_are_counted(make: Make) -> None:
    camera, clock = make(), SystemClock()
    opened_ns, frames = clock.now_ns(), []
    for _ in range(5):
        frames += read(camera, 1)
        assert opened_ns - 2_000_000_000 < frames[-1].stamp_ns <= clock.now_ns()
    for earlier, later in itertools.pairwise(frames):
        assert later.stamp_ns > earlier.stamp_ns
        assert later.sequence - earlier.sequence - 1 == later.dropped - earlier.dropped >= 0


def test_stamps_follow_the_rate_of_the_source(make: Make) -> None:
    """50 or 100 frames a second are 10 to 20 ms from one to the next; most are, even if some come late and at once."""
    frames = read(make(loop=True), 25)
    steps = [
        (later.stamp_ns - earlier.stamp_ns) / (later.sequence - earlier.sequence)
        for earlier, later in itertools.pairwise(frames)
    ]
    assert 0.005e9 < statistics.median(steps) < 0.5e9


def test_reading_gives_up_after_its_timeout(slow: Camera) -> None:
    clock = SystemClock()
    with pytest.raises(DeviceTimeoutError):
        for _ in range(2):
            started_ns = clock.now_ns()
            slow.read(0.1)
    assert 0.09e9 < clock.now_ns() - started_ns < 4e9  # the next frame would come after five seconds, if any


def test_an_open_camera_is_not_in_error_and_one_that_was_closed_twice_is_stale_and_gives_no_frame(make: Make) -> None:
    camera = make()
    read(camera, 1)
    assert camera.health.level in {Level.OK, Level.WARN}
    camera.close()
    camera.close()
    assert camera.health.level == Level.STALE
    with pytest.raises(DeviceError, match='closed'):
        camera.read(0.1)


def test_the_size_that_it_has_may_be_asked_for_and_another_is_refused_with_both_sizes(make: Make) -> None:
    height, width = read(camera := make(), 1)[0].image.shape[:2]
    camera.close()
    with pytest.raises(ImageError, match=rf'{width}x{height}.*77x33 was requested.*set width and height'):
        make(width=77, height=33)
    assert read(make(width=width, height=height), 1)[0].image.shape[:2] == (height, width)


def test_the_description_names_the_source_the_size_and_the_origin_of_the_stamps(make: Make) -> None:
    camera = make()
    image = read(camera, 1)[0].image
    assert {'source', 'kind', 'stamps'} <= set(camera.description)
    assert camera.description['size'].startswith(f'{image.shape[1]}x{image.shape[0]}')


def test_closing_ends_the_threads_and_opening_again_works(make: Make) -> None:
    for _ in range(3):
        camera = make()
        assert read(camera, 2)[0].image.size > 0
        camera.close()


@pytest.mark.parametrize(
    ('source', 'error', 'text'),
    [
        ('/dev/video63', 'DeviceNotFoundError', r'there is no camera /dev/video63; .*connect one'),
        ('63', 'DeviceNotFoundError', r'there is no camera /dev/video63'),
        ('/dev/v4l/by-id/none', 'DeviceNotFoundError', r'there is no camera /dev/v4l/by-id/none'),
        ('/dev/null', 'DeviceNotFoundError', r'/dev/null is not a video device'),
        ('', 'ConfigurationError', 'the camera source is empty; name a device, a file or an address, or "simulated"'),
        ('nowhere.avi', 'DeviceNotFoundError', r"no camera, video or folder of images is named 'nowhere.avi'"),
        ('ftp://camera/a', 'ConfigurationError', r'scheme ftp:// is not supported; use http://'),
        (
            'http://127.0.0.1:9/a',
            'DeviceNotFoundError',
            r'cannot connect to http://127.0.0.1:9/a \(Connection refused\)',
        ),
        (
            'rtsp://127.0.0.1:9/a',
            'DeviceNotFoundError',
            r'cannot connect to rtsp://127.0.0.1:9/a \(Connection refused\)',
        ),
        ('http:///a', 'ConfigurationError', r'not a camera address; use http://host:port/path'),
        ('http://h:x/a', 'ConfigurationError', r'not a camera address'),
    ],
)
def test_a_source_that_is_not_there_is_one_clear_sentence(source: str, error: str, text: str) -> None:
    with pytest.raises(Exception, match=text) as raised:
        open_camera(CameraSettings(source), SystemClock())
    assert type(raised.value).__name__ == error
    assert '\n' not in str(raised.value)
    assert re.search(r'[;,(]', str(raised.value))
