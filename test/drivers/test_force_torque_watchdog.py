"""The watchdog: silence, lateness, repetition and faults, within the time that is granted."""

from __future__ import annotations

import pytest

from tactile_nodes.clock import SteppedClock
from tactile_nodes.drivers.force_torque import Flag, Sample
from tactile_nodes.drivers.force_torque_watchdog import Watchdog
from tactile_nodes.errors import DeviceError, DeviceTimeoutError


@pytest.fixture
def clock() -> SteppedClock:
    return SteppedClock(1_000_000_000)


def sample(stamp_ns: int, flags: int = 0, arrival_ns: int | None = None, status: int = 0) -> Sample:
    return Sample((0.0,) * 6, stamp_ns, arrival_ns or stamp_ns, 0, 0, 0, flags, status, ())


def test_all_is_well_while_samples_come(clock: SteppedClock) -> None:
    watchdog = Watchdog('the sensor', clock)
    for _ in range(100):
        clock.advance(0.049)
        watchdog.feed(sample(clock.now_ns()))
        watchdog.check()


def test_fifty_milliseconds_of_silence_are_granted_and_not_more(clock: SteppedClock) -> None:
    watchdog = Watchdog('the sensor', clock)
    watchdog.feed(sample(clock.now_ns()))
    clock.advance(0.050)
    watchdog.check()
    clock.advance(0.001)
    with pytest.raises(DeviceTimeoutError, match='the sensor has been silent for 51 ms'):
        watchdog.check()


def test_a_slow_sensor_is_granted_three_periods(clock: SteppedClock) -> None:
    watchdog = Watchdog('the sensor', clock, silence_ms=50, rate_hz=10)
    assert watchdog.limit_ms == 300
    clock.advance(0.299)
    watchdog.check()


def test_a_sensor_that_never_spoke_is_silent(clock: SteppedClock) -> None:
    watchdog = Watchdog('the sensor', clock)
    clock.advance(0.1)
    with pytest.raises(DeviceTimeoutError, match='has not measured anything'):
        watchdog.check()


def test_old_samples_that_arrive_late_do_not_count_as_new(clock: SteppedClock) -> None:
    watchdog = Watchdog('the sensor', clock)
    measured_ns = clock.now_ns()
    clock.advance(0.06)
    watchdog.feed(sample(measured_ns, arrival_ns=clock.now_ns()))
    with pytest.raises(DeviceTimeoutError, match='arrive 60 ms late'):
        watchdog.check()


def test_a_front_end_that_stands_still_is_silent(clock: SteppedClock) -> None:
    watchdog = Watchdog('the sensor', clock)
    for _ in range(6):
        clock.advance(0.01)
        watchdog.feed(sample(clock.now_ns(), Flag.STALLED))
    with pytest.raises(DeviceTimeoutError, match='repeated one measurement'):
        watchdog.check()


@pytest.mark.parametrize(
    ('flags', 'words'), [(Flag.FAULT, 'reports a fault'), (Flag.FAULT | Flag.SATURATED, 'is beyond its range')]
)
def test_a_fault_is_an_error_at_once(clock: SteppedClock, flags: Flag, words: str) -> None:
    watchdog = Watchdog('the sensor', clock)
    watchdog.feed(sample(clock.now_ns(), flags, status=0x8002_0000))
    with pytest.raises(DeviceError, match=rf'the sensor {words} \(status 0x80020000\)'):
        watchdog.check()


def test_a_threshold_that_was_passed_is_left_to_whoever_set_it(clock: SteppedClock) -> None:
    watchdog = Watchdog('the sensor', clock)
    watchdog.feed(sample(clock.now_ns(), Flag.THRESHOLD))
    watchdog.check()
