"""Losing a camera and finding it again, on a cable that the test pulls."""

from __future__ import annotations

import contextlib
import re
import threading
from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pytest
from jumping_clock import AheadClock

from tactile_nodes.clock import SystemClock, monotonic_s
from tactile_nodes.drivers import reopening
from tactile_nodes.drivers.camera import reader
from tactile_nodes.drivers.camera.contract import CameraSettings
from tactile_nodes.drivers.camera.reader import LiveCamera, NewestFrame
from tactile_nodes.drivers.health import Level
from tactile_nodes.errors import DeviceLostError, DeviceNotFoundError, DeviceTimeoutError, ImageError

IMAGE = np.zeros((2, 2), np.uint8)
STALL_S = 60.0


class Bench:
    """A camera on a cable that the test can pull."""

    def __init__(self) -> None:
        self.plugged = True
        self.silent = False
        self.hanging = threading.Event()
        self.hangs = threading.Event()
        self.fetched: Callable[[], None] = lambda: None
        self.refusal: Exception = DeviceNotFoundError('there is no camera X')
        self.opened = self.closed = 0

    def connect(self) -> BenchConnection:
        if not self.plugged:
            raise self.refusal
        self.opened += 1
        return BenchConnection(self)


class BenchConnection:
    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._stamp_ns = 0
        self.complaints: list[str] = []

    @property
    def description(self) -> Mapping[str, str]:
        return {'source': 'X'}

    def fetch(self, slot: NewestFrame) -> None:
        threading.Event().wait(0.01)
        while self._bench.hanging.is_set():
            self._bench.hangs.set()
            threading.Event().wait(0.01)
        if not self._bench.plugged:
            raise DeviceLostError('X was unplugged')
        if not self._bench.silent:
            self._stamp_ns += 1
            slot.put(IMAGE, self._stamp_ns)
            self._bench.fetched()

    def interrupt(self) -> None:
        self._bench.hanging.clear()

    def close(self) -> None:
        self._bench.closed += 1


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setattr(reopening, 'FIRST_DELAY_S', 0.02)
    monkeypatch.setattr(reopening, 'LONGEST_DELAY_S', 0.05)
    return Bench()


@pytest.fixture
def camera(bench: Bench, ahead: AheadClock) -> Iterator[LiveCamera]:
    live = LiveCamera('X', bench.connect, ahead, CameraSettings('X', stall_s=STALL_S))
    live.open()
    yield live
    live.close()
    deadline_s = monotonic_s() + 30.0
    while bench.opened != bench.closed:
        assert monotonic_s() < deadline_s
        threading.Event().wait(0.01)


def miss(camera: LiveCamera) -> None:
    """Read until there is nothing."""
    with pytest.raises(DeviceTimeoutError):
        while True:
            camera.read(0.1)


def lose(camera: LiveCamera) -> None:
    """Read until it is lost and none of its frames is left."""
    while camera.health.level == Level.OK:
        miss(camera)
    miss(camera)


def test_a_camera_that_sends_nothing_is_not_opened(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, 'FIRST_FRAME_S', 0.5)
    monkeypatch.setattr(reader, 'JOIN_S', 30.0)
    bench.silent = True
    with pytest.raises(DeviceTimeoutError, match=r'sent no complete picture within 0\.5 s|no complete picture for'):
        LiveCamera('X', bench.connect, SystemClock(), CameraSettings('X')).open()
    assert bench.closed == 1


def test_an_unplugged_camera_is_found_again_and_numbers_go_on(bench: Bench, camera: LiveCamera) -> None:
    before = camera.read(20.0)
    bench.plugged = False
    lose(camera)
    bench.plugged = True
    after = camera.read(20.0)
    assert after.sequence > before.sequence
    assert after.sequence - before.sequence - 1 == after.dropped - before.dropped
    assert camera.health.level == Level.OK
    assert camera.health.message.endswith('; reconnected so far: 1')


def test_the_health_says_how_long_it_has_been_away_and_why(bench: Bench, camera: LiveCamera, ahead: AheadClock) -> None:
    bench.refusal = DeviceNotFoundError('X was unplugged')
    bench.plugged = False
    lose(camera)
    ahead.advance(7200.0)
    health = camera.health
    assert health.level == Level.ERROR
    assert re.fullmatch(r'lost for 72\d\d\.\d s, reconnecting: X was unplugged', health.message)
    assert camera.description == {'source': 'X', 'times lost': '1'}


def test_a_silence_shorter_than_the_stall_time_is_only_a_timeout(
    bench: Bench, camera: LiveCamera, ahead: AheadClock
) -> None:
    bench.silent = True
    miss(camera)
    ahead.advance(0.5 * STALL_S)
    miss(camera)
    assert camera.health.level == Level.OK
    assert bench.opened == 1


def test_a_silence_longer_than_the_stall_time_opens_the_camera_again(
    bench: Bench, camera: LiveCamera, ahead: AheadClock
) -> None:
    """It stays in error, as long as it gives no frame."""
    bench.silent = True
    while bench.opened < 3:
        ahead.advance(1.1 * STALL_S)
        miss(camera)
    assert camera.health.level == Level.ERROR
    assert camera.description['times lost'] == '1'


def test_a_pause_of_this_computer_right_after_a_picture_is_no_silence(
    bench: Bench, camera: LiveCamera, ahead: AheadClock
) -> None:
    bench.fetched = lambda: ahead.advance(1.1 * STALL_S)
    for _ in range(3):
        camera.read(20.0)
    bench.fetched = lambda: None
    camera.read(20.0)
    assert camera.description['times lost'] == '0'


def test_a_camera_that_hangs_is_in_error_and_a_read_does_not_wait_for_it(
    bench: Bench, camera: LiveCamera, ahead: AheadClock
) -> None:
    bench.hanging.set()
    assert bench.hangs.wait(30)
    ahead.advance(1.1 * STALL_S)
    miss(camera)
    assert bench.hanging.is_set()
    assert camera.health.level == Level.ERROR
    assert 'X has sent no complete picture for' in camera.health.message


def test_another_camera_of_the_wrong_size_is_not_taken_instead(bench: Bench, camera: LiveCamera) -> None:
    bench.refusal = ImageError('X gives pictures of 1x1')
    bench.plugged = False
    with pytest.raises(ImageError):
        while True:
            with contextlib.suppress(DeviceTimeoutError):
                camera.read(20.0)
