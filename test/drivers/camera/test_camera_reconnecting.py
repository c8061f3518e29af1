"""Losing a camera and finding it again, on a clock that only the tests move."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping

import numpy as np
import pytest

from tactile_nodes.clock import SteppedClock
from tactile_nodes.drivers.camera.contract import CameraSettings, Frame
from tactile_nodes.drivers.camera.reconnecting import Reconnecting
from tactile_nodes.drivers.health import Health, Level
from tactile_nodes.errors import DeviceLostError, DeviceNotFoundError, DeviceTimeoutError, ImageError

IMAGE = np.zeros((2, 2), np.uint8)


class Bench:
    """A camera on a cable that the test can pull, which notes when it was opened."""

    def __init__(self, clock: SteppedClock) -> None:
        self.clock = clock
        self.plugged = True
        self.silent = False
        self.opened_ns: list[int] = []
        self.closed = 0
        self.refusal: Exception = DeviceNotFoundError('there is no camera X')

    def camera(self) -> BenchCamera:
        return BenchCamera(self)


class BenchCamera:
    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._sequence = -1

    @property
    def description(self) -> Mapping[str, str]:
        return {'source': 'X'}

    @property
    def health(self) -> Health:
        return Health(Level.OK, 'receiving X')

    def open(self) -> None:
        self._bench.opened_ns.append(self._bench.clock.now_ns())
        if not self._bench.plugged:
            raise self._bench.refusal

    def read(self, timeout_s: float) -> Frame:
        if not self._bench.plugged:
            raise DeviceLostError('X was unplugged')
        if self._bench.silent:
            self._bench.clock.advance(timeout_s)
            raise DeviceTimeoutError('X is silent')
        self._bench.clock.advance(0.01)
        self._sequence += 1
        return Frame(IMAGE, self._bench.clock.now_ns(), self._sequence, 0)

    def close(self) -> None:
        self._bench.closed += 1


@pytest.fixture
def bench(jumping: SteppedClock) -> Bench:
    return Bench(jumping)


@pytest.fixture
def camera(bench: Bench, jumping: SteppedClock) -> Reconnecting:
    wrapped = Reconnecting(bench.camera, jumping, CameraSettings('X', stall_s=1.5), lambda job: job())
    wrapped.open()
    return wrapped


def read_or_none(camera: Reconnecting, timeout_s: float) -> Frame | None:
    with contextlib.suppress(DeviceTimeoutError):
        return camera.read(timeout_s)
    return None


def miss(camera: Reconnecting, times: int, timeout_s: float = 0.5) -> None:
    for _ in range(times):
        with pytest.raises(DeviceTimeoutError):
            camera.read(timeout_s)


def test_a_camera_that_was_never_there_is_an_error_at_once(bench: Bench, jumping: SteppedClock) -> None:
    bench.plugged = False
    with pytest.raises(DeviceNotFoundError, match='there is no camera X'):
        Reconnecting(bench.camera, jumping, CameraSettings('X')).open()
    assert bench.closed == 1


def test_an_unplugged_camera_is_found_again_after_it_is_plugged_in(bench: Bench, camera: Reconnecting) -> None:
    camera.read(0.5)
    bench.plugged = False
    miss(camera, 3)
    bench.plugged = True
    while (frame := read_or_none(camera, 0.5)) is None:
        pass
    assert frame.sequence == 1
    assert camera.health == Health(Level.OK, 'receiving X; reconnected so far: 1')


def test_attempts_wait_twice_as_long_each_time_up_to_five_seconds(
    bench: Bench, camera: Reconnecting, jumping: SteppedClock
) -> None:
    bench.plugged = False
    lost_ns = jumping.now_ns()
    miss(camera, 60)
    waits = np.diff([lost_ns, *bench.opened_ns[1:]]) / 1e9
    assert waits[:8].tolist() == [0.25, 0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 5.0]


def test_the_delays_start_over_after_a_good_frame(bench: Bench, camera: Reconnecting) -> None:
    for _ in range(2):
        bench.plugged = False
        lost_ns = bench.clock.now_ns()
        opened = len(bench.opened_ns)
        miss(camera, 6)
        assert bench.opened_ns[opened] - lost_ns == 250_000_000
        bench.plugged = True
        while camera.health.level == Level.ERROR:
            read_or_none(camera, 0.5)


def test_the_health_says_how_long_it_has_been_away_and_why(bench: Bench, camera: Reconnecting) -> None:
    camera.read(0.5)
    bench.plugged = False
    miss(camera, 1)
    bench.clock.advance(2.0)
    assert camera.health == Health(Level.ERROR, 'lost for 2.0 s, reconnecting: X was unplugged')


def test_a_silence_shorter_than_the_stall_time_is_only_a_timeout(bench: Bench, camera: Reconnecting) -> None:
    bench.silent = True
    miss(camera, 2, 0.5)
    assert camera.health.level == Level.OK
    assert len(bench.opened_ns) == 1


def test_a_silence_longer_than_the_stall_time_opens_the_camera_again(bench: Bench, camera: Reconnecting) -> None:
    bench.silent = True
    miss(camera, 4, 0.5)
    assert camera.health.level == Level.ERROR
    assert len(bench.opened_ns) == 2


def test_a_camera_that_opens_and_gives_no_frame_stays_in_error(bench: Bench, camera: Reconnecting) -> None:
    bench.silent = True
    miss(camera, 20, 0.5)
    assert camera.health.level == Level.ERROR
    assert camera.description['times lost'] == '1'


def test_numbers_go_on_across_connections(bench: Bench, camera: Reconnecting) -> None:
    numbers = [camera.read(0.5).sequence for _ in range(3)]
    bench.plugged = False
    miss(camera, 1)
    bench.plugged = True
    numbers += [camera.read(0.5).sequence for _ in range(3)]
    assert numbers == [0, 1, 2, 3, 4, 5]


def test_a_read_while_the_camera_is_away_takes_no_longer_than_its_timeout(bench: Bench, camera: Reconnecting) -> None:
    bench.plugged = False
    miss(camera, 8)
    before_ns = bench.clock.now_ns()
    miss(camera, 1, 0.1)
    assert bench.clock.now_ns() - before_ns <= 100_000_000


def test_another_camera_of_the_wrong_size_is_not_taken_instead(bench: Bench, camera: Reconnecting) -> None:
    bench.plugged = False
    miss(camera, 1)
    bench.refusal = ImageError('X gives pictures of 1x1')
    with pytest.raises(ImageError):
        camera.read(0.5)


def test_a_read_does_not_wait_for_a_device_that_hangs_while_it_is_opened(bench: Bench, jumping: SteppedClock) -> None:
    """The job that opens it again is left lying; a closed camera closes what comes of it later."""
    jobs = []
    camera = Reconnecting(bench.camera, jumping, CameraSettings('X'), jobs.append)
    camera.open()
    bench.plugged = False
    miss(camera, 5, 0.1)
    assert len(jobs) == 1
    bench.plugged = True
    camera.close()
    closed = bench.closed
    jobs[0]()
    assert bench.closed == closed + 1
