"""When everything must stop."""

from __future__ import annotations

import math
import threading
from math import ceil

import pytest

from tactile_nodes.collection.safety import CAMERA, FORCE, MACHINE, OVERLOAD, SENSOR, SILENT_MACHINE, Safety, Trip
from tactile_nodes.collection.settings import LimitSettings
from tactile_nodes.drivers.force_torque.contract import Flag, Sample
from tactile_nodes.drivers.health import Health, Level

MS = 1_000_000
WELL = Health(Level.OK, 'idle')


def sample(at_ms: float, fz: float = 0.0, flags: int = 0, fx: float = 0.0) -> Sample:
    at_ns = round(at_ms * MS)
    return Sample((fx, 0.0, fz, 0.0, 0.0, 0.0), at_ns, at_ns, 0, int(at_ms), 0, flags, 0, ())


def watching(**limits: float) -> tuple[Safety, list[Trip]]:
    trips: list[Trip] = []
    safety = Safety(LimitSettings(**limits), trips.append)
    safety.watch(0, camera=True)
    return safety, trips


def test_the_very_sample_above_the_limit_trips() -> None:
    safety, trips = watching(force_n=1.0)
    safety.tare((0.0, 0.0, 5.0, 0.0, 0.0, 0.0))
    safety.sample(sample(1, fz=5.9))
    assert not trips
    safety.sample(sample(2, fz=6.1))
    assert [trip.kind for trip in trips] == [FORCE]
    assert trips[0].stamp_ns == 2 * MS


def test_force_counts_in_every_direction() -> None:
    safety, trips = watching(force_n=1.0)
    safety.tare((0.0,) * 6)
    safety.sample(sample(1, fx=0.8, fz=-0.8))  # 1.13 N
    assert trips


def test_before_the_first_tare_the_first_sample_is_the_zero() -> None:
    safety, trips = watching(force_n=1.0)
    safety.sample(sample(1, fz=50.0))
    assert not trips
    safety.sample(sample(2, fz=52.0))
    assert trips


def test_fast_rise_trips_long_before_the_limit() -> None:
    safety, trips = watching(force_n=100.0, force_rate_n_s=10.0, rate_ms=40.0)
    safety.tare((0.0,) * 6)
    for ms in range(200):
        safety.sample(sample(ms, fz=max(0.0, (ms - 100) * 0.011)))  # 11 N/s from 100 ms on
    assert trips and 'rises' in trips[0].reason
    assert trips[0].stamp_ns <= 145 * MS


def test_slow_rise_does_not_trip() -> None:
    safety, trips = watching(force_n=100.0, bearable_n=200.0, force_rate_n_s=10.0)
    for ms in range(1000):
        safety.sample(sample(ms, fz=ms * 0.009))
    assert not trips


@pytest.mark.parametrize(
    ('told', 'kind'),
    [
        *((sample(1, flags=flag), SENSOR) for flag in (Flag.FAULT, Flag.STALLED, Flag.NOT_A_NUMBER, Flag.UNTIMED)),
        (sample(1)._replace(wrench=(math.nan,) * 6), SENSOR),
        *((sample(1, flags=flag), OVERLOAD) for flag in (Flag.SATURATED, Flag.THRESHOLD)),
    ],
)
def test_sample_that_says_nothing_of_now_or_of_a_load_beyond_what_is_allowed_trips(told: Sample, kind: str) -> None:
    safety, trips = watching()
    safety.sample(told)
    assert [trip.kind for trip in trips] == [kind]


def test_threshold_that_the_box_has_latched_is_named_with_what_ends_it() -> None:
    """Until then each sample has the flag, so that each answer is followed by the same question."""
    safety, trips = watching()
    safety.sample(sample(1, flags=Flag.THRESHOLD))
    assert 'until somebody resets its threshold latch' in trips[0].reason


def test_force_that_goes_on_to_what_is_not_bearable_stops_once_more() -> None:
    safety, trips = watching(force_n=3.0, bearable_n=5.0)
    safety.tare((0.0,) * 6)
    for ms, force in enumerate((3.5, 4.9, 5.1, 6.0), start=1):
        safety.sample(sample(ms, fz=force))
    assert [(trip.kind, trip.stamp_ns) for trip in trips] == [(FORCE, 1 * MS), (OVERLOAD, 3 * MS)]
    assert safety.trip is trips[-1]


def test_silence_of_the_sensor_trips_after_50_ms() -> None:
    safety, trips = watching()
    for ms in range(100):
        safety.sample(sample(ms))
        safety.frame(ms * MS)
    safety.tick(148 * MS, WELL)
    assert not trips
    safety.tick(150 * MS, WELL)
    assert [trip.kind for trip in trips] == [SENSOR]


def test_slow_sensor_is_given_three_periods() -> None:
    trips: list[Trip] = []
    safety = Safety(LimitSettings(), trips.append, rate_hz=12.5)
    safety.watch(0, camera=False)
    for ms in range(0, 2000, 80):
        safety.sample(sample(ms))
    safety.tick((1920 + 239) * MS, WELL)
    assert not trips
    safety.tick((1920 + 241) * MS, WELL)
    assert [trip.kind for trip in trips] == [SENSOR]


def test_sensor_that_slows_down_step_by_step_earns_no_silence_by_it() -> None:
    """1000 samples a second at first, a tenth more time from each to the next: 50 ms is the 43rd pause."""
    trips: list[Trip] = []
    safety = Safety(LimitSettings(), trips.append, rate_hz=1000.0)
    safety.watch(0, camera=False)
    at_ms, pause_ms = 0.0, 1.0
    while not trips and pause_ms < 500:
        for _ in range(50):
            safety.sample(sample(at_ms))
            for now_ms in (*range(ceil(at_ms), int(at_ms + pause_ms), 10), at_ms + pause_ms):
                safety.tick(round(now_ms * MS), WELL)
            at_ms += pause_ms
        pause_ms *= 1.1
    assert pause_ms < 61
    assert 'silent for 5' in trips[0].reason


def test_samples_that_were_measured_long_ago_do_not_count_by_their_arrival() -> None:
    safety, trips = watching()
    safety.watch(1600 * MS, camera=False)
    for ms in range(1600, 1700, 10):
        safety.sample(sample(ms - 1500)._replace(arrival_ns=ms * MS))
        safety.tick(ms * MS, WELL)
    assert [(trip.kind, trip.stamp_ns) for trip in trips] == [(SENSOR, 1660 * MS)]
    assert 'samples that are 1500 ms old' in trips[0].reason


def test_silence_of_the_camera_trips_after_250_ms() -> None:
    safety, trips = watching()
    safety.frame(0)
    for ms in range(300):
        safety.sample(sample(ms))
        safety.tick(ms * MS, WELL)
    assert [trip.kind for trip in trips] == [CAMERA]
    assert trips[0].stamp_ns == 251 * MS


def test_fault_of_the_machine_trips() -> None:
    safety, trips = watching()
    safety.sample(sample(1))
    safety.tick(2 * MS, Health(Level.ERROR, 'is locked by alarm 1'))
    assert [(trip.kind, trip.reason) for trip in trips] == [(MACHINE, 'is locked by alarm 1')]


def test_first_reason_stands_until_it_is_dealt_with() -> None:
    safety, trips = watching(force_n=1.0)
    safety.tare((0.0,) * 6)
    for ms in (1, 2, 3):
        safety.sample(sample(ms, fz=2.0))
    assert len(trips) == 1
    safety.reset(3 * MS, trips[0])
    safety.sample(sample(4, fz=2.0))
    assert len(trips) == 2


def well_until(safety: Safety, end_ms: int) -> None:
    for ms in range(0, end_ms, 10):
        safety.sample(sample(ms))
        safety.frame(ms * MS)
        safety.tick(ms * MS, WELL)


def test_what_waited_while_this_process_got_no_processor_is_no_silence() -> None:
    safety, trips = watching()
    well_until(safety, 110)
    safety.tick(400 * MS, WELL)  # 300 ms later: the guard ran before the thread that reads
    for ms in range(101, 400):
        safety.sample(sample(ms)._replace(arrival_ns=402 * MS))
    safety.frame(405 * MS)
    safety.tick(410 * MS, WELL)
    assert not trips


def test_silence_after_a_pause_of_this_process_trips_when_the_limit_has_passed_again() -> None:
    safety, trips = watching()
    well_until(safety, 110)
    for ms in range(400, 500, 10):
        safety.tick(ms * MS, WELL)
    # 300 ms without the processor, of which a tick may take 30; the newest sample is of 100 ms.
    assert [(trip.kind, trip.stamp_ns) for trip in trips] == [(SENSOR, 430 * MS)]


def test_a_guard_that_always_comes_late_finds_a_silent_sensor_all_the_same() -> None:
    safety, trips = watching()
    well_until(safety, 110)
    for ms in range(160, 400, 60):
        safety.tick(ms * MS, WELL)
    assert [trip.kind for trip in trips] == [SENSOR]


def test_fault_of_the_machine_that_a_pause_of_this_process_made_is_looked_at_twice() -> None:
    safety, trips = watching()
    silent = Health(Level.ERROR, 'is silent', silent=True)
    well_until(safety, 110)
    safety.tick(700 * MS, silent)
    assert not trips
    safety.tick(710 * MS, silent)
    assert [trip.kind for trip in trips] == [SILENT_MACHINE]
    assert safety.machine_tripped  # only a force may say that the tip is up


def test_whoever_sees_a_reason_finds_the_stop_begun() -> None:
    """Else a retract that does not wait for the stop is aborted by it, with the tip in the gel."""
    begun, observed = threading.Event(), list[tuple[bool, bool]]()
    reader = threading.Thread(target=lambda: observed.append((safety.trip is not None, begun.is_set())))

    def stop(_: Trip) -> None:
        reader.start()
        reader.join(0.1)
        begun.set()

    safety = Safety(LimitSettings(), stop)
    safety.fail(MACHINE, 'off its way', 0)
    reader.join()
    assert observed == [(True, True)]


def test_what_came_after_the_reason_that_was_dealt_with_stands() -> None:
    """The force may become unbearable just as a run, whose sensor was silent, goes on."""
    safety, trips = watching(force_n=3.0, bearable_n=5.0)
    safety.tare((0.0,) * 6)
    safety.fail(SENSOR, 'silent', 1 * MS)
    safety.sample(sample(2, fz=6.0))
    safety.reset(3 * MS, trips[0])
    assert safety.trip is trips[1]
    assert trips[1].kind == OVERLOAD
    safety.reset(4 * MS, trips[1])
    assert safety.trip is None
