"""What every sample must be: numbers, never the same ones for long, and not old."""

from __future__ import annotations

import math
import random

import pytest

from tactile_nodes.drivers.force_torque.check import SampleCheck, permitted_ms, too_old
from tactile_nodes.drivers.force_torque.contract import AXES, Flag, Sample
from tactile_nodes.drivers.force_torque.queue import SampleQueue

MS = 1_000_000
WRENCH = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
ONLY_Z = (math.nan, math.nan, 3.0, math.nan, math.nan, math.nan)


def sample(stamp_ms: float, arrival_ms: float | None = None) -> Sample:
    arrived = stamp_ms if arrival_ms is None else arrival_ms
    return Sample(WRENCH, round(stamp_ms * MS), round(arrived * MS), 0, 0, 0, 0, 0, ())


def first_stalled(check: SampleCheck, wrenches: list[tuple[float, ...]]) -> int | None:
    return next((at for at, wrench in enumerate(wrenches) if check.flags(wrench) & Flag.STALLED), None)


NOISY_BUT_Z = [(float(at), at * 0.1, 3.0, at * 1e-3, at * 1e-4, at * 1e-5) for at in range(200)]


@pytest.mark.parametrize(
    ('axes', 'same_values', 'wrenches', 'stalled'),
    [
        pytest.param(AXES, 20, [WRENCH] * 40, 20, id='all axes'),
        pytest.param(AXES, 20, [(0.0,) * 6] * 40, 20, id='all axes at zero'),
        pytest.param(AXES, 20, NOISY_BUT_Z, 120, id='one axis of six, after six times as many'),
        pytest.param(('fz',), 20, [ONLY_Z] * 40, 20, id='a sensor of one axis'),
        pytest.param(AXES, 0, [WRENCH] * 1000, None, id='nobody asks'),
    ],
)
def test_so_many_repetitions_are_a_sensor_that_stands_still(
    axes: tuple, same_values: int, wrenches: list, stalled: int | None
) -> None:
    assert first_stalled(SampleCheck(axes, same_values), wrenches) == stalled


def test_a_sensor_that_moves_again_is_well_again() -> None:
    check = SampleCheck(AXES, 5)
    assert first_stalled(check, [WRENCH] * 6) == 5
    assert not check.flags(tuple(value + 1 for value in WRENCH))


@pytest.mark.parametrize(('axes', 'share'), [(AXES, 0.5), (('fz',), 1.5)])
def test_a_quiet_sensor_of_coarse_steps_is_not_taken_for_one_that_stands_still(axes: tuple, share: float) -> None:
    """Noise of half a step on six axes, or of one and a half on one: within the bound of the docstring, for 20 000."""
    chance, check = random.Random(1), SampleCheck(axes, 20)
    quiet = [tuple(float(round(chance.gauss(0, share))) for _ in AXES) for _ in range(20_000)]
    assert first_stalled(check, quiet) is None


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('axis', range(6))
def test_an_axis_that_is_no_number_is_reported(axis: int, value: float) -> None:
    wrench = tuple(value if at == axis else number for at, number in enumerate(WRENCH))
    assert SampleCheck(AXES, 20).flags(wrench) == Flag.NOT_A_NUMBER


def test_an_axis_that_is_not_measured_need_not_be_a_number() -> None:
    assert SampleCheck(('fz',), 20).flags(ONLY_Z) == 0


def test_every_sample_of_every_driver_goes_through_the_check() -> None:
    queue, passed = SampleQueue('a sensor', 100, SampleCheck(AXES, 3)), []
    queue.listen(passed.append)
    for at in range(4):
        queue.put(WRENCH, (), at, at, at)
    queue.put((math.nan, *WRENCH[1:]), (), 5, 5, 5)
    assert [Flag(each.flags) for each in passed] == [0, 0, 0, Flag.STALLED, Flag.STALLED | Flag.NOT_A_NUMBER]
    assert not passed[-1].usable


@pytest.mark.parametrize(('expected_hz', 'limit_ms'), [(1000.0, 50.0), (60.0, 50.0), (10.0, 300.0), (0.0, 50.0)])
def test_fifty_milliseconds_or_three_periods_are_granted(expected_hz: float, limit_ms: float) -> None:
    assert permitted_ms(50.0, expected_hz) == limit_ms


def test_silence_is_too_old_after_the_limit_and_not_before() -> None:
    assert too_old(sample(100), 0, 150 * MS, 50.0) == ''
    assert too_old(sample(100), 0, 151 * MS, 50.0) == 'has been silent for 51 ms; check its power and its cable'


def test_what_was_measured_long_ago_and_comes_now_is_too_old() -> None:
    assert 'delivers samples that are 1500 ms old' in too_old(sample(500, 2000), 0, 2000 * MS, 50.0)


def test_a_sensor_has_its_full_time_from_the_beginning() -> None:
    assert too_old(None, 1000 * MS, 1050 * MS, 50.0) == ''
    assert too_old(None, 1000 * MS, 1051 * MS, 50.0)
    assert too_old(sample(100), 1000 * MS, 1050 * MS, 50.0) == ''
