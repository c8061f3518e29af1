"""When a frame was taken, from the kernel's stamp and the time of arrival."""

from __future__ import annotations

import re

import pytest

from tactile_nodes import clock
from tactile_nodes.drivers.camera.stamps import Cadence, KernelStamps

NOW = 5_000_000_000_000  # ns on CLOCK_MONOTONIC


def test_a_kernel_stamp_becomes_a_stamp_on_the_time_base_of_the_host() -> None:
    """4999998.7 ms on CLOCK_MONOTONIC, 1.3 ms ago."""
    assert KernelStamps().stamp(4_999_998.7, NOW) == clock.from_monotonic_ns(4_999_998_700_000)


@pytest.mark.parametrize(
    ('position_ms', 'text'),
    [
        (0.0, 'gives no stamps'),
        (-1.0, 'gives no stamps'),
        (5_000_010.0, r'0\.010 s in the future'),
        (4_900_000.0, r'100\.000 s old'),
        (1_700_000_000_000.0, 'in the future'),  # the wall clock
        (40.0, 'old'),  # the frame's number over a rate, as on a network source
    ],
)
def test_a_stamp_that_cannot_be_gives_way_to_the_time_of_arrival(position_ms: float, text: str) -> None:
    stamps = KernelStamps()
    assert stamps.stamp(position_ms, NOW) == clock.from_monotonic_ns(NOW)
    assert re.search(text, stamps.source)


def test_a_stamp_that_stands_still_gives_way_and_stamps_still_increase() -> None:
    stamps = KernelStamps()
    first = stamps.stamp(4_999_999.0, NOW)
    second = stamps.stamp(4_999_999.0, NOW + 16_000_000)
    assert second - first == 17_000_000
    assert 'do not increase' in stamps.complaint


def test_frames_that_the_driver_held_while_this_computer_paused_are_as_old_as_it_says() -> None:
    """Of 3 s of pause the driver held the first four frames; what comes after them is fresh again."""
    stamps, period_ns = KernelStamps(), 16_000_000
    for number in (1, 2, 3, 4, 5, 190):
        taken_ns = NOW + number * period_ns
        handed_ns = max(taken_ns, NOW + period_ns + 3_000_000_000 * (number > 1)) + 1_000_000
        assert stamps.stamp(taken_ns / 1e6, handed_ns) == clock.from_monotonic_ns(taken_ns)
    assert stamps.complaint == ''


def test_stamps_that_stay_old_are_of_another_clock() -> None:
    stamps = KernelStamps()
    for number in range(100):
        taken_ns = NOW + 16_000_000 * number
        stamps.stamp(taken_ns / 1e6, taken_ns + (3_000_000_000 if number else 0))
    assert "the driver's stamps are 3.000 s old" in stamps.source


def test_arrival_times_are_kept_once_they_are_chosen() -> None:
    """Two kinds of stamp in one stream would make the interval between two frames wrong by the camera's delay."""
    stamps = KernelStamps()
    stamps.stamp(0.0, NOW)
    assert stamps.stamp(5_000_015.0, NOW + 16_000_000) == clock.from_monotonic_ns(NOW + 16_000_000)


@pytest.mark.parametrize(('gap_ms', 'missing'), [(16.7, 0), (24.0, 0), (33.3, 1), (50.0, 2), (1000.0, 59), (1.0, 0)])
def test_missing_frames_are_read_off_the_gap_between_stamps(gap_ms: float, missing: int) -> None:
    cadence = Cadence(60.0)
    cadence.missing(NOW)
    assert cadence.missing(NOW + round(gap_ms * 1e6)) == missing


def test_nothing_is_missing_before_the_first_frame_or_without_a_rate() -> None:
    assert Cadence(60.0).missing(NOW) == 0
    cadence = Cadence(0.0)
    assert [cadence.missing(NOW), cadence.missing(2 * NOW)] == [0, 0]


def test_the_frames_of_a_camera_that_is_slower_than_it_says_are_not_lost() -> None:
    """A frame every 50 ms, announced 60 a second: once that is clear, only a gap of two periods tells of a loss."""
    cadence = Cadence(60.0)
    for number in range(40):
        cadence.missing(1 + 50_000_000 * number)
    assert cadence.missing(1 + 50_000_000 * 40) == 0
    assert cadence.missing(1 + 50_000_000 * 42) == 1
    assert cadence.complaint == 'it sends 20.0 frames/s, but announces 60'


def test_a_camera_that_keeps_its_rate_is_no_complaint_however_many_frames_are_lost_now_and_then() -> None:
    cadence = Cadence(50.0)
    lost = sum(cadence.missing(1 + 20_000_000 * number) for number in range(200) if number % 4)
    assert lost == 49  # every fourth; the first of all is not known to be missing
    assert cadence.complaint == ''
