"""Stamps from a sensor's counter: the lower envelope of the arrivals."""

from __future__ import annotations

import math
import random

import pytest

from tactile_nodes.drivers.force_torque.clock import WANDERS, TickClock
from tactile_nodes.drivers.force_torque.contract import Flag

START_NS = 1_795_000_000_000_000_000


def stamps(seconds: float, drift_ppm: float, rate_hz: float = 200.0, seed: int = 1) -> list[tuple[int, int]]:
    """(error, time since start) of each stamp, in ns, for arrivals 0.2 ms late and at times much more.

    Three of four arrivals are delayed by an exponential time of 1 ms; one in fifty by up to 30 ms.
    """
    chance, clock, found = random.Random(seed), TickClock(7000), []
    for number in range(round(seconds * rate_hz)):
        ticks = round(number * 7000 / rate_hz)
        true_ns = START_NS + round(ticks / 7000 * 1e9 / (1 + drift_ppm * 1e-6))
        late_ns = 200_000 + round(chance.expovariate(1000) * 1e9) * (chance.random() < 0.75)
        late_ns += round(chance.uniform(0, 30e6)) * (chance.random() < 0.02)
        found.append((clock.stamp(clock.unwrapped(ticks % 2**32), true_ns + late_ns) - true_ns, true_ns - START_NS))
    return found


@pytest.mark.parametrize('drift_ppm', [-100.0, 0.0, 100.0])
def test_drift_and_delays_leave_less_than_half_a_millisecond(drift_ppm: float) -> None:
    """From 1 s on. Before the drift is known, it adds 100 ppm of 2 s at most: 0.2 ms to the constant 0.2 ms."""
    errors = [error for error, since in stamps(40, drift_ppm) if since > 1e9]
    assert min(errors) > -0.1e6
    assert max(errors) < 0.5e6


@pytest.mark.parametrize('drift_ppm', [-100.0, 100.0])
def test_the_drift_is_found_within_half_a_minute(drift_ppm: float) -> None:
    clock = TickClock(7000)
    for number in range(2500):
        ticks = number * 70
        clock.stamp(ticks, START_NS + round(ticks / 7000 * 1e9 / (1 + drift_ppm * 1e-6)))
    assert clock.drift_ppm == pytest.approx(drift_ppm, abs=1)


def test_a_constant_delay_that_is_known_is_taken_off() -> None:
    clock = TickClock(1e6, delay_ns=3_000_000)
    assert clock.stamp(0, START_NS) == START_NS - 3_000_000


def test_stamps_increase_even_when_the_counter_stands_still() -> None:
    clock = TickClock(1e6)
    assert clock.stamp(5, START_NS) < clock.stamp(5, START_NS + 10) < clock.stamp(5, START_NS + 20)


def test_no_stamp_lies_after_the_arrival() -> None:
    clock = TickClock(1000)
    clock.stamp(0, START_NS + 9_000_000)  # 9 ms late
    assert clock.stamp(10, START_NS + 10_000_000) == START_NS + 10_000_000


def test_a_counter_that_wraps_goes_on() -> None:
    clock = TickClock(1e6)
    assert [clock.unwrapped(reading) for reading in (2**32 - 2, 1, 7)] == [2**32 - 2, 2**32 + 1, 2**32 + 7]


def test_a_reading_from_before_the_last_one_is_a_smaller_number() -> None:
    clock = TickClock(1e6)
    clock.unwrapped(5)
    assert clock.unwrapped(2**32 - 1) == -1


def test_it_settles_after_eight_samples_and_a_tenth_of_a_second() -> None:
    clock = TickClock(1e6)
    settled = []
    for number in range(12):
        clock.stamp(clock.unwrapped(number * 12_500), START_NS + number * 12_500_000)
        settled.append(clock.settled)
    assert settled == [False] * 8 + [True] * 4


@pytest.mark.parametrize('factor', [0.1, 0.9, 0.99, 1.01, 1.1, 3.0])
def test_a_counter_that_runs_at_another_rate_is_found_out_and_not_believed(factor: float) -> None:
    """A second and a half later, or ten where it is off by a hundredth, stamps are those of arrival."""
    clock, ages = TickClock(1000), []
    for number in range(6000):
        arrival_ns = START_NS + number * 5_000_000
        stamp_ns = clock.stamp(clock.unwrapped(round(5 * number * factor)), arrival_ns)
        ages.append((arrival_ns - stamp_ns) / 1e9)
    assert max(ages) < 0.25
    assert max(ages[2400:]) < 0.001
    assert 'does not keep the announced rate' in clock.complaint
    assert clock.drift_text == 'unknown: stamped on arrival'
    assert clock.flags == Flag.UNTIMED  # its stamps are no measure of age


def test_a_ceramic_resonator_is_a_clock_for_whom_allows_it() -> None:
    """4000 ppm are within what an Arduino Uno may do; its stamps stay within a few milliseconds."""
    clock, errors = TickClock(1e6, most_drift=0.01), []
    for number in range(80 * 60):
        true_ns = START_NS + number * 12_500_000
        late_ns = 300_000 + 5_000_000 * (number % 3 == 0)
        errors.append(clock.stamp(clock.unwrapped(round(number * 12_500 * 1.004)), true_ns + late_ns) - true_ns)
    assert clock.complaint == ''
    assert clock.drift_ppm == pytest.approx(3984, abs=2)  # 4000 too fast against the host's, as a share of its own
    assert max(map(abs, errors[-2000:])) < 1e6


def test_a_host_that_stands_still_for_seconds_does_not_spoil_the_clock() -> None:
    """Everything of three seconds arrives at their end; afterwards the stamps are again those of the sensor's clock."""
    clock, errors = TickClock(1000), []
    for number in range(30_000):
        true_ns = START_NS + number * 1_000_000
        arrival_ns = max(true_ns + 200_000, START_NS + 8_000_000_000 if 5000 <= number < 8000 else 0)
        arrival_ns += 3_000_000 * (number % 5 != 0)
        errors.append(clock.stamp(clock.unwrapped(number), arrival_ns) - true_ns)
    assert clock.complaint == ''
    assert max(map(abs, errors[12_000:])) < 0.5e6


LATE_NS = 1_500_000_000


def ages(late_from_s: float, until_s: float, grows_s: float = 0.0, drift_ppm: float = 80.0) -> list[float]:
    """How old each sample is, in s, of 200 a second that from some time on arrive 1.5 s late, at once or by and by.

    Infinite where nobody knows it, which is flagged.
    """
    clock, found = TickClock(7000), []
    for number in range(round(until_s * 200)):
        passed_s = number / 200
        share = min(1.0, max(0.0, passed_s - late_from_s) / grows_s) if grows_s else float(passed_s >= late_from_s)
        arrival_ns = START_NS + round(passed_s * 1e9) + round(share * LATE_NS) + 200_000 + 3_000_000 * (number % 3 == 0)
        ticks = round(number * 35 * (1 + drift_ppm * 1e-6))
        age_s = (arrival_ns - clock.stamp(ticks, arrival_ns)) / 1e9
        found.append(math.inf if clock.flags & Flag.UNTIMED else age_s)
    return found


@pytest.mark.parametrize('late_from_s', [1.0, 3.0, 8.0, 30.0])
def test_samples_that_arrive_late_from_some_time_on_stay_old(late_from_s: float) -> None:
    """For as long as anybody waits for the sensor to become well: their delay is no drift of the clock."""
    found = ages(late_from_s, late_from_s + 40.0)
    late = found[round(late_from_s * 200) + 1 :]
    assert max(found[: round(late_from_s * 200)]) < 0.01
    assert min(late) > 1.4


@pytest.mark.parametrize('late_from_s', [5.0, 30.0])
def test_a_delay_that_grows_by_and_by_shows_as_age(late_from_s: float) -> None:
    """50 ms more each second, for half a minute; a clock off by 500 ppm would be 15 ms."""
    found = ages(late_from_s, late_from_s + 30.0, grows_s=30.0)
    assert found[-1] > 1.4
    assert found[round((late_from_s + 5) * 200)] > 0.2


@pytest.mark.parametrize(('most_drift', 'grows'), [(500e-6, 450e-6), (0.01, 0.009)], ids=['crystal', 'resonator'])
def test_a_delay_that_grows_as_slowly_as_a_clock_may_drift_shows_as_age_once_the_clock_is_known(
    most_drift: float, grows: float
) -> None:
    """Known after half a minute, it wanders by a tenth of the most drift; the rest of what is added is age."""
    clock, ages = TickClock(1e6, most_drift=most_drift), {}
    for number in range(50 * 120):
        since_s = number / 50
        delay_s = 0.001 + 0.001 * (number % 3) + max(0.0, since_s - 60.0) * grows
        arrival_ns = START_NS + round((since_s + delay_s) * 1e9)
        stamp_ns = clock.stamp(clock.unwrapped(number * 20_000), arrival_ns)
        ages[number] = ((arrival_ns - stamp_ns) / 1e9, delay_s)
    assert clock.flags == 0
    assert max(age_s for number, (age_s, _) in ages.items() if number < 60 * 50) < 0.0035
    age_s, delay_s = ages[50 * 120 - 1]
    assert delay_s - 60.0 * WANDERS * most_drift - 0.002 < age_s < delay_s  # the least delay, 1 ms, is not seen


def test_a_crystal_that_warms_up_is_followed() -> None:
    """By 100 ppm after two minutes, twice of what is followed at once: 50 ppm of a window of two minutes are 6 ms."""
    clock, errors = TickClock(1e6), []
    for number in range(20 * 300):
        since_s = number / 20
        ticks = round((since_s + max(0.0, since_s - 120.0) * 100e-6) * 1e6)
        late_s = 0.0002 + 0.003 * (number % 3 == 0)
        true_ns = START_NS + round(since_s * 1e9)
        errors.append(clock.stamp(ticks, true_ns + round(late_s * 1e9)) - true_ns)
    assert max(map(abs, errors)) < 7e6
    assert clock.flags == 0


def test_a_counter_that_jumps_ahead_is_followed_at_once() -> None:
    clock, errors = TickClock(7000), []
    for number in range(200 * 60):
        true_ns = START_NS + number * 5_000_000
        ticks = number * 35 + (2100 if number >= 4000 else 0)  # 0.3 s after 20 s
        errors.append(clock.stamp(ticks, true_ns + 200_000 + 3_000_000 * (number % 3 == 0)) - true_ns)
    assert max(map(abs, errors)) < 5e6
    assert not clock.flags


def test_old_samples_that_come_at_once_at_the_beginning_do_not_count() -> None:
    """Half a second of them waited somewhere: they are not old because of the counter, and it keeps time afterwards."""
    clock, errors = TickClock(7000), []
    for number in range(400):
        true_ns = START_NS + number * 5_000_000
        arrival_ns = max(true_ns, START_NS + 500_000_000) + 200_000
        errors.append(clock.stamp(number * 35, arrival_ns) - true_ns)
        assert not clock.flags
    assert max(errors[101:]) < 1e6


@pytest.mark.parametrize('first', [1, 3, 40])
def test_a_host_that_stands_still_right_after_the_first_samples_shows_no_other_rate(first: int) -> None:
    """Half a second of them waits for a processor: all are stamped as they were measured, and none is marked."""
    clock = TickClock(1000)
    for number in range(400):
        true_ns = START_NS + number * 5_000_000
        held_ns = START_NS + first * 5_000_000 + 500_000_000
        arrival_ns = (max(true_ns, held_ns) if number >= first else true_ns) + 200_000
        assert abs(clock.stamp(5 * number, arrival_ns) - true_ns) < 1e6, number
        assert not clock.flags, number


def test_a_host_that_stands_still_again_and_again_before_it_has_caught_up_shows_no_other_rate() -> None:
    """Three times 0.4 s, each after two more samples of what waits: 1.2 s behind, it catches up."""
    clock, now_ns = TickClock(1000), START_NS
    for number in range(400):
        true_ns = START_NS + number * 5_000_000
        now_ns = max(now_ns, true_ns + 200_000) + 400_000_000 * (number in {1, 3, 5})
        assert abs(clock.stamp(5 * number, now_ns) - true_ns) < 1e6, number
        assert not clock.flags, number
